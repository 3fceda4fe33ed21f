"""`camojab scale`: votes to JND, with what is known of their uncertainty."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TYPE_CHECKING

import jax
import numpy as np

from . import votes
from ._command import print_table, Unusable, usable
from ._page import Html, page, picture, table, text
from ._results import (
    check_folder,
    provenance,
    quote,
    records,
    save,
    to_csv,
    to_json,
)
from ._scale_sources import own_votes, Source, SOURCES
from .votes._tally import ADDED


if TYPE_CHECKING:
    import pandas


FILES = ("scale.json", "scale.csv", "report.html")
LEVEL = 0.95

# The library's names, and those of the command line.
_OPTIONS = {
    "`reference`": "`--reference`",
    "`Prior.BOUNDED`": "`--prior bounded`",
}
_FORMATS = {"p_value": ".2g", "log_likelihood": ".1f", "deviance": ".1f"}


def scale(
    *,
    file: Path | None,
    data: str | None,
    by: str | None,
    prior: str | None,
    reference: str | None,
    resamples: int,
    seed: int,
    output: Path,
    progress: Callable[[str, int, int], None],
) -> None:
    """Scale, write the files of `FILES` into the folder, and print the tables."""
    check_folder(output, FILES)
    with usable():
        source = own_votes(file) if file else SOURCES[str(data)]()
    groups = source.by if by is None else _columns(by, source.cast)
    chosen = source.prior if prior is None else votes.Prior(prior)
    anchor = source.reference if reference is None else reference
    found = _scaled(source, groups, chosen, anchor, resamples, seed, progress)
    line = quote(
        source.name,
        f"prior: {chosen.value}",
        f"0 JND: {anchor or 'mean of each group'}",
        *([f"{resamples} resamples, seed {seed}"] if found.resampled else []),
    )
    document = {
        **provenance("camojab-scale/1", source.files, seed),
        "data": source.name,
        "by": list(groups),
        "prior": chosen.value,
        "reference": anchor,
        "resamples": resamples if found.resampled else 0,
        "level": LEVEL,
        "notes": found.notes,
        "scale": records(found.table),
        "groups": records(found.groups),
        "outliers": records(found.outliers) if found.outliers is not None else None,
        "residuals_jnd": {
            name: {"conditions": list(frame.columns), "rows": frame.to_numpy().tolist()}
            for name, frame in found.residuals.items()
        },
    }
    contents = (to_json(document), to_csv(found.table), _page(source, found, line))
    save(output, dict(zip(FILES, contents, strict=True)))
    formats = _formats(groups)
    print_table(f"JND of {source.name}", found.table, formats)
    print_table("Does one scale explain the votes?", found.groups, formats)
    if found.outliers is not None:
        print_table("Observers", found.outliers)
    for note in found.notes:
        print(note)
    print(f"to quote: {line}")
    print(f"written: {', '.join(str(output / name) for name in FILES)}")


@dataclass(frozen=True)
class _Found:
    table: "pandas.DataFrame"
    groups: "pandas.DataFrame"
    outliers: "pandas.DataFrame | None"
    residuals: Mapping[str, "pandas.DataFrame"]
    by: tuple[str, ...]
    resampled: bool
    notes: list[str]


def _scaled(
    source: Source,
    by: tuple[str, ...],
    prior: votes.Prior,
    reference: str | None,
    resamples: int,
    seed: int,
    progress: Callable[[str, int, int], None],
) -> _Found:
    options: Any = {"by": by, "prior": prior}
    progress("scale", 0, 1)
    with usable(_OPTIONS):
        found = votes.scale_groups(source.cast, reference=reference, **options)
    progress("scale", 1, 1)
    scaled, outliers, notes = found.table, None, []
    observers = list(dict.fromkeys(source.cast["observer"]))
    several = len(observers) > 1
    if not several:
        notes.append(
            "No intervals and no outlier scores: these need votes of two observers or "
            f"more, told apart by the column observer, which has only {observers[0]!r}."
        )
    elif not resamples:
        notes.append("No intervals: none were asked for (--bootstrap 0).")
    if several and resamples:
        progress("bootstrap", 0, 1)
        scaled = votes.bootstrap(
            source.cast,
            key=jax.random.key(seed),
            resamples=resamples,
            reference=reference,
            level=LEVEL,
            **options,
        ).table
        progress("bootstrap", 1, 1)
        notes.append(_resampling_note(scaled, resamples))
    if several:
        progress("observers", 0, 1)
        outliers = votes.outliers(source.cast, **options)
        # Where the interquartile range is 0 the distance is not a number for JSON.
        outliers["suspicious"] = outliers["distance"] > 1
        progress("observers", 1, 1)
        notes.append(_outlier_note(outliers))
    if source.published is not None:
        scaled, more = _beside_published(scaled, source.published, by, reference)
        notes += more
    failed = list(found.groups["converged"]).count(False)
    if failed:
        notes.append(f"The search did not meet its tolerance in {failed} groups.")
    return _Found(
        scaled,
        found.groups,
        outliers,
        _residuals(source.cast, scaled, by),
        by,
        several and resamples > 0,
        notes,
    )


def _resampling_note(table: Any, resamples: int) -> str:
    least = int(table["resamples"].min())
    if least == resamples:
        return (
            f"Intervals: {LEVEL:.0%}, percentiles of {resamples} bootstraps over "
            "observers."
        )
    return (
        f"Intervals: {LEVEL:.0%}, percentiles of bootstraps over observers; of "
        f"{resamples} resamples only {least} could be scaled in the worst group, so "
        "its intervals are narrower than they should be: --prior bounded scales all."
    )


def _outlier_note(table: Any) -> str:
    far = table[table["suspicious"]]
    if not len(far):
        return "Observers: none is suspicious (no distance above 1)."
    shown = ", ".join(
        f"{name} ({distance:.2f})"
        for name, distance in zip(far["observer"], far["distance"], strict=True)
    )
    return f"Observers: a distance above 1 is suspicious, no more: {shown}."


def _beside_published(
    table: Any, published: Any, by: tuple[str, ...], reference: str | None
) -> tuple[Any, list[str]]:
    """The published JND as a further column, if they are of the same groups."""
    keys = [*by, "condition"]
    names = [name for name in published.columns if name != "published_jnd"]
    anchors = published.loc[published["published_jnd"] == 0, "condition"]
    if sorted(keys) != sorted(names) or reference not in set(anchors):
        return table, []
    joined = table.merge(published, on=keys, how="left")
    off = (joined["quality_jnd"] - joined["published_jnd"]).abs()
    worst = off.groupby([joined[name] for name in by], sort=False).max()
    near = int((worst < 1e-3).sum())
    return joined, [
        f"Published JND: met to 0.001 JND in {near} of {len(worst)} groups; the "
        f"largest difference is {off.max():.2g} JND."
    ]


def _residuals(
    cast: Any, table: Any, by: tuple[str, ...]
) -> dict[str, "pandas.DataFrame"]:
    """By group, the conditions as index and columns."""
    import pandas as pd

    from .plotting._votes import group_label

    matrices = {}
    groups = table.groupby(list(by), sort=False) if by else [((), table)]
    own = dict(list(cast.groupby(list(by), sort=False))) if by else {(): cast}
    for key, part in groups:
        names = list(part["condition"])
        wins = votes.count(own[key], names)
        values = np.asarray(votes.residuals(wins, part["quality_jnd"].to_numpy(float)))
        label = group_label(by, key) if by else "all votes"
        matrices[label] = pd.DataFrame(values, index=names, columns=names)
    return matrices


def _page(source: Source, found: _Found, line: str) -> str:
    from .plotting import outlier_distances, pair_residuals, scaled_quality

    by, formats = found.by, _formats(found.by)
    figure = picture(
        scaled_quality(found.table, by), "JND of every condition, with intervals"
    )
    sections: list[tuple[str, list[Html]]] = [
        ("In short", [text(note) for note in found.notes]),
        ("Just-noticeable differences", [figure, table(found.table, formats)]),
    ]
    if found.outliers is not None:
        distances = picture(
            outlier_distances(found.outliers), "Distance of every observer"
        )
        sections.append(("Observers", [distances, table(found.outliers)]))
    words = (
        "Deviance of the scale from a model with a free preference for each pair. A "
        "small p-value speaks against one scale for all votes of the group."
    )
    matrices = picture(pair_residuals(found.residuals), "Residual of every pair")
    sections += [
        ("Goodness of fit", [text(words), table(found.groups, formats)]),
        ("Residuals", [matrices]),
    ]
    title = f"JND of {source.name}"
    return page(title, sections, quote=line, simulated=source.simulated)


def _formats(by: tuple[str, ...]) -> dict[str, str]:
    return {**_FORMATS, **dict.fromkeys(by, "g")}


def _columns(by: str, cast: Any) -> tuple[str, ...]:
    names = tuple(name.strip() for name in by.split(",")) if by.strip() else ()
    known = [
        name
        for name in cast.columns
        if name not in ("observer", "condition_a", "condition_b", "a_preferred")
    ]
    for name in names:
        if name not in known or names.count(name) > 1:
            rule = f"different columns of {', '.join(known) or 'which there are none'}"
            raise Unusable(f"`--by` must name {rule}, got {name!r}.")
        if name in ADDED:
            raise Unusable(f"`--by` must not name {name!r}, a column of the result.")
    return names
