"""Votes counted: wins of one condition over another, by observer and group."""

import re
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from .._columns import check_columns, TableError
from ._tables import check_votes, NAMES, SIDES


if TYPE_CHECKING:
    import pandas


# What the tables of results have beside the columns that tell the groups apart.
ADDED = (
    "condition",
    "votes",
    "quality_jnd",
    "low_jnd",
    "high_jnd",
    "standard_error_jnd",
    "resamples",
    "conditions",
    "observers",
    "log_likelihood",
    "deviance",
    "degrees_of_freedom",
    "p_value",
    "converged",
)


def count(
    votes: "pandas.DataFrame", conditions: Sequence[Hashable]
) -> Int[np.ndarray, "n n"]:
    """Wins between conditions: entry (i, j) is how often i was preferred to j.

    **Arguments:**

    - `votes`: columns `condition_a`, `condition_b` and `a_preferred`, as `read_votes`
        returns them, of conditions that were compared with each other. No votes at all
        give zeros.
    - `conditions`: the names, in the order of the result; some may be without votes.

    **Raises:** `TableError`, a `ValueError`, naming the rows of `votes` that are not
    votes; `ValueError` naming a condition of `votes` that is not in the list, or is
    there twice.

    **Example:**

    >>> import pandas as pd
    >>> from camojab.votes import count
    >>> votes = pd.DataFrame({
    ...     "condition_a": ["fine", "fine", "coarse"],
    ...     "condition_b": ["coarse", "coarse", "fine"],
    ...     "a_preferred": [True, True, True],
    ... })
    >>> count(votes, ["fine", "coarse"])
    array([[0, 2],
           [1, 0]])
    """
    flags = check_votes(votes, SIDES)
    place = {name: i for i, name in enumerate(conditions)}
    if len(place) < len(conditions):
        twice = next(name for i, name in enumerate(conditions) if place[name] != i)
        raise ValueError(f"`conditions` must name each once, got {twice!r} again.")
    names = [*votes["condition_a"], *votes["condition_b"]]
    for name in names:
        if name not in place:
            raise ValueError(f"`votes` must name known conditions only, got {name!r}.")
    pair = np.array([place[name] for name in names], int).reshape(2, -1)
    wins = np.zeros((len(conditions),) * 2, int)
    np.add.at(wins, _winner_first(flags, pair), 1)
    return wins


@dataclass(frozen=True, eq=False)
class Tally:
    """Votes counted by observer, group and pair; groups are padded to the largest.

    - `wins`: how often, in a group, an observer preferred one condition to another.
    - `present`: which conditions of a group there are; the rest is padding.
    - `observers`, `groups` (values of the columns `by`) and `conditions` of each group
      name the axes.
    """

    by: tuple[str, ...]
    observers: list[Hashable]
    groups: list[tuple[Hashable, ...]]
    conditions: list[list[Hashable]]
    wins: Float[np.ndarray, "observers groups n n"]
    present: Bool[np.ndarray, "groups n"]

    def label(self, group: int) -> str:
        """What to call the votes of a group in a message."""
        pairs = zip(self.by, self.groups[group], strict=True)
        where = ", ".join(f"{name} {value}" for name, value in pairs)
        return f"`votes` of {where}" if where else "`votes`"

    def rows(self) -> dict[str, list[Hashable]]:
        """The columns `by` and `condition` of a table with a row per condition."""
        columns: dict[str, list[Hashable]] = {name: [] for name in self.by}
        columns["condition"] = []
        for group, names in zip(self.groups, self.conditions, strict=True):
            for name, value in zip(self.by, group, strict=True):
                columns[name] += [value] * len(names)
            columns["condition"] += names
        return columns

    def group_rows(self) -> dict[str, list[Hashable]]:
        """The columns `by` of a table with a row per group."""
        return {name: [g[i] for g in self.groups] for i, name in enumerate(self.by)}


def tally(
    votes: "pandas.DataFrame",
    by: Sequence[str] = (),
    *,
    reference: Hashable | None = None,
) -> Tally:
    """Count a checked table of votes; conditions, groups and observers are sorted.

    The reference comes first in the groups that have it.
    """
    by = tuple(by)
    check_columns(by, required=(), added=ADDED)
    flags = check_votes(votes, (*NAMES, *by))
    if not len(votes):
        raise TableError("`votes` must have at least one row, got none.")
    observers, observer = _coded(votes["observer"])
    keys = zip(*(votes[name] for name in by), strict=True) if by else [()] * len(votes)
    groups, group = _coded(keys)
    both = [*votes["condition_a"], *votes["condition_b"]]
    names, code = _coded(both, first=reference)
    pair = code.reshape(2, -1)
    member = np.zeros((len(groups), len(names)), bool)
    member[group, pair] = True
    place = np.cumsum(member, axis=1) - 1
    sizes = member.sum(axis=1)
    width = int(sizes.max())
    winner, loser = _winner_first(flags, place[group, pair])
    wins = np.zeros((len(observers), len(groups), width, width))
    np.add.at(wins, (observer, group, winner, loser), 1.0)
    present = np.arange(width) < sizes[:, None]
    conditions = [[names[c] for c in np.flatnonzero(row)] for row in member]
    return Tally(by, observers, groups, conditions, wins, present)


def check_observers(counted: Tally) -> None:
    if len(counted.observers) < 2:
        raise ValueError(
            "`votes` must be of two observers or more, got only "
            f"{counted.observers[0]!r}."
        )


def _winner_first(
    a_preferred: Bool[np.ndarray, " votes"], pair: Int[np.ndarray, "2 votes"]
) -> tuple[Int[np.ndarray, " votes"], Int[np.ndarray, " votes"]]:
    a, b = pair
    return np.where(a_preferred, a, b), np.where(a_preferred, b, a)


def _coded(
    values: Iterable[Hashable], *, first: Hashable | None = None
) -> tuple[list[Any], Int[np.ndarray, " values"]]:
    """The different values in order, and for each value its place among them."""
    values = list(values)
    different = sorted(
        dict.fromkeys(values), key=lambda value: (value != first, _order(value))
    )
    place = {value: i for i, value in enumerate(different)}
    return different, np.array([place[value] for value in values], int)


def _order(value: Any) -> tuple[Any, ...]:
    """Numbers by size, text as people sort it: 50 Hz before 100 Hz."""
    if isinstance(value, tuple):
        return tuple(_order(each) for each in value)
    if isinstance(value, int | float | np.number):
        return (0, float(value))
    parts = re.split(r"(\d+)", str(value))
    by_size = tuple(int(part) if part.isdecimal() else part for part in parts)
    return (1, by_size, str(value))
