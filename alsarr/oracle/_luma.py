"""The previous picture in tiles, and the rule that both image-based methods end in."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._frame import Frame
from .._rates import RATES, TILE


def needed_image(frame: Frame, who: str) -> Float[Array, "height width 3"]:
    """The previous picture. **Raises:** `ValueError`, saying who needs it, for none."""
    if frame.previous_image is None:
        raise ValueError(
            f"`frame.previous_image` must be given, since {who} looks at the picture "
            "itself, got None."
        )
    return frame.previous_image.astype(frame.velocity_x.dtype)


def luma(
    image: Float[Array, "height width 3"], weights: tuple[float, float, float]
) -> Float[Array, "height width"]:
    """Weighted sum of the encoded red, green and blue. [1]"""
    return jnp.sum(image * jnp.asarray(weights, image.dtype)[None, None], axis=-1)


def by_tile(
    of: Callable[[Float[Array, "r c h w"]], Float[Array, "r c *n"]],
    luma: Float[Array, "height width"],
) -> Float[Array, "rows columns *n"]:
    """What a function of pixels gives for each tile, of those that exist.

    The tiles that the right and the lower edge of the picture cut come to `of` as small
    as they are, but with every pixel twice along an axis that has only one.
    """
    rows, columns = (_parts(n) for n in luma.shape)
    parts = [[of(_tiles(luma[r][:, c])) for c in columns] for r in rows]
    return jnp.concatenate([jnp.concatenate(row, axis=1) for row in parts], axis=0)


def pixels_per_frame(
    velocity: Float[Array, "*n"], ppd: Float[Array, ""], rate: Float[Array, ""]
) -> Float[Array, "*n"]:
    """Motion between two frames. [px]. `velocity` [deg/s], `rate` [Hz]."""
    return velocity * (ppd / rate).astype(velocity.dtype)


@eqx.filter_jit
def coarsest(
    allowed: Bool[Array, "tiles 7"], quality: Float[Array, "tiles 7"]
) -> Int[Array, " tiles"]:
    """The cheapest rate that is allowed, the better of two, 1x1 where none is."""
    cost = jnp.where(allowed, jnp.asarray(RATES.cost)[None], RATES.cost.max())
    cheapest = cost == jnp.min(cost, axis=1, keepdims=True)
    candidate = cheapest & (allowed | (np.arange(len(RATES)) == len(RATES) - 1)[None])
    return jnp.argmax(jnp.where(candidate, quality, -jnp.inf), axis=1)


def _parts(size: int) -> list[slice]:
    whole = size // TILE * TILE
    parts = slice(0, whole), slice(whole, size)
    return [part for part in parts if part.start < part.stop]


def _tiles(luma: Float[Array, "height width"]) -> Float[Array, "r c h w"]:
    for axis in (0, 1):
        if luma.shape[axis] == 1:
            luma = jnp.repeat(luma, 2, axis=axis)
    height, width = (min(n, TILE) for n in luma.shape)
    blocks = luma.reshape(luma.shape[0] // height, height, -1, width)
    return blocks.swapaxes(1, 2)
