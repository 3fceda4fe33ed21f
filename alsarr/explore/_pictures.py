"""The pictures of the page: a texture, the frame, and its shading rates."""

from typing import Any

import numpy as np
from bokeh.models import (
    ColumnDataSource,
    FixedTicker,
    Label,
    LabelSet,
    LinearColorMapper,
    Range1d,
)
from jaxtyping import Float, Int, UInt8

from .._rates import RATES
from ._style import picture, plot


_GREYS = [f"#{i:02x}{i:02x}{i:02x}" for i in range(256)]

# Sides of a texture and width of a frame on the page. [px]
_TEXTURE, _FRAME = 128, 260


class TextureFigure:
    """A small picture of a texture."""

    def __init__(self):
        self.figure = picture("", width=_TEXTURE, height=_TEXTURE)
        self.figure.css_classes = ["texture_picture"]
        # The heading above reaches into what follows, as its text does not.
        self.figure.margin = (9, 1, 0, 5)
        blank = np.zeros((_TEXTURE, _TEXTURE), np.uint8)
        self._source = _grey(self.figure, blank, "texture")

    def show(self, texture: Float[np.ndarray, "rows columns"]) -> None:
        """Draw relative luminance: what the model looks at, padding and all."""
        whole = np.zeros((512, 512))
        part = texture[:512, :512]
        whole[: part.shape[0], : part.shape[1]] = part
        side = 512 // _TEXTURE
        small = whole.reshape(_TEXTURE, side, _TEXTURE, side).mean(axis=(1, 3))
        encoded = small ** (1 / 2.2)
        self._source.data = {"image": [_bytes(encoded)]}


class FrameFigures:
    """The drawn frame, its rate map, and how many tiles have each rate.

    **Arguments:** `image`: of the frame, encoded for a screen, in [0, 1].
    """

    def __init__(self, image: Float[np.ndarray, "height width 3"]):
        height = round(_FRAME * image.shape[0] / image.shape[1])
        self.picture = picture("Drawn frame", width=_FRAME, height=height)
        _grey(self.picture, _bytes(image[::2, ::2, 0]), "picture")
        self.rates = picture("Shading rates of its tiles", width=_FRAME, height=height)
        self._map = ColumnDataSource({"image": []}, name="rate_map")
        self.rates.image_rgba("image", source=self._map, x=0, y=0, dw=1, dh=1)
        self._same = {
            "rate": list(RATES.names),
            "colour": [f"#{bytes(colour).hex()}" for colour in RATES.colour],
        }
        none = {"share": [0.0] * len(RATES), "text": [""] * len(RATES)}
        self._shares = ColumnDataSource({**self._same, **none}, name="shares")
        self.shares = _bars(self._shares)
        # Not mark-up of the page, whose every change would lay all of it out anew.
        self._note = Label(
            x=8,
            y=152,
            x_units="screen",
            text="",
            text_baseline="top",
            text_font_size="12px",
            name="frame_note",
        )
        self.shares.add_layout(self._note)

    def show(
        self, rate: Int[np.ndarray, "rows columns"], shares: Float[np.ndarray, " rates"]
    ) -> None:
        """Draw a rate map in the colours of the paper's."""
        opaque = np.full((*rate.shape, 1), 255, np.uint8)
        colours = np.concatenate([RATES.colour[rate], opaque], axis=-1)
        packed = np.ascontiguousarray(colours[::-1]).view(np.uint32)[..., 0]
        self._map.data = {"image": [packed]}
        texts = [f"{100 * share:.1f} %" for share in shares]
        self._shares.data = {**self._same, "share": 100 * shares, "text": texts}

    def say(self, text: str) -> None:
        """Write above the shares."""
        self._note.text = text


def _bars(source: ColumnDataSource) -> Any:
    made = plot(
        "",
        x_range=list(RATES.names),
        y_range=Range1d(start=0, end=155),
        x_axis_label="shading rate: width x height of the coarse pixel [px]",
        y_axis_label="tiles [%]",
        height=276,
        name="shares_figure",
    )
    made.vbar("rate", top="share", width=0.85, color="colour", source=source)
    labels = LabelSet(
        x="rate",
        y="share",
        text="text",
        source=source,
        text_align="center",
        text_font_size="12px",
        y_offset=2,
    )
    made.add_layout(labels)
    made.xgrid.visible = False
    made.yaxis.ticker = FixedTicker(ticks=[0, 50, 100])
    return made


def _grey(
    on: Any, values: UInt8[np.ndarray, "rows columns"], name: str
) -> ColumnDataSource:
    source = ColumnDataSource({"image": [values]}, name=name)
    mapper = LinearColorMapper(palette=_GREYS, low=0, high=255)
    on.image("image", source=source, x=0, y=0, dw=1, dh=1, color_mapper=mapper)
    return source


def _bytes(encoded: Float[np.ndarray, "rows columns"]) -> UInt8[np.ndarray, "r c"]:
    """Values in [0, 1] as bytes, the bottom row first."""
    return np.round(255 * np.clip(encoded[::-1], 0, 1)).astype(np.uint8)
