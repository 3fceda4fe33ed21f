import equinox as eqx
from jaxtyping import Array, Bool, Float, Int


class Selection(eqx.Module, strict=True):
    """One shading rate for every tile, and what it buys.

    - `rate`: index of the rate of each tile, in the order of `alsarr.RATES`.
    - `quality`: total over the tiles, in the unit of the qualities that were given.
    - `cost`: total over the tiles, in the unit of the costs that were given.
    - `gap`: how much higher the total of a better choice within the budget could be at
        the most, from the dual of the problem. >= 0; 0 proves the best choice.
    - `feasible`: whether the cheapest rate of every tile fits the budget; if not,
        `rate` is the cheapest everywhere, and `gap` is 0.
    """

    rate: Int[Array, " tiles"]
    quality: Float[Array, ""]
    cost: Float[Array, ""]
    gap: Float[Array, ""]
    feasible: Bool[Array, ""]

    @property
    def bound(self) -> Float[Array, "..."]:
        """No choice within the budget has a higher total."""
        return self.quality + self.gap
