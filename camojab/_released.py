"""The released formulation: the authors' program, to the bin.

Its radial frequency max(|rho_x|, |rho_y|) takes one of 257 values, so the energies of a
texture at one mip level and rate pool, without any approximation, into what each ring
lost to shading and what each pair of ring and horizontal frequency kept. Displays and
velocities then cost a hundredth of the spectrum itself.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ._condition import (
    Condition,
    Field,
    log_eye_blur,
    log_sensitivity_of,
    sensitivity_power,
    Terms,
    terms_within,
)
from ._display import Components, Shading
from ._filters import mipmap
from ._math import safe_power
from ._node_pool import NodePool
from ._nodes import Axis
from ._parameters import Parameters
from ._sampling import band, BANDS, HALF, released_replica, shifted
from ._spectrum import SIZE


# No replica that lies farther has a bin in the band. [bins].
FARTHEST = SIZE

# Frequency 0 has no sensitivity and is left by itself.
_AXIS = Axis(1.0, float(HALF))

_K = np.arange(-HALF, HALF)

# Where the horizontal frequency is the larger one and decides the ring.
_BELOW = np.arange(HALF + 1)[:, None] < np.abs(_K)[None, :]
_WIDER = np.abs(_K)[:, None] < np.abs(_K)[None, :]


class ReleasedPool(eqx.Module):
    """Pooled energies of one texture, mip level, rate and exponent. [1].

    - `lost`: per ring, what the reference has more than the shaded spectrum.
    - `kept`: the shaded spectrum's, per ring and horizontal frequency.
    - `bins`: the shaded spectrum's, per vertical frequency, either sign, and signed
      horizontal frequency, for the temporal replica.
    """

    lost: Float[Array, "257"]
    kept: Float[Array, "257 257"]
    bins: Float[Array, "257 512"]


def shade(
    amplitude: Float[Array, "512 512"], s: Shading, c: Components, p: Parameters
) -> Float[Array, "512 512"]:
    """Mipmap, one replica on each axis, Nyquist crop (`b_m rho` is free of ppd)."""
    filtered = mipmap(amplitude, s, p.mipmap_width, c.low_pass)
    across = released_replica(filtered, s.rate_y)
    return jnp.where(c.vrs, released_replica(across.T, s.rate_x).T, amplitude)


def _power_within(
    half: int, spectrum: Float[Array, "512 512"], beta: Float[Array, ""]
) -> Float[Array, "512 512"]:
    """Power of the bins up to `half`; the others hold exact zeros."""
    low, high = HALF - half, min(HALF + half + 1, SIZE)
    power = safe_power(spectrum[low:high, low:high], beta)
    return jnp.pad(power, (low, SIZE - high))


_POWER_WITHIN = [functools.partial(_power_within, half) for half in BANDS]


def _band(s: Shading, c: Components) -> Int[Array, ""]:
    """The crop leaves nothing beyond the coarse Nyquist frequencies."""
    return band(HALF * jnp.where(c.vrs, jnp.maximum(s.rate_x, s.rate_y), 1))


def pool(
    amplitude: Float[Array, "512 512"], s: Shading, c: Components, p: Parameters
) -> ReleasedPool:
    """Pool the energies of a texture at one mip level, rate and exponent."""
    shaded = shade(amplitude, s, c, p)
    power = _once(jax.lax.switch(_band(s, c), _POWER_WITHIN, shaded, p.beta))
    lost = _once(safe_power(amplitude, p.beta) - power)
    bins = _fold(power)
    return ReleasedPool(jnp.sum(_rings(_fold(lost)), axis=1), _rings(bins), bins)


def evaluate(p: ReleasedPool, c: Condition) -> tuple[Array, Array, Terms]:
    """E_s and E_t, means over all bins, and the terms that were evaluated."""
    dtype = p.lost.dtype
    rho = jnp.arange(HALF + 1, dtype=dtype) * (c.display.ppd / SIZE)
    evaluated = terms(c)
    blurred = lambda: p.kept @ -jnp.expm1(c.parameters.beta * log_eye_blur(rho, c))
    taken = jax.lax.cond(evaluated.eye_blur, blurred, lambda: jnp.zeros_like(rho))
    still = sensitivity_power(rho, jnp.zeros((), dtype), 0.0, c)
    spatial = jnp.dot(still, p.lost + taken) / SIZE**2

    def temporal() -> Array:
        flicker = _once(sensitivity_power(rho, c.display.refresh_rate, 1.0, c))
        moved = _by_ring(shifted(p.bins.T, -judder_shift(c)).T)
        return jnp.dot(flicker, moved) / SIZE**2

    nothing = lambda: jnp.zeros((), dtype)
    return spatial, jax.lax.cond(evaluated.judder, temporal, nothing), evaluated


def terms(c: Condition) -> Terms:
    """The terms that matter: the replica counts while a bin of it is in the band."""
    rate = jnp.where(c.components.vrs, c.shading.rate_x, 1)
    within = jnp.asarray(BANDS)[_band(c.shading, c.components)]
    return terms_within(c, HALF - 1 + HALF * rate, replica_place(c), within)


def on_nodes(
    p: ReleasedPool, nodes: int, places: Float[np.ndarray, " places"]
) -> NodePool:
    """The pooled energies carried over to nodes; frequency 0 is left by itself."""
    dtype = p.lost.dtype
    rings = jnp.arange(HALF + 1, dtype=dtype)
    weights = _AXIS.weights(rings, nodes).at[0].set(0)
    by_ring = jax.lax.map(
        lambda s: _by_ring(shifted(p.bins.T, -s).T), jnp.asarray(places, jnp.int32)
    )
    at = jnp.asarray(_AXIS.nodes(nodes), dtype)
    return NodePool(
        lost=p.lost @ weights,
        kept=weights.T @ p.kept @ weights,
        moved=jnp.concatenate([by_ring[:, :1], by_ring @ weights], axis=1),
        radial=at,
        along=at,
        places=jnp.asarray(places, dtype),
    )


def replica_place(c: Condition) -> Float[Array, ""]:
    """Bins between the texture and its temporal replica."""
    return judder_shift(c).astype(c.display.ppd.dtype)


def cell_area(c: Condition) -> Float[Array, ""]:
    """What a bin counts in an energy. [1]."""
    return jnp.full_like(c.display.ppd, 1.0 / SIZE**2)


def fields(
    amplitude: Float[Array, "512 512"], c: Condition
) -> tuple[Field, Field, Field]:
    """Reference, shaded and replica, before the power: what `beta` acts on."""
    dtype = amplitude.dtype
    shaded = shade(amplitude, c.shading, c.components, c.parameters)
    moved = shifted(shaded.T, -judder_shift(c)).T
    rho = jnp.arange(HALF + 1, dtype=dtype) * (c.display.ppd / SIZE)
    still = _log_on_rings(rho, jnp.zeros((), dtype), -jnp.inf, c)
    flicker = _log_on_rings(rho, c.display.refresh_rate, 0.0, c)
    blur = _both_sides(log_eye_blur(rho, c))[None, :]
    weight = jnp.full((SIZE, SIZE), 1.0 / SIZE**2, dtype)
    return (
        Field(jnp.log(amplitude) + still, weight),
        Field(jnp.log(shaded) + blur + still, weight),
        Field(jnp.log(moved) + flicker, jnp.where(c.components.judder, weight, 0)),
    )


def _log_on_rings(
    rho: Float[Array, "257"], f: Float[Array, ""], at_zero: float, c: Condition
) -> Float[Array, "512 512"]:
    """Logarithm of the sensitivity at max(|rho_x|, |rho_y|)."""
    log = jnp.where(rho > 0, log_sensitivity_of(rho, f, c), at_zero)
    columns = jnp.broadcast_to(_both_sides(_once(log)), (SIZE, SIZE))
    return jnp.where(_WIDER, columns, columns.T)


def _both_sides(half: Float[Array, "257"]) -> Float[Array, "512"]:
    """Bins -256..255 of a function of the bins' distance from 0."""
    return jnp.concatenate([half[:0:-1], half[:-1]])


def judder_shift(c: Condition) -> Int[Array, ""]:
    """Bins between the texture and its temporal replica, at most all of them."""
    velocity = jnp.maximum(c.viewing.velocity, 0.1)
    bins = c.display.refresh_rate * SIZE / (2.0 * velocity * c.display.ppd)
    return jnp.floor(jnp.minimum(bins, SIZE)).astype(jnp.int32)


def _once(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """Keep XLA from computing `x` again wherever it is read."""
    return jax.lax.optimization_barrier(x)


def _fold(power: Float[Array, "512 ..."]) -> Float[Array, "257 ..."]:
    """Sum over the sign of the first axis's frequency."""
    negative, positive = power[HALF::-1], power[HALF:].at[0].set(0)
    return negative.at[:-1].add(positive)


def _by_ring(bins: Float[Array, "257 512"]) -> Float[Array, "257"]:
    """Sum over each ring max(|k_x|, |k_y|)."""
    beyond = jnp.sum(jnp.where(_BELOW, bins, 0), axis=0)
    return jnp.sum(jnp.where(_BELOW, 0, bins), axis=1) + _fold(beyond)


def _rings(bins: Float[Array, "257 512"]) -> Float[Array, "257 257"]:
    """Sum over the sign of the horizontal frequency, per ring max(|k_x|, |k_y|)."""
    folded = _once(_fold(bins.T).T)
    within = jnp.diag(jnp.sum(jnp.triu(folded), axis=0))
    return jnp.tril(folded, -1) + within
