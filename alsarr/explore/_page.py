"""The page's controls and where everything stands on it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from bokeh.layouts import column, row
from bokeh.models import (
    Button,
    CategoricalSlider,
    ColumnDataSource,
    CustomJS,
    CustomJSTickFormatter,
    Div,
    GlobalInlineStyleSheet,
    Range1d,
    Select,
    Slider,
)

from .._rates import RATES
from ._conditions import Conditions, RANGES
from ._figures import QualityFigure, SpectrumFigure
from ._pictures import FrameFigures, TextureFigure
from ._style import CARD, HEAD, HEADING, HINT, PAGE, READOUT
from ._upload import MOST_BYTES


TITLE = "CaMoJAB and ALSaRR"

ENCODINGS = ("sRGB", "linear")
"""How the values of an uploaded image may stand for light."""

_ABOUT = (
    "At 0 JND the energies are those of the texture itself; what aliases add can lift "
    "quality above 0. One JND apart, 75 % of people prefer the better picture. Motion "
    "is horizontal, and the eye follows it. The spike that ends a coarsely shaded "
    "spectrum is the replica of the texture's mean. The frame has the built-in "
    "textures, and the mean speed and luminance of the sliders."
)

# The file is read in the browser, and one that is too large never leaves it.
_CHOOSE = """
const input = document.createElement("input")
input.type = "file"
input.accept = "image/*"
input.addEventListener("change", async () => {
  const file = input.files[0]
  if (file == null)
    return
  const small = file.size <= most
  const content = small ? new Uint8Array(await file.arrayBuffer()) : new Uint8Array(0)
  carrier.data = {content}
  carrier.tags = [file.name, file.size, Date.now()]
})
input.click()
"""


@dataclass(frozen=True)
class Controls:
    """Everything on the page that can be moved, and what it answers.

    - `carrier`: its tags change, to the name and size of a file and a time, after its
        column `content` was set to the bytes of the file.
    """

    velocity: Slider
    refresh_rate: Slider
    persistence: Slider
    ppd: Slider
    luminance: Slider
    texture: Select
    upload: Button
    carrier: ColumnDataSource
    encoding: Select
    mip_level: Slider
    rate: CategoricalSlider
    budget: Slider
    oracle: Select
    message: Div
    readout: Div

    def conditions(self) -> Conditions:
        """What the sliders say of the display and the motion."""
        # A browser sends whole numbers as integers.
        plain = {n: float(getattr(self, n).value) for n in Conditions._fields}
        return Conditions(**plain | {"luminance": 10 ** plain["luminance"]})


def controls(textures: Sequence[str], oracles: Sequence[str]) -> Controls:
    """Every control where it starts."""
    start = Conditions()
    carrier = ColumnDataSource({"content": []}, name="carrier")
    upload = Button(label="Upload an image", name="upload", width=128)
    choose = CustomJS(args={"carrier": carrier, "most": MOST_BYTES}, code=_CHOOSE)
    upload.js_on_event("button_click", choose)
    slider = lambda name, title, step, **more: _slider(
        name, title, getattr(start, name), *RANGES[name], step, **more
    )
    power = CustomJSTickFormatter(code="return Number((10 ** tick).toPrecision(3))")
    return Controls(
        velocity=slider("velocity", "Velocity [deg/s]", 0.5),
        refresh_rate=slider("refresh_rate", "Refresh rate [Hz]", 1),
        persistence=slider("persistence", "Persistence [1]", 0.01),
        ppd=slider("ppd", "Resolution of the display [px/deg]", 1),
        luminance=_slider(
            "luminance", "Luminance [cd/m²]", 2.0, -1.0, 3.0, 0.05, format=power
        ),
        texture=_select("texture_choice", "Texture", textures, 128),
        upload=upload,
        carrier=carrier,
        encoding=_select("encoding", "Encoding of uploads", ENCODINGS, 128),
        mip_level=_slider("mip_level", "Mip level [octaves]", 0, 0, 8, 1),
        rate=CategoricalSlider(
            categories=list(RATES.names),
            value="2x2",
            title="Shading rate [px of the coarse pixel]",
            name="rate",
            css_classes=["rate"],
            **_WIDE,
        ),
        budget=_slider("budget", "Budget [% of full rate]", 25, 6.25, 100, 0.25),
        oracle=_select("oracle", "Oracle", oracles, 262),
        message=Div(text="", render_as_text=True, name="message", styles=HINT),
        readout=Div(text="", name="readout", styles=READOUT),
    )


_WIDE: dict[str, Any] = {"width": 262, "margin": (2, 5, 2, 5)}


def _slider(
    name: str,
    title: str,
    value: float | int,
    start: float | int,
    end: float | int,
    step: float | int,
    **more: Any,
) -> Slider:
    ends = {"start": start, "end": end, "step": step, "value": value}
    return Slider(title=title, name=name, css_classes=[name], **ends, **_WIDE, **more)


def _select(name: str, title: str, options: Sequence[str], width: int) -> Select:
    return Select(
        title=title, name=name, options=list(options), value=options[0], width=width
    )


@dataclass(frozen=True)
class Figures:
    """Everything on the page that is drawn.

    - `quality`, `curves`: the axis and the source of both figures of quality.
    """

    quality: Range1d
    curves: ColumnDataSource
    by_velocity: QualityFigure
    by_refresh_rate: QualityFigure
    spectrum: SpectrumFigure
    texture: TextureFigure
    frame: FrameFigures


def head(of: Controls) -> Any:
    """The line above the page.

    By itself: all that stands in one layout is laid out anew when a text changes.
    """
    title = Div(text=TITLE, render_as_text=True, styles=HEAD, width=300)
    return row(
        title,
        of.readout,
        sizing_mode="stretch_width",
        margin=(4, 8, 0, 8),
        stylesheets=[GlobalInlineStyleSheet(css=PAGE)],
    )


def page(of: Controls, figures: Figures) -> Any:
    """All below the head, for 1440 x 900 pixels and more."""
    side = column(
        _heading("Texture"),
        row(figures.texture.figure, column(of.texture, of.upload, of.encoding)),
        of.message,
        of.mip_level,
        of.rate,
        _heading("Display and motion"),
        *(getattr(of, name) for name in Conditions._fields),
        _heading("Drawn frame"),
        of.budget,
        of.oracle,
        _hint(_ABOUT),
        width=290,
        styles=CARD,
    )
    frame = figures.frame
    framed = column(
        row(frame.picture, frame.rates, spacing=8),
        frame.shares,
        sizing_mode="stretch_width",
        styles=CARD,
    )
    curves = row(
        figures.by_velocity.figure,
        figures.by_refresh_rate.figure,
        sizing_mode="stretch_width",
        styles=CARD,
    )
    spectrum = column(figures.spectrum.figure, sizing_mode="stretch_width", styles=CARD)
    below = row(spectrum, framed, sizing_mode="stretch_width", spacing=8)
    right = column(curves, below, sizing_mode="stretch_width", spacing=8)
    return row(
        side,
        right,
        sizing_mode="stretch_width",
        spacing=8,
        margin=8,
    )


def _hint(text: str) -> Div:
    return Div(text=text, render_as_text=True, styles=HINT, width=262)


def _heading(text: str) -> Div:
    return Div(text=text, render_as_text=True, styles=HEADING)
