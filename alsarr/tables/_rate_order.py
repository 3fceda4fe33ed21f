"""In which order of shading rates quality must not fall."""

from enum import StrEnum
from typing import NamedTuple

from .._rates import RATES


# What the engine's single precision may lose of a difference between rates. [JND].
_MARGIN = 1e-4

SIDES = ("4", "2", "1")
"""Rates of separable tables: the coarse pixel's side along the motion. [px]."""


class Constraint(StrEnum):
    """What a table keeps everywhere in its domain.

    - `GAIN`: no rate is worse than the one that qualities are relative to.
    - `MONOTONE`: no rate is worse than a coarser one.
    """

    GAIN = "gain"
    MONOTONE = "monotone"


class RateOrder(NamedTuple):
    """Pairs of rates, the better one first; -1 is a quality of 0.

    - `margin`: by which the better one is better, at least. [JND].
    """

    pairs: tuple[tuple[int, int], ...]
    margin: float = _MARGIN


def rate_order(
    constraint: Constraint, rates: tuple[str, ...], relative_to: str | None
) -> RateOrder:
    """The pairs that a constraint orders, as indices into the rates other than 0.

    **Raises:** `ValueError` for `GAIN` of qualities that are relative to no rate, or
    to one that is not the coarsest.
    """
    coarsest = [r for r in rates if all(_coarser(r, other) for other in rates)]
    if relative_to is not None and [relative_to] != coarsest:
        raise ValueError(
            "`constraint` must go with qualities relative to the coarsest rate or to "
            f"none, got {relative_to}."
        )
    if constraint is Constraint.GAIN and relative_to is None:
        raise ValueError(
            "`constraint` must be monotone for qualities relative to no rate, got gain."
        )
    free = [r for r in rates if r != relative_to]
    place = {relative_to: -1} | {r: i for i, r in enumerate(free)}
    if constraint is Constraint.GAIN:
        return RateOrder(tuple((place[r], -1) for r in free))
    better = [(a, b) for a in rates for b in rates if a != b and _coarser(b, a)]
    between = lambda a, b: any((a, c) in better and (c, b) in better for c in rates)
    cover = [(a, b) for a, b in better if not between(a, b)]
    return RateOrder(tuple((place[a], place[b]) for a, b in cover))


def _coarser(rate: str, other: str) -> bool:
    """Whether no side of the coarse pixel is shorter than the other's."""
    sides = zip(_sides(rate), _sides(other), strict=True)
    return all(a >= b for a, b in sides)


def _sides(rate: str) -> tuple[int, ...]:
    return tuple(map(int, rate.split("x")))


def check_rates(rates: tuple[str, ...]) -> None:
    """Fail unless these are `SIDES`, or some of the seven in their order with 1x1."""
    of_the_seven = tuple(name for name in RATES.names if name in rates)
    if rates != SIDES and (rates != of_the_seven or "1x1" not in rates):
        raise ValueError(
            f"`rates` must be some of {', '.join(RATES.names)} in this order with 1x1, "
            f"or {', '.join(SIDES)}, got {', '.join(rates) or 'none'}."
        )
