from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from camojab import Display, Shading, Viewing
from camojab._errors import check
from camojab.baselines import Denes2020, quality_denes2020

from .._frame import Frame, mean_velocity
from .._rates import RATES
from ._base import AbstractQualityOracle
from ._checks import checked_refresh_rate, positive


class Denes2020Oracle(AbstractQualityOracle, strict=True):
    """MARRR: what the motion of the whole frame makes of each rate, for every tile.

    The model knows one velocity and one resolution. The velocity is the mean over the
    tiles of the speed, sqrt(vx^2 + vy^2); the resolution that m x n stands for is
    1/sqrt(mn) on both axes, since both were reduced alike where the model was
    calibrated. So 2x4 and 4x2 are equal, and so are 2x1 and 1x2.

    **Arguments:**

    - `ppd`: of the display. [px/deg], > 0.
    - `persistence`: lit fraction of each frame. [1], in (0, 1].
    - `constants`: `Denes2020.released()` if left out.

    **Raises:** `ValueError` naming the argument that is out of range.

    **Source:** Denes et al. 2020, ACM Trans. Graph. 39(4), Eq. 3 to 18.
    """

    ppd: Float[Array, ""]
    persistence: Float[Array, ""]
    constants: Denes2020

    unit: ClassVar[str] = "JND"

    def __init__(
        self,
        *,
        ppd: ArrayLike,
        persistence: ArrayLike = 1.0,
        constants: Denes2020 | None = None,
    ):
        self.ppd = positive("ppd", ppd, "px/deg")
        share = lambda p: (p > 0) & (p <= 1)
        self.persistence = check("persistence", persistence, share, "in (0, 1]")
        self.constants = constants or Denes2020.released()

    def quality(self, frame: Frame, refresh_rate: ArrayLike) -> Float[Array, "tiles 7"]:
        """See `AbstractQualityOracle.quality`. [JND].

        Every row is the same.
        """
        rate = checked_refresh_rate(refresh_rate)
        row = _quality(self, mean_velocity(frame), rate)
        return jnp.broadcast_to(row, (frame.texture.size, len(RATES)))

    def count_outside(self, frame: Frame, refresh_rate: ArrayLike) -> Int[Array, ""]:
        """See `AbstractQualityOracle.count_outside`."""
        return jnp.zeros((), int)


@eqx.filter_jit
def _quality(
    oracle: Denes2020Oracle,
    speed: Float[Array, ""],
    refresh_rate: Float[Array, ""],
) -> Float[Array, "7"]:
    # The model's constants hold for 100 cd/m^2 and it does not look at another.
    display = Display(
        ppd=oracle.ppd,
        refresh_rate=refresh_rate,
        luminance=100.0,
        persistence=oracle.persistence,
    )
    side = jnp.asarray(np.sqrt(RATES.resolution.prod(axis=1)), speed.dtype)
    shading = Shading(rate_x=side, rate_y=side)
    return quality_denes2020(display, Viewing(speed), shading, oracle.constants)
