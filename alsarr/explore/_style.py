"""What the figures of the page have in common."""

from collections.abc import Mapping
from typing import Any

from bokeh.models import Range1d
from bokeh.plotting import figure


LEGEND: Mapping[str, Any] = {
    "border_line_color": None,
    "background_fill_alpha": 0.0,
    "label_text_font_size": "12px",
    "glyph_width": 18,
    "spacing": 2,
    "margin": 2,
    "padding": 2,
}


def plot(title: str, **options: Any) -> Any:
    """A figure in the manner of the page."""
    made: Any = figure(
        title=title,
        sizing_mode="stretch_width",
        tools="",
        toolbar_location=None,
        min_border_right=12,
        output_backend="canvas",
        **options,
    )
    made.title.text_font_size = "14px"
    made.axis.axis_label_text_font_style = "normal"
    made.axis.axis_label_text_font_size = "12px"
    made.axis.major_label_text_font_size = "12px"
    made.outline_line_color = "#cccccc"
    made.grid.grid_line_color = "#eeeeee"
    return made


def picture(title: str, *, width: int, height: int) -> Any:
    """A figure of an image alone, without axes; `height` is that of the image. [px]"""
    made: Any = figure(
        title=title or None,
        width=width,
        height=height + (26 if title else 0),
        tools="",
        toolbar_location=None,
        x_range=Range1d(start=0, end=1),
        y_range=Range1d(start=0, end=1),
        min_border=0,
    )
    made.axis.visible = False
    made.grid.visible = False
    made.outline_line_color = None
    if title:
        made.title.text_font_size = "14px"
    return made
