import equinox as eqx
import jax.numpy as jnp
from jaxtyping import ArrayLike

from ._finish import price, selection
from ._problem import checked, Problem
from ._selection import Selection


def uniform(
    quality: ArrayLike, cost: ArrayLike, budget: ArrayLike, *, throw: bool = True
) -> Selection:
    """One shading rate for the whole frame: the best of those that fit the budget.

    What a renderer does that knows nothing of its tiles. Where costs differ so much
    from tile to tile that no single rate fits, every tile has its cheapest.

    **Arguments, returns, raises:** as `lagrangian`.
    """
    return _uniform(checked(quality, cost, budget, throw=throw))


@eqx.filter_jit
def _uniform(problem: Problem) -> Selection:
    fits = jnp.sum(problem.every_cost, axis=0) <= problem.budget
    total = jnp.where(fits, jnp.sum(problem.quality, axis=0), -jnp.inf)
    same = jnp.full(problem.quality.shape[0], jnp.argmax(total))
    rate = jnp.where(jnp.any(fits), same, problem.cheapest)
    return selection(problem, rate, price(problem))
