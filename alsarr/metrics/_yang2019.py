"""Errors of luma, as adaptive shading estimates them."""

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._picture import checked_picture
from .._rates import TILE
from ._checks import checked_pair
from ._colour import luma
from ._pooling import checked_tile, pool_tiles


def yang2019(reference: ArrayLike, test: ArrayLike) -> Float[Array, "height width"]:
    """How far each pixel's luma is from that of the reference.

    What Yang et al. estimate from a picture at full rate, measured on the picture at a
    coarse one.

    **Arguments:** `reference`, `test`: sRGB-encoded, shape [height, width, 3]. [1], in
    [0, 1]; integers count from 0 to the largest value of their type.

    **Returns:** difference of the two, without its sign. [1], in [0, 1]. Where it is 0
    its derivative is taken as 0.

    **Raises:** `ValueError` for pictures of another shape or of two, or values out of
    range.

    **Source:** Cardoso et al. 2022, doi:10.1145/3522625, after Yang et al. 2019,
    doi:10.1145/3320287; luma of ITU-R BT.601.
    """
    first, second = checked_pair(reference, test)
    return jnp.abs(luma(first) - luma(second))


def estimate_yang2019(
    reference: ArrayLike, *, tile: int = TILE
) -> Float[Array, "rows columns 2"]:
    """Error of halving the rate, from the picture at full rate alone.

    The largest difference of luma between the two pixels of a coarse one, on a grid
    that begins at the top left; of a coarse pixel that the edge cuts there is none.

    **Arguments:**

    - `reference`: as for `yang2019`.
    - `tile`: width and height of a tile. [px], a whole number > 0; 1 for the error of
      each pixel, which `weber` and `pool_tiles` take an axis at a time.

    **Returns:** for each tile the error along x, of 2x1, and along y, of 1x2. [1], in
    [0, 1].

    **Raises:** `ValueError` as `yang2019`, or for `tile`.

    **Source:** Cardoso et al. 2022, whose programs take the maximum; Yang et al. 2019,
    Eq. 2, take the root of the mean square, and half the difference
    (`camojab.baselines.half_rate_error_yang2019`).
    """
    values = luma(checked_picture("reference", reference))
    checked_tile(tile)
    across = _pairs(values, axis=1)
    down = _pairs(values, axis=0)
    return jnp.stack([pool_tiles(d, tile=tile) for d in (across, down)], axis=-1)


def _pairs(
    values: Float[Array, "height width"], axis: int
) -> Float[Array, "height width"]:
    """For each pixel, the difference within the pair that it belongs to."""
    size = values.shape[axis]
    place = jnp.arange(size)
    # A last pixel without another is compared with itself.
    other = jnp.minimum(place ^ 1, size - 1)
    return jnp.abs(values - jnp.take(values, other, axis=axis))
