import equinox as eqx
from jaxtyping import Array, Bool, Float, Int


class Selection(eqx.Module, strict=True):
    """One shading rate for every tile, and what it buys.

    - `rate`: index of the rate of each tile, in the order of `alsarr.RATES`.
    - `quality`: total over the tiles. [JND]
    - `cost`: total over the tiles, in the unit of the costs that were given.
    - `feasible`: whether the cheapest rate of every tile fits the budget; if not,
        `rate` is the first rate everywhere.
    """

    rate: Int[Array, " tiles"]
    quality: Float[Array, ""]
    cost: Float[Array, ""]
    feasible: Bool[Array, ""]
