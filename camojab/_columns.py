"""Tables of numbers: the columns they must have, and which cell breaks which rule."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float


class Problem(NamedTuple):
    """A cell that cannot be used: its row, counted from 0, and what is wrong."""

    row: int
    message: str


class TableError(ValueError):
    """A table that cannot be used.

    `problems` lists the cells at fault, by row; it is empty where the table as a whole
    is at fault.
    """

    problems: tuple[Problem, ...]

    def __init__(self, message: str, problems: Sequence[Problem] = ()):
        super().__init__(message)
        self.problems = tuple(problems)

    @classmethod
    def of(cls, problems: Iterable[Problem]) -> "TableError":
        """The error of one or more problems: the first, and how many there are."""
        ordered = sorted(problems, key=lambda problem: problem.row)
        first, more = ordered[0], len(ordered) - 1
        rest = f" (and {more} more)" if more else ""
        return cls(f"row {first.row}: {first.message}{rest}", ordered)


@dataclass(frozen=True)
class Rule:
    """What the numbers of a column must be, in words and as a test that NaN fails."""

    words: str
    ok: Callable[[Float[np.ndarray, " rows"]], Bool[np.ndarray, " rows"]]


FRACTION = Rule("in (0, 1]", lambda x: (x > 0) & (x <= 1))
FLAG = Rule("0 or 1", lambda x: (x == 0) | (x == 1))


def positive(unit: str = "") -> Rule:
    return Rule(f"finite and > 0 {unit}".rstrip(), lambda x: (x > 0) & (x < np.inf))


def not_negative(unit: str = "") -> Rule:
    return Rule(f"finite and >= 0 {unit}".rstrip(), lambda x: (x >= 0) & (x < np.inf))


def check_columns(
    names: Sequence[str], *, required: Iterable[str], added: Iterable[str]
) -> None:
    """Fail unless the required columns are there, none twice, and none to be added."""
    for name in names:
        if list(names).count(name) > 1:
            raise TableError(
                f"the table must have each column once, got `{name}` twice."
            )
    for name in added:
        if name in names:
            raise TableError(
                f"the table must not have the column `{name}`, which is added to it: "
                "rename it."
            )
    for name in required:
        if name not in names:
            raise TableError(
                f"the table must have the column `{name}`, got {', '.join(names)}."
            )


def numbers(
    columns: Mapping[str, Iterable[Any]], rules: Mapping[str, Rule], dtype: np.dtype
) -> tuple[dict[str, Float[np.ndarray, " rows"]], list[Problem]]:
    """The columns that have rules as numbers of `dtype`, and the cells that break them.

    Cells may be numbers or texts of numbers. A number that is in range but not in
    `dtype` is a problem too.
    """
    values, problems = {}, []
    for name, rule in rules.items():
        cells = list(columns[name])
        exact = np.array([_number(cell) for cell in cells], np.float64)
        values[name] = _rounded(exact, dtype)
        for row in np.flatnonzero(~rule.ok(values[name])):
            words = rule.words
            if rule.ok(exact[row : row + 1])[0]:
                words += f" in {dtype.name}"
            got = _shown(cells[row], exact[row])
            problems.append(Problem(int(row), f"`{name}` must be {words}, got {got}."))
    return values, problems


def check_finite(name: str, values: Float[np.ndarray, " rows"]) -> None:
    """Fail if a result is not finite, which very large or small numbers lead to."""
    problems = [
        Problem(int(row), f"`{name}` must be finite, got {values[row]}.")
        for row in np.flatnonzero(~np.isfinite(values))
    ]
    if problems:
        raise TableError.of(problems)


def _number(cell: Any) -> float:
    # Python reads 1_000 as a number; no other reader of tables does.
    if isinstance(cell, str) and "_" in cell:
        return np.nan
    try:
        return float(cell)
    except (TypeError, ValueError):
        return np.nan


def _rounded(
    exact: Float[np.ndarray, " rows"], dtype: np.dtype
) -> Float[np.ndarray, " rows"]:
    with np.errstate(over="ignore"):
        rounded = exact.astype(dtype)
    # XLA takes subnormal numbers for zero.
    return np.where(np.abs(rounded) < np.finfo(dtype).tiny, dtype.type(0), rounded)


def _shown(cell: Any, value: float) -> str:
    if isinstance(cell, str) and np.isnan(value):
        return repr(cell if len(cell) <= 60 else f"{cell[:57]}...")
    return str(cell).strip()
