"""What accuracy costs: error against throughput."""

from typing import Any, TYPE_CHECKING

import numpy as np

from ._style import COLOURS, legend, MARKERS, new_figure


if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def error_and_throughput(table: "pandas.DataFrame") -> "Figure":
    """Largest error against conditions a second, a panel for each formulation.

    **Arguments:**

    - `table`: a row for each point, with the columns `formulation`, `precision`,
      `fidelity`, `error_jnd` [JND], `conditions_per_s` [1/s] and `front`, which is not
      empty where no other row of the formulation is better in both. Errors of 0 stand
      at the lower edge.
    """
    rows: Any = table
    panels = list(rows.groupby("formulation", sort=False))
    precisions = list(dict.fromkeys(rows["precision"]))
    figure = new_figure(5.0 * len(panels) + 0.2, 4.6)
    axes = figure.subplots(1, len(panels), squeeze=False, sharex=True, sharey=True)[0]
    every = rows["error_jnd"].to_numpy(float)
    positive = every[every > 0]
    # A decade below the smallest error that a logarithm can show.
    edge = 10.0 ** np.floor(np.log10(positive.min(initial=1.0)) - 1.0)
    for axis, (name, part) in zip(axes, panels, strict=True):
        _points(axis, part.assign(shown=part["error_jnd"].clip(lower=edge)), precisions)
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
        axis.set_title(f"formulation: {name}", fontsize=10)
        axis.set_xlabel("throughput after pooling [conditions/s]")
        axis.grid(color="0.92", zorder=0)
        axis.margins(x=0.25, y=0.12)
    axes[0].set_ylabel("largest error [JND]")
    ticks = 10.0 ** np.arange(np.log10(edge), np.log10(positive.max(initial=edge)) + 1)
    labels = [
        "0" if i == 0 and not every.all() else f"{tick:g}"
        for i, tick in enumerate(ticks)
    ]
    axes[0].set_yticks(ticks, labels)
    axes[0].minorticks_off()
    legend(figure, list(axes), "numbers are the cells that energies are pooled into")
    return figure


def _points(axis: "Axes", part: Any, precisions: list[str]) -> None:
    front = part[part["front"] != ""].sort_values("conditions_per_s")
    axis.plot(
        front["conditions_per_s"],
        front["shown"],
        color="0.6",
        linewidth=1.5,
        label="none more accurate and faster",
    )
    for i, precision in enumerate(precisions):
        own = part[part["precision"] == precision]
        axis.plot(
            own["conditions_per_s"],
            own["shown"],
            MARKERS[i],
            color=COLOURS[i],
            markersize=6,
            label=precision,
        )
        for _, row in own.iterrows():
            axis.annotate(
                row["fidelity"].removesuffix(" cells"),
                (row["conditions_per_s"], row["shown"]),
                # The front rises; points of two precisions lie beside each other.
                xytext=(5, -4) if i else (-5, 4),
                textcoords="offset points",
                ha="left" if i else "right",
                va="top" if i else "bottom",
                fontsize=8,
                color=COLOURS[i],
            )
