"""The paper's formulation: Eq. 3 to 23 as printed, of continuous functions.

Integrals run over the quadrant [0, Nyquist]^2 of the bins 0..256, with weights that
follow the crop and the replica continuously.
"""

import functools
import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

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
from ._math import safe_hypot, safe_power
from ._node_pool import NodePool
from ._nodes import Axis
from ._parameters import Parameters
from ._sampling import band, BANDS, below, comb, HALF, RESOLUTION
from ._spectrum import SIZE


# Twelve standard deviations: the edge of the crop falls to 0 in any precision. [bins].
SOFT = math.ceil(12 * RESOLUTION)

# No replica that lies farther has energy left. [bins].
FARTHEST = HALF + 2 * SOFT


class PaperPool(eqx.Module):
    """Energies of one texture, mip level, rate and exponent, per bin. [1].

    - `lost`: what the reference has more than the shaded spectrum.
    - `kept`: the shaded spectrum's.
    - `rate_x`, `rate_y`: the shading resolution that crops them.
    """

    lost: Float[Array, "257 257"]
    kept: Float[Array, "257 257"]
    rate_x: Float[Array, ""]
    rate_y: Float[Array, ""]


class Shaded(NamedTuple):
    """Spectra of a texture at full rate and as shaded, the latter with its crop."""

    reference: Float[Array, "257 257"]
    shaded: Float[Array, "257 257"]
    rate_x: Float[Array, ""]
    rate_y: Float[Array, ""]


def shade(
    amplitude: Float[Array, "512 512"], s: Shading, c: Components, p: Parameters
) -> Shaded:
    """Eq. 4 to 12. Both images map a texel to a pixel, as Eq. 20 has it."""
    one = jnp.ones((), amplitude.dtype)
    reference = sample(amplitude, one, one, impulses=0)
    filtered = mipmap(amplitude, s, p.mipmap_width, c.low_pass)
    shaded = sample(filtered, s.rate_x, s.rate_y, impulses=2)
    return Shaded(
        reference,
        jnp.where(c.vrs, shaded, reference),
        jnp.where(c.vrs, s.rate_x, one),
        jnp.where(c.vrs, s.rate_y, one),
    )


def sample(
    amplitude: Float[Array, "512 512"],
    rate_x: Float[Array, ""],
    rate_y: Float[Array, ""],
    *,
    impulses: int,
) -> Float[Array, "257 257"]:
    """The spectrum convolved with the comb on both axes."""
    # Bin 256 is bin -256 again; with it the two sides are alike.
    whole = jnp.pad(amplitude, ((0, 1), (0, 1)), mode="wrap")
    along, across = comb(rate_x, impulses), comb(rate_y, impulses)
    exact = jax.lax.Precision.HIGHEST
    rows = jnp.matmul(across, whole, precision=exact)
    return jnp.matmul(rows, along.T, precision=exact)


def pool(
    amplitude: Float[Array, "512 512"], s: Shading, c: Components, p: Parameters
) -> PaperPool:
    """Pool the energies of a texture at one mip level, rate and exponent."""
    one = jnp.ones((), amplitude.dtype)
    reference, shaded, rate_x, rate_y = shade(amplitude, s, c, p)
    kept = safe_power(shaded, p.beta)
    full = safe_power(reference, p.beta) * _from_zero(one, one)
    return PaperPool(full - kept * _from_zero(rate_x, rate_y), kept, rate_x, rate_y)


def evaluate(p: PaperPool, c: Condition) -> tuple[Array, Array, Terms]:
    """E_s and E_t, integrals over frequency, and the terms that were evaluated.

    [(cycles/deg)^2].
    """
    dtype = p.lost.dtype
    step = c.display.ppd / SIZE
    rho = jnp.arange(HALF + 1, dtype=dtype) * step
    evaluated = terms(c)

    def blurred() -> Array:
        taken = -jnp.expm1(c.parameters.beta * log_eye_blur(rho, c))
        return p.kept * taken[None, :] * _from_zero(p.rate_x, p.rate_y)

    nothing = lambda: jnp.zeros_like(p.kept)
    energy = p.lost + jax.lax.cond(evaluated.eye_blur, blurred, nothing)
    still = sensitivity_power(
        safe_hypot(rho[None, :], rho[:, None]), jnp.zeros((), dtype), 0.0, c
    )
    spatial = step**2 * jnp.sum(energy * still)

    def temporal(half: int) -> Array:
        n = min(half + SOFT, HALF) + 1
        radius, inside = replica(rho[:n], step, p.rate_x, p.rate_y, c)
        flicker = sensitivity_power(radius, c.display.refresh_rate, 0.0, c)
        return step**2 * jnp.sum(p.kept[:n, :n] * flicker * inside)

    ways = [lambda: jnp.zeros((), dtype)]
    ways += [functools.partial(temporal, half) for half in BANDS]
    way = 1 + band(HALF * jnp.maximum(p.rate_x, p.rate_y))
    return spatial, jax.lax.switch(jnp.where(evaluated.judder, way, 0), ways), evaluated


def terms(c: Condition) -> Terms:
    """The terms that matter: beyond the crop, its soft edge falls below rounding."""
    rate = jnp.where(c.components.vrs, c.shading.rate_x, 1)
    highest = jnp.where(
        c.components.vrs, jnp.maximum(c.shading.rate_x, c.shading.rate_y), 1
    )
    within = jnp.minimum(jnp.asarray(BANDS)[band(HALF * highest)] + SOFT, HALF)
    return terms_within(c, HALF * rate + SOFT, replica_place(c), within)


# Radial frequencies of the integrals and of the replica lie between these. [bins].
_RADIAL = Axis(0.5, HALF * math.sqrt(2.0) + 1.0)
_ALONG = Axis(1.0, float(HALF))


def on_nodes(
    p: PaperPool, nodes: int, places: Float[np.ndarray, " places"]
) -> NodePool:
    """The pooled energies carried over to nodes."""
    dtype = p.lost.dtype
    # A barrier, or XLA would evaluate these millions of constants while it compiles.
    k = jax.lax.optimization_barrier(jnp.arange(HALF + 1, dtype=dtype))
    within = _RADIAL.weights(safe_hypot(k[None, :], k[:, None]), nodes)
    within = within.at[0, 0].set(0)
    along = _ALONG.weights(k, nodes).at[0].set(0)
    lost = jnp.einsum("yx,yxn->n", p.lost, within)
    kept = p.kept * _from_zero(p.rate_x, p.rate_y)
    columns = jnp.einsum("yx,yxn->nx", kept, within)

    radius = jnp.sqrt(k[None, :] ** 2 + k[:, None] ** 2 + 0.25)
    about = _RADIAL.weights(radius, nodes)
    rows = p.kept * _half_axis(p.rate_y)[:, None]
    shifts = jnp.einsum("yx,ymn->xmn", rows, about)

    def moved(place: Float[Array, ""]) -> Float[Array, " nodes"]:
        ahead = below(p.rate_x * HALF) * (1.0 - below(place))
        distance = jnp.minimum(jnp.abs(k - place), HALF).astype(jnp.int32)
        return ahead @ jnp.take_along_axis(shifts, distance[:, None, None], 1)[:, 0]

    by_place = jax.lax.map(moved, jnp.asarray(places, dtype))
    return NodePool(
        lost=lost,
        kept=columns @ along,
        moved=jnp.pad(by_place, ((0, 0), (1, 0))),
        radial=jnp.asarray(_RADIAL.nodes(nodes), dtype),
        along=jnp.asarray(_ALONG.nodes(nodes), dtype),
        places=jnp.asarray(places, dtype),
    )


def replica_place(c: Condition) -> Float[Array, ""]:
    """Bins between the texture and its temporal replica (Eq. 22)."""
    return _replica_distance(c) / (c.display.ppd / SIZE)


def cell_area(c: Condition) -> Float[Array, ""]:
    """What a bin counts in an energy. [(cycles/deg)^2]."""
    return (c.display.ppd / SIZE) ** 2


def fields(
    amplitude: Float[Array, "512 512"], c: Condition
) -> tuple[Field, Field, Field]:
    """Reference, shaded and replica, before the power: what `beta` acts on."""
    dtype = amplitude.dtype
    step = c.display.ppd / SIZE
    rho = jnp.arange(HALF + 1, dtype=dtype) * step
    one, rest = jnp.ones((), dtype), jnp.zeros((), dtype)
    reference, shaded, rate_x, rate_y = shade(
        amplitude, c.shading, c.components, c.parameters
    )
    still = safe_hypot(rho[None, :], rho[:, None])
    blur = log_eye_blur(rho, c)[None, :]
    static = jnp.where(still > 0, log_sensitivity_of(still, rest, c), -jnp.inf)
    moving, inside = replica(rho, step, rate_x, rate_y, c)
    flicker = log_sensitivity_of(moving, c.display.refresh_rate, c)
    within, coarse = _from_zero(one, one), _from_zero(rate_x, rate_y)
    area = step**2
    return (
        Field(jnp.log(reference) + static, area * within),
        Field(jnp.log(shaded) + blur + static, area * coarse),
        Field(
            jnp.log(shaded) + flicker, jnp.where(c.components.judder, area * inside, 0)
        ),
    )


def replica(
    rho: Float[Array, " n"],
    step: Float[Array, ""],
    rate_x: Float[Array, ""],
    rate_y: Float[Array, ""],
    c: Condition,
) -> tuple[Float[Array, "n n"], Float[Array, "n n"]]:
    """Radial frequency [cpd] and weights of the temporal replica (Eq. 22, 23)."""
    distance = _replica_distance(c)
    moved = rho[None, :] - distance
    # Half a bin of uncertainty, or the cusp of S^beta at 0 could sit on a grid point.
    radius = jnp.sqrt(moved**2 + rho[:, None] ** 2 + (0.5 * step) ** 2)
    ahead = below(rate_x * HALF) * (1.0 - below(distance / step))
    n = rho.shape[0]
    return radius, ahead[None, :n] * _half_axis(rate_y)[:n, None]


def _replica_distance(c: Condition) -> Float[Array, ""]:
    """Spatial frequency of the temporal replica. [cycles/deg]."""
    # Beyond the band there is nothing to move; the bound keeps a still image finite.
    slowest = c.display.refresh_rate / (2.0 * c.display.ppd)
    return c.display.refresh_rate / jnp.maximum(c.viewing.velocity, slowest)


def _from_zero(
    rate_x: Float[Array, ""], rate_y: Float[Array, ""]
) -> Float[Array, "257 257"]:
    """Weights of the integral from 0 to the coarse Nyquist frequencies (Eq. 13)."""
    return _half_axis(rate_x)[None, :] * _half_axis(rate_y)[:, None]


def _half_axis(rate: Float[Array, ""]) -> Float[Array, "257"]:
    return below(rate * HALF).at[0].multiply(0.5)
