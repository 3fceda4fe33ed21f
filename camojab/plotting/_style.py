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


def with_unit(label: str) -> str:
    """A label that ends with a unit; one without any is that of a pure number."""
    return label if "[" in label else f"{label} [1]"


def logarithmic(side: Any) -> None:
    """Give the axis of a drawn figure a logarithmic scale with plain numbers."""
    from matplotlib.ticker import LogLocator, NullFormatter

    side.axes.set(**{f"{side.axis_name}scale": "log"})
    low, high = side.get_data_interval()
    # Over several decades there is room for the powers of ten alone.
    between = (1.0,) if high / low > 10**2.5 else (1.0, 2.0, 5.0)
    side.set_major_locator(LogLocator(subs=between))
    side.set_major_formatter(lambda value, _: f"{value:g}")
    side.set_minor_formatter(NullFormatter())


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
