"""What shading costs, and how much of it a frame may take."""

from abc import abstractmethod
from typing import ClassVar, TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from camojab._errors import check

from ._frame import Frame
from ._rates import RATES


if TYPE_CHECKING:
    from typing import ClassVar as AbstractClassVar
else:
    from equinox import AbstractClassVar


class AbstractCost(eqx.Module, strict=True):
    """What each shading rate costs on each tile of a frame.

    - `unit`: of the costs, "px" or "ms".
    """

    unit: AbstractClassVar[str]

    @property
    @abstractmethod
    def shared(self) -> bool:
        """Whether all tiles cost alike, which solvers make use of."""

    @abstractmethod
    def of(self, frame: Frame) -> Float[Array, "tiles 7"]:
        """Costs in `unit`, > 0; tiles row by row, rates in the order of `RATES`."""


class PixelCost(AbstractCost, strict=True):
    """Shaded pixels, 256/(mn) a tile (Jindal et al. 2021, Eq. 27).

    - `size_px`: width and height of the picture, which make the tiles at its right and
      lower edge smaller; whole tiles if left out.

    **Raises:** `ValueError` for a size below 1 px; `of`, if a frame has other numbers
    of tiles.

    **Example:**

    >>> from alsarr import PixelCost, procedural_frame
    >>> frame = procedural_frame(3, rows=2, columns=3, seed=1)
    >>> PixelCost(size_px=(40, 32)).of(frame)[2].tolist()  # half a tile is left
    [8.0, 16.0, 16.0, 32.0, 64.0, 64.0, 128.0]
    """

    size_px: tuple[int, int] | None = eqx.field(static=True, default=None)

    unit: ClassVar[str] = "px"

    def __check_init__(self):
        if self.size_px is not None and min(self.size_px) < 1:
            raise ValueError(
                f"`size_px` must be a width and a height >= 1 px, got {self.size_px}."
            )

    @property
    def shared(self) -> bool:
        """See `AbstractCost.shared`."""
        return self.size_px is None

    def of(self, frame: Frame) -> Float[Array, "tiles 7"]:
        """See `AbstractCost.of`."""
        cost = jnp.asarray(RATES.cost, float)[None]
        if self.size_px is None:
            return jnp.broadcast_to(cost, (frame.texture.size, len(RATES)))
        width, height = (_extent(n) for n in self.size_px)
        if frame.shape != (height.size, width.size):
            raise ValueError(
                f"`size_px` must be that of a picture with {frame.shape[0]} rows and "
                f"{frame.shape[1]} columns of tiles, got {self.size_px}."
            )
        share = (height[:, None] * width[None]).ravel() / 256
        return share[:, None] * cost


class MeasuredCost(AbstractCost, strict=True):
    """Time that was measured for each texture at each shading rate.

    - `milliseconds`: a tile of each texture at each rate. [ms], finite and > 0. They
      need not fall with coarser rates.

    **Raises:** `ValueError` for another shape and for times out of range; `of`, for a
    texture without times.
    """

    milliseconds: Float[Array, "textures 7"]

    unit: ClassVar[str] = "ms"

    def __init__(self, milliseconds: ArrayLike):
        times = check("milliseconds", milliseconds, _positive, "> 0 ms and finite")
        if times.ndim != 2 or times.shape[1] != len(RATES):
            raise ValueError(
                f"`milliseconds` must have shape [textures, {len(RATES)}], got "
                f"{times.shape}."
            )
        self.milliseconds = times

    @property
    def shared(self) -> bool:
        """See `AbstractCost.shared`."""
        return False

    def of(self, frame: Frame) -> Float[Array, "tiles 7"]:
        """See `AbstractCost.of`."""
        known = self.milliseconds.shape[0]
        rule = f"a texture with measured times, of which there are {known}"
        texture = check("frame.texture", frame.texture, lambda t: t < known, rule)
        return self.milliseconds[texture.ravel().astype(int)]


class TileCost(AbstractCost, strict=True):
    """Costs of one's own for every tile.

    - `cost`: one row a tile. [px], finite and > 0.

    **Raises:** `ValueError` for another shape and for costs out of range; `of`, for a
    frame of another number of tiles.
    """

    cost: Float[Array, "tiles 7"]

    unit: ClassVar[str] = "px"

    def __init__(self, cost: ArrayLike):
        self.cost = check("cost", cost, _positive, "> 0 px and finite")
        if self.cost.ndim != 2 or self.cost.shape[1] != len(RATES):
            raise ValueError(
                f"`cost` must have shape [tiles, {len(RATES)}], got {self.cost.shape}."
            )

    @property
    def shared(self) -> bool:
        """See `AbstractCost.shared`."""
        return False

    def of(self, frame: Frame) -> Float[Array, "tiles 7"]:
        """See `AbstractCost.of`."""
        if self.cost.shape[0] != frame.texture.size:
            raise ValueError(
                f"`cost` must have a row for each of {frame.texture.size} tiles, got "
                f"{self.cost.shape[0]}."
            )
        return self.cost


class Budget(eqx.Module, strict=True):
    """How much a frame, or a second, may take.

    Made by `share`, `pixels_per_frame`, `pixels_per_second` or `milliseconds`.
    """

    amount: Float[Array, ""]
    unit: str = eqx.field(static=True)

    @classmethod
    def share(cls, amount: ArrayLike) -> "Budget":
        """Part of what full rate everywhere takes at the highest refresh rate.

        In (0, 1]. At lower refresh rates a frame has more: the budget is one of time.
        """
        rule = "in (0, 1]"
        return cls(check("share", amount, lambda x: (x > 0) & (x <= 1), rule), "share")

    @classmethod
    def pixels_per_frame(cls, amount: ArrayLike) -> "Budget":
        """Shaded pixels of every frame, whatever its refresh rate. [px], > 0."""
        return cls(check("pixels", amount, _positive, "> 0 px and finite"), "px")

    @classmethod
    def pixels_per_second(cls, amount: ArrayLike) -> "Budget":
        """Shaded pixels a second (Eq. 25). [px/s], > 0."""
        return cls(check("pixels", amount, _positive, "> 0 px/s and finite"), "px/s")

    @classmethod
    def milliseconds(cls, amount: ArrayLike) -> "Budget":
        """Time of every frame, whatever its refresh rate. [ms], > 0."""
        rule = "> 0 ms and finite"
        return cls(check("milliseconds", amount, _positive, rule), "ms")

    def check_unit(self, cost: AbstractCost) -> None:
        """**Raises:** `ValueError` if costs are in another unit than the budget."""
        if self.unit != "share" and self.unit.removesuffix("/s") != cost.unit:
            raise ValueError(
                f"`budget` must be a share or in the unit of the costs, {cost.unit}, "
                f"got {self.unit}."
            )

    def of_frame(
        self,
        cost: Float[Array, "tiles 7"],
        refresh_rate: Float[Array, ""],
        highest: Float[Array, ""],
    ) -> Float[Array, ""]:
        """What a frame at `refresh_rate` may take, in the unit of `cost`.

        `highest` is the highest refresh rate that the display may be given. [Hz]
        """
        amount = self.amount.astype(cost.dtype)
        if self.unit == "share":
            return amount * jnp.sum(cost[:, -1]) * (highest / refresh_rate)
        return amount / refresh_rate if self.unit == "px/s" else amount


def _extent(pixels: int) -> Float[Array, " tiles"]:
    """Pixels of each tile along an axis: sixteen, and what is left."""
    whole, rest = divmod(pixels, 16)
    return jnp.asarray([16.0] * whole + [float(rest)] * (rest > 0), float)


def _positive(x: Array) -> Array:
    return (x > 0) & jnp.isfinite(x)
