"""Errors in proportion to what is just noticeable, by Weber's law."""

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from camojab._errors import check

from .._picture import block_means, checked_picture
from ._colour import luma
from ._flip import flip
from ._yang2019 import yang2019


# Side of the blocks whose mean luma counts. [px]
_BLOCK = 4
# Stands for an environment without light in the programs of Cardoso et al. 2022.
DARK = 1e-10


def weber(
    error: Float[Array, "height width"],
    reference: ArrayLike,
    *,
    environment_luminance: ArrayLike = DARK,
) -> Float[Array, "height width"]:
    r"""An error over the luminance that it is seen on.

    $$Y' = \frac{E}{L + l}$$

    so that one threshold, t in Yang et al. 2019, serves bright and dark places.

    **Arguments:**

    - `error`: of each pixel, on a scale of luminance. [1], >= 0.
    - `reference`: the picture without error, sRGB-encoded, shape [height, width, 3].
      [1], in [0, 1]; integers count from 0 to the largest value of their type.
    - `environment_luminance`: l, light from elsewhere, which hides errors in the dark.
      [1], > 0. The default of next to nothing is what the networks of Cardoso et al.
      were trained with: where the reference is black it makes of any error up to 1e10,
      which their transforms cut off, but means do not. Nvidia's sample of adaptive
      shading has 0.1.

    **Returns:** `error` over the mean luma of the 4 x 4 pixels around, of those that
    exist, plus l. [1], >= 0.

    **Raises:** `ValueError` for a picture of another shape or values out of range.

    **Source:** Cardoso et al. 2022, doi:10.1145/3522625, Eq. 9, with the blocks of
    their programs; Yang et al. 2019, doi:10.1145/3320287, Eq. 15.
    """
    picture = checked_picture("reference", reference)
    if error.shape != picture.shape[:2]:
        raise ValueError(
            f"`error` must have the pixels of `reference`, {picture.shape[:2]}, got "
            f"{error.shape}."
        )
    level = check("environment_luminance", environment_luminance, _positive, "> 0")
    means = block_means(luma(picture), _BLOCK, _BLOCK)
    means = jnp.repeat(jnp.repeat(means, _BLOCK, axis=0), _BLOCK, axis=1)
    height, width = error.shape
    return error / (means[:height, :width] + level)


def jnflip(
    reference: ArrayLike,
    test: ArrayLike,
    *,
    ppd: ArrayLike,
    environment_luminance: ArrayLike = DARK,
) -> Float[Array, "height width"]:
    """`flip` in the form of `weber`, which is just noticeable at some constant.

    **Arguments, returns, raises:** as the two.

    **Source:** Cardoso et al. 2022, section 3.4.
    """
    error = flip(reference, test, ppd=ppd)
    return weber(error, reference, environment_luminance=environment_luminance)


def jnyang(
    reference: ArrayLike, test: ArrayLike, *, environment_luminance: ArrayLike = DARK
) -> Float[Array, "height width"]:
    """`yang2019` in the form of `weber`.

    **Arguments, returns, raises:** as the two.

    **Source:** Cardoso et al. 2022, section 3.4.
    """
    error = yang2019(reference, test)
    return weber(error, reference, environment_luminance=environment_luminance)


def _positive(x: Array) -> Array:
    return (x > 0) & (x < jnp.inf)
