"""From a frame to the refresh rate and the rate map that a budget buys."""

import enum
from collections.abc import Callable, Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from camojab import Display, Spectrum
from camojab._errors import check

from ._budget import AbstractCost, Budget, PixelCost
from ._frame import Frame, mean_velocity
from ._joint import JointRefresh
from ._rates import RATES
from ._refresh import RefreshTable
from .oracle import AbstractQualityOracle, CamojabOracle, TableOracle
from .solve import lagrangian, Selection
from .tables import AbstractTables


Solver = Callable[..., Selection]


class Binding(enum.IntEnum):
    """What kept a rate map from being better."""

    NOTHING = 0
    """The budget allows every tile the best of its rates."""
    BUDGET = 1
    """The best rate of every tile costs more than the budget."""
    COARSEST = 2
    """The cheapest rate of every tile costs more than the budget, and was chosen."""


class Decision(eqx.Module, strict=True):
    """How a frame is to be shown, and what that buys.

    - `refresh_rate`: [Hz]
    - `rate`: index of the shading rate of each tile, in the order of `RATES`.
    - `quality`: total over the tiles, in the unit of the oracle and with its zero.
    - `loss`: what a tile loses on average to being shaded more coarsely than 1x1, in
        that unit. Negative where coarse rates are better.
    - `gap`: how much higher than `quality`, less the cost of changes, the total of a
        better map at this refresh rate could be at the most.
    - `cost` and `budget`: of this frame, in the unit of the costs.
    - `binding`: a `Binding`.
    - `changed`: tiles whose rate differs from that in the decision before.
    - `outside`: tiles that show what the oracle does not know, and that it judged by
        the nearest that it knows.
    - `worth`: what was compared between the candidates of a `JointRefresh`: quality of
        the moving picture, less the mean loss, what the changes of tiles cost, on
        average, and what that of the refresh rate does, [JND]; one number, where there
        was nothing to compare.
    """

    refresh_rate: Float[Array, "..."]
    rate: Int[Array, "... rows columns"]
    quality: Float[Array, "..."]
    loss: Float[Array, "..."]
    gap: Float[Array, "..."]
    cost: Float[Array, "..."]
    budget: Float[Array, "..."]
    binding: Int[Array, "..."]
    changed: Int[Array, "..."]
    outside: Int[Array, "..."]
    worth: Float[Array, "... candidates"]


class Controller(eqx.Module, strict=True):
    """Chooses a frame's refresh rate and the shading rate of each of its tiles.

    Calling it with a `Frame` gives a `Decision`; with the decision of the frame before
    as second argument, changes have a price. `over` goes through a sequence. A pytree:
    jit and vmap go through, and one compilation serves all frames of one size.

    **Arguments:**

    - `display`: whose `refresh_rate` is used unless `refresh` chooses one. Single
        numbers. [Hz], [px/deg], [cd/m^2], [1]
    - `oracle`: tells the quality of each tile at each rate. Tables stand for a
        `TableOracle` of them; textures, spectra by name, for a `CamojabOracle` of them
        at the twelve published mip levels, on this display.
    - `budget`: of a frame or a second.
    - `cost`: of the rates; pixels if left out.
    - `refresh`: where the refresh rate is from. A `RefreshTable` is asked first, and
        the map solved for what it says (two stages, as in the paper). With a
        `JointRefresh` the map is solved at each candidate, and the best whole is taken.
        The display's own refresh rate if left out.
    - `solver`: one of `alsarr.solve` but `dynamic_programme`, whose costs must be known
        before anything is compiled.
    - `rate_change`: what a tile's quality loses when its rate changes, so that maps do
        not flicker; in the oracle's unit, >= 0 and finite.
    - `refresh_change`: what the frame loses when its refresh rate changes; used with a
        `JointRefresh`. [JND], >= 0 and finite.

    A budget below the cheapest map gives the cheapest map (`Binding.COARSEST`).

    **Raises:** `ValueError` for a budget in another unit than the costs, a display that
    is not a single one, a price < 0, and a `JointRefresh` with an oracle that does not
    tell JND, since these are added.

    **Source:** Jindal et al. (2021), Section 5; choosing both rates at once, and prices
    of changes, are this package's own.

    **Example:**

    >>> from alsarr import Budget, Controller, procedural_frame
    >>> from alsarr.oracle import UniformOracle
    >>> from camojab import Display
    >>> display = Display(ppd=60, refresh_rate=60, luminance=100)
    >>> controller = Controller(display, UniformOracle(), Budget.share(0.25))
    >>> decision = controller(procedural_frame(3, rows=9, columns=16, seed=1))
    >>> decision.rate.shape
    (9, 16)
    >>> controller.why(decision)
    "the budget binds: 9216 of 9216 px at 60 Hz, the display's only one."
    """

    display: Display
    oracle: AbstractQualityOracle
    budget: Budget
    cost: AbstractCost
    refresh: RefreshTable | JointRefresh | None
    rate_change: Float[Array, ""]
    refresh_change: Float[Array, ""]
    solver: Solver = eqx.field(static=True)

    def __init__(
        self,
        display: Display,
        oracle: AbstractQualityOracle | AbstractTables | Mapping[str, Spectrum],
        budget: Budget,
        *,
        cost: AbstractCost | None = None,
        refresh: RefreshTable | JointRefresh | None = None,
        solver: Solver = lagrangian,
        rate_change: ArrayLike = 0.0,
        refresh_change: ArrayLike = 0.0,
    ):
        self.display = display
        self.oracle = _oracle(oracle, display)
        self.budget = budget
        self.cost = PixelCost() if cost is None else cost
        self.refresh = refresh
        self.solver = solver
        self.rate_change = _price("rate_change", rate_change)
        self.refresh_change = _price("refresh_change", refresh_change)
        budget.check_unit(self.cost)
        if display.refresh_rate.ndim:
            raise ValueError(
                "`display` must be a single one, got a refresh rate of shape "
                f"{display.refresh_rate.shape}."
            )
        if isinstance(refresh, JointRefresh) and self.oracle.unit != "JND":
            raise ValueError(
                "`oracle` must tell JND where the refresh rate is chosen jointly, got "
                f"{self.oracle.unit}."
            )

    @property
    def candidates(self) -> Float[Array, " candidates"]:
        """Refresh rates that may be chosen, rising. [Hz]"""
        if self.refresh is None:
            return self.display.refresh_rate[None]
        return self.refresh.candidates

    @property
    def highest_refresh_rate(self) -> Float[Array, ""]:
        """That a budget which is a share is a share of. [Hz]"""
        if isinstance(self.refresh, RefreshTable):
            return self.refresh.highest
        return self.candidates[-1]

    def __call__(self, frame: Frame, previous: Decision | None = None) -> Decision:
        """**Arguments:** `previous`: the decision for the frame before this."""
        if previous is None:
            return _decide(self, frame, *_nothing_before(frame.shape))
        if previous.rate.shape != frame.shape:
            raise ValueError(
                f"`previous` must be of a frame of {frame.shape} tiles, got "
                f"{previous.rate.shape}."
            )
        return _decide(self, frame, previous.rate, previous.refresh_rate)

    def over(self, frames: Frame) -> Decision:
        """Decisions for frames one after another, each knowing the one before.

        **Arguments:** `frames`: whose arrays have a leading axis of the frames.

        **Returns:** decisions whose arrays have that axis too.

        **Raises:** `ValueError` for arrays without that axis.
        """
        if frames.texture.ndim != 3:
            raise ValueError(
                "`frames` must have arrays of shape [frames, rows, columns], got "
                f"{frames.texture.shape}."
            )
        return _over(self, frames)

    def why(self, decision: Decision) -> str:
        """One sentence that says what a decision was bound by."""
        unit, spent = self.cost.unit, float(decision.cost)
        allowed = float(decision.budget)
        binding = {
            Binding.NOTHING: "the budget allows every tile its best rate",
            Binding.BUDGET: "the budget binds",
            Binding.COARSEST: "the budget is below the cheapest map, which is shown",
        }[Binding(int(decision.binding))]
        rate, every = float(decision.refresh_rate), self.candidates
        if self.refresh is None:
            refresh = "the display's only one"
        else:
            ends = {float(every[0]): "the lowest", float(every[-1]): "the highest"}
            place = ends.get(rate, "one")
            refresh = f"{place} of {every.size} that may be chosen"
        amounts = f"{_amount(spent)} of {_amount(allowed)} {unit}"
        return f"{binding}: {amounts} at {rate:g} Hz, {refresh}."


def _oracle(
    source: AbstractQualityOracle | AbstractTables | Mapping[str, Spectrum],
    display: Display,
) -> AbstractQualityOracle:
    if isinstance(source, AbstractTables):
        return TableOracle(source)
    if isinstance(source, Mapping):
        return CamojabOracle(source, ppd=display.ppd, persistence=display.persistence)
    return source


@eqx.filter_jit
def _decide(
    controller: Controller,
    frame: Frame,
    rate_before: Int[Array, "rows columns"],
    refresh_before: Float[Array, ""],
) -> Decision:
    refresh, before = controller.refresh, (rate_before, refresh_before)
    at = lambda rate, moving: _at(controller, frame, *before, rate, moving)
    if refresh is None:
        return at(controller.display.refresh_rate, jnp.zeros(()))
    if isinstance(refresh, RefreshTable):
        return at(refresh.lookup(mean_velocity(frame)).refresh_rate, jnp.zeros(()))
    moving = refresh.at(mean_velocity(frame))
    every = jax.vmap(at)(refresh.candidates, moving)
    best = jnp.argmax(every.worth)
    chosen = jax.tree.map(lambda x: x[best], every)
    return eqx.tree_at(lambda d: d.worth, chosen, every.worth[:, 0])


def _at(
    controller: Controller,
    frame: Frame,
    rate_before: Int[Array, "rows columns"],
    refresh_before: Float[Array, ""],
    refresh_rate: Float[Array, ""],
    moving: Float[Array, ""],
) -> Decision:
    """The best map at one refresh rate."""
    quality = controller.oracle.quality(frame, refresh_rate)
    same = lambda x: x.astype(quality.dtype)
    cost = same(controller.cost.of(frame))
    highest = controller.highest_refresh_rate
    budget = same(controller.budget.of_frame(cost, same(refresh_rate), same(highest)))
    before = rate_before.ravel()
    changes = same(jnp.arange(len(RATES))[None] != before[:, None])
    # The paper's ratios need a zero; it is that of its tables, the coarsest rate.
    over_coarsest = lambda x: x - x[:, :1]
    # What every rate would lose cancels first, or it would take digits of the rest.
    priced = same(controller.rate_change) * over_coarsest(changes)
    gain = over_coarsest(quality) - priced
    each = cost[0] if controller.cost.shared else cost
    found = controller.solver(gain, each, budget, throw=False)

    chosen = jnp.take_along_axis(quality, found.rate[:, None], axis=1)[:, 0]
    # Of differences, since totals would lose them to rounding.
    loss = jnp.mean(quality[:, -1] - chosen)
    known = jnp.all(before >= 0)
    moved = known & (refresh_before != refresh_rate.astype(float))
    price = jnp.where(moved, same(controller.refresh_change), 0)
    changed = known & (found.rate != before)
    price += same(controller.rate_change) * jnp.mean(same(changed))
    return Decision(
        refresh_rate=refresh_rate.astype(float),
        rate=found.rate.reshape(frame.shape),
        quality=jnp.sum(chosen),
        loss=loss,
        gap=found.gap,
        cost=found.cost,
        budget=budget,
        binding=_binding(gain, cost, budget, found.feasible),
        changed=jnp.sum(changed),
        outside=controller.oracle.count_outside(frame, refresh_rate),
        worth=(same(moving) - loss - price)[None],
    )


def _binding(
    quality: Float[Array, "tiles 7"],
    cost: Float[Array, "tiles 7"],
    budget: Float[Array, ""],
    feasible: Bool[Array, ""],
) -> Int[Array, ""]:
    best = jnp.max(quality, axis=1, keepdims=True)
    least = jnp.min(jnp.where(quality == best, cost, jnp.inf), axis=1)
    nothing, by_budget, coarsest = (jnp.asarray(b, int) for b in Binding)
    wanted = jnp.where(jnp.sum(least) <= budget, nothing, by_budget)
    return jnp.where(feasible, wanted, coarsest)


@eqx.filter_jit
def _over(controller: Controller, frames: Frame) -> Decision:
    def step(before, frame: Frame):
        decision = _decide(controller, frame, *before)
        return (decision.rate, decision.refresh_rate), decision

    start = _nothing_before(frames.texture.shape[1:])
    return jax.lax.scan(step, start, frames)[1]


def _nothing_before(
    shape: tuple[int, ...],
) -> tuple[Int[Array, "rows columns"], Float[Array, ""]]:
    """A rate and a refresh rate that are none, so every choice is as much a change."""
    # Of the types that a decision has, or the second frame would compile anew.
    return jnp.full(shape, -1, int), jnp.zeros((), float)


def _amount(x: float) -> str:
    """Six digits, but whole numbers without an exponent."""
    return f"{x:.0f}" if x >= 1e5 else f"{x:g}"


def _price(name: str, x: ArrayLike) -> Float[Array, ""]:
    return check(name, x, lambda v: (v >= 0) & jnp.isfinite(v), ">= 0 and finite")
