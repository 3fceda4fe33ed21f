"""Tidy vote tables: one vote a row, checked before it is counted."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np
from jaxtyping import Bool

from .._columns import check_columns, Problem, TableError
from .._csv import read_rows


if TYPE_CHECKING:
    import pandas


SIDES = ("condition_a", "condition_b")
NAMES = ("observer", *SIDES)
_FLAGS = {"0": False, "1": True, "false": False, "true": True}


def read_votes(path: str | Path) -> "pandas.DataFrame":
    """Read a table of votes from a CSV file, one vote a row.

    The file is in UTF-8 and begins with the names of the columns, of which these must
    be there:

    - `observer`: who voted.
    - `condition_a`, `condition_b`: the two that were compared, in any order.
    - `a_preferred`: 1 or true if `condition_a` was chosen, 0 or false if not.

    Others are kept: columns that tell apart conditions which were never compared with
    each other (`by` of `scale_groups`), or anything else.

    **Returns:** a table with the file's columns in the file's order. `a_preferred` is
    boolean, the three names above are text without the spaces around it, and any other
    column is of numbers if all its cells are numbers. Empty lines are left out.

    **Raises:** `TableError`, a `ValueError`, for a file that is not such a table. Its
    message has one sentence a problem, each on its own line with the line of the file:
    missing, repeated or unnamed columns, rows with more or fewer cells than the header,
    empty names, an `a_preferred` of another kind, a condition compared with itself, no
    votes at all. Its `problems` has those of the rows, unless the header is at fault.
    `OSError` if the file cannot be read.
    """
    import pandas as pd

    table = read_rows(Path(path))
    header, lines = [name.strip() for name in table.header], table.lines
    cell = lambda row, i: row[i].strip() if i < len(row) else ""
    columns = {n: [cell(row, i) for row in table.rows] for i, n in enumerate(header)}
    whole = [(1, message) for message in _header_problems(header)]
    if not table.rows:
        whole.append((1, "the table must have votes below its header, got none."))
    problems = table.ragged()
    ragged = {problem.row for problem in problems}
    problems += [p for p in _row_problems(columns, NAMES) if p.row not in ragged]
    if whole or problems:
        found = sorted(whole + [(lines[p.row], p.message) for p in problems])
        message = "\n".join(f"{path}, line {line}: {text}" for line, text in found)
        raise TableError(message, () if whole else sorted(problems))
    return pd.DataFrame({name: _typed(name, cells) for name, cells in columns.items()})


def check_votes(
    votes: "pandas.DataFrame", names: Sequence[str]
) -> Bool[np.ndarray, " votes"]:
    """Whether a was preferred, of a table in which nothing is wrong.

    `names` are the columns that must be there without an empty cell.
    """
    needed = (*names, "a_preferred")
    check_columns([*map(str, votes)], required=needed, added=())
    cells = {name: _cells(votes[name]) for name in needed}
    problems = sorted(_row_problems(cells, names))
    if problems:
        lines = [f"`votes`, row {p.row}: {p.message}" for p in problems]
        raise TableError("\n".join(lines), problems)
    return np.array([_flag(cell) for cell in cells["a_preferred"]], bool)


def _header_problems(header: Sequence[str]) -> list[str]:
    shown = ", ".join(header)
    problems = [
        f"the table must have the column `{name}`, got {shown}."
        for name in (*NAMES, "a_preferred")
        if name not in header
    ]
    problems += [
        f"the table must have each column once, got `{name}` again."
        for i, name in enumerate(header)
        if name and name in header[:i]
    ]
    problems += [
        f"every column must have a name, got none for column {i + 1}."
        for i, name in enumerate(header)
        if not name
    ]
    return problems


def _row_problems(
    columns: Mapping[str, Iterable[Any]], names: Iterable[str]
) -> list[Problem]:
    """What is wrong with the rows, as far as the columns are there."""
    problems = [
        Problem(row, f"`{name}` must not be empty.")
        for name in dict.fromkeys(names)
        for row, cell in enumerate(columns.get(name, ()))
        if _blank(cell)
    ]
    for row, cell in enumerate(columns.get("a_preferred", ())):
        if _flag(cell) is None:
            rule = "`a_preferred` must be 0, 1, true or false"
            problems.append(Problem(row, f"{rule}, got {cell!r}."))
    sides = (columns.get(name, ()) for name in SIDES)
    for row, (a, b) in enumerate(zip(*sides, strict=False)):
        if not _blank(a) and a == b:
            rule = "a condition must be compared with another one"
            problems.append(Problem(row, f"{rule}, got {a!r} twice."))
    return problems


def _cells(column: Any) -> list[Any]:
    """With `None` where pandas has one of its several ways to say nothing."""
    return [
        None if missing else cell
        for cell, missing in zip(column, column.isna(), strict=True)
    ]


def _blank(cell: Any) -> bool:
    return cell is None or (isinstance(cell, str) and not cell.strip())


def _flag(cell: Any) -> bool | None:
    if isinstance(cell, str):
        return _FLAGS.get(cell.strip().lower())
    return bool(cell) if cell in (0, 1) else None


def _typed(name: str, cells: list[str]) -> Any:
    import pandas as pd

    if name in NAMES:
        return cells
    if name == "a_preferred":
        return [_flag(cell) for cell in cells]
    try:
        return pd.to_numeric(pd.Series(cells, dtype=object))
    except ValueError:
        return cells
