from abc import abstractmethod
from typing import TYPE_CHECKING

import equinox as eqx
from jaxtyping import Array, ArrayLike, Float, Int

from .._frame import Frame


if TYPE_CHECKING:
    from typing import ClassVar as AbstractClassVar
else:
    from equinox import AbstractClassVar


class AbstractQualityOracle(eqx.Module, strict=True):
    """Tells how good each tile of a frame would look at each shading rate.

    An oracle is a pytree: jit, vmap and grad go through `quality`, vmap over frames of
    one size (their arrays stacked) as well as over refresh rates, and one compilation
    serves all frames of one size. What an oracle needs beyond the frame, such as
    textures, tables or weights, is in its own fields; a buffer that frames may lack is
    an optional field of `Frame`, and an oracle that needs it says so.

    - `unit`: of the qualities.
    """

    unit: AbstractClassVar[str]

    @abstractmethod
    def quality(self, frame: Frame, refresh_rate: ArrayLike) -> Float[Array, "tiles 7"]:
        """Quality of each tile at each rate, in `unit`, larger is better.

        **Arguments:**

        - `frame`: what the tiles show.
        - `refresh_rate`: at which the frame will be shown. A single number. [Hz], > 0.

        **Returns:** tiles row by row, the top row first; rates in the order of
        `alsarr.RATES`. The zero is the oracle's own: only differences within a tile
        mean something.

        **Raises:** `ValueError` for a refresh rate that is not a positive number, for a
        tile that the oracle cannot judge and for a buffer that it needs and the frame
        lacks; for values at run time under a JAX transformation.
        """

    @abstractmethod
    def count_outside(self, frame: Frame, refresh_rate: ArrayLike) -> Int[Array, ""]:
        """How many tiles show what the oracle does not know.

        They are judged as the nearest that it does. 0 for an oracle that knows all.
        """
