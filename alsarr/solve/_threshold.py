"""Choices of rates that one threshold rules, and the last of them that fits a budget.

The price of a pixel, the paper's ratio of quality to cost, and a tolerated loss are
such thresholds. What fits is found by bisection, since XLA sorts slowly. Rates are gone
through one by one: terms along the tiles fuse into one loop, arrays do not.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ._problem import Problem


class Choice(NamedTuple):
    """A rate for each tile, and its cost above the cheapest."""

    rate: Int[Array, " tiles"]
    extra: Float[Array, " tiles"]


Rule = Callable[[Float[Array, ""]], Choice]
"""What each tile takes at a threshold. A higher one makes no tile dearer."""


class Tiles(NamedTuple):
    """Every rate over the cheapest of its tile, one entry a rate.

    - `gain`: quality above that of the cheapest.
    - `extra`: cost above that of the cheapest.
    """

    gain: list[Float[Array, " tiles"]]
    extra: list[Float[Array, " #tiles"]]


def over_cheapest(problem: Problem) -> Tiles:
    quality, cost = problem.quality.T, problem.cost.T
    base, least = pick(quality, problem.cheapest), jnp.min(cost, axis=0)
    gain = [one - base for one in quality]
    extra = [one - least for one in cost]
    # Otherwise both are computed anew at every threshold.
    return Tiles(*jax.lax.optimization_barrier((gain, extra)))


def by_price(problem: Problem) -> Rule:
    r"""At a price $\lambda$ of a unit of cost, the rate of highest $q - \lambda b$."""
    tiles, cheapest = over_cheapest(problem), problem.cheapest

    def rule(price: Float[Array, ""]) -> Choice:
        value = spent = jnp.zeros_like(tiles.gain[0])
        rate = cheapest
        # Fused with the subtraction they would be rounded in one way or another.
        prices = jax.lax.optimization_barrier([price * extra for extra in tiles.extra])
        for k, (more, extra) in enumerate(zip(*tiles, strict=True)):
            each = more - prices[k]
            better = each > value
            value = jnp.where(better, each, value)
            rate = jnp.where(better, k, rate)
            spent = jnp.where(better, extra, spent)
        return Choice(rate, spent)

    return rule


def by_ratio(problem: Problem) -> Rule:
    """The best of the rates whose own quality over cost reaches a ratio.

    These are the states that the paper's greedy algorithm goes through; of equally good
    rates the cheapest is taken.
    """
    tiles, cheapest = over_cheapest(problem), problem.cheapest
    quality, cost = problem.quality.T, problem.cost.T
    ratio = [q / c for q, c in zip(quality, cost, strict=True)]
    gain = [
        jnp.where(_has_cheaper_equal(quality, cost, k), -jnp.inf, more)
        for k, more in enumerate(tiles.gain)
    ]
    ratio, gain = jax.lax.optimization_barrier((ratio, gain))

    def rule(least: Float[Array, ""]) -> Choice:
        best = spent = jnp.zeros_like(gain[0])
        rate = cheapest
        for k, (more, extra) in enumerate(zip(gain, tiles.extra, strict=True)):
            better = (ratio[k] >= least) & (more > best)
            rate = jnp.where(better, k, rate)
            best = jnp.where(better, more, best)
            spent = jnp.where(better, extra, spent)
        return Choice(rate, spent)

    return rule


def _has_cheaper_equal(
    quality: Float[Array, "rates tiles"], cost: Float[Array, "rates _"], k: int
) -> Bool[Array, " tiles"]:
    """Whether another rate is as good as rate `k` and costs less."""
    found = jnp.zeros(quality.shape[1:], bool)
    for i in range(len(quality)):
        found |= (quality[i] == quality[k]) & (cost[i] < cost[k])
    return found


def by_shortfall(problem: Problem) -> Rule:
    """The cheapest rate that falls short of its tile's best by no more. From 0."""
    tiles, cheapest = over_cheapest(problem), problem.cheapest
    best_of_all = jnp.max(problem.quality, axis=1)
    short = jax.lax.optimization_barrier([best_of_all - q for q in problem.quality.T])

    def rule(shortfall: Float[Array, ""]) -> Choice:
        gain = jnp.zeros_like(best_of_all)
        rate, spent = cheapest, jnp.full_like(gain, jnp.inf)
        for k, (more, extra) in enumerate(zip(*tiles, strict=True)):
            better = (extra < spent) | ((extra == spent) & (more > gain))
            better &= short[k] <= shortfall
            rate = jnp.where(better, k, rate)
            gain = jnp.where(better, more, gain)
            spent = jnp.where(better, extra, spent)
        return Choice(rate, spent)

    return rule


def last_that_fits(
    rule: Rule, problem: Problem, lowest: float, *, last_in_part: bool = False
) -> tuple[Int[Array, " tiles"], Float[Array, ""]]:
    """The dearest choice of a rule within the budget.

    The threshold is bisected among the floating-point numbers, from `lowest` up, until
    two neighbours are left, of which one fits. Tiles that the other one would change
    follow one after another while they fit; the first that does not has, with
    `last_in_part`, the best of its rates that does.

    **Returns:** the rates, and the threshold that fits.
    """
    left, dtype = problem.left, problem.quality.dtype
    unlimited = jnp.asarray(lowest, dtype)
    highest = _ordered(jnp.asarray(jnp.finfo(dtype).max, dtype))

    def halve(_, ends):
        fits_not, fits = ends
        middle = (fits_not >> 1) + (fits >> 1) + (fits_not & fits & 1)
        ok = jnp.sum(rule(_number(middle, dtype)).extra) <= left
        return jnp.where(ok, fits_not, middle), jnp.where(ok, middle, fits)

    steps = 8 * dtype.itemsize
    ends = jax.lax.fori_loop(0, steps, halve, (_ordered(unlimited), highest))
    everything = jnp.sum(rule(unlimited).extra) <= left
    fits_not, fits = (jnp.where(everything, _ordered(unlimited), end) for end in ends)
    fits, rate = _that_fits(rule, problem, fits, highest)
    more = rule(_number(fits_not, dtype)).rate
    return _one_by_one(problem, rate, more, last_in_part), _number(fits, dtype)


def _that_fits(
    rule: Rule, problem: Problem, fits: Int[Array, ""], highest: Int[Array, ""]
) -> tuple[Int[Array, ""], Int[Array, " tiles"]]:
    """The threshold or a slightly higher one, and what it chooses.

    A rule that is compiled twice may round in two ways, and a tile that is worth just
    the price may change; so what is returned is what was added up.
    """

    def at(threshold):
        rate = rule(_number(threshold, problem.quality.dtype)).rate
        # Otherwise the sum and the rates are compiled apart, each with its own rule.
        return threshold, jax.lax.optimization_barrier(rate)

    def next_one(state):
        (threshold, _), step = state
        step = jnp.minimum(step, highest - threshold)
        return at(threshold + step), 2 * step

    fits_not = lambda state: (_left(problem, state[0][1]) < 0) & (state[0][0] < highest)
    one = jnp.ones_like(fits)
    return jax.lax.while_loop(fits_not, next_one, (at(fits), one))[0]


def _left(problem: Problem, rate: Int[Array, " tiles"]) -> Float[Array, ""]:
    """What a choice leaves of the budget."""
    return problem.budget - jnp.sum(pick(problem.cost.T, rate))


def _one_by_one(
    problem: Problem,
    rate: Int[Array, " tiles"],
    more: Int[Array, " tiles"],
    last_in_part: bool,
) -> Int[Array, " tiles"]:
    """Tiles change from one rate to a dearer one, in order, while the budget lasts."""
    cost = problem.cost.T
    left = _left(problem, rate)
    change = pick(cost, more) - pick(cost, rate)
    spent = jnp.cumsum(change)
    tile = jnp.arange(spent.size)
    stop = jnp.min(jnp.where(spent > left, tile, spent.size))
    before = jnp.where(tile < stop, more, rate)
    if not last_in_part:
        return before
    stop = jnp.minimum(stop, spent.size - 1)
    own = before[stop]
    quality, cost = problem.quality[stop], problem.every_cost[stop]
    affordable = cost - cost[own] <= _left(problem, before)
    best = jnp.argmax(jnp.where(affordable, quality, -jnp.inf))
    better = affordable[best] & (quality[best] > quality[own])
    best = jnp.where(better, best, own)
    return jnp.where(tile == stop, best, before)


def pick(
    values: Float[Array, "rates _"], rate: Int[Array, " tiles"]
) -> Float[Array, " tiles"]:
    """Value at each tile's rate; selections fuse where a gather does not."""
    found = jnp.zeros(rate.shape, values.dtype)
    for k, value in enumerate(values):
        found = jnp.where(rate == k, value, found)
    return found


def _ordered(x: Float[Array, ""]) -> Int[Array, ""]:
    """Whole numbers in the order of floating ones, neighbours next to each other."""
    kind = jnp.int32 if x.dtype == jnp.float32 else jnp.int64
    bits = jax.lax.bitcast_convert_type(x, kind)
    return jnp.where(bits < 0, bits ^ jnp.iinfo(kind).max, bits)


def _number(order: Int[Array, ""], dtype: jnp.dtype) -> Float[Array, ""]:
    bits = jnp.where(order < 0, order ^ jnp.iinfo(order.dtype).max, order)
    return jax.lax.bitcast_convert_type(bits, dtype)
