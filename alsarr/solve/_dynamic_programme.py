import functools
import math

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from ._problem import checked, Problem
from ._selection import Selection


# Beyond this the table would take gigabytes; costs with no common unit get here too.
_LARGEST = 2**24


def dynamic_programme(
    quality: ArrayLike, cost: ArrayLike, budget: ArrayLike, *, throw: bool = True
) -> Selection:
    """The best choice of shading rates there is: exact, for the others to be held to.

    A dynamic programme over tiles and whole units of cost. Costs may differ from tile
    to tile and need not fall with coarser rates. Of equally good choices the one that
    costs least is returned; of several such, the one with the first rate on the last
    tile, then on the tile before it, and so on.

    **Arguments:**

    - `quality`: quality of every rate on every tile, shape `[tiles, rates]`. [JND],
        finite. May be traced: jit and vmap over qualities work.
    - `cost`: cost of every rate, shape `[rates]` or `[tiles, rates]`. Any unit, > 0.
        Within a tile they must differ by whole multiples of a common unit, which is
        found from the values: 16 for `RATES.cost`, 1 for `RATES.relative_cost`. Round
        measured times to whole microseconds, for example: decimals such as 0.1 have no
        such unit in binary. Not traced.
    - `budget`: total cost allowed, in the unit of `cost`. Not traced: the size of the
        table depends on it. Budgets that differ by a few per cent mostly share a
        compilation.
    - `throw`: fail if the cheapest rate of every tile exceeds the budget; otherwise see
        `Selection.feasible`.

    **Returns:** a `Selection` whose cost is at most `budget` and whose `gap` is 0.

    **Raises:** as `lagrangian`; also `ValueError` for a traced cost or budget, and for
    a budget that holds more than 2^24 of the common unit above the cheapest rates,
    which tells that costs have no useful unit.

    **Accuracy:** exact up to the rounding of single qualities. What is added up is how
    far each tile falls below its best at a price that just spends the budget; along
    good choices that is next to nothing, so the sums hardly round, in float32 too.

    **Speed and memory:** `tiles * rates * units` additions and comparisons, `units`
    being what the budget holds above the cheapest rates: it grows with the square of
    the number of tiles. 8 040 tiles take 0.2, 0.3 and 0.6 s in float32 and 0.3, 0.6 and
    1.9 s in float64 at 10, 25 and 50 % of full cost, on two cores, after up to 1 s of
    compilation. Kept are a row of values every `sqrt(itemsize * tiles)` tiles and the
    choices of the tiles between two rows, together about
    `2 * sqrt(itemsize * tiles) * units` bytes at the most: 13 and 19 MB for those tiles
    at 50 %.

    **Source:** Dudzinski and Walukiewicz (1987), Eur. J. Oper. Res. 28(1), 3-21, for
    the recursion; rows kept at intervals as by Grice, Hughey and Speck (1997), Comput.
    Appl. Biosci. 13(1), 45-53.
    """
    problem = checked(quality, cost, budget, throw=throw)
    known = _known("cost", cost), _known("budget", budget)
    units, capacity = _in_units(*known, problem.quality.shape)
    slots = _rounded_up(capacity + 1)
    # A rate beyond the budget reads only the padding.
    padding = min(slots, 1 << max(int(units.max()).bit_length(), 4))
    units = np.minimum(units, padding).astype(np.int32)
    units, capacity = jnp.asarray(units), jnp.asarray(capacity, problem.quality.dtype)
    return _solve(problem, units, capacity, slots, padding)


def _known(name: str, x: ArrayLike) -> Float[np.ndarray, "..."]:
    if isinstance(x, jax.core.Tracer):
        raise ValueError(
            f"`{name}` must be known before the computation is compiled, because the "
            f"size of the table depends on it, got a traced value."
        )
    return np.asarray(x, np.float64)


def _in_units(
    cost: Float[np.ndarray, "..."],
    budget: Float[np.ndarray, ""],
    shape: tuple[int, ...],
) -> tuple[Float[np.ndarray, "tiles rates"], int]:
    """Costs and budget above the cheapest rates, in whole units."""
    cost = np.broadcast_to(cost, shape)
    least = cost.min(axis=1, keepdims=True)
    above = cost - least
    # Remainders of floating-point numbers are exact, and so is the divisor.
    unit = functools.reduce(_common_divisor, np.unique(above).tolist(), 0.0) or 1.0
    left = min(float(budget) - least.sum(), above.max(axis=1).sum())
    capacity = max(left / unit, 0.0)
    if capacity > _LARGEST:
        raise ValueError(
            f"`cost` must be whole multiples of a common unit of which the budget "
            f"holds at most {_LARGEST} above the cheapest rates (write times in whole "
            f"microseconds, for example), got {capacity:g} units of {unit:g}."
        )
    return above / unit, math.floor(capacity)


def _common_divisor(a: float, b: float) -> float:
    while b:
        a, b = b, math.fmod(a, b)
    return a


def _rounded_up(size: int) -> int:
    """Near sizes become one, at most an eighth larger, and share a compilation."""
    step = max(64, 1 << max(size.bit_length() - 4, 0))
    return -(-size // step) * step


@eqx.filter_jit
def _solve(
    problem: Problem,
    units: Int[Array, "tiles rates"],
    capacity: Float[Array, ""],
    slots: int,
    padding: int,
) -> Selection:
    price = _price(problem.quality, units, capacity)
    loss = _loss(problem.quality, units, price)
    left = capacity - jnp.arange(slots, dtype=loss.dtype)
    unused = jnp.where(left < 0, jnp.inf, price * left)
    rate = _least_loss(loss, units, unused, padding)
    pick = lambda x: jnp.sum(jnp.take_along_axis(x, rate[:, None], axis=1))
    found = pick(problem.quality)
    return Selection(
        rate=rate,
        quality=found,
        cost=pick(problem.every_cost),
        gap=jnp.zeros_like(found),
        feasible=problem.left >= 0,
    )


def _least_loss(
    loss: Float[Array, "tiles rates"],
    units: Int[Array, "tiles rates"],
    unused: Float[Array, " slots"],
    padding: int,
) -> Int[Array, " tiles"]:
    """The rates of least loss, what is lost by the units that are not used included."""
    tiles, rates = loss.shape
    block = math.ceil(math.sqrt(loss.dtype.itemsize * tiles))
    count = -(-tiles // block)
    # Tiles that cost and lose nothing fill the last block.
    in_blocks = lambda x: jnp.pad(x, ((0, count * block - tiles), (0, 0))).reshape(
        count, block, rates
    )
    blocks = in_blocks(loss), in_blocks(units)
    # Column `padding + w` of a row is the least loss at a cost of exactly w units.
    row = jnp.full(padding + unused.size, jnp.inf, loss.dtype).at[padding].set(0)
    through = functools.partial(_block_through, padding=padding)
    row, rows = jax.lax.scan(through, row, blocks)
    end = jnp.argmin(row[padding:] + unused).astype(units.dtype)
    back = functools.partial(_block_back, padding=padding)
    _, rate = jax.lax.scan(back, end, (rows, *blocks), reverse=True)
    return rate.ravel()[:tiles]


def _price(
    quality: Float[Array, "tiles rates"],
    units: Int[Array, "tiles rates"],
    capacity: Float[Array, ""],
) -> Float[Array, ""]:
    """Of one unit, at which the tiles' best rates just fit; about 0 if they do anyway.

    Any price leads to the same choice; this one keeps the losses small.
    """

    def fits(price):
        loss = _loss(quality, units, price)
        spent = jnp.where(loss == 0, units.astype(quality.dtype), jnp.inf)
        return jnp.sum(jnp.min(spent, axis=1)) <= capacity

    def halve(_, ends):
        low, high = ends
        middle = (low + high) / 2
        ok = fits(middle)
        return jnp.where(ok, low, middle), jnp.where(ok, middle, high)

    free = jnp.zeros((), quality.dtype)
    dearest = jnp.max(_loss(quality, units, free))
    _, price = jax.lax.fori_loop(0, 40, halve, (free, dearest))
    # With few digits, a price times some units is exact, and equal choices stay equal.
    return jax.lax.reduce_precision(price, jnp.finfo(price.dtype).nexp, mantissa_bits=7)


def _loss(
    quality: Float[Array, "tiles rates"],
    units: Int[Array, "tiles rates"],
    price: Float[Array, ""],
) -> Float[Array, "tiles rates"]:
    """How much worse than the tile's best each rate is at that price. >= 0."""
    # Differences first: they keep their digits however large the qualities are.
    below = quality - jnp.max(quality, axis=1, keepdims=True)
    value = below - price * units.astype(quality.dtype)
    return jnp.max(value, axis=1, keepdims=True) - value


def _block_through(
    row: Float[Array, " columns"],
    block: tuple[Float[Array, "tiles rates"], Int[Array, "tiles rates"]],
    *,
    padding: int,
) -> tuple[Float[Array, " columns"], Float[Array, " columns"]]:
    """The row after a block of tiles; the one before it is kept."""

    def add_tile(row, tile):
        loss, units = tile
        least = functools.reduce(jnp.minimum, _candidates(row, loss, units, padding))
        # Written into the row: XLA then copies nothing else.
        return jax.lax.dynamic_update_slice(row, least, (padding,)), None

    return jax.lax.scan(add_tile, row, block)[0], row


def _block_back(
    end: Int[Array, ""],
    block: tuple[
        Float[Array, " columns"],
        Float[Array, "tiles rates"],
        Int[Array, "tiles rates"],
    ],
    *,
    padding: int,
) -> tuple[Int[Array, ""], Int[Array, " tiles"]]:
    """Units spent before a block that ends at `end`, and the rates of its tiles."""
    row, loss, units = block
    tiles, rates = loss.shape
    # Only what the block can have spent is computed again.
    width = min(row.size - padding, tiles * padding + 1)
    first = jnp.maximum(end - (width - 1), 0)
    part = jax.lax.dynamic_slice(row, (padding + first,), (width,))
    row = jnp.concatenate([jnp.full(padding, jnp.inf, row.dtype), part])
    kind = np.min_scalar_type(rates - 1)

    def add_tile(row, tile):
        loss, units = tile
        least, *others = _candidates(row, loss, units, padding)
        choice = jnp.zeros(least.shape, kind)
        for rate, other in enumerate(others, 1):
            choice = jnp.where(other < least, jnp.asarray(rate, kind), choice)
            least = jnp.minimum(other, least)
        return jax.lax.dynamic_update_slice(row, least, (padding,)), choice

    def remove_tile(column, tile):
        choice, units = tile
        rate = choice[column].astype(int)
        return column - units[rate], rate

    _, choices = jax.lax.scan(add_tile, row, (loss, units))
    walk = jax.lax.scan(remove_tile, end - first, (choices, units), reverse=True)
    return walk[0] + first, walk[1]


def _candidates(
    row: Float[Array, " columns"],
    loss: Float[Array, " rates"],
    units: Int[Array, " rates"],
    padding: int,
) -> list[Float[Array, " slots"]]:
    """For each rate of one more tile, the least loss at every cost."""
    size = (row.size - padding,)
    return [
        jax.lax.dynamic_slice(row, (padding - units[rate],), size) + loss[rate]
        for rate in range(loss.size)
    ]
