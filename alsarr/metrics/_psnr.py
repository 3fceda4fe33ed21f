"""Peak signal-to-noise ratio."""

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._picture import block_means
from .._rates import TILE
from ._checks import checked_pair
from ._pooling import checked_tile


def squared_error(
    reference: ArrayLike, test: ArrayLike
) -> Float[Array, "height width"]:
    """Mean of the three channels' squared differences, for each pixel.

    **Arguments:** `reference`, `test`: sRGB-encoded, shape [height, width, 3]. [1], in
    [0, 1]; integers count from 0 to the largest value of their type.

    **Returns:** [1], in [0, 1].

    **Raises:** `ValueError` for pictures of another shape or of two, or values out of
    range.
    """
    first, second = checked_pair(reference, test)
    return jnp.mean((first - second) ** 2, axis=-1)


def psnr(reference: ArrayLike, test: ArrayLike) -> Float[Array, ""]:
    """Peak signal-to-noise ratio of a whole picture.

    **Arguments, raises:** as `squared_error`.

    **Returns:** -10 log10 of the mean of `squared_error`. [dB], >= 0, larger where the
    pictures are more alike, and infinite where they are equal, with derivative 0.

    **Example:**

    >>> import numpy as np
    >>> from alsarr.metrics import psnr
    >>> grey = np.full((16, 16, 3), 0.5)
    >>> f"{psnr(grey, grey + 0.1):.2f}"  # [dB]
    '20.00'
    """
    return decibels(jnp.mean(squared_error(reference, test)))


def psnr_tiles(
    reference: ArrayLike, test: ArrayLike, *, tile: int = TILE
) -> Float[Array, "rows columns"]:
    """The same for each tile, of the mean over its pixels that exist.

    **Arguments:** as `psnr`, and `tile`: width and height of a tile. [px], a whole
    number > 0.

    **Returns:** [dB], >= 0, infinite for a tile that is equal in both, with derivative
    0.

    **Raises:** `ValueError` as `psnr`, or for `tile`.
    """
    error = squared_error(reference, test)
    checked_tile(tile)
    return decibels(block_means(error, tile, tile))


def decibels(error: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """PSNR of a mean squared error; of none it is infinite, with derivative 0."""
    none = error == 0
    return jnp.where(none, jnp.inf, -10 * jnp.log10(jnp.where(none, 1, error)))
