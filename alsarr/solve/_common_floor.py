import equinox as eqx
import jax.numpy as jnp
from jaxtyping import ArrayLike

from ._finish import price, selection
from ._problem import checked, Problem
from ._selection import Selection
from ._threshold import by_shortfall, last_that_fits


def common_floor(
    quality: ArrayLike, cost: ArrayLike, budget: ArrayLike, *, throw: bool = True
) -> Selection:
    """The cheapest rate of each tile whose quality reaches a floor common to all.

    The rule of NAS and of FidelityFX, where the floor is an error that is just
    tolerated. Here it is the highest that the budget allows, found as `lagrangian`
    finds its price: the tile of lowest quality always comes first. A tile that no rate
    lifts to the floor has its best. It is no attempt at the highest total, whose
    distance is in `Selection.gap`.

    **Arguments, returns, raises:** as `lagrangian`.

    **Source:** Yang et al. (2019), Proc. ACM Comput. Graph. Interact. Tech. 2(1),
    Eq. 16, with the threshold as the unknown.
    """
    return _common_floor(checked(quality, cost, budget, throw=throw))


@eqx.filter_jit
def _common_floor(problem: Problem) -> Selection:
    rate, _ = last_that_fits(by_shortfall(problem), problem, -jnp.inf)
    return selection(problem, rate, price(problem))
