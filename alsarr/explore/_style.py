"""What the texts and the figures of the page look like."""

from collections.abc import Mapping
from typing import Any

from bokeh.models import Range1d
from bokeh.plotting import figure


PAGE = """
body { margin: 0; background: #f6f6f4; color: #222;
       font: 14px/1.4 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; }
"""

HEADING: dict[str, Any] = {
    "font-size": "15px",
    "font-weight": "600",
    "margin-bottom": "-4px",
}
HEAD: dict[str, Any] = {
    "font-size": "21px",
    "font-weight": "600",
    "white-space": "nowrap",
}
READOUT: dict[str, Any] = {
    "font-size": "15px",
    "line-height": "30px",
    "white-space": "nowrap",
}
HINT: dict[str, Any] = {"font-size": "12px", "color": "#555"}
CARD: dict[str, Any] = {
    "background": "#ffffff",
    "border": "1px solid #dddddd",
    "border-radius": "6px",
    "box-sizing": "border-box",
    "padding": "8px",
}

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
