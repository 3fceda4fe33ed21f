from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int

from ._finish import better_of, filled, greedy_or_better, selection
from ._problem import checked, Problem
from ._selection import Selection
from ._threshold import pick


def hull(
    quality: ArrayLike, cost: ArrayLike, budget: ArrayLike, *, throw: bool = True
) -> Selection:
    """Shading rates by the increments of each tile's hull, sorted by efficiency.

    The linear relaxation of the knapsack, solved by a sort: increments along the upper
    convex hull of each tile's costs and qualities are taken in the order of quality
    gained over cost added, until the next would not fit. What is left goes to the best
    changes that fit. The efficiency at which the budget ends bounds the optimum
    (`Selection.gap`). As with `lagrangian`, whose choice it confirms by another way and
    more slowly, the result is never worse than that of `greedy_jindal2021` (but for the
    rounding of the sums).

    **Arguments, returns, raises:** as `lagrangian`.

    **Source:** Dyer (1984), Math. Program. 29, 57-63, and Zemel (1984), Inf. Process.
    Lett. 18, 123-128.
    """
    return _hull(checked(quality, cost, budget, throw=throw))


@eqx.filter_jit
def _hull(problem: Problem) -> Selection:
    rate, price = _relaxed(problem, _increments(problem))
    rate = better_of(problem, rate, greedy_or_better(problem))
    return selection(problem, filled(problem, rate), price)


class _Increments(NamedTuple):
    """Steps along the hulls, each tile's one after another.

    - `efficiency`: quality gained over cost added, falling; -inf where there is none.
    - `cost`: added.
    - `rate`: reached.
    """

    efficiency: Float[Array, "steps tiles"]
    cost: Float[Array, "steps tiles"]
    rate: Int[Array, "steps tiles"]


def _increments(problem: Problem) -> _Increments:
    """From the cheapest rate always to the most efficient, of equal ones the dearest.

    That is the upper convex hull of a tile's costs and qualities.
    """
    quality, cost = problem.quality.T, problem.every_cost.T
    rates, start = quality.shape[0], problem.cheapest

    def step(at, _):
        rate, at_quality, at_cost, slope = at
        best = jnp.full_like(at_quality, -jnp.inf)
        to, to_quality, to_cost = rate, at_quality, at_cost
        for k in range(rates):
            gain, extra = quality[k] - at_quality, cost[k] - at_cost
            usable = (gain > 0) & (extra > 0)
            each = jnp.where(usable, gain / jnp.where(usable, extra, 1), -jnp.inf)
            better = (each > best) | ((each == best) & usable & (cost[k] > to_cost))
            best = jnp.where(better, each, best)
            to = jnp.where(better, k, to)
            to_quality = jnp.where(better, quality[k], to_quality)
            to_cost = jnp.where(better, cost[k], to_cost)
        # Rounding must not make a later increment more efficient than an earlier one.
        slope = jnp.minimum(slope, best)
        found = _Increments(slope, to_cost - at_cost, to)
        return (to, to_quality, to_cost, slope), found

    at = start, pick(quality, start), pick(cost, start)
    at = *at, jnp.full(start.shape, jnp.inf, quality.dtype)
    # A loop, since unrolled steps are compiled for minutes.
    return jax.lax.scan(step, at, length=max(rates - 1, 1))[1]


def _relaxed(
    problem: Problem, steps: _Increments
) -> tuple[Int[Array, " tiles"], Float[Array, ""]]:
    """Rates before the first increment that does not fit, and its efficiency."""
    flat = steps.efficiency.T.ravel()
    order = jnp.argsort(flat, stable=True, descending=True)
    sorted_out = flat[order]
    exists = sorted_out > -jnp.inf
    spent = jnp.cumsum(jnp.where(exists, steps.cost.T.ravel()[order], 0))
    taken = exists & (spent <= problem.left)
    # A tile's increments are taken in their order, so their number tells the rate.
    tile = order // steps.rate.shape[0]
    count = jnp.zeros(steps.rate.shape[1], int).at[tile].add(taken.astype(int))
    rate = problem.cheapest
    for k in range(steps.rate.shape[0]):
        rate = jnp.where(count > k, steps.rate[k], rate)
    ended = jnp.argmin(taken)
    price = jnp.where(jnp.all(taken) | ~exists[ended], 0, sorted_out[ended])
    return rate, price
