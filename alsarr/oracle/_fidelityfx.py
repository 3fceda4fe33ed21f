from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int

from camojab._errors import check
from camojab._math import safe_hypot

from .._frame import Frame
from .._rates import RATES, TILE
from ._base import AbstractQualityOracle
from ._checks import checked_refresh_rate, positive
from ._luma import coarsest, luma, needed_image, pixels_per_frame


# That the library weighs the encoded picture with.
_WEIGHTS = (0.30, 0.59, 0.11)


class FidelityFxOracle(AbstractQualityOracle, strict=True):
    """Variance of the previous picture, in the manner of FidelityFX Variable Shading.

    What m x n would lose is the largest range of luma, largest minus smallest, within
    one of the tile's blocks of m x n pixels; motion hides `motion_factor` of it for
    every pixel that the tile moves between two frames, both axes taken together. The
    quality is minus what is left, and 0 at full rate.

    The library adds to a block what its four neighbours exceed it by. That is left out:
    it charges a rate with a range that none of its coarse pixels spans. The library
    also looks along the motion of each pixel, where here a tile is judged where it is.
    And it judges 1x2 by the pixels of 2x1 and starts the smallest luma of a block at
    the cutoff, which keeps bright flat tiles from 4x4; neither is so here.

    **Arguments:**

    - `ppd`: of the display, which takes velocities to pixels per frame. [px/deg], > 0.
    - `motion_factor`: luma hidden for each pixel of motion. [1/px], >= 0.
    - `variance_cutoff`: range of luma below which `rate` takes a rate. [1], > 0.

    **Raises:** `ValueError` naming the argument that is out of range.

    **Source:** GPUOpen-Effects/FidelityFX-VariableShading, ffx_variable_shading.h
    (MIT), whose defaults these are.
    """

    ppd: Float[Array, ""]
    motion_factor: Float[Array, ""]
    variance_cutoff: Float[Array, ""]

    unit: ClassVar[str] = "luma"

    def __init__(
        self,
        *,
        ppd: ArrayLike,
        motion_factor: ArrayLike = 0.01,
        variance_cutoff: ArrayLike = 0.015,
    ):
        self.ppd = positive("ppd", ppd, "px/deg")
        good = lambda x: (x >= 0) & jnp.isfinite(x)
        rule = "finite and >= 0 a pixel"
        self.motion_factor = check("motion_factor", motion_factor, good, rule)
        self.variance_cutoff = positive("variance_cutoff", variance_cutoff, "")

    def quality(self, frame: Frame, refresh_rate: ArrayLike) -> Float[Array, "tiles 7"]:
        """See `AbstractQualityOracle.quality`. `frame.previous_image` is needed."""
        rate = checked_refresh_rate(refresh_rate)
        image = needed_image(frame, "FidelityFX")
        return _quality(self, image, frame.velocity_x, frame.velocity_y, rate)

    def count_outside(self, frame: Frame, refresh_rate: ArrayLike) -> Int[Array, ""]:
        """See `AbstractQualityOracle.count_outside`."""
        return jnp.zeros((), int)

    def rate(self, frame: Frame, refresh_rate: ArrayLike) -> Int[Array, " tiles"]:
        """The method's own choice: the coarsest rate that loses less than the cutoff.

        Of two that are as coarse it is the one that loses less.

        **Returns:** index into `alsarr.RATES`, tiles row by row.

        **Raises:** as `quality`.
        """
        quality = self.quality(frame, refresh_rate)
        return coarsest(-quality < self.variance_cutoff.astype(quality.dtype), quality)


@eqx.filter_jit
def _quality(
    oracle: FidelityFxOracle,
    image: Float[Array, "height width 3"],
    velocity_x: Float[Array, "rows columns"],
    velocity_y: Float[Array, "rows columns"],
    refresh_rate: Float[Array, ""],
) -> Float[Array, "tiles 7"]:
    y = _whole_tiles(luma(image, _WEIGHTS))
    ranges = jnp.stack([_largest_range(y, *size) for size in RATES.size.tolist()], -1)
    speed = safe_hypot(velocity_x.ravel(), velocity_y.ravel())
    motion = pixels_per_frame(speed, oracle.ppd, refresh_rate)
    hidden = motion * oracle.motion_factor.astype(motion.dtype)
    return -jnp.maximum(ranges - hidden[:, None], 0)


def _whole_tiles(luma: Float[Array, "h w"]) -> Float[Array, "height width"]:
    """Pixels repeated beyond the edge: they add no range to a block."""
    return jnp.pad(luma, [(0, -n % TILE) for n in luma.shape], mode="edge")


def _largest_range(
    luma: Float[Array, "height width"], wide: int, high: int
) -> Float[Array, " tiles"]:
    height, width = luma.shape
    blocks = luma.reshape(height // high, high, width // wide, wide)
    spread = jnp.max(blocks, axis=(1, 3)) - jnp.min(blocks, axis=(1, 3))
    tiles = spread.reshape(height // TILE, TILE // high, width // TILE, TILE // wide)
    return jnp.max(tiles, axis=(1, 3)).ravel()
