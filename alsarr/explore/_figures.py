"""The curves of the page, each with the columns of data that redraw them."""

from typing import Any

import numpy as np
from bokeh.models import (
    ColumnDataSource,
    HoverTool,
    Legend,
    LegendItem,
    Range1d,
)
from jaxtyping import Float

from camojab.plotting._style import COLOURS

from ._chain import Stages
from ._conditions import RANGES
from ._curves import Parts
from ._style import LEGEND, plot


_PARTS = {
    "quality": ("quality", "#111111", "solid", 3.0),
    "spatial": ("spatial part", COLOURS[0], "solid", 2.0),
    "temporal": ("temporal part", COLOURS[5], "solid", 2.0),
    "full": ("quality at 1x1", "#888888", "dashed", 2.0),
}

_STAGES = {
    "texture": ("texture", "#111111", "solid", 2.0),
    "mipmap": ("1 mipmap filter", COLOURS[1], "solid", 2.0),
    "coarse_shading": ("2 coarse shading", COLOURS[5], "solid", 2.0),
    "hold": ("3 hold-type blur", COLOURS[2], "solid", 2.0),
    "pursuit": ("4 pursuit blur", COLOURS[4], "solid", 2.0),
    "perceived": ("5 sensitivity", COLOURS[0], "solid", 3.0),
    "reference": ("texture, sensitivity", "#888888", "dashed", 2.0),
    "replica": ("temporal replica,\nsensitivity", COLOURS[3], "dotted", 2.0),
}

# What is left of a spectrum below this share of its peak is not drawn.
_FLOOR = 1e-6


class QualityFigure:
    """Quality and its parts against one of the conditions, marked where it is now.

    Figures share `source`, which gets the columns of all: every change is painted.
    """

    def __init__(
        self,
        name: str,
        label: str,
        unit: str,
        y_range: Range1d,
        source: ColumnDataSource,
    ):
        self._name = name
        self.figure = plot(
            f"Quality against {label}",
            x_axis_label=f"{label} [{unit}]",
            y_axis_label="quality [JND]",
            x_range=Range1d(start=RANGES[name][0], end=RANGES[name][1]),
            y_range=y_range,
            height=310,
            name=f"{name}_figure",
        )
        own = lambda column: f"{name}_{column}"
        self.figure.vspan(own("here"), source=source, color="#bbbbbb")
        items = []
        for key, (text, colour, dash, width) in reversed(_PARTS.items()):
            style: dict[str, Any] = {"line_dash": dash, "line_width": width}
            drawn = self.figure.line(
                own("x"), own(key), source=source, color=colour, **style
            )
            point = {"x": own("here"), "y": own(f"{key}_here"), "color": colour}
            self.figure.scatter(source=source, size=9, **point)
            items.insert(0, LegendItem(label=text, renderers=[drawn]))
            if key == "quality":
                self._hover(drawn, label, unit)
        legend = Legend(items=items, orientation="horizontal", **LEGEND)
        legend.spacing, legend.location = 14, "left"
        self.figure.add_layout(legend, "above")

    def columns(
        self,
        x: Float[np.ndarray, " n"],
        curves: Parts,
        full: Parts,
        here: tuple[float, Parts, Parts],
    ) -> dict[str, np.ndarray]:
        """The curves of the rate and of full rate, and the marks at `here`."""
        at, own, own_full = here
        values = {**curves._asdict(), "full": full.quality}
        points = {**own._asdict(), "full": own_full.quality}
        first = lambda value: np.append(value, np.full(len(x) - 1, np.nan))
        marked = {f"{key}_here": first(value) for key, value in points.items()}
        found = {"x": x, "here": first(at), **values, **marked}
        return {f"{self._name}_{column}": value for column, value in found.items()}

    def _hover(self, drawn: Any, label: str, unit: str) -> None:
        own = lambda column: f"@{self._name}_{column}"
        rows = [(label, f"{own('x')}{{0.0}} {unit}")]
        rows += [
            (text, f"{own(key)}{{0.00}} JND") for key, (text, *_) in _PARTS.items()
        ]
        hover = HoverTool(renderers=[drawn], tooltips=rows, mode="vline")
        self.figure.add_tools(hover)


class SpectrumFigure:
    """The amplitude spectrum after each stage of the model."""

    def __init__(self):
        self._source = ColumnDataSource(
            {"frequency": [], **{key: [] for key in _STAGES}}, name="spectrum"
        )
        self.figure = plot(
            "Spectrum after each stage",
            x_axis_label="spatial frequency along the motion [cycles/deg]",
            y_axis_label="amplitude, rms over the other axis [1]",
            x_axis_type="log",
            y_axis_type="log",
            x_range=Range1d(start=0.1, end=RANGES["ppd"][1] / 2),
            y_range=Range1d(start=1e-2, end=1e4),
            height=452,
            name="spectrum_figure",
        )
        items = []
        for key, (text, colour, dash, width) in _STAGES.items():
            line = self.figure.line(
                "frequency",
                key,
                source=self._source,
                color=colour,
                line_dash=dash,
                line_width=width,
            )
            items.append(LegendItem(label=text, renderers=[line]))
        legend = Legend(items=items, click_policy="hide", **LEGEND)
        legend.title = "stage (click to hide)"
        legend.title_text_font_size = "12px"
        self.figure.add_layout(legend, "right")

    def show(self, stages: Stages) -> None:
        """Draw the stages; what one leaves nothing of is left out."""
        data = stages._asdict()
        peak = max(float(np.max(data[key])) for key in _STAGES)
        seen = lambda y: np.where(y > _FLOOR * peak, y, np.nan)
        drawn = {key: seen(y) for key, y in data.items() if key != "frequency"}
        self._source.data = {"frequency": stages.frequency, **drawn}

    def fit(self, stages: Stages) -> None:
        """Set the axis of amplitude for a texture, so that it rests during a drag."""
        top = float(np.max(stages.texture)) or 1.0
        self.figure.y_range.start, self.figure.y_range.end = 1e-4 * top, 300 * top
