"""From a choice of rates to a selection: what is left is spent, and the gap proved."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ._problem import Problem
from ._selection import Selection
from ._threshold import by_price, by_ratio, last_that_fits, pick


# What increments in order of efficiency leave is less than the dearest of them.
_ROUNDS = 16


def price(problem: Problem) -> Float[Array, ""]:
    """Of one unit of cost, where the budget binds; 0 where it does not."""
    return last_that_fits(by_price(problem), problem, 0.0)[1]


def greedy_or_better(problem: Problem) -> Int[Array, " tiles"]:
    """What the paper's greedy algorithm would choose, or a choice that is better.

    Its states are those of `by_ratio`, each better than the one before; it ends at the
    first that is followed by one that does not fit, this at any such.
    """
    return last_that_fits(by_ratio(problem), problem, -jnp.inf, last_in_part=True)[0]


def better_of(
    problem: Problem, one: Int[Array, " tiles"], other: Int[Array, " tiles"]
) -> Int[Array, " tiles"]:
    """The choice of higher quality."""
    total = lambda rate: jnp.sum(pick(problem.quality.T, rate))
    return jnp.where(total(other) > total(one), other, one)


def filled(problem: Problem, rate: Int[Array, " tiles"]) -> Int[Array, " tiles"]:
    """Spend what a choice leaves, each time on the most efficient change that fits.

    At most sixteen changes are made.
    """
    quality, cost = problem.quality.T, problem.cost.T

    def best_change(rate):
        at_quality, at_cost = pick(quality, rate), pick(cost, rate)
        left = problem.budget - jnp.sum(at_cost)
        best, to = jnp.zeros_like(at_quality), rate
        for k in range(quality.shape[0]):
            gain, extra = quality[k] - at_quality, cost[k] - at_cost
            usable = (gain > 0) & (extra <= left)
            each = gain / jnp.where(extra > 0, extra, jnp.finfo(extra.dtype).tiny)
            better = usable & (each > best)
            best = jnp.where(better, each, best)
            to = jnp.where(better, k, to)
        tile = jnp.argmax(best)
        return tile, to[tile], best[tile] > 0

    def change(state):
        rate, (tile, to, _), count = state
        rate = jnp.where(jnp.arange(rate.size) == tile, to, rate)
        return rate, best_change(rate), count + 1

    goes_on = lambda state: state[1][2] & (state[2] < _ROUNDS)
    return jax.lax.while_loop(goes_on, change, (rate, best_change(rate), 0))[0]


def selection(
    problem: Problem, rate: Int[Array, " tiles"], price: Float[Array, ""]
) -> Selection:
    r"""What a choice buys, and how far it can be from the best.

    At a price $\lambda \ge 0$ of one unit of cost, no choice within the budget $B$ is
    better than $\sum_j \max_k (q_{jk} - \lambda b_{jk}) + \lambda B$. The gap to it is
    a sum of terms none of which is negative, so it loses nothing to rounding.
    """
    quality, cost = problem.quality.T, problem.cost.T
    at_quality, at_cost = pick(quality, rate), pick(cost, rate)
    missed = jnp.zeros_like(at_quality)
    for k in range(quality.shape[0]):
        gain, extra = quality[k] - at_quality, cost[k] - at_cost
        missed = jnp.maximum(missed, gain - price * extra)
    spent = jnp.sum(at_cost)
    left = jnp.maximum(problem.budget - spent, 0)
    # A price of 0 leaves nothing to pay for a budget without an end.
    unspent = jnp.where(price > 0, price * left, 0)
    feasible = problem.left >= 0
    return Selection(
        rate=rate,
        quality=jnp.sum(at_quality),
        cost=spent,
        gap=jnp.where(feasible, jnp.sum(missed) + unspent, 0),
        feasible=feasible,
    )
