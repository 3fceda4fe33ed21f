from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int

from camojab.baselines import (
    half_rate_error_yang2019,
    quality_yang2019,
    threshold_yang2019,
)

from .._frame import Frame
from .._rates import RATES
from ._base import AbstractQualityOracle
from ._checks import checked_refresh_rate, positive
from ._luma import by_tile, coarsest, luma, needed_image, pixels_per_frame


# Of ITU-R BT.601, on the encoded picture.
_WEIGHTS = (0.299, 0.587, 0.114)


class Yang2019Oracle(AbstractQualityOracle, strict=True):
    """Nvidia Adaptive Shading: the detail of the previous picture, blurred by motion.

    On each axis the error of a tile is that of halving its rate (Eq. 2), times what
    motion leaves of it at half (Eq. 20) or at quarter rate (Eq. 14 and 21), over what
    is just noticeable in a tile of its luma (Eq. 15). The method decides per axis, so
    that of m x n is the larger of both axes, and its quality is minus that: 0 at full
    rate, and -1 where something is just noticeable.

    **Arguments:**

    - `ppd`: of the display, which takes velocities to pixels per frame. [px/deg], > 0.
    - `sensitivity`: t of Eq. 15, the noticeable error per luma. [1], > 0. It scales all
      qualities alike, and makes `rate` coarser. 0.07 is the default of Nvidia's sample,
      which takes it for the largest difference in a tile instead of their mean square.
    - `environment_luma`: l of Eq. 15. [1], > 0. 0.1 is the default of that sample.

    **Raises:** `ValueError` naming the argument that is out of range.

    **Source:** Yang et al. 2019, Proc. ACM Comput. Graph. Interact. Tech. 2(1),
    doi:10.1145/3320287; see `camojab.baselines` for the equations. The picture is
    judged where it was: no tile is looked up along its motion.
    """

    ppd: Float[Array, ""]
    sensitivity: Float[Array, ""]
    environment_luma: Float[Array, ""]

    unit: ClassVar[str] = "just noticeable errors"

    def __init__(
        self,
        *,
        ppd: ArrayLike,
        sensitivity: ArrayLike = 0.07,
        environment_luma: ArrayLike = 0.1,
    ):
        self.ppd = positive("ppd", ppd, "px/deg")
        self.sensitivity = positive("sensitivity", sensitivity, "")
        self.environment_luma = positive("environment_luma", environment_luma, "")

    def quality(self, frame: Frame, refresh_rate: ArrayLike) -> Float[Array, "tiles 7"]:
        """See `AbstractQualityOracle.quality`. `frame.previous_image` is needed."""
        rate = checked_refresh_rate(refresh_rate)
        image = needed_image(frame, "NAS")
        return _quality(self, image, frame.velocity_x, frame.velocity_y, rate)

    def count_outside(self, frame: Frame, refresh_rate: ArrayLike) -> Int[Array, ""]:
        """See `AbstractQualityOracle.count_outside`."""
        return jnp.zeros((), int)

    def rate(self, frame: Frame, refresh_rate: ArrayLike) -> Int[Array, " tiles"]:
        """The method's own choice: the coarsest rate whose error is not noticeable.

        **Returns:** index into `alsarr.RATES`, tiles row by row: what
        `camojab.baselines.rates_yang2019` makes of each tile.

        **Raises:** as `quality`.

        **Source:** Yang et al. 2019, Eq. 16.
        """
        quality = self.quality(frame, refresh_rate)
        return coarsest(quality > -1, quality)


@eqx.filter_jit
def _quality(
    oracle: Yang2019Oracle,
    image: Float[Array, "height width 3"],
    velocity_x: Float[Array, "rows columns"],
    velocity_y: Float[Array, "rows columns"],
    refresh_rate: Float[Array, ""],
) -> Float[Array, "tiles 7"]:
    y = luma(image, _WEIGHTS)
    mean = by_tile(lambda tile: jnp.mean(tile, axis=(2, 3)), y).ravel()
    least = threshold_yang2019(
        mean,
        sensitivity=oracle.sensitivity.astype(mean.dtype),
        environment_luma=oracle.environment_luma.astype(mean.dtype),
    )
    error = by_tile(half_rate_error_yang2019, y).reshape(-1, 2) / least[:, None]
    velocity = jnp.stack([velocity_x.ravel(), velocity_y.ravel()], axis=-1)
    speed = pixels_per_frame(velocity, oracle.ppd, refresh_rate)
    resolution = jnp.asarray(RATES.resolution, error.dtype)
    axes = quality_yang2019(error[:, None], resolution[None], speed[:, None])
    return jnp.min(axes, axis=-1)
