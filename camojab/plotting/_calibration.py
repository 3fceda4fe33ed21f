"""Measured quality beside the model's, laid out as Figure 7 of Jindal et al. 2021."""

from itertools import cycle
from typing import Any, TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ._style import COLOURS, new_figure


if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def quality_by_shading_rate(
    table: "pandas.DataFrame", predicted: Float[np.ndarray, " rows"]
) -> "Figure":
    """Figure 7a: a panel for each block and velocity, a colour for each texture.

    **Arguments:**

    - `table`: as in `camojab.fit.Observations`; only data sets in which the shading
      rate varies are drawn.
    - `predicted`: the model's quality of each row. [JND].
    """
    rows: Any = table.assign(predicted=predicted, size=1.0 / table["rate_x"])
    rows = _where(rows, rows.groupby("data_set")["size"].nunique() > 1)
    blocks = list(dict.fromkeys(rows["block"]))
    colours = dict(zip(dict.fromkeys(rows["texture"]), cycle(COLOURS), strict=False))
    widest = rows.groupby("block")["velocity_deg_s"].nunique().max()
    figure, axes = _panels(len(blocks), int(widest))
    for line, block in enumerate(blocks):
        members = rows[rows["block"] == block].groupby("velocity_deg_s", sort=True)
        for column, (velocity, panel) in enumerate(members):
            axis = axes[line][column]
            for texture, points in panel.groupby("texture", sort=False):
                colour = colours[str(texture)]
                _draw(axis, points.sort_values("size"), "size", str(texture), colour)
            axis.set_title(f"{block}, {velocity:g} deg/s", fontsize=9)
            axis.set_xscale("log", base=2)
            axis.set_xticks([1, 2, 4], ["1x1", "2x1", "4x1"])
            axis.minorticks_off()
    return _finished(figure, axes, "shading rate [px x px]")


def quality_by_refresh_rate(
    table: "pandas.DataFrame", predicted: Float[np.ndarray, " rows"]
) -> "Figure":
    """Figure 7b: a panel for each block in which the refresh rate varies.

    **Arguments:** as `quality_by_shading_rate`; a colour stands for a velocity.
    """
    rows: Any = table.assign(predicted=predicted)
    several = rows.groupby("data_set")[["refresh_rate_hz", "rate_x"]].nunique() > 1
    rows = _where(rows, several["refresh_rate_hz"] & ~several["rate_x"])
    blocks = list(dict.fromkeys(rows["block"]))
    velocities = dict.fromkeys(rows["velocity_deg_s"])
    colours = dict(zip(velocities, cycle(COLOURS), strict=False))
    figure, axes = _panels(1, len(blocks))
    for axis, block in zip(axes[0], blocks, strict=True):
        panel = rows[rows["block"] == block]
        for velocity, points in panel.groupby("velocity_deg_s", sort=True):
            points = points.sort_values("refresh_rate_hz")
            label, colour = f"{velocity:g} deg/s", colours[velocity]
            _draw(axis, points, "refresh_rate_hz", label, colour)
        axis.set_title(str(block), fontsize=9)
    return _finished(figure, axes, "refresh rate [Hz]")


def _where(table: Any, chosen: Any) -> Any:
    """Rows of the chosen data sets."""
    return table[table["data_set"].isin(chosen.index[chosen])]


def _draw(axis: "Axes", points: Any, along: str, label: str, colour: str) -> None:
    x, measured = points[along].to_numpy(float), points["quality_jnd"].to_numpy()
    axis.plot(x, points["predicted"], "-", color=colour, label=label, linewidth=1.5)
    low, high = points["low_jnd"].to_numpy(), points["high_jnd"].to_numpy()
    interval = np.stack([measured - low, high - measured])
    axis.errorbar(
        x,
        measured,
        yerr=np.nan_to_num(np.maximum(interval, 0.0)),
        fmt="o",
        color=colour,
        markersize=4,
        capsize=2,
        linewidth=0.8,
    )


def _panels(rows: int, columns: int) -> tuple["Figure", list[list["Axes"]]]:
    figure = new_figure(3.0 * columns + 1.6, 2.5 * rows + 0.6)
    axes = figure.subplots(rows, columns, squeeze=False, sharey="row")
    return figure, [list(row) for row in axes]


def _finished(figure: "Figure", axes: list[list["Axes"]], x_label: str) -> "Figure":
    handles: dict[str, Any] = {}
    for row in axes:
        row[0].set_ylabel("quality [JND]")
        for axis in row:
            axis.axhline(0.0, color="0.8", linewidth=0.8, zorder=0)
            lines, labels = axis.get_legend_handles_labels()
            handles.update(zip(labels, lines, strict=True))
    for axis in axes[-1]:
        axis.set_xlabel(x_label)
    figure.legend(
        list(handles.values()),
        list(handles),
        loc="outside right upper",
        fontsize=8,
        title="line: model\ndot: measured",
        title_fontsize=8,
        frameon=False,
    )
    return figure
