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
        count = self.tables.num_textures
        rule = f"less than the number of textures in the tables, {count}"
        texture = check("frame.texture", frame.texture, lambda t: t < count, rule)
        return self.tables.quality(texture.ravel().astype(int), *conditions)

    def count_outside(self, frame: Frame, refresh_rate: ArrayLike) -> Int[Array, ""]:
        """How many tiles show conditions that the tables were not fitted to."""
        return jnp.sum(self.tables.outside(*self._conditions(frame, refresh_rate)))

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
