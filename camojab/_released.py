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
from ._sampling import band, BANDS, HALF
from ._spectrum import SIZE


# No replica that lies farther has a bin in the band. [bins].
FARTHEST = SIZE

# Frequency 0 has no sensitivity and is left by itself.
_AXIS = Axis(1.0, float(HALF))

_K = np.arange(-HALF, HALF)

# Width of the blocks of a running sum: little work within and few of them.
_BLOCK = 16

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
    return jax.lax.switch(_band(s, c), _SHADE_WITHIN, amplitude, s, c, p)


def _shade_within(
    half: int,
    amplitude: Float[Array, "512 512"],
    s: Shading,
    c: Components,
    p: Parameters,
) -> Float[Array, "512 512"]:
    """Shaded where nothing is left beyond `half`; there are exact zeros."""
    filtered = mipmap(amplitude, s, p.mipmap_width, c.low_pass)
    across = _replica(filtered, s.rate_y, half, axis=0)
    shaded = _replica(across, s.rate_x, half, axis=1)
    inside = _within(half)
    both = jnp.where(c.vrs, shaded, amplitude[inside, inside])
    return jnp.pad(both, (inside.start, SIZE - inside.stop))


_SHADE_WITHIN = [functools.partial(_shade_within, half) for half in BANDS]


def _within(half: int) -> slice:
    """Bins -`half` to `half`, of those there are."""
    return slice(HALF - half, min(HALF + half + 1, SIZE))


def _replica(
    spectrum: Float[Array, "n m"], rate: Float[Array, ""], half: int, *, axis: int
) -> Float[Array, "..."]:
    """The spectrum plus one replica along an axis, cropped to the coarse Nyquist.

    **Source:** the program released with Jindal et al. 2021 (Eq. 11 to 13 there).
    """
    samples = jnp.floor(SIZE * rate + 1.5).astype(jnp.int32)
    # An even number of samples has no centre: the program takes the one after it.
    off_centre = (samples + 1) % 2
    margins = [(0, 0), (0, 0)]
    margins[axis] = (0, HALF + 1)
    padded = _once(jnp.pad(spectrum, margins))
    inside = _K[_within(half)]

    def ahead(bins: Int[Array, ""]) -> Float[Array, "..."]:
        first = bins + (HALF - half)
        return jax.lax.dynamic_slice_in_dim(padded, first, inside.size, axis)

    kept = jnp.asarray(np.abs(inside), rate.dtype) <= rate * HALF
    both = ahead(off_centre) + ahead(samples // 2)
    return jnp.where(jnp.expand_dims(kept, 1 - axis), both, 0)


def _power_within(
    half: int, spectrum: Float[Array, "512 512"], beta: Float[Array, ""]
) -> Float[Array, "512 512"]:
    """Power of the bins up to `half`; the others hold exact zeros."""
    inside = _within(half)
    power = safe_power(spectrum[inside, inside], beta)
    return jnp.pad(power, (inside.start, SIZE - inside.stop))


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
    lost = safe_power(amplitude, p.beta) - power
    bins = _once(_fold(power))
    return ReleasedPool(_by_ring(_fold(lost)), _rings(bins), bins)


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
        moved = _by_ring(_moved(p.bins, judder_shift(c)))
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
    by_ring = _by_ring_about(p.bins, places.astype(int))
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
    moved = _moved(shaded, judder_shift(c))
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


def _moved(
    spectrum: Float[Array, "n 512"], bins: Int[Array, ""]
) -> Float[Array, "n 512"]:
    """Columns moved right by 0 to 512 bins, with zeros where there was nothing."""
    padded = _once(jnp.pad(spectrum, ((0, 0), (SIZE, 0))))
    return _once(jax.lax.dynamic_slice_in_dim(padded, SIZE - bins, SIZE, axis=1))


def _once(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """Keep XLA from computing `x` again wherever it is read."""
    return jax.lax.optimization_barrier(x)


def _fold(power: Float[Array, "..."], axis: int = 0) -> Float[Array, "..."]:
    """Sum over the sign of the frequency of an axis: 512 bins become 257."""
    negative = jax.lax.slice_in_dim(power, 0, HALF + 1, axis=axis)
    positive = jax.lax.slice_in_dim(power, HALF + 1, SIZE, axis=axis)
    ends = [(0, 0)] * power.ndim
    ends[axis] = (1, 1)
    return jnp.flip(negative, axis) + jnp.pad(positive, ends)


def _by_ring(bins: Float[Array, "257 512"]) -> Float[Array, "257"]:
    """Sum over each ring max(|k_x|, |k_y|)."""
    beyond = jnp.sum(jnp.where(_BELOW, bins, 0), axis=0)
    return jnp.sum(jnp.where(_BELOW, 0, bins), axis=1) + _fold(beyond)


def _by_ring_about(
    bins: Float[Array, "257 512"], places: Int[np.ndarray, " places"]
) -> Float[Array, "places 257"]:
    """`_by_ring` of the bins as if moved to each of some places, which are >= 0.

    A ring about a place is a piece of a row and of two columns, so running sums along
    both axes give it as a difference of two numbers of its own size.
    """
    along = _running_sum(bins)
    inner = jnp.pad(_running_sum(bins.T).T[:-1], ((1, 0), (0, 0)))
    # Bin -256 has no counterpart on the other side.
    right = along + inner.at[-1].set(0)
    left = along - bins - inner
    ring = np.arange(HALF + 1)[None, :]
    last = np.minimum(ring, HALF - 1) - places[:, None]
    first = -ring - places[:, None]
    return _taken(right, ring, last) - _taken(left, ring, first)


def _taken(
    sums: Float[Array, "257 512"],
    ring: Int[np.ndarray, "1 257"],
    k: Int[np.ndarray, "places 257"],
) -> Float[Array, "places 257"]:
    """Running sums of each ring at bins `k` <= 255, 0 before the first bin."""
    before = jnp.pad(sums, ((0, 0), (1, 0)))
    return before[ring, np.maximum(k + HALF + 1, 0)]


def _running_sum(x: Float[Array, "n m"]) -> Float[Array, "n m"]:
    """Along the rows: in blocks, of a running sum of which XLA makes slow work."""
    rows, columns = x.shape
    blocks = -(-columns // _BLOCK)
    padded = jnp.pad(x, ((0, 0), (0, blocks * _BLOCK - columns)))
    up_to = lambda n, k: jnp.asarray(np.triu(np.ones((n, n)), k), x.dtype)
    exact = jax.lax.Precision.HIGHEST
    each = padded.reshape(rows, blocks, _BLOCK)
    within = jnp.matmul(each, up_to(_BLOCK, 0), precision=exact)
    before = jnp.matmul(within[..., -1], up_to(blocks, 1), precision=exact)
    return (within + before[..., None]).reshape(rows, -1)[:, :columns]


def _rings(bins: Float[Array, "257 512"]) -> Float[Array, "257 257"]:
    """Sum over the sign of the horizontal frequency, per ring max(|k_x|, |k_y|)."""
    folded = _once(_fold(bins, axis=1))
    within = jnp.diag(jnp.sum(jnp.triu(folded), axis=0))
    return jnp.tril(folded, -1) + within
