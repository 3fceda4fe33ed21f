"""Any number of a tidy table against one other, or over two, with units on the axes."""

from collections.abc import Iterable
from typing import Any, TYPE_CHECKING

import numpy as np

from ._style import COLOURS, legend, logarithmic, new_figure, with_unit


if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# How column names end, and the unit that this stands for.
_UNITS = {
    "_deg_s": "deg/s",
    "_cd_m2": "cd/m²",
    "_hz": "Hz",
    "_jnd": "JND",
    "_percent": "%",
}
_PIXELS = "pixels per degree [px/deg]"
_PANELS_IN_A_LINE = 3


def curves(
    table: "pandas.DataFrame",
    x: str,
    y: str = "quality_jnd",
    *,
    by: str,
    panel: str | None = None,
    log_x: bool = False,
) -> "Figure":
    """Lines of one column against another, with intervals and tangents if there are.

    Axes are named after the columns, with the unit that these end in: `velocity_deg_s`
    is "velocity [deg/s]"; one without an ending is a pure number, "persistence [1]".

    **Arguments:**

    - `table`: a row for each point, in any order, with the columns `x`, `y`, `by` and
        `panel`; optionally `low_jnd` and `high_jnd`, the ends of an interval of `y`,
        drawn as a band, and `slope`, the derivative of `y` with respect to `x` itself,
        drawn as a short tangent where it is not NaN, straight on either axis.
    - `by`: the column that tells lines apart: numbers go from dark to bright.
    - `panel`: the column that tells panels apart, three in a line; one if left out.
    - `log_x`: whether `x`, then > 0, has a logarithmic axis.

    **Raises:** `ValueError` for a column that is missing and for a table without rows.
    """
    rows: Any = _checked(table, [x, y, by, *([panel] if panel else [])])
    parts = list(rows.groupby(panel, sort=False)) if panel else [("", rows)]
    figure, axes = _panels(len(parts))
    colours = _colours(rows[by])
    span = _span(rows[x].to_numpy(float), log_x)
    for axis, (name, part) in zip(axes, parts, strict=True):
        for value, line in part.groupby(by, sort=False):
            _draw(axis, line.sort_values(x), (x, y), colours[value], _named(by, value))
            _tangents(axis, line, (x, y), span, log_x)
        axis.set_title(_title(panel, name), fontsize=10)
        axis.set_xlabel(axis_label(x))
        axis.set_ylabel(axis_label(y))
        axis.grid(color="0.92", zorder=0)
        if log_x:
            logarithmic(axis.xaxis)
    legend(figure, axes, axis_label(by) if _numbers(rows[by]) else _words(by))
    return figure


def contour_map(
    table: "pandas.DataFrame",
    x: str,
    y: str,
    value: str = "quality_jnd",
    *,
    panel: str | None = None,
    paths: "pandas.DataFrame | None" = None,
    log_x: bool = False,
    log_y: bool = False,
    levels: int = 14,
) -> "Figure":
    """Filled contours of one column over two others, and ways over them.

    Axes are named as in `curves`.

    **Arguments:**

    - `table`: a row for each point of a grid, in any order, with the columns `x`, `y`,
        `value` and `panel`.
    - `panel`: the column that tells panels apart, three in a line; one if left out.
    - `paths`: a row for each step, in the order that they were taken, with the columns
        `x`, `y`, `path`, the name of a way, and `panel`. A ring is its start, a star
        its end.
    - `log_x`, `log_y`: whether `x` or `y`, then > 0, has a logarithmic axis.
    - `levels`: about how many contours.

    **Raises:** `ValueError` for a column that is missing, for a table without rows and
    for points that are not a grid.
    """
    more = [panel] if panel else []
    rows: Any = _checked(table, [x, y, value, *more])
    ways: Any = None if paths is None else _checked(paths, [x, y, "path", *more])
    parts = list(rows.groupby(panel, sort=False)) if panel else [("", rows)]
    figure, axes = _panels(len(parts))
    heights = _levels(rows[value].to_numpy(float), levels)
    filled: Any = None
    for axis, (name, part) in zip(axes, parts, strict=True):
        grid = _grid(part, x, y, value)
        across, up = grid.columns.to_numpy(float), grid.index.to_numpy(float)
        filled = axis.contourf(
            across, up, grid.to_numpy(float), heights, cmap="cividis"
        )
        lines = axis.contour(
            across, up, grid.to_numpy(float), heights, colors="white", linewidths=0.4
        )
        some = heights[::2]
        axis.clabel(lines, some, fontsize=7.5, fmt="%g", colors=_inks(filled, some))
        if ways is not None:
            _ways(axis, ways[ways[panel] == name] if panel else ways, x, y)
        axis.set_title(_title(panel, name), fontsize=10)
        axis.set_xlabel(axis_label(x))
        axis.set_ylabel(axis_label(y))
        for chosen, side in ((log_x, axis.xaxis), (log_y, axis.yaxis)):
            if chosen:
                logarithmic(side)
    figure.colorbar(filled, ax=axes, label=axis_label(value))
    if ways is not None:
        legend(figure, axes, "ring: start; star: end")
    return figure


def axis_label(column: str) -> str:
    """What an axis is called that shows a column of numbers: its words, its unit."""
    if column == "ppd":
        return _PIXELS
    for ending, unit in _UNITS.items():
        if column.endswith(ending):
            return f"{_words(column.removesuffix(ending))} [{unit}]"
    return with_unit(_words(column))


def _checked(table: Any, columns: Iterable[str]) -> Any:
    missing = [name for name in columns if name not in table]
    if missing:
        raise ValueError(f"`table` must have a column {missing[0]!r}, got none.")
    if not len(table):
        raise ValueError("`table` must have at least one row, got none.")
    return table


def _panels(count: int) -> tuple["Figure", list["Axes"]]:
    columns = min(_PANELS_IN_A_LINE, count)
    lines = -(-count // columns)
    figure = new_figure((6.6, 8.4, 10.0)[columns - 1], 3.1 * lines + 1.0)
    # Many panels are stored in notebooks, whose pictures have to stay small.
    figure.set_dpi(80)
    axes = figure.subplots(lines, columns, squeeze=False, sharex=True, sharey=True)
    for axis in axes.ravel()[count:]:
        axis.remove()
    # Each panel is labelled, so each needs its own numbers.
    for axis in axes.ravel()[:count]:
        axis.tick_params(labelleft=True, labelbottom=True)
    return figure, list(axes.ravel()[:count])


def _words(column: str) -> str:
    return column.replace("_", " ")


def _numbers(values: Any) -> bool:
    from pandas.api.types import is_numeric_dtype

    return is_numeric_dtype(values)


def _colours(values: Any) -> dict[Any, Any]:
    from matplotlib import colormaps

    known = list(dict.fromkeys(values))
    if _numbers(values):
        rank = {value: i for i, value in enumerate(sorted(known))}
        scale = 0.85 / max(len(known) - 1, 1)
        return {value: colormaps["viridis"](scale * rank[value]) for value in known}
    return {value: COLOURS[i % len(COLOURS)] for i, value in enumerate(known)}


def _named(column: str, value: Any) -> str:
    """A line's name: a number has its unit beside it."""
    if isinstance(value, str):
        return value
    unit = axis_label(column).partition("[")[2].rstrip("]")
    return f"{value:g}" if unit == "1" else f"{value:g} {unit}"


def _title(panel: str | None, value: Any) -> str:
    """A panel's name: a number has before it what it is of."""
    if panel is None or isinstance(value, str):
        return str(value)
    return f"{axis_label(panel).partition(' [')[0]} {_named(panel, value)}"


def _draw(
    axis: "Axes", line: Any, columns: tuple[str, str], colour: Any, name: str
) -> None:
    x, y = (line[column].to_numpy(float) for column in columns)
    if "low_jnd" in line and "high_jnd" in line:
        low, high = (line[f"{end}_jnd"].to_numpy(float) for end in ("low", "high"))
        axis.fill_between(x, low, high, color=colour, alpha=0.22, linewidth=0)
    axis.plot(x, y, color=colour, linewidth=1.6, label=name)


def _span(x: np.ndarray, log_x: bool) -> float:
    """How far a tangent goes to either side: in x, or as a factor of it."""
    if log_x:
        return float((x.max() / x.min()) ** 0.06)
    return float(0.06 * (x.max() - x.min()))


def _tangents(
    axis: "Axes", line: Any, columns: tuple[str, str], span: float, log_x: bool
) -> None:
    if "slope" not in line:
        return
    for _, row in line[line["slope"].notna()].iterrows():
        x, y = (float(row[column]) for column in columns)
        ends = (x / span, x * span) if log_x else (x - span, x + span)
        at = np.array(ends)
        # What is straight on a logarithmic axis goes up with the logarithm of x.
        way = x * np.log(at / x) if log_x else at - x
        axis.plot(at, y + float(row["slope"]) * way, color="black", linewidth=1.3)
        axis.plot(x, y, "o", color="black", markersize=3.5)


def _levels(values: np.ndarray, levels: int) -> np.ndarray:
    from matplotlib.ticker import MaxNLocator

    return np.asarray(MaxNLocator(levels).tick_values(values.min(), values.max()))


def _grid(part: Any, x: str, y: str, value: str) -> Any:
    columns, lines = part[x].nunique(), part[y].nunique()
    if part.duplicated([x, y]).any() or len(part) != columns * lines:
        raise ValueError(
            f"`table` must have each pair of `{x}` and `{y}` once, got {len(part)} "
            f"rows of {columns} by {lines}."
        )
    return part.pivot(index=y, columns=x, values=value)


def _inks(filled: Any, heights: np.ndarray) -> list[str]:
    """Black on what is bright and white on what is dark, whichever stands out more."""
    colours = filled.cmap(filled.norm(heights))[:, :3]
    luminance = colours**2.2 @ (0.2126, 0.7152, 0.0722)
    return ["black" if bright else "white" for bright in luminance > 0.18]


def _ways(axis: "Axes", ways: Any, x: str, y: str) -> None:
    for i, (name, steps) in enumerate(ways.groupby("path", sort=False)):
        across, up = steps[x].to_numpy(float), steps[y].to_numpy(float)
        colour = COLOURS[(1, 5, 3, 4, 2, 0)[i % len(COLOURS)]]
        axis.plot(across, up, color=colour, linewidth=1.8, label=str(name))
        axis.plot(across[0], up[0], "o", color=colour, markerfacecolor="none")
        axis.plot(across[-1], up[-1], "*", color=colour, markersize=13, zorder=4)
