"""Figures of tables: their cost, their errors, and the rates that they lead to."""

from collections.abc import Mapping
from typing import Any, TYPE_CHECKING

import numpy as np
from jaxtyping import Int

from .._rates import RATES
from ..tables import QualityTables


if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


_ERRORS = {
    "largest_jnd": "largest",
    "percentile_99_jnd": "99 % are below",
    "median_jnd": "median",
}
# Errors below it are drawn at it: a logarithm has no 0.
_SMALLEST = 1e-6


def errors_by_size(
    table: "pandas.DataFrame", *, tolerance_jnd: float | None = None
) -> "Figure":
    """Errors of tables, a line for each from the smallest to the largest.

    **Arguments:**

    - `table`: a row for each table, with the columns `name`, `numbers`, how many it
        stores, and `largest_jnd`, `percentile_99_jnd` and `median_jnd`, its errors.
        [JND], >= 0.
    - `tolerance_jnd`: where a line is drawn. [JND], > 0; none if left out.
    """
    from matplotlib.figure import Figure

    from camojab.plotting._style import COLOURS, MARKERS

    rows: Any = table.sort_values("numbers", kind="stable")
    figure = Figure(figsize=(8.5, 0.5 * len(rows) + 1.5))
    figure.set_layout_engine("constrained")
    axis = figure.subplots()
    at = np.arange(len(rows))
    for i, (column, label) in enumerate(_ERRORS.items()):
        error = np.maximum(rows[column].to_numpy(float), _SMALLEST)
        style: dict[str, Any] = {"color": COLOURS[i], "marker": MARKERS[i]}
        axis.plot(error, at, linestyle="none", label=label, **style)
    if tolerance_jnd is not None:
        style = {"color": "0.3", "linestyle": "--", "linewidth": 1}
        axis.axvline(tolerance_jnd, label="tolerance", **style)
    numbers = [f"{number:,}".replace(",", " ") for number in rows["numbers"]]
    names = [
        f"{name}\n{number} numbers"
        for name, number in zip(rows["name"], numbers, strict=True)
    ]
    axis.set_yticks(at, names, fontsize=8.5)
    axis.set_ylim(len(rows) - 0.5, -0.5)
    axis.set_xscale("log")
    axis.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
    axis.margins(x=0.06)
    axis.set_xlabel("error against the model [JND]")
    axis.set_ylabel("tables")
    axis.grid(color="0.92", zorder=0)
    axis.set_axisbelow(True)
    figure.legend(
        loc="outside upper center",
        ncols=len(_ERRORS) + (tolerance_jnd is not None),
        fontsize=9,
        frameon=False,
    )
    return figure


def table_errors(tables: QualityTables) -> "Figure":
    """The certificate of tables: the largest error of each texture and mip level.

    A square has the largest error over all rates, directions and held-out conditions;
    of a pair that the tables were not made for there is none, and it is grey.
    """
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    worst = np.asarray(tables.certificate.largest, float).max(axis=(1, 2))
    error = np.where(np.asarray(tables.occurs), worst[np.asarray(tables.entry)], np.nan)
    textures, levels = error.shape
    figure = Figure(figsize=(0.75 * levels + 3.2, 0.45 * textures + 1.7))
    figure.set_layout_engine("constrained")
    axis = figure.subplots()
    # 0 of the reference rate, or of a constant, has no place on a logarithmic scale.
    shown = np.maximum(error, 1e-4)
    low, high = np.nanmin(shown), np.nanmax(shown)
    scale: Any = LogNorm(low, max(high, 1.01 * low))
    image = axis.imshow(shown, cmap="viridis", norm=scale, aspect="auto")
    axis.set_facecolor("0.85")
    for (row, column), value in np.ndenumerate(error):
        if not np.isnan(value):
            bright = float(scale(max(value, 1e-4))) > 0.6
            axis.text(
                float(column),
                float(row),
                f"{value:.2g}",
                ha="center",
                va="center",
                fontsize=8,
                color="black" if bright else "white",
            )
    axis.set_xticks(
        range(levels), [f"{level:g}" for level in np.asarray(tables.mip_levels)]
    )
    axis.set_yticks(range(textures), tables.texture_names)
    axis.set_xlabel("mip level [octaves]")
    axis.set_ylabel("texture")
    bar = figure.colorbar(image, ax=axis)
    ticks = np.geomspace(scale.vmin, scale.vmax, 4)
    bar.set_ticks(ticks.tolist(), labels=[f"{tick:.2g}" for tick in ticks])
    bar.minorticks_off()
    bar.set_label("largest error [JND]")
    return figure


def tile_rates(maps: Mapping[str, Int[np.ndarray, "rows columns"]]) -> "Figure":
    """Rate maps in the paper's colours, a square a tile, two in a line.

    **Arguments:**

    - `maps`: index of the rate of each tile, in the order of `alsarr.RATES`, by the
        name of the map. The cost is in the title.
    """
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    columns = min(2, len(maps))
    lines = -(-len(maps) // columns)
    rows, wide = next(iter(maps.values())).shape
    width = 10.0 / columns if columns > 1 else 7.0
    figure = Figure(
        figsize=(width * columns, (width * rows / wide + 0.3) * lines + 0.3)
    )
    figure.set_layout_engine("constrained")
    axes: Any = figure.subplots(lines, columns, squeeze=False).ravel()
    for axis in axes:
        axis.set_axis_off()
    for axis, (name, rate) in zip(axes, maps.items(), strict=False):
        cost = RATES.cost[rate].mean() / RATES.cost.max()
        axis.imshow(RATES.colour[rate], interpolation="nearest")
        axis.set_title(f"{name}: {cost:.1%} of the cost of 1x1", fontsize=10)
    keys = [
        Patch(color=tuple(colour / 255), label=name)
        for name, colour in zip(RATES.names, RATES.colour, strict=True)
    ]
    figure.legend(
        handles=keys,
        ncols=len(keys),
        loc="outside lower center",
        fontsize=9,
        frameon=False,
    )
    return figure
