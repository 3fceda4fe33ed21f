"""Choices of rates that one threshold rules, and the last of them that fits a budget.

The price of a pixel, the paper's ratio of quality to cost, and a floor of quality are
such thresholds. What fits is found by bisection, since XLA sorts slowly. Rates are
gone through one by one: terms along the tiles fuse into one loop, arrays do not.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

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
        for k, (more, extra) in enumerate(zip(*tiles, strict=True)):
            each = more - price * extra
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
    ratio = [q / c for q, c in zip(problem.quality.T, problem.cost.T, strict=True)]
    ratio = jax.lax.optimization_barrier(ratio)

    def rule(least: Float[Array, ""]) -> Choice:
        gain = spent = jnp.zeros_like(tiles.gain[0])
        rate = cheapest
        for k, (more, extra) in enumerate(zip(*tiles, strict=True)):
            better = (more > gain) | ((more == gain) & (extra < spent))
            better &= ratio[k] >= least
            rate = jnp.where(better, k, rate)
            gain = jnp.where(better, more, gain)
            spent = jnp.where(better, extra, spent)
        return Choice(rate, spent)

    return rule


def by_shortfall(problem: Problem) -> Rule:
    """The cheapest rate whose quality reaches a floor, or else the best.

    The threshold is the floor with its sign turned.
    """
    tiles, cheapest = over_cheapest(problem), problem.cheapest
    quality = list(problem.quality.T)

    def rule(shortfall: Float[Array, ""]) -> Choice:
        best = rate = cheapest
        highest = gain = jnp.zeros_like(tiles.gain[0])
        dearest = highest
        spent = jnp.full_like(gain, jnp.inf)
        for k, (more, extra) in enumerate(zip(*tiles, strict=True)):
            better = (more > highest) | ((more == highest) & (extra < dearest))
            best = jnp.where(better, k, best)
            highest = jnp.where(better, more, highest)
            dearest = jnp.where(better, extra, dearest)
            better = (extra < spent) | ((extra == spent) & (more > gain))
            better &= quality[k] >= -shortfall
            rate = jnp.where(better, k, rate)
            gain = jnp.where(better, more, gain)
            spent = jnp.where(better, extra, spent)
        none = jnp.isinf(spent)
        return Choice(jnp.where(none, best, rate), jnp.where(none, dearest, spent))

    return rule


def last_that_fits(
    rule: Rule, problem: Problem, lowest: float
) -> tuple[Int[Array, " tiles"], Float[Array, ""]]:
    """The dearest choice of a rule within the budget.

    The threshold is bisected among the floating-point numbers, from `lowest` up, until
    two neighbours are left, of which one fits. Tiles that the other one would change
    follow one after another while they fit, and the first that does not has the best of
    its rates that does.

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
    return _one_by_one(problem, rate, more), _number(fits, dtype)


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
    problem: Problem, rate: Int[Array, " tiles"], more: Int[Array, " tiles"]
) -> Int[Array, " tiles"]:
    """Tiles change from one rate to a dearer one, in order, while the budget lasts."""
    cost = problem.cost.T
    left = _left(problem, rate)
    change = pick(cost, more) - pick(cost, rate)
    spent = jnp.cumsum(change)
    tile = jnp.arange(spent.size)
    stop = jnp.min(jnp.where(spent > left, tile, spent.size - 1))
    before = jnp.where(tile < stop, more, rate)

    # The tile where the budget ends has the best that fits, which may be all of it.
    own = rate[stop]
    quality, cost = problem.quality[stop], problem.every_cost[stop]
    affordable = cost - cost[own] <= left - (spent - change)[stop]
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
