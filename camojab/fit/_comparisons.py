"""Pairwise votes, with the conditions that the model is evaluated at."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TYPE_CHECKING

import jax
import numpy as np
from jaxtyping import Array, Float, Int, Key

from .. import datasets
from .._columns import check_columns, FLAG, numbers, Problem, TableError
from .._csv import CsvTable, read_csv
from .._predict import REQUIRED
from .._textures import sources
from ..votes import (
    bootstrap,
    Prior,
    read_votes,
    scale_groups,
    votes_denes2020,
    votes_jindal2021,
)
from ._observations import jindal2021, Observations


if TYPE_CHECKING:
    import pandas


_VOTES = ("observer", "condition_a", "condition_b", "a_preferred")


@dataclass(frozen=True)
class Comparisons:
    """What a fit to votes needs: who preferred which condition to which.

    - `table`: a row per condition, with the columns of `Observations.table` but for the
      measured ones, and `group`, within which conditions were compared, and
      `condition`, the name there. Rows that could not be told apart share a name.
    - `votes`: a row per vote. Columns: `observer`; `group`, `condition_a` and
      `condition_b`; `a` and `b`, the rows of `table` that these are; `a_preferred`.
    - `textures`: the texels of each name in the column `texture`.
    """

    table: "pandas.DataFrame"
    votes: "pandas.DataFrame"
    textures: Mapping[str, Float[np.ndarray, "rows columns"]]


def jindal2021_comparisons() -> Comparisons:
    """Votes of Jindal et al. 2021, Exp. 1 (4764), and Denes et al. 2020, Exp. 1 (1980).

    The conditions are those of `jindal2021`. Of the six stimuli of Denes et al. the
    three are here that the published constants were fitted to; who cast which vote was
    not published. Nor were the votes of their Experiment 3.

    **Raises:** as `datasets.fetch`.
    """
    import pandas as pd

    whole = jindal2021()
    table: Any = whole.table.drop(columns=["quality_jnd", "low_jnd", "high_jnd"])
    # The last rows: no other row refers to them.
    table = table[~table["temporal_only"].astype(bool)].reset_index(drop=True)
    rates = table["data_set"] == "jindal2021"
    coarse = (1.0 / table["rate_x"]).round().astype(int).astype(str)
    shown = datasets.jindal2021_jnd()["velocity_deg_s"]
    table["group"] = np.where(
        rates,
        table["block"].str.removeprefix("Block-")
        + " "
        + shown.reindex(table.index).map("{:g} deg/s".format),
        "checkerboard_" + table["velocity_deg_s"].map("{:g}".format),
    )
    table["condition"] = np.where(
        rates,
        (table["texture"] + " " + coarse + "x1").where(table["rate_x"] < 1, "full"),
        table["refresh_rate_hz"].map("{:g} Hz".format),
    )
    own = votes_jindal2021()
    own["group"] = own["block"] + " " + own["velocity_deg_s"].map("{:g} deg/s".format)
    theirs = votes_denes2020().rename(columns={"stimulus": "group"})
    theirs = theirs[theirs["group"].isin(table["group"])]
    cast = pd.concat([own, theirs], ignore_index=True, join="inner")
    return _joined(table, cast, whole.textures)


def simulated_comparisons() -> Comparisons:
    """The votes of the simulated observer, cast on the built-in textures."""
    table: Any = datasets.simulated_conditions()
    votes: Any = datasets.simulated_votes()
    named = {"session": "group"}
    return _joined(
        table.rename(columns=named).drop(columns="true_quality_jnd"),
        votes.rename(columns=named),
        datasets.builtin_textures(),
    )


def simulated() -> Observations:
    """The same three kinds of experiment, voted on by a simulated observer.

    The shipped votes (`data/simulated_votes.csv`) are scaled to JND here, with the
    prior of the published scaling.
    """
    return scaled(simulated_comparisons())


def scaled(
    comparisons: Comparisons,
    *,
    prior: Prior = Prior.BOUNDED,
    key: Key[Array, ""] | None = None,
    resamples: int = 1000,
) -> Observations:
    """Scale votes to JND, each group on its own.

    **Arguments:** `key`: a JAX random key, for intervals of 95 % from so many resamples
    of the observers; without it, or where the observers of a data set are not known,
    there are none.

    **Returns:** observations whose `quality_jnd` is relative to the row `reference`.
    Those of one group cannot be compared with another's unless both refer to what is
    alike in them.

    **Raises:** as `camojab.votes.scale_groups` and `camojab.votes.bootstrap`.
    """
    found = scale_groups(comparisons.votes, by=("group",), prior=prior).table
    rows, anchors = places(comparisons.table, found)
    jnd = found["quality_jnd"].to_numpy()
    table: Any = comparisons.table.assign(
        quality_jnd=jnd[rows] - jnd[anchors], low_jnd=np.nan, high_jnd=np.nan
    )
    if key is not None:
        for mine, samples in resampled(comparisons, key, resamples, prior):
            ends = np.quantile(samples, [0.025, 0.975], axis=0)
            low, high = (table.columns.get_loc(n) for n in ("low_jnd", "high_jnd"))
            table.iloc[mine, low], table.iloc[mine, high] = ends
    return Observations(table, comparisons.textures)


def resampled(
    comparisons: Comparisons, key: Key[Array, ""], resamples: int, prior: Prior
) -> Iterator[tuple[Int[np.ndarray, " part"], Float[np.ndarray, "resamples part"]]]:
    """JND of the rows of each data set, from observers drawn again.

    Relative to each row's reference. Data sets of one observer are left out.
    """
    table: Any = comparisons.table
    data_set = table["data_set"].to_numpy()
    for number, name in enumerate(dict.fromkeys(data_set)):
        mine = np.flatnonzero(data_set == name)
        groups = list(set(table["group"].iloc[mine]))
        cast: Any = comparisons.votes[comparisons.votes["group"].isin(groups)]
        if cast["observer"].nunique() < 2:
            continue
        own = jax.random.fold_in(key, number)
        options: Any = {"by": ("group",), "resamples": resamples, "prior": prior}
        found = bootstrap(cast, key=own, **options)
        rows, anchors = places(table, found.table, mine)
        yield mine, found.samples[:, rows] - found.samples[:, anchors]


def places(
    table: Any, found: Any, rows: Int[np.ndarray, " part"] | None = None
) -> tuple[Int[np.ndarray, " part"], Int[np.ndarray, " part"]]:
    """Where a table of scaled conditions has each row, and its reference."""
    keys = zip(found["group"], found["condition"], strict=True)
    place = {key: number for number, key in enumerate(keys)}
    named = list(zip(table["group"], table["condition"], strict=True))
    rows = np.arange(len(table)) if rows is None else rows
    anchors = table["reference"].to_numpy(int)[rows]
    unseen = [named[row] for row in rows if named[row] not in place]
    if unseen:
        group, condition = unseen[0]
        raise ValueError(
            "`comparisons` must have votes on every condition, got none on "
            f"{condition!r} of {group}."
        )
    at = lambda chosen: np.array([place[named[row]] for row in chosen], int)
    return at(rows), at(anchors)


def read_comparisons(
    votes: str | Path,
    conditions: str | Path,
    textures: str | Path | None = None,
    *,
    encoding: str | None = None,
) -> Comparisons:
    """Read one's own experiment from two CSV files and a folder of textures.

    **Arguments:**

    - `votes`: a file as `camojab.votes.read_votes` reads it.
    - `conditions`: a file with a row per condition: the columns of `camojab.predict`,
        `condition`, the name that the votes use, and optionally

        - `data_set`, whose conditions share one scale, and `block`, which is reported
            on its own; one of each if left out;
        - `reference`, the condition that quality is relative to: that of the same
            texture at full rate, say, where observers compare what each texture lost.
            The first condition of the group if left out;
        - `temporal_only`, 0 or 1: whether only the judder differs.

        Any other column that both files have tells groups apart, within which names
        are unique and conditions were compared: a block or a session, for example.
    - `textures`: the folder that the column `texture` is relative to.
    - `encoding`: of the textures, as in `camojab.Spectrum.from_texture`.

    **Raises:** `TableError`, a `ValueError`, with a sentence for each problem that
    names its file and line; `OSError` for files that cannot be read.
    """
    cast = read_votes(votes)
    described = read_csv(Path(conditions))
    table = _conditions(described, cast, Path(votes))
    texels = _texels(described, table, textures, encoding)
    return _joined(table, cast.assign(group=_groups(cast, table.attrs["by"])), texels)


def _joined(table: Any, votes: Any, textures: Mapping[str, Any]) -> Comparisons:
    """Votes with the rows that they are about; of rows of one name, the first."""
    names = zip(table["group"], table["condition"], strict=True)
    rows: dict[tuple[str, str], int] = {}
    for row, name in enumerate(names):
        rows.setdefault(name, row)
    sides = {
        side: [rows[name] for name in zip(votes["group"], votes[column], strict=True)]
        for side, column in (("a", "condition_a"), ("b", "condition_b"))
    }
    kept = votes[["observer", "group", *_VOTES[1:]]].assign(**sides)
    return Comparisons(table, kept.reset_index(drop=True), textures)


def _conditions(described: CsvTable, votes: Any, path: Path) -> Any:
    """The table of conditions, checked alone and against the votes."""
    import pandas as pd

    needed = ("condition", "texture", *REQUIRED)
    try:
        check_columns(described.header, required=needed, added=["group"])
    except TableError as error:
        raise TableError(f"{described.path}: {error}") from error
    optional = {"temporal_only": FLAG} if "temporal_only" in described.header else {}
    rules = REQUIRED | optional
    values, problems = numbers(described.columns(rules), rules, np.dtype(np.float64))
    own = ("data_set", "block", "reference")
    texts = described.columns(("condition", "texture", *own))
    by = [n for n in described.header if n in votes and n not in (*_VOTES, *rules)]
    by = [n for n in by if n not in ("texture", "condition", "reference")]
    table = pd.DataFrame({**texts, **values, **described.columns(by)})
    table = table.assign(
        data_set=texts.get("data_set", "votes"),
        block=texts.get("block", texts.get("data_set", "votes")),
        temporal_only=values.get("temporal_only", np.zeros(len(table))) > 0,
        group=_groups(table, by),
    )
    table.attrs["by"] = by
    rows, repeated = _places(table)
    problems += repeated
    table["reference"], unknown = _references(table, rows, "reference" in texts)
    problems += unknown
    if problems:
        raise described.error(problems)
    if not len(table):
        raise TableError(f"{described.path}: must have conditions, got none.")
    _check_votes(votes, by, rows, path, described.path)
    return table


def _groups(table: Any, by: Sequence[str]) -> list[str]:
    """What to call the group of each row: the cells of the columns, joined."""
    if not by:
        return ["all"] * len(table)
    cells = [[_text(cell) for cell in table[name]] for name in by]
    return [", ".join(parts) for parts in zip(*cells, strict=True)]


def _text(cell: Any) -> str:
    """A cell alike in both files, however its number is written."""
    try:
        return f"{float(cell):g}"
    except ValueError:
        return str(cell).strip()


def _places(table: Any) -> tuple[dict[tuple[str, str], int], list[Problem]]:
    rows: dict[tuple[str, str], int] = {}
    problems = []
    for row, name in enumerate(zip(table["group"], table["condition"], strict=True)):
        if name in rows:
            rule = f"`condition` must be unique, got {name[1]!r} again in {name[0]}."
            problems.append(Problem(row, rule))
        rows.setdefault(name, row)
    return rows, problems


def _references(
    table: Any, rows: Mapping[tuple[str, str], int], named: bool
) -> tuple[list[int], list[Problem]]:
    first: dict[str, int] = {}
    for row, group in enumerate(table["group"]):
        first.setdefault(group, row)
    if not named:
        return [first[group] for group in table["group"]], []
    found, problems = [], []
    pairs = zip(table["group"], table["reference"], strict=True)
    for row, (group, name) in enumerate(pairs):
        if (group, name) not in rows:
            rule = f"`reference` must be a condition of {group}, got {name!r}."
            problems.append(Problem(row, rule))
        found.append(rows.get((group, name), row))
    return found, problems


def _check_votes(
    votes: Any,
    by: Sequence[str],
    rows: Mapping[tuple[str, str], int],
    path: Path,
    described: Path,
) -> None:
    lines = read_csv(path)
    problems = []
    groups = _groups(votes, by)
    for side in ("condition_a", "condition_b"):
        for row, name in enumerate(zip(groups, votes[side], strict=True)):
            if name not in rows:
                rule = f"`{side}` must be a condition of {described} in {name[0]}"
                problems.append(Problem(row, f"{rule}, got {name[1]!r}."))
    if problems:
        raise lines.error(problems)


def _texels(
    described: CsvTable, table: Any, folder: str | Path | None, encoding: str | None
) -> dict[str, Float[np.ndarray, "rows columns"]]:
    names = list(table["texture"])
    found, unknown = sources(dict.fromkeys(names), {}, encoding, folder)
    texels, problems = {}, [Problem(names.index(n), t) for n, t in unknown.items()]
    for name, source in found.items():
        try:
            texels[name] = source()
        except (OSError, ValueError) as error:
            problems.append(Problem(names.index(name), f"in {name!r}, {error}"))
    if problems:
        raise described.error(problems)
    return texels
