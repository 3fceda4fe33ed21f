"""Low-pass filters of the chain, as transfer functions."""

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._display import LowPass, Shading
from ._spectrum import SIZE


def log_lorentzian(
    frequency: Float[Array, "*#n"], width: Float[Array, "*#n"]
) -> Float[Array, "*n"]:
    r"""Natural logarithm of a monotone stand-in for a box blur's transfer function.

    $$\mathcal L(\rho; b) = \frac{\sigma^2}{\sigma^2 + 4\rho^2},\quad
    \sigma = \frac{\pi}{2b},$$

    written without the division by `width`, so that no blur at all is the exact
    limit 1 with a finite derivative. Exact where the blur is weak.

    **Arguments:** `frequency`, of either sign, and `width` of the blur, >= 0, in
    reciprocal units. [cycles/deg] and [deg], or [cycles/px] and [px].

    **Returns:** <= 0. [1].

    **Source:** Jindal et al. 2021, Eq. 6 and 7.
    """
    return -jnp.log1p((4.0 / math.pi * frequency * width) ** 2)


def log_sinc(
    frequency: Float[Array, "*#n"], width: Float[Array, "*#n"]
) -> Float[Array, "*n"]:
    """Natural logarithm of the magnitude of a box blur's transfer function."""
    # Its zeros would make the logarithm, and every derivative, infinite.
    smallest = float(jnp.finfo(frequency.dtype).eps)
    return jnp.log(jnp.maximum(jnp.abs(jnp.sinc(frequency * width)), smallest))


def log_gaussian(
    frequency: Float[Array, "*#n"], width: Float[Array, "*#n"]
) -> Float[Array, "*n"]:
    """Natural logarithm of the transfer of a normal blur of a box's variance."""
    return -((math.pi * frequency * width) ** 2) / 6.0


LOG_TRANSFER = {
    LowPass.LORENTZIAN: log_lorentzian,
    LowPass.SINC: log_sinc,
    LowPass.GAUSSIAN: log_gaussian,
}


def mipmap(
    amplitude: Float[Array, "512 512"],
    shading: Shading,
    factor: Float[Array, ""],
    low_pass: LowPass,
) -> Float[Array, "512 512"]:
    """The spectrum after the blur of the mip level that a coarse pixel selects.

    `factor` widens the blur.

    **Source:** Jindal et al. 2021, Eq. 4, 8 and 9, in units of full-rate pixels, so
    that the display's resolution cancels.
    """
    k = jnp.asarray(np.arange(-SIZE // 2, SIZE // 2), amplitude.dtype) / SIZE
    texels = 2.0 ** jnp.minimum(shading.mip_level, 60)
    width = factor * texels / jnp.minimum(shading.rate_x, shading.rate_y)
    # Beyond 2^60 texels nothing is left of a texture of 2^9, and 2^64 would overflow.
    width = jnp.minimum(width, 2.0**60)
    transfer = jnp.exp(LOG_TRANSFER[low_pass](k, width))
    return amplitude * transfer[None, :] * transfer[:, None]
