"""What coarse shading leaves of a picture."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int

from camojab._errors import check

from ._picture import block_means, checked_picture, decoded, encoded
from ._rates import RATES, TILE


def coarse(image: ArrayLike, rate: ArrayLike) -> Float[Array, "height width 3"]:
    """A picture with one colour in each coarse pixel: the mean light of its pixels.

    Light is averaged, not the picture's values, because shading comes before they are
    encoded for the display: a coarse pixel over black and white is as bright as half of
    white. Real coarse shading samples filtered textures once in each coarse pixel and
    keeps the edges of triangles sharp; the mean stands for the filter, and edges are
    averaged with the rest. Coarse pixels that the picture's edge cuts are means of the
    pixels that exist. Where all is 1x1 the picture is returned bit by bit.

    **Arguments:**

    - `image`: sRGB-encoded, shape [height, width, 3]. [1], in [0, 1]; integers count
        from 0 to the largest value of their type.
    - `rate`: index of each tile's rate in the order of `alsarr.RATES`, shape [rows,
        columns], with a tile for each 16 x 16 pixels, the last cut by the edge or not.

    **Returns:** the same size, sRGB-encoded, in [0, 1]. Differentiable in `image`.

    **Raises:** `ValueError` for another shape or values out of range; under a JAX
    transformation values are checked at run time.

    **Example:**

    >>> import numpy as np
    >>> from alsarr import coarse, RATES
    >>> checks = np.indices((16, 16)).sum(axis=0)[..., None] % 2 * np.ones(3)
    >>> rate = np.array([[RATES.names.index("2x1")]])
    >>> f"{coarse(checks, rate).min():.3f}"  # sRGB of half the light of white
    '0.735'
    """
    picture = checked_picture("image", image)
    return _coarse(picture, _tile_rates(rate, picture.shape[:2]))


@jax.jit
def _coarse(
    picture: Float[Array, "height width 3"], rate: Int[Array, "rows columns"]
) -> Float[Array, "height width 3"]:
    height, width, _ = picture.shape
    chosen = _blocks(rate, TILE, TILE)[:height, :width, None]
    light, result = decoded(picture), picture
    for index, (wide, high) in enumerate(RATES.size.tolist()):
        if wide == high == 1:
            continue
        shown = _blocks(encoded(block_means(light, high, wide)), high, wide)
        shown = jnp.clip(shown[:height, :width], 0.0, 1.0)
        result = jnp.where(chosen == index, shown, result)
    return result


def _tile_rates(rate: ArrayLike, size: tuple[int, ...]) -> Array:
    height, width = size
    rate = jnp.asarray(rate)
    if not jnp.issubdtype(rate.dtype, jnp.integer):
        raise ValueError(f"`rate` must be whole numbers, got {rate.dtype}.")
    tiles = -(-height // TILE), -(-width // TILE)
    if rate.shape != tiles:
        raise ValueError(
            f"`rate` must have the tiles of `image`, {tiles} for {width} x {height} "
            f"px, got {rate.shape}."
        )
    rule = f"an index from 0 to {len(RATES) - 1}"
    index = check("rate", rate, lambda r: (r >= 0) & (r < len(RATES)), rule)
    return index.astype(jnp.int32)


def _blocks(values: Array, high: int, wide: int) -> Array:
    """Each value as a block of so many pixels."""
    return jnp.repeat(jnp.repeat(values, high, axis=0), wide, axis=1)
