import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int

from camojab._errors import check

from .._frame import Frame
from ..tables import AbstractTables
from ._base import AbstractQualityOracle


class TableOracle(AbstractQualityOracle, strict=True):
    """Looks the tiles of a frame up in polynomial tables.

    - `tables`: either layout of `alsarr.tables`.
    """

    tables: AbstractTables

    def quality(self, frame: Frame, refresh_rate: ArrayLike) -> Float[Array, "tiles 7"]:
        """See `AbstractQualityOracle.quality`.

        **Raises:** also for a texture index that the tables do not hold.
        """
        conditions = self._conditions(frame, refresh_rate)
        return self.tables.quality(self._texture(frame), *conditions)

    def count_outside(self, frame: Frame, refresh_rate: ArrayLike) -> Int[Array, ""]:
        """How many tiles show conditions that the tables were not fitted to."""
        conditions = self._conditions(frame, refresh_rate)
        return jnp.sum(self.tables.outside(self._texture(frame), *conditions))

    def _texture(self, frame: Frame) -> Int[Array, " tiles"]:
        rule = f"a texture of the tables, which know {self.tables.num_textures}"
        holds = lambda t: self.tables.holds(t.ravel().astype(int)).reshape(t.shape)
        texture = check("frame.texture", frame.texture, holds, rule)
        return texture.ravel().astype(int)

    def _conditions(self, frame: Frame, refresh_rate: ArrayLike) -> tuple[Array, ...]:
        rate = check("refresh_rate", refresh_rate, lambda f: f > 0, "> 0 Hz")
        buffers = (
            frame.mip_level.ravel(),
            frame.velocity_x.ravel(),
            frame.velocity_y.ravel(),
            frame.luminance.ravel(),
            rate,
        )
        return tuple(x.astype(self.tables.dtype) for x in buffers)
