"""One page that somebody has open: the only place where anything changes."""

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.model import Model
from bokeh.models import ColumnDataSource, Range1d
from jaxtyping import Array, Float

from camojab import Spectrum

from ..oracle import AbstractQualityOracle
from . import _chain, _curves, _frame_map, _upload
from ._conditions import Conditions
from ._figures import QualityFigure, SpectrumFigure
from ._page import controls, Figures, head, page, TITLE
from ._pictures import FrameFigures, TextureFigure
from ._workbench import Workbench


TABLES = "tables"
"""The oracle whose tables are distilled when it is first chosen."""

# Moves of a slider that arrive within this time are answered together. [ms]
_GATHER_MS = 5

_STEP_JND = 2.0

_DISTILLING = "Tables are being distilled, which takes some ten seconds."
# Of what went wrong so many characters have room. [1]
_REASON = 40

_GOOD: dict[str, Any] = {"font-size": "12px", "color": "#555"}
_BAD: dict[str, Any] = {"font-size": "12px", "color": "#b3261e"}

_EVERYTHING = frozenset({"texture", "conditions", "budget"})


class Session:
    """The state of one page, which no other page shares.

    **Arguments:** `document`: the page is added to it. `bench`: what all pages share.
    """

    def __init__(self, document: Document, bench: Workbench):
        self._document, self._bench = document, bench
        oracles = dict(bench.drawn.oracles)
        self.controls = controls([*bench.textures], [*oracles, TABLES])
        empty: dict[str, Any] = {}
        same = Range1d(), ColumnDataSource(empty, name="curves")
        self.figures = Figures(
            *same,
            QualityFigure("velocity", "velocity", "deg/s", *same),
            QualityFigure("refresh_rate", "refresh rate", "Hz", *same),
            SpectrumFigure(),
            TextureFigure(),
            FrameFigures(np.asarray(bench.drawn.frame.previous_image)),
        )
        self._upload: tuple[str, np.ndarray] | None = None
        self._spectra: dict[str, Spectrum] = dict(bench.spectra)
        self._textures = dict(bench.textures)
        self._oracle: AbstractQualityOracle = bench.drawn.judge
        self._awaited: Future[AbstractQualityOracle] | None = None
        self._notice = ""
        self._stale: set[str] = set(_EVERYTHING)
        self._waits = False
        self.refresh()
        self._connect()
        document.title = TITLE
        document.add_root(head(self.controls))
        document.add_root(page(self.controls, self.figures))

    def _connect(self) -> None:
        of = self.controls
        for name in Conditions._fields:
            _on(getattr(of, name), "value", lambda: self._ask("conditions"))
        for control in (of.texture, of.mip_level, of.rate):
            _on(control, "value", lambda: self._ask("texture"))
        _on(of.budget, "value", lambda: self._ask("budget"))
        _on(of.oracle, "value", self._choose_oracle)
        _on(of.encoding, "value", self._decode)
        _on(of.carrier, "tags", self._receive)

    def _ask(self, what: str) -> None:
        """Have something drawn anew, soon, together with what else is moved by then."""
        self._stale.add(what)
        if not self._waits:
            self._waits = True
            self._document.add_timeout_callback(self.refresh, _GATHER_MS)

    def refresh(self) -> None:
        """Draw anew what the controls have changed since the last time."""
        stale, self._stale, self._waits = self._stale, set(), False
        at = self.controls.conditions()
        if "texture" in stale:
            self._pool()
        if stale & {"texture", "conditions"}:
            self._draw_curves(at, fit="texture" in stale)
        if "conditions" in stale:
            self._judge(at)
        if stale & {"conditions", "budget"}:
            self._draw_rates()

    def _pool(self) -> None:
        """What changes with the texture, the mip level and the rate alone."""
        of, parameters = self.controls, self._bench.parameters
        name = of.texture.value
        spectrum = self._spectra[name]
        level = float(of.mip_level.value)
        own = _curves.shading(of.rate.value, level)
        whole = _curves.shading("1x1", level)
        self._pooled = _curves.pooled_texture(spectrum, own, parameters)
        self._full = _curves.pooled_texture(spectrum, whole, parameters)
        self._chain = _chain.chain(spectrum, own, parameters)
        self.figures.texture.show(self._textures[name])

    def _draw_curves(self, at: Conditions, *, fit: bool) -> None:
        own = _curves.curves(self._pooled, at)
        full = _curves.curves(self._full, at)
        by_velocity = self.figures.by_velocity.columns(
            _curves.VELOCITIES,
            own.by_velocity,
            full.by_velocity,
            (at.velocity, own.here, full.here),
        )
        by_refresh_rate = self.figures.by_refresh_rate.columns(
            _curves.REFRESH_RATES,
            own.by_refresh_rate,
            full.by_refresh_rate,
            (at.refresh_rate, own.here, full.here),
        )
        self.figures.curves.data = {**by_velocity, **by_refresh_rate}
        self._fit_quality(own, full)
        stages = _chain.stages(self._chain, at)
        if fit:
            self.figures.spectrum.fit(stages)
        self.figures.spectrum.show(stages)
        self.controls.readout.text = _readout(own.here, full.here)

    def _fit_quality(self, *shown: _curves.Curves) -> None:
        """Set the axis of quality in steps, so that it mostly rests during a drag."""
        curves = [x for c in shown for x in (*c.by_velocity, *c.by_refresh_rate)]
        low, high = float(np.min(curves)), float(np.max(curves))
        y_range = self.figures.quality
        y_range.start = _STEP_JND * np.floor(low / _STEP_JND - 0.1)
        y_range.end = _STEP_JND * np.ceil(high / _STEP_JND + 0.1)

    def _judge(self, at: Conditions) -> None:
        """Quality of the frame's tiles, by the oracle and by the judge."""
        drawn = self._bench.drawn
        shown = _frame_map.adapted(drawn.frame, at)
        self._judged: Float[Array, "tiles 7"]
        self._judged = _frame_map.qualities(drawn.judge, shown, at)
        self._quality = self._judged
        if self._oracle is not drawn.judge:
            self._quality = _frame_map.qualities(self._oracle, shown, at)

    def _draw_rates(self) -> None:
        shape = self._bench.drawn.frame.shape
        budget = self.controls.budget.value / 100
        found = _frame_map.rate_map(self._quality, self._judged, budget, shape)
        self.figures.frame.show(found.rate, found.shares)
        note = _frame_note(found, self._oracle_name, self._notice)
        self.figures.frame.say(note)

    @property
    def _oracle_name(self) -> str:
        known = self._bench.drawn.oracles.items()
        return next((n for n, o in known if o is self._oracle), TABLES)

    def _choose_oracle(self) -> None:
        name = self.controls.oracle.value
        self._awaited, self._notice = None, ""
        if name != TABLES:
            self._oracle = self._bench.drawn.oracles[name]
            self._ask("conditions")
            return
        self._awaited, self._notice = self._bench.tables(), _DISTILLING
        self._ask("budget")
        # It ends in another thread, from which this is the one safe call.
        soon = lambda future: self._document.add_next_tick_callback(
            lambda: self._have_tables(future)
        )
        self._awaited.add_done_callback(soon)

    def _have_tables(self, future: Future[AbstractQualityOracle]) -> None:
        """Show what was distilled, or say why there is nothing, if it is waited for."""
        if future is not self._awaited or future.cancelled():
            return
        self._awaited, self._notice = None, ""
        error = future.exception()
        if error is None:
            self._oracle = future.result()
            self._ask("conditions")
            return
        # What is shown is chosen again, so that tables can be.
        self.controls.oracle.value = self._oracle_name
        self._notice = f"Tables could not be distilled: {_reason(error)}"
        self._ask("budget")

    def _receive(self) -> None:
        """A file was chosen: show it, or say why not."""
        name, size, _ = self.controls.carrier.tags
        content = bytes(np.asarray(self.controls.carrier.data["content"], np.uint8))
        self.controls.carrier.data = {"content": []}
        name = name if len(name) <= 40 else f"{name[:39]}…"
        try:
            # What the browser kept back is not here, but its size is told.
            _upload.check_bytes(int(size))
            pixels = _upload.read_image(content)
            texture = _upload.texture(pixels, self.controls.encoding.value)
        except ValueError as error:
            self._say(f"{name}: {error}".replace("`image` ", ""), _BAD)
            return
        self._upload = name, pixels
        self._add(name, texture)

    def _decode(self) -> None:
        """The upload once more, its values taken for other light."""
        if self._upload is not None:
            name, pixels = self._upload
            texture = _upload.texture(pixels, self.controls.encoding.value)
            self._add(name, texture)

    def _add(self, name: str, texture: Float[np.ndarray, "rows columns"]) -> None:
        """An upload takes the place of the one before."""
        option = f"uploaded: {name}"
        self._spectra = self._bench.spectra | {option: Spectrum.from_texture(texture)}
        self._textures = self._bench.textures | {option: texture}
        self.controls.texture.options = [*self._textures]
        self.controls.texture.value = option
        rows, columns = texture.shape
        size = f"{columns} x {rows} px"
        text = f"the top left {size} are shown."
        if min(rows, columns) < 512:
            text = f"the {size} are shown, padded with black to 512 x 512 px."
        # A list of choices has no room for a whole name.
        self._say(f"{name}: {text}", _GOOD)
        self._ask("texture")

    def _say(self, text: str, styles: dict[str, Any]) -> None:
        self.controls.message.text = text
        self.controls.message.styles = styles


def _on(control: Model, attribute: str, act: Callable[[], None]) -> None:
    control.on_change(attribute, lambda attr, old, new: act())


def _readout(own: _curves.Parts, full: _curves.Parts) -> str:
    """The quality at the sliders' place, in words."""
    lost = float(full.quality - own.quality)
    return (
        f"quality <b style='font-size:20px'>{own.quality:.2f} JND</b> = spatial "
        f"{own.spatial:.2f} + temporal {own.temporal:.2f}; coarse shading costs "
        f"{lost:.2f} JND"
    )


def _frame_note(found: _frame_map.RateMap, oracle: str, notice: str) -> str:
    where = _frame_map.TABLES_DISPLAY
    made = f" for {where.ppd:g} px/deg and persistence 1" if oracle == TABLES else ""
    chosen = "Still chosen by" if notice else "Chosen by"
    lines = [
        *([notice] if notice else []),
        f"{chosen} {oracle}{made}: {found.cost:.1%} of full rate.",
        f"A tile loses {found.loss:.3f} JND on average, by CaMoJAB.",
    ]
    return "\n".join(lines)


def _reason(error: BaseException) -> str:
    """The first line of an error, as far as there is room for it."""
    text = str(error).partition("\n")[0] or type(error).__name__
    return text if len(text) <= _REASON else f"{text[: _REASON - 1]}…"
