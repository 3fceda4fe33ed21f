"""What the figures have in common."""

from typing import Any, TYPE_CHECKING


if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Of Okabe and Ito, which the colour-blind tell apart too.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")
MARKERS = ("o", "s", "^", "D", "v", "P")


def new_figure(width: float, height: float) -> "Figure":
    """An empty figure of a size in inches; a report's page is 10 inches wide."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height))
    figure.set_layout_engine("constrained")
    return figure


def legend(figure: "Figure", axes: list["Axes"], title: str = "") -> None:
    """One legend, above the panels, of every name in any of them."""
    handles: dict[str, Any] = {}
    for axis in axes:
        drawn, labels = axis.get_legend_handles_labels()
        handles |= dict(zip(labels, drawn, strict=True))
    figure.legend(
        list(handles.values()),
        list(handles),
        loc="outside upper center",
        ncols=len(handles),
        fontsize=9,
        title=title or None,
        title_fontsize=9,
        frameon=False,
    )
