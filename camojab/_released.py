"""The released formulation: the authors' program, to the bin.

Its radial frequency max(|rho_x|, |rho_y|) takes one of 257 values, so the energies of a
texture at one mip level and rate pool, without any approximation, into what each ring
lost to shading and what each pair of ring and horizontal frequency kept. Displays and
velocities then cost a hundredth of the spectrum itself.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ._condition import Condition, log_eye_blur, sensitivity_power
from ._display import Shading
from ._filters import lorentzian
from ._math import safe_power
from ._sampling import HALF, released_replica, shifted
from ._spectrum import SIZE


_K = np.arange(-HALF, HALF)

# Where the horizontal frequency is the larger one and decides the ring.
_BELOW = np.arange(HALF + 1)[:, None] < np.abs(_K)[None, :]


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
    amplitude: Float[Array, "512 512"], shading: Shading
) -> Float[Array, "512 512"]:
    """Mipmap, one replica on each axis, Nyquist crop (`b_m rho` is free of ppd)."""
    k = jnp.asarray(_K, amplitude.dtype) / SIZE
    width = 2.0**shading.mip_level / jnp.minimum(shading.rate_x, shading.rate_y)
    mip = lorentzian(k, width)
    filtered = amplitude * mip[None, :] * mip[:, None]
    across = released_replica(filtered, shading.rate_y)
    return released_replica(across.T, shading.rate_x).T


def pool(
    amplitude: Float[Array, "512 512"],
    shading: Shading,
    vrs: Bool[Array, ""],
    beta: Float[Array, ""],
) -> ReleasedPool:
    """Pool the energies of a texture at one mip level, rate and exponent."""
    shaded = jnp.where(vrs, shade(amplitude, shading), amplitude)
    power = _once(safe_power(shaded, beta))
    lost = _once(safe_power(amplitude, beta) - power)
    bins = _fold(power)
    return ReleasedPool(jnp.sum(_rings(_fold(lost)), axis=1), _rings(bins), bins)


def evaluate(p: ReleasedPool, c: Condition) -> tuple[Float[Array, ""], Array]:
    """E_s and E_t, means over all bins."""
    dtype = p.lost.dtype
    rho = jnp.arange(HALF + 1, dtype=dtype) * (c.display.ppd / SIZE)
    blurred = -jnp.expm1(c.parameters.beta * log_eye_blur(rho, c))
    still = sensitivity_power(rho, jnp.zeros((), dtype), 0.0, c)
    spatial = jnp.dot(still, p.lost + jnp.dot(p.kept, blurred)) / SIZE**2

    flicker = sensitivity_power(rho, c.display.refresh_rate, 1.0, c)
    flicker = _once(flicker)
    columns = jnp.concatenate([flicker[:0:-1], flicker[:-1]])
    on_ring = jnp.where(_BELOW, columns[None, :], flicker[:, None])
    moved = shifted(p.bins.T, -judder_shift(c)).T
    temporal = jnp.sum(moved * on_ring) / SIZE**2
    return spatial, jnp.where(c.components.judder, temporal, 0)


def judder_shift(c: Condition) -> Int[Array, ""]:
    """Bins between the texture and its temporal replica, at most all of them."""
    velocity = jnp.maximum(c.viewing.velocity, 0.1)
    bins = c.display.refresh_rate * SIZE / (2.0 * velocity * c.display.ppd)
    return jnp.floor(jnp.minimum(bins, SIZE)).astype(jnp.int32)


def _once(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """Keep XLA from computing `x` again wherever it is read."""
    return jax.lax.optimization_barrier(x)


def _fold(power: Float[Array, "512 m"]) -> Float[Array, "257 m"]:
    """Sum over the sign of the vertical frequency."""
    negative, positive = power[HALF::-1], power[HALF:]
    return negative + jnp.pad(positive.at[0].set(0), ((0, 1), (0, 0)))


def _rings(bins: Float[Array, "257 512"]) -> Float[Array, "257 257"]:
    """Sum over the sign of the horizontal frequency, per ring max(|k_x|, |k_y|)."""
    folded = _once(_fold(bins.T).T)
    within = jnp.diag(jnp.sum(jnp.triu(folded), axis=0))
    return jnp.tril(folded, -1) + within
