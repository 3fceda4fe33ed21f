import math
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from .._frame import Frame
from .._rates import RATES
from ._base import AbstractQualityOracle
from ._checks import checked_refresh_rate


class UniformOracle(AbstractQualityOracle, strict=True):
    """Every tile alike, whatever it shows: the baseline that spreads a budget evenly.

    The quality of m x n is log2 of the share of the tile's pixels that are shaded,
    1/(mn). It is concave in the cost, so what buys most is always to refine one of the
    coarsest tiles.
    """

    unit: ClassVar[str] = "octaves"

    def quality(self, frame: Frame, refresh_rate: ArrayLike) -> Float[Array, "tiles 7"]:
        """See `AbstractQualityOracle.quality`; 0 at full rate, whatever the rate [Hz].

        **Raises:** for a refresh rate that is not positive, though it counts nothing.
        """
        # Used, or the check would be dropped under a transformation.
        zero = 0 * checked_refresh_rate(refresh_rate)
        octaves = jnp.asarray(np.log2(RATES.cost / RATES.cost.max()), zero.dtype)
        tiles = math.prod(frame.shape)
        return jnp.broadcast_to(octaves + zero[None], (tiles, len(RATES)))

    def count_outside(self, frame: Frame, refresh_rate: ArrayLike) -> Int[Array, ""]:
        """See `AbstractQualityOracle.count_outside`."""
        return jnp.zeros((), int)
