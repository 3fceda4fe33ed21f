import equinox as eqx
from jaxtyping import ArrayLike

from ._finish import price, selection
from ._problem import checked, Problem
from ._selection import Selection
from ._threshold import by_shortfall, last_that_fits


def common_threshold(
    quality: ArrayLike, cost: ArrayLike, budget: ArrayLike, *, throw: bool = True
) -> Selection:
    """The cheapest rate of each tile that loses no more than is tolerated of all.

    The rule of NAS and of FidelityFX, where an error is just tolerated. Here the loss,
    how far a rate falls short of the best of its tile, is the smallest that the budget
    allows, found as `lagrangian` finds its price: the tile that loses most always comes
    first. It is no attempt at the highest total, whose distance is in `Selection.gap`.

    **Arguments, returns, raises:** as `lagrangian`.

    **Source:** Yang et al. (2019), Proc. ACM Comput. Graph. Interact. Tech. 2(1),
    Eq. 16, with the threshold as the unknown.
    """
    return _common_threshold(checked(quality, cost, budget, throw=throw))


@eqx.filter_jit
def _common_threshold(problem: Problem) -> Selection:
    rate, _ = last_that_fits(by_shortfall(problem), problem, 0.0)
    return selection(problem, rate, price(problem))
