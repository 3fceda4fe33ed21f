"""How bright each tile is: from the picture before, or from nothing at all."""

import warnings

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from camojab._errors import check

from .._picture import block_means, checked_picture, decoded
from .._rates import TILE


DEFAULT_LUMINANCE = 50.0
"""Luminance of a tile where none is known: what the frame of Jindal et al. (2021) is
taken at, whose own was not published. [cd/m^2]"""

# Of red, green and blue light in luminance, ITU-R BT.709.
_WEIGHTS = (0.2126, 0.7152, 0.0722)


def tile_luminance(
    image: ArrayLike, peak_luminance: ArrayLike
) -> Float[Array, "rows columns"]:
    """Mean luminance of each 16x16 tile of a picture, for the frame that follows it.

    Light is what is averaged, over the pixels of the tile that exist: a tile that
    the picture's edge cuts has fewer.

    **Arguments:**

    - `image`: picture shown before, sRGB-encoded, [height, width, 3]. [1], in [0, 1];
        integers count from 0 to the largest value of their type.
    - `peak_luminance`: of the display's white. [cd/m^2], > 0.

    **Returns:** for `Frame`. [cd/m^2], in [0, `peak_luminance`].

    **Raises:** `ValueError` for another shape or values out of range; under a JAX
    transformation values are checked at run time.

    **Source:** Jindal et al. (2021), Section 5.1; IEC 61966-2-1 for sRGB.
    """
    picture = checked_picture("image", image)
    peak = check(
        "peak_luminance",
        peak_luminance,
        lambda x: (x > 0) & jnp.isfinite(x),
        "> 0 cd/m^2 and finite",
    )
    return _relative(picture) * peak.astype(picture.dtype)


@jax.jit
def _relative(
    picture: Float[Array, "height width 3"],
) -> Float[Array, "rows columns"]:
    light = decoded(picture) @ jnp.asarray(_WEIGHTS, picture.dtype)
    return block_means(light, TILE, TILE)


def default_luminance() -> float:
    """The luminance that stands in where none is given, with a warning."""
    warnings.warn(
        f"`luminance` was not given and is taken as {DEFAULT_LUMINANCE:g} cd/m^2 in "
        "every tile.",
        UserWarning,
        stacklevel=3,
    )
    return DEFAULT_LUMINANCE
