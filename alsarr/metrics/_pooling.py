"""From pixels to tiles."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._picture import block_means
from .._rates import TILE


def pool_tiles(
    values: Float[Array, "height width"], *, tile: int = TILE, how: str = "max"
) -> Float[Array, "rows columns"]:
    """The largest or the mean value of each tile's pixels.

    **Arguments:**

    - `values`: a value for each pixel.
    - `tile`: width and height of a tile. [px], a whole number > 0.
    - `how`: "max" or "mean".

    **Returns:** one value a tile. Tiles that the right and the lower edge cut count the
    pixels that exist. Where several pixels are largest they share the derivative.

    **Raises:** `ValueError` naming the argument that is out of range.

    **Source:** Cardoso et al. 2022, "Training and Predicting Visual Error for Real-Time
    Applications", Proc. ACM Comput. Graph. Interact. Tech. 5(1), doi:10.1145/3522625,
    whose programs take the maximum.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from alsarr.metrics import pool_tiles
    >>> error = jnp.zeros((16, 40)).at[3, 35].set(0.75)
    >>> print(pool_tiles(error))
    [[0.   0.   0.75]]
    """
    if values.ndim != 2 or not values.size:
        raise ValueError(
            f"`values` must have shape [height, width], none of them 0, got "
            f"{values.shape}."
        )
    checked_tile(tile)
    if how == "mean":
        return block_means(values, tile, tile)
    if how != "max":
        raise ValueError(f"`how` must be max or mean, got {how!r}.")
    height, width = values.shape
    rows, columns = -(-height // tile), -(-width // tile)
    missing = (0, rows * tile - height), (0, columns * tile - width)
    padded = jnp.pad(values, missing, constant_values=-jnp.inf)
    return padded.reshape(rows, tile, columns, tile).max(axis=(1, 3))


def checked_tile(tile: int) -> None:
    if not isinstance(tile, int) or tile < 1:
        raise ValueError(f"`tile` must be a whole number > 0 px, got {tile!r}.")
