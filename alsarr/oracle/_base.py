from abc import abstractmethod

import equinox as eqx
from jaxtyping import Array, ArrayLike, Float

from .._frame import Frame


class AbstractQualityOracle(eqx.Module, strict=True):
    """Tells how good each tile of a frame would look at each shading rate.

    An oracle is a pytree: jit, vmap and grad go through `quality`.
    """

    @abstractmethod
    def quality(self, frame: Frame, refresh_rate: ArrayLike) -> Float[Array, "tiles 7"]:
        """Quality of each tile at each rate. [JND], larger is better.

        **Arguments:**

        - `frame`: what the tiles show.
        - `refresh_rate`: at which the frame will be shown. [Hz], > 0.

        **Returns:** tiles row by row, the top row first; rates in the order of
        `alsarr.RATES`. The zero is the oracle's own: only differences within a tile
        mean something.

        **Raises:** `ValueError` for a refresh rate that is not positive and for a tile
        that the oracle cannot judge; at run time under a JAX transformation.
        """
