"""What ways of choosing rates make of the same frames and budgets, judged alike."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from camojab import Display, Spectrum

from ._budget import Budget
from ._controller import Controller, Decision, Solver
from ._frame import Frame, mean_velocity
from ._joint import joint_refresh, JointRefresh
from ._rates import RATES, TILE
from ._refresh import (
    refresh_table,
    refresh_table_denes2020,
    RefreshTable,
    sorted_numbers,
)
from .oracle import (
    AbstractQualityOracle,
    Denes2020Oracle,
    FidelityFxOracle,
    Yang2019Oracle,
)
from .solve import (
    common_threshold,
    dynamic_programme,
    greedy_jindal2021,
    hull,
    lagrangian,
    uniform,
)


SHARES = (0.0625, 0.125, 0.25, 0.5, 1.0)
"""Budgets that are compared, as shares of full rate at the highest refresh rate."""

# What 4x4 everywhere takes.
_LEAST = float(RATES.cost.min() / RATES.cost.max())

# The time of the dynamic programme grows with their square.
_MOST_TILES = 20_000


@dataclass(frozen=True)
class Setting:
    """What every method is given, and what all are judged by.

    - `frames`: one or more.
    - `judge`: tells what tiles lose by coarse rates. [JND]
    - `ppd` [px/deg] and `persistence` (0, 1] of the display.
    - `refresh_rate`: of the methods that choose none. [Hz]
    - `refresh_rates`: that the others choose from; `refresh_rate` alone, if empty. None
      of them all is below `refresh_rate`.
    - `oracles`: by name, others than the judge that know the frames' textures. [JND]
    - `picture`: whole, what the eye follows; needed where there is a choice. It is seen
      at the mean luminance and speed of the frames.

    **Raises:** `ValueError` for no frames, a judge of another unit, refresh rates that
    are all below `refresh_rate`, or a choice of them without a picture.
    """

    frames: Sequence[Frame]
    judge: AbstractQualityOracle
    ppd: float
    refresh_rate: float
    refresh_rates: Sequence[float | int] = ()
    persistence: float = 1.0
    oracles: Mapping[str, AbstractQualityOracle] = field(default_factory=dict)
    picture: Spectrum | None = None

    def __post_init__(self):
        if not self.frames:
            raise ValueError("`frames` must have at least one frame, got none.")
        if self.judge.unit != "JND":
            raise ValueError(f"`judge` must tell JND, got {self.judge.unit}.")
        _check_highest(self.highest, self.refresh_rate)
        if self.chooses and self.picture is None:
            raise ValueError(
                "`picture` must be given where there are refresh rates to choose from, "
                "got None."
            )

    @property
    def choice(self) -> Float[np.ndarray, " rates"]:
        """Refresh rates that may be chosen, rising. [Hz]"""
        return _rising(self.refresh_rates or (self.refresh_rate,))

    @property
    def chooses(self) -> bool:
        """Whether they are others than `refresh_rate` alone."""
        return self.choice.tolist() != [self.refresh_rate]

    @property
    def highest(self) -> float:
        """Refresh rate that the budgets are shares of. [Hz]"""
        return float(self.choice[-1])

    @property
    def luminance(self) -> float:
        """Mean of the frames. [cd/m^2]"""
        return float(np.mean([np.mean(frame.luminance) for frame in self.frames]))

    @property
    def velocities(self) -> list[float]:
        """Mean speed in each frame. [deg/s]"""
        return [float(mean_velocity(frame)) for frame in self.frames]

    @property
    def has_images(self) -> bool:
        """Whether there is a picture before every frame."""
        return all(frame.previous_image is not None for frame in self.frames)

    @property
    def is_small(self) -> bool:
        """Whether a dynamic programme takes no more than a minute."""
        return max(frame.texture.size for frame in self.frames) <= _MOST_TILES


@dataclass(frozen=True)
class Method:
    """A way of choosing rates.

    - `name`: shown to people.
    - `oracle`, `solver`, `refresh`: of its `Controller`; refresh tables by the share
      that they are for.
    - `exact`: whether the shading rates are then replaced by the best that there are.
    """

    name: str
    oracle: AbstractQualityOracle
    solver: Solver = lagrangian
    refresh: Mapping[float, RefreshTable] | JointRefresh | None = None
    exact: bool = False

    def controller(self, setting: Setting, share: float) -> Controller:
        """For a share of full rate at the highest refresh rate of the setting."""
        refresh = self.refresh
        if refresh is None:
            # The same pixels a second; more than full rate takes are left.
            share = min(1.0, share * (setting.highest / setting.refresh_rate))
        elif not isinstance(refresh, JointRefresh):
            refresh = refresh[share]
        display = Display(
            ppd=setting.ppd,
            refresh_rate=setting.refresh_rate,
            luminance=setting.luminance,
            persistence=setting.persistence,
        )
        budget = Budget.share(share)
        return Controller(
            display, self.oracle, budget, refresh=refresh, solver=self.solver
        )

    def decide(self, setting: Setting, share: float, frame: Frame) -> Decision:
        """What it would show of a frame."""
        controller = self.controller(setting, share)
        decision = controller(frame)
        if not self.exact:
            return decision
        quality = self.oracle.quality(frame, decision.refresh_rate)
        best = dynamic_programme(quality, RATES.cost, decision.budget, throw=False)
        parts = lambda d: (d.rate, d.cost, d.gap)
        found = best.rate.reshape(frame.shape), best.cost, best.gap
        return eqx.tree_at(parts, decision, found)


@dataclass(frozen=True)
class Judged:
    """What a method made of a budget, on average over the frames.

    - `method`: its name.
    - `budget`: share of full rate everywhere at the highest refresh rate.
    - `refresh_rate`: [Hz]
    - `quality`: of the moving picture at full shading rate, 0 if there is none, less
      `loss`. [JND]
    - `loss`: what a tile loses to its shading rate. [JND]
    - `cost`: spent, in the unit of `budget`.
    - `gap`: how much less a tile could lose on average at the most, had the rates been
      chosen better at this refresh rate; NaN for a method that has not the judge for
      its oracle. [JND]
    - `shares`: of the tiles that have each of `RATES`.
    """

    method: str
    budget: float
    refresh_rate: float
    quality: float
    loss: float
    cost: float
    gap: float
    shares: tuple[float, ...]


def compare(
    setting: Setting,
    budgets: Sequence[float] = SHARES,
    *,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Judged]:
    """Every method at every budget, all judged alike.

    ALSaRR with every solver and oracle, the best single rate for all tiles, NAS and
    FidelityFX with the threshold that the budget allows and in the place of the oracle
    of a knapsack, and MARRR. Where several refresh rates may be chosen, ALSaRR chooses
    both kinds of rates at once, or the refresh rate before, and MARRR has a table of
    its own.

    **Arguments:**

    - `setting`: what they are given. Without pictures before the frames NAS and
        FidelityFX are left out. They have no use for what remains of a budget once
        motion hides all that they see.
    - `budgets`: shares of full rate everywhere at the highest refresh rate, [1/16, 1].
        At lower refresh rates a frame has more.
    - `progress`: called with the steps done and their number.

    **Returns:** for each method in turn one for each budget.

    **Raises:** `ValueError` for a budget out of range, and as `Setting`.
    """
    check_budgets(budgets)
    moving = _moving(setting)
    steps = list(itertools.product(methods(setting, budgets, moving), budgets))
    rows = []
    for done, (method, share) in enumerate(steps):
        progress(done, len(steps))
        rows.append(_judged(setting, moving, method, share))
    progress(len(steps), len(steps))
    return rows


def check_display(
    display: Mapping[str, float], choice: Sequence[float], luminance: float
) -> None:
    """Fail for what a display cannot be, before anything is computed for it.

    **Arguments:** `display`: `ppd`, `refresh_rate` and `persistence`; `choice`: refresh
    rates to choose from, if there are any. [Hz]

    **Raises:** `ValueError` as `Display`, `refresh_table` and `Setting`.
    """
    Display(**display, luminance=luminance)
    if choice:
        _check_highest(float(_rising(choice)[-1]), display["refresh_rate"])


def check_budgets(budgets: Sequence[float]) -> None:
    """**Raises:** `ValueError` for none, and one below 4x4 or above 1x1 everywhere."""
    for share in budgets or (math.nan,):
        if not _LEAST <= share <= 1:
            raise ValueError(
                f"`budgets` must be in [{_LEAST:g}, 1], from 4x4 to 1x1 everywhere at "
                f"the highest refresh rate, got {share:g}."
            )


def methods(
    setting: Setting, budgets: Sequence[float], moving: JointRefresh | None
) -> list[Method]:
    """All that a setting has what they need for."""
    judge, joint, first, marrr = setting.judge, None, [], None
    if moving is not None and setting.chooses:
        joint = _chosen_from(moving, setting.choice)
        tables = _by_share(setting, budgets, _table)
        first = [Method("ALSaRR, two stages", judge, refresh=tables)]
        marrr = _by_share(setting, budgets, _table_denes2020)
    found = [
        Method("ALSaRR", judge, lagrangian, joint),
        Method("ALSaRR, hull", judge, hull, joint),
        Method("ALSaRR, greedy", judge, greedy_jindal2021, joint),
    ]
    if setting.is_small:
        found.append(Method("ALSaRR, exact", judge, refresh=joint, exact=True))
    for name, oracle in setting.oracles.items():
        found.append(Method(f"ALSaRR, {name}", oracle, refresh=joint))
    found += [*first, Method("uniform", judge, uniform)]
    if setting.has_images:
        for name, oracle in (
            ("NAS", Yang2019Oracle(ppd=setting.ppd)),
            ("FidelityFX", FidelityFxOracle(ppd=setting.ppd)),
        ):
            found.append(Method(name, oracle, common_threshold))
            found.append(Method(f"{name} knapsack", oracle))
    oracle = Denes2020Oracle(ppd=setting.ppd, persistence=setting.persistence)
    return [*found, Method("MARRR", oracle, uniform, marrr)]


def _moving(setting: Setting) -> JointRefresh | None:
    """Quality of the picture in motion at every refresh rate that may occur."""
    if setting.picture is None:
        return None
    return joint_refresh(
        setting.picture,
        ppd=setting.ppd,
        luminance=setting.luminance,
        refresh_rates=[*setting.choice, setting.refresh_rate],
        velocities=setting.velocities,
        persistence=setting.persistence,
    )


def _check_highest(highest: float, refresh_rate: float) -> None:
    if highest < refresh_rate:
        raise ValueError(
            f"`refresh_rate` must be at most the highest of `refresh_rates`, "
            f"{highest:g} Hz, got {refresh_rate:g}."
        )


def _rising(rates: Sequence[float | int]) -> Float[np.ndarray, " rates"]:
    return sorted_numbers("refresh_rates", rates, lambda x: x > 0, "> 0 Hz")


def _chosen_from(
    moving: JointRefresh, choice: Float[np.ndarray, " rates"]
) -> JointRefresh:
    """That part of it whose refresh rates may be chosen."""
    every = np.asarray(moving.candidates)
    kept = np.isin(every, choice.astype(every.dtype))
    parts = moving.candidates[kept], moving.quality[:, kept]
    return JointRefresh(moving.velocity, *parts)


def _by_share(
    setting: Setting,
    budgets: Sequence[float],
    table: Callable[[Setting, dict[str, Any]], RefreshTable],
) -> dict[float, RefreshTable]:
    rows, columns = setting.frames[0].shape
    # Its share alone counts, so one size stands for those of all frames.
    width, height = columns * TILE, rows * TILE
    # Entries for the frames' own speeds: none is taken for the nearest of a table's.
    common: dict[str, Any] = {
        "ppd": setting.ppd,
        "persistence": setting.persistence,
        "resolution_px": (width, height),
        "refresh_rates": setting.choice,
        "velocities": setting.velocities,
    }
    full = width * height * setting.highest
    of = lambda share: table(setting, common | {"pixels_per_second": share * full})
    return {share: of(share) for share in budgets}


def _table(setting: Setting, common: dict[str, Any]) -> RefreshTable:
    if setting.picture is None:
        raise ValueError("`picture` must be given for a refresh-rate table, got None.")
    return refresh_table(setting.picture, luminance=setting.luminance, **common)


def _table_denes2020(setting: Setting, common: dict[str, Any]) -> RefreshTable:
    del setting
    return refresh_table_denes2020(**common)


def _judged(
    setting: Setting, moving: JointRefresh | None, method: Method, share: float
) -> Judged:
    each = [
        _numbers(setting, moving, frame, method.decide(setting, share, frame))
        for frame in setting.frames
    ]
    hertz, quality, loss, cost, gap, *shares = np.mean(each, axis=0).tolist()
    if method.oracle is not setting.judge:
        gap = math.nan
    return Judged(method.name, share, hertz, quality, loss, cost, gap, tuple(shares))


def _numbers(
    setting: Setting, moving: JointRefresh | None, frame: Frame, decision: Decision
) -> list[float]:
    """Refresh rate, quality, loss, cost, gap and shares of one frame."""
    loss = float(_loss(setting.judge, frame, decision))
    hertz, tiles = float(decision.refresh_rate), decision.rate.size
    bought = 0.0 if moving is None else _at(moving, frame, hertz)
    full = tiles * int(RATES.cost.max()) * setting.highest
    cost, gap = float(decision.cost) * hertz / full, float(decision.gap) / tiles
    count = np.bincount(np.asarray(decision.rate).ravel(), minlength=len(RATES))
    return [hertz, bought - loss, loss, cost, gap, *(count / tiles).tolist()]


@eqx.filter_jit
def _loss(
    judge: AbstractQualityOracle, frame: Frame, decision: Decision
) -> Float[Array, ""]:
    quality = judge.quality(frame, decision.refresh_rate)
    rate = decision.rate.reshape(-1, 1)
    chosen = jnp.take_along_axis(quality, rate, axis=1)[:, 0]
    return jnp.mean(quality[:, -1] - chosen)


def _at(moving: JointRefresh, frame: Frame, hertz: float) -> float:
    nearest = np.argmin(np.abs(np.asarray(moving.candidates) - hertz))
    return float(moving.at(mean_velocity(frame))[nearest])
