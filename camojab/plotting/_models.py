"""Models beside each other, beside measurements, and before an audience."""

from itertools import cycle
from typing import Any, TYPE_CHECKING

import numpy as np

from ._style import COLOURS, legend, MARKERS, new_figure


if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def rmse_by_block(table: "pandas.DataFrame", *, x_label: str = "block") -> "Figure":
    """Bars of what each model leaves of each block, a line of panels a setting.

    **Arguments:**

    - `table`: a row for each bar, with the columns `model`, `block`, `rmse`, `unit`
      (blocks in JND are drawn apart from opinion scores), `setting`, the name of a
      line, and `printed`, where a mark is to show another number, else NaN.
    - `x_label`: what the blocks are called.
    """
    rows: Any = table
    settings = list(dict.fromkeys(rows["setting"]))
    in_jnd = rows["unit"] == "JND"
    sides = [
        (words, rows[chosen])
        for words, chosen in (
            ("RMSE [JND]", in_jnd),
            ("RMSE [points of the score]", ~in_jnd),
        )
        if chosen.any()
    ]
    widths = [part["block"].nunique() for _, part in sides]
    figure = new_figure(10.0, 2.9 * len(settings) + 0.5)
    axes = figure.subplots(
        len(settings), len(sides), squeeze=False, width_ratios=widths
    )
    models = list(dict.fromkeys(rows["model"]))
    for line, setting in enumerate(settings):
        for column, (words, part) in enumerate(sides):
            axis = axes[line][column]
            _bars(axis, part[part["setting"] == setting], models)
            axis.set_xlabel(x_label)
            axis.set_ylabel(words)
            axis.set_title(setting, fontsize=10)
    legend(figure, list(axes.ravel()))
    return figure


def _bars(axis: "Axes", rows: Any, models: list[str]) -> None:
    blocks = list(dict.fromkeys(rows["block"]))
    width = 0.8 / len(models)
    for i, (model, colour) in enumerate(zip(models, cycle(COLOURS), strict=False)):
        own = rows[rows["model"] == model].set_index("block").reindex(blocks)
        at = np.arange(len(blocks)) + (i - (len(models) - 1) / 2) * width
        bars = axis.bar(at, own["rmse"], 0.9 * width, color=colour, label=model)
        axis.bar_label(bars, fmt="%.2f", fontsize=7, padding=1)
        if own["printed"].notna().any():
            style = {"linestyle": "none", "marker": "_", "markersize": 14}
            axis.plot(at, own["printed"], color="black", label="printed", **style)
    axis.set_xticks(np.arange(len(blocks)), blocks, fontsize=8)
    axis.margins(y=0.12)
    axis.spines[["top", "right"]].set_visible(False)


def measured_and_predicted(table: "pandas.DataFrame") -> "Figure":
    """Measurements against what models make of them, a panel for each block.

    **Arguments:**

    - `table`: a row for each point, with the columns `model`, `block`, `unit`,
      `measured` and `predicted`, and optionally `low` and `high`, the ends of the
      measurement's interval.
    """
    rows: Any = table
    blocks = list(rows.groupby("block", sort=False))
    models = list(dict.fromkeys(rows["model"]))
    columns = min(len(blocks), 3 if len(blocks) != 4 else 2)
    lines = -(-len(blocks) // columns)
    figure = new_figure(3.3 * columns + 0.2, 3.4 * lines + 0.6)
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    for axis in panels[len(blocks) :]:
        axis.remove()
    for axis, (block, part) in zip(panels, blocks, strict=False):
        for colour, marker, model in zip(
            cycle(COLOURS), cycle(MARKERS), models, strict=False
        ):
            _points(axis, part[part["model"] == model], str(model), colour, marker)
        ends = [*part["measured"], *part["predicted"]]
        axis.axline((min(ends),) * 2, slope=1.0, color="0.7", linewidth=0.8, zorder=0)
        axis.set_title(str(block), fontsize=10)
        axis.set_xlabel(f"measured [{part['unit'].iloc[0]}]", fontsize=9)
        axis.set_ylabel(f"predicted [{part['unit'].iloc[0]}]", fontsize=9)
        axis.tick_params(labelsize=8)
    legend(figure, list(panels[: len(blocks)]))
    return figure


def _points(axis: "Axes", part: Any, model: str, colour: str, marker: str) -> None:
    measured = part["measured"].to_numpy(float)
    interval = None
    if "low" in part:
        low, high = (part[name].to_numpy(float) for name in ("low", "high"))
        interval = np.nan_to_num(np.maximum([measured - low, high - measured], 0))
    axis.errorbar(
        measured,
        part["predicted"].to_numpy(float),
        xerr=interval,
        fmt=marker,
        color=colour,
        markersize=4,
        alpha=0.8,
        linewidth=0.7,
        label=model,
    )


def preferences(table: "pandas.DataFrame") -> "Figure":
    """How often something was preferred, with intervals, beside even odds.

    **Arguments:**

    - `table`: as `camojab.comparison.validation_preferences` returns it. Its columns
      before `votes` name the rows; of a column `scene` each value has a panel.
    """
    rows: Any = table
    keys = list(rows.columns[: list(rows.columns).index("votes")])
    panels = [("", rows)]
    if "scene" in keys:
        keys.remove("scene")
        panels = list(rows.groupby("scene", sort=False))
    figure = new_figure(3.0 * len(panels) + 2.2, 0.32 * len(panels[0][1]) + 1.3)
    axes = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
    for axis, (name, part) in zip(axes, panels, strict=True):
        share = part["preference"].to_numpy(float)
        ends = np.stack([share - part["low"], part["high"] - share])
        at = np.arange(len(part))
        axis.errorbar(
            share, at, xerr=ends, fmt="o", color=COLOURS[0], markersize=5, capsize=3
        )
        axis.axvline(0.5, color="0.3", linewidth=1.0, linestyle="--")
        labels = [
            ", ".join(_said(k, row[k]) for k in keys) for _, row in part.iterrows()
        ]
        axis.set_yticks(at, labels, fontsize=9)
        axis.set_ylim(len(at) - 0.5, -0.5)
        axis.set_xlim(-0.02, 1.02)
        axis.set_title(str(name), fontsize=10)
        axis.set_xlabel("share of votes for ALSaRR [1]", fontsize=9)
    return figure


def _said(name: str, value: Any) -> str:
    return f"budget {value:.4g}" if name == "budget" else str(value)
