from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int

from .._frame import Frame
from ..tables import AbstractTables
from ._base import AbstractQualityOracle
from ._checks import checked_refresh_rate, known_texture


class TableOracle(AbstractQualityOracle, strict=True):
    """Looks the tiles of a frame up in polynomial tables.

    - `tables`: either layout of `alsarr.tables`.
    - `missing`: what becomes of a tile whose texture has no table. `"nearest"` judges
        it by the texture nearest to the middle of those that have one: its gain from
        4x4 to 1x1 in the frame's mean condition is their median, the lower of two.
        `count_outside` tells of how many tiles. `"error"` fails.
    """

    tables: AbstractTables
    missing: Literal["nearest", "error"] = eqx.field(static=True, default="nearest")

    unit: ClassVar[str] = "JND"

    def quality(self, frame: Frame, refresh_rate: ArrayLike) -> Float[Array, "tiles 7"]:
        """See `AbstractQualityOracle.quality`.

        **Raises:** also for a texture index that the tables do not hold, if `missing`
        is `"error"`.
        """
        conditions = self._conditions(frame, refresh_rate)
        if self.missing == "error":
            return self.tables.quality(self._texture(frame), *conditions)
        texture = frame.texture.ravel().astype(int)
        return self.tables.quality(self._nearest(texture, *conditions), *conditions)

    def count_outside(self, frame: Frame, refresh_rate: ArrayLike) -> Int[Array, ""]:
        """See `AbstractQualityOracle.count_outside`."""
        texture = frame.texture.ravel().astype(int)
        conditions = self._conditions(frame, refresh_rate)
        outside = self.tables.outside(texture, *conditions)
        return jnp.sum(outside | ~self.tables.holds(texture))

    def _nearest(
        self, texture: Int[Array, " tiles"], *conditions: Array
    ) -> Int[Array, " tiles"]:
        """The texture itself where it has a table."""
        every = jnp.arange(self.tables.num_textures)
        *buffers, rate = conditions
        # One condition for all: which is in the middle hardly depends on it.
        mean = [jnp.broadcast_to(jnp.mean(x), every.shape) for x in buffers]
        level, velocity_x, velocity_y, luminance = mean
        quality = self.tables.quality(
            every, level, velocity_x, velocity_y, luminance, rate
        )
        held = self.tables.holds(every)
        gain = jnp.where(held, quality[:, -1] - quality[:, 0], jnp.inf)
        stand_in = jnp.argsort(gain)[(jnp.sum(held) - 1) // 2]
        return jnp.where(self.tables.holds(texture), texture, stand_in)

    def _texture(self, frame: Frame) -> Int[Array, " tiles"]:
        rule = f"a texture of the tables, which know {self.tables.num_textures}"
        return known_texture(frame, self.tables.holds, rule)

    def _conditions(self, frame: Frame, refresh_rate: ArrayLike) -> tuple[Array, ...]:
        buffers = (
            frame.mip_level.ravel(),
            frame.velocity_x.ravel(),
            frame.velocity_y.ravel(),
            frame.luminance.ravel(),
            checked_refresh_rate(refresh_rate),
        )
        return tuple(x.astype(self.tables.dtype) for x in buffers)
