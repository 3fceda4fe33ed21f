"""What sampling does to a spectrum: replicas, crops and the temporal replica.

The released program moves whole bins and cuts between them. The paper's comb, crop and
replica are continuous in the display and the rate; here the spectrum between the bins
of its transform is their Gaussian-weighted mean, which is smooth and never exactly zero
beside a line, so that the derivative of any power of it exists.
"""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ._spectrum import SIZE


HALF = SIZE // 2

# Spectral resolution, in bins: the narrowest that interpolates a constant to 5e-4.
RESOLUTION = 0.65


# Frequencies that the band of a shaded spectrum may end at: those of the usual rates.
BANDS = (HALF // 4, HALF // 2, HALF)


def band(highest: Float[Array, ""]) -> Int[Array, ""]:
    """Index of the narrowest of `BANDS` that has all bins up to `highest`."""
    return jnp.where(highest > BANDS[1], 2, jnp.where(highest > BANDS[0], 1, 0))


def comb(rate: Float[Array, ""], impulses: int) -> Float[Array, "257 513"]:
    """Sampling as a matrix from bins -256..256 to bins 0..256 (Eq. 11 and 12).

    The replicas lie at multiples of `rate` cycles per texel; `impulses` of them on each
    side take part, the two that the paper names, or none for the unsampled spectrum.
    """
    out = jnp.arange(HALF + 1, dtype=rate.dtype)[:, None]
    bins = jnp.arange(-HALF, HALF + 1, dtype=rate.dtype)[None, :]
    replicas = [
        _kernel(out + n * SIZE * rate - bins) for n in range(-impulses, impulses + 1)
    ]
    return jnp.sum(jnp.stack(replicas), axis=0)


def below(bound: Float[Array, ""]) -> Float[Array, "257"]:
    """How much of each of the bins 0..256 lies below `bound` [bins]."""
    k = jnp.arange(HALF + 1, dtype=bound.dtype)
    return 0.5 * jax.scipy.special.erfc((k - bound) / (RESOLUTION * math.sqrt(2.0)))


def _kernel(x: Float[Array, "*n"]) -> Float[Array, "*n"]:
    scale = RESOLUTION * math.sqrt(2.0 * math.pi)
    return jnp.exp(-0.5 * (x / RESOLUTION) ** 2) / scale
