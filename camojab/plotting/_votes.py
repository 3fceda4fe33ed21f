"""Votes scaled to JND: the scale, how well it fits, and who disagrees with it."""

from collections.abc import Mapping, Sequence
from typing import Any, TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ._style import COLOURS, new_figure


if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase


# Conditions up to which the cells of a matrix have room for numbers.
_ROOM = 12


def scaled_quality(table: "pandas.DataFrame", by: Sequence[str] = ()) -> "Figure":
    """JND of every condition, a panel for each group, with intervals if there are any.

    **Arguments:**

    - `table`: as in `camojab.votes.GroupScaling` or `camojab.votes.Bootstrap`.
    - `by`: the columns that tell its groups apart.
    """
    rows: Any = table
    groups = list(rows.groupby(list(by), sort=False)) if by else [((), rows)]
    names = [list(part["condition"]) for _, part in groups]
    same = all(each == names[0] for each in names)
    longest = max(map(len, names))
    lines = -(-len(groups) // 3)
    figure = new_figure(_width(len(groups)), (0.22 * longest + 0.5) * lines + 1.0)
    axes = _panels(figure, len(groups))
    drawn = rows[[n for n in ("quality_jnd", "low_jnd", "high_jnd") if n in rows]]
    left, right = float(drawn.min(axis=None)), float(drawn.max(axis=None))
    margin = 0.04 * (right - left) or 1.0
    for i, (axis, (key, part)) in enumerate(zip(axes, groups, strict=True)):
        at = np.arange(len(part))
        measured = part["quality_jnd"].to_numpy(float)
        interval = None
        if "low_jnd" in part:
            low, high = (part[f"{end}_jnd"].to_numpy(float) for end in ("low", "high"))
            # A percentile interval need not hold the estimate.
            interval = np.nan_to_num(np.maximum([measured - low, high - measured], 0))
        axis.errorbar(
            measured,
            at,
            xerr=interval,
            fmt="o",
            color=COLOURS[0],
            markersize=4,
            capsize=2,
            linewidth=0.9,
        )
        axis.axvline(0.0, color="0.8", linewidth=0.8, zorder=0)
        axis.set_title(group_label(by, key) if by else "", fontsize=9)
        axis.set_yticks(at, [str(name) for name in part["condition"]], fontsize=8)
        named = not same or i % 3 == 0
        axis.tick_params(labelleft=named)
        axis.set_ylabel("condition" if named else "", fontsize=9)
        axis.set_ylim(longest - 0.5, -0.5)
        axis.set_xlim(left - margin, right + margin)
        axis.grid(color="0.93", linewidth=0.6)
        axis.set_axisbelow(True)
        axis.set_xlabel("quality [JND]", fontsize=9)
        axis.tick_params(axis="x", labelsize=8)
    return figure


def outlier_distances(table: "pandas.DataFrame") -> "Figure":
    """How far each observer is from the others; beyond the line is suspicious.

    **Arguments:** `table`: as `camojab.votes.outliers` returns it.
    """
    distance = table["distance"].to_numpy(float)
    at = np.arange(len(distance))
    figure = new_figure(7.0, 0.24 * len(at) + 1.0)
    axis = figure.subplots()
    suspicious = distance > 1
    for chosen, colour in ((~suspicious, COLOURS[0]), (suspicious, COLOURS[5])):
        ends = np.where(np.isfinite(distance), distance, 0.0)[chosen]
        axis.hlines(at[chosen], 0.0, ends, color=colour, linewidth=1.5)
        axis.plot(ends, at[chosen], "o", color=colour, markersize=5)
    axis.axvline(1.0, color="0.3", linewidth=1.0, linestyle="--")
    for row in np.flatnonzero(~np.isfinite(distance)):
        words = "not known" if np.isnan(distance[row]) else "infinite"
        axis.text(0.06, float(row), words, fontsize=8, va="center")
    axis.set_yticks(at, [str(name) for name in table["observer"]], fontsize=8)
    axis.set_ylim(len(at) - 0.5, -0.5)
    finite = distance[np.isfinite(distance)]
    axis.set_xlim(-0.03, 1.08 * max(1.1, finite.max(initial=0.0)))
    axis.set_xlabel("distance below the first quartile [interquartile ranges]")
    axis.set_ylabel("observer")
    return figure


def pair_residuals(matrices: Mapping[str, "pandas.DataFrame"]) -> "Figure":
    """How far the scale is from each pair's own votes, a matrix for each group.

    **Arguments:** `matrices`: for each group, by its name, `camojab.votes.residuals`
    with the conditions as index and columns. [JND]
    """
    frames = list(matrices.values())
    values = [frame.to_numpy(float) for frame in frames]
    labels = [[str(name) for name in frame.columns] for frame in frames]
    same = all(names == labels[0] for names in labels)
    limit = max(map(_largest, values)) or 1.0
    size = 3.0 if len(frames) > 2 else 4.6
    lines = -(-len(frames) // 3)
    size = (size if same else 1.3 * size) * lines + 0.5
    figure = new_figure(_width(len(frames)), size + 0.8)
    parts: Any = figure.subfigures(2, 1, height_ratios=[size, 0.8])
    above, below = parts
    axes = _panels(above, len(frames), share=same)
    image: Any = None
    for axis, title, cells, names in zip(axes, matrices, values, labels, strict=True):
        image = axis.imshow(cells, cmap="RdBu_r", vmin=-limit, vmax=limit)
        axis.set_facecolor("0.85")
        axis.set_title(title, fontsize=9)
        font = 8 if len(names) <= _ROOM else 6
        at = np.arange(len(names))
        axis.set_xticks(at, names, fontsize=font, rotation=90)
        axis.set_yticks(at, names, fontsize=font)
        if len(names) <= _ROOM:
            _write_values(axis, cells, limit)
    bar = figure.colorbar(image, cax=below.subplots(), orientation="horizontal")
    words = "row less column, scale less votes [JND]; grey: unanimous or not compared"
    bar.set_label(words, fontsize=9)
    return figure


def _write_values(axis: "Axes", cells: Float[np.ndarray, "n n"], limit: float) -> None:
    for (row, column), value in np.ndenumerate(cells):
        if not np.isnan(value):
            dark = abs(value) > 0.6 * limit
            axis.text(
                float(column),
                float(row),
                f"{value:.1f}".replace("-0.0", "0.0"),
                ha="center",
                va="center",
                fontsize=6.5,
                color="white" if dark else "black",
            )


def _largest(values: Float[np.ndarray, "n n"]) -> float:
    known = np.abs(values[~np.isnan(values)])
    return float(known.max(initial=0.0))


def group_label(by: Sequence[str], key: Any) -> str:
    """What to call a group: the columns that tell it apart, and their values."""
    values = key if isinstance(key, tuple) else (key,)
    return ", ".join(
        f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in zip(by, values, strict=True)
    )


def _width(panels: int) -> float:
    return (6.0, 8.0, 10.0)[min(panels, 3) - 1]


def _panels(figure: "FigureBase", count: int, *, share: bool = False) -> list["Axes"]:
    """As many panels, three in a row; `share` leaves out the labels of inner ones."""
    columns = min(3, count)
    axes = figure.subplots(-(-count // columns), columns, squeeze=False)
    for i, axis in enumerate(axes.ravel()):
        if i >= count:
            axis.remove()
        elif share:
            # The lowest panel of its column, which may end a row early.
            last = i + columns >= count
            axis.tick_params(labelleft=i % columns == 0, labelbottom=last)
    return list(axes.ravel()[:count])
