"""Low-pass filters of the chain, as transfer functions."""

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._display import Shading
from ._spectrum import SIZE


def lorentzian(
    frequency: Float[Array, "*#n"], width: Float[Array, "*#n"]
) -> Float[Array, "*n"]:
    r"""Monotone stand-in for the transfer function of a box blur.

    $$\mathcal L(\rho; b) = \frac{\sigma^2}{\sigma^2 + 4\rho^2},\quad
    \sigma = \frac{\pi}{2b},$$

    written without the division by `width`, so that no blur at all is the exact
    limit 1 with a finite derivative.

    **Arguments:** `frequency`, of either sign, and `width` of the blur, >= 0, in
    reciprocal units. [cycles/deg] and [deg], or [cycles/px] and [px].

    **Returns:** transfer, in (0, 1]. [1].

    **Source:** Jindal et al. 2021, Eq. 6 and 7.
    """
    return 1.0 / (1.0 + (4.0 / math.pi * frequency * width) ** 2)


def log_lorentzian(
    frequency: Float[Array, "*#n"], width: Float[Array, "*#n"]
) -> Float[Array, "*n"]:
    """Natural logarithm of `lorentzian`, exact where the blur is weak."""
    return -jnp.log1p((4.0 / math.pi * frequency * width) ** 2)


def mipmap(
    amplitude: Float[Array, "512 512"], shading: Shading
) -> Float[Array, "512 512"]:
    """The spectrum after the blur of the mip level that a coarse pixel selects.

    **Source:** Jindal et al. 2021, Eq. 4, 8 and 9, in units of full-rate pixels, so
    that the display's resolution cancels.
    """
    k = jnp.asarray(np.arange(-SIZE // 2, SIZE // 2), amplitude.dtype) / SIZE
    # Beyond 2^60 texels nothing is left of a texture of 2^9, and 2^128 would overflow.
    texels = 2.0 ** jnp.minimum(shading.mip_level, 60)
    width = texels / jnp.minimum(shading.rate_x, shading.rate_y)
    transfer = lorentzian(k, width)
    return amplitude * transfer[None, :] * transfer[:, None]
