import equinox as eqx
from jaxtyping import ArrayLike

from ._finish import better_of, filled, greedy_or_better, selection
from ._problem import checked, Problem
from ._selection import Selection
from ._threshold import by_price, last_that_fits


def lagrangian(
    quality: ArrayLike, cost: ArrayLike, budget: ArrayLike, *, throw: bool = True
) -> Selection:
    r"""Shading rates by the price of a pixel.

    At a price $\lambda$ every tile takes the rate of highest $q_{jk} - \lambda b_{jk}$.
    The lowest price at which all of them fit the budget is found by bisection among the
    floating-point numbers, in a fixed number of steps and without a sort; tiles that
    are worth exactly that price follow in their order, and what is left goes to the
    best changes that fit. The price also bounds the optimum from above
    (`Selection.gap`). The same bisection over the ratios of the paper's algorithm gives
    a second choice, and the better of the two is returned: it is never worse than
    `greedy_jindal2021` (but for the rounding of the sums).

    **Arguments:** as `greedy_jindal2021`; qualities may be negative, and `cost` any
    numbers > 0, whether or not they fall with coarser rates. Traced: `jax.vmap` goes
    over budgets and frames, and one compilation serves all of a size.

    **Returns:** a `Selection` whose cost is at most `budget`.

    **Raises:** as `greedy_jindal2021`.

    **Accuracy:** on the authors' SciFi frame within 0.001 % of the optimum at 10, 25
    and 50 % of full cost (`tests/alsarr/test_alsarr_lagrangian.py`).

    **Source:** Everett (1963), Oper. Res. 11(3), 399-417; the relaxation is that of
    Dyer (1984) and Zemel (1984).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from alsarr import RATES
    >>> from alsarr.solve import lagrangian
    >>> gain = jnp.log2(RATES.cost / 16.0)
    >>> gain = jnp.stack([gain, 10 * gain])  # the second tile matters more
    >>> found = lagrangian(gain, RATES.cost, 256 + 64)
    >>> [RATES.names[i] for i in found.rate], float(found.cost)
    (['2x2', '1x1'], 320.0)
    """
    return _lagrangian(checked(quality, cost, budget, throw=throw))


@eqx.filter_jit
def _lagrangian(problem: Problem) -> Selection:
    rate, price = last_that_fits(by_price(problem), problem, 0.0)
    rate = better_of(problem, rate, greedy_or_better(problem))
    return selection(problem, filled(problem, rate), price)
