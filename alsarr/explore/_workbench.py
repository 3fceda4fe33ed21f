"""What all pages of one server share, and none of them changes."""

import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from camojab import Parameters, Spectrum

from ..oracle import AbstractQualityOracle
from . import _chain, _curves, _frame_map
from ._conditions import Conditions
from ._library import textures


class _Closed(Exception):
    """The work is not wanted any more."""


@dataclass
class Workbench:
    """Textures, the drawn frame, and the tables once somebody asks for them.

    - `textures`: relative luminance by name, and their `spectra`.
    - `drawn`: the frame and its oracles.
    - `parameters`: of the model.
    """

    textures: dict[str, Float[np.ndarray, "512 512"]]
    spectra: dict[str, Spectrum]
    drawn: _frame_map.DrawnFrame
    parameters: Parameters
    _pool: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1))
    _tables: Future[AbstractQualityOracle] | None = None
    _closed: threading.Event = field(default_factory=threading.Event)

    def tables(self) -> Future[AbstractQualityOracle]:
        """Tables of the frame's textures, distilled in the background, once for all.

        Once more if that failed.
        """
        if self._tables is None or _failed(self._tables):
            frame_spectra = _builtin(self.spectra)

            def work() -> AbstractQualityOracle:
                return _frame_map.distilled(self.drawn, frame_spectra, self._go_on)

            self._tables = self._pool.submit(work)
        return self._tables

    def close(self) -> None:
        """End what runs in the background, at its next step."""
        self._closed.set()
        self._pool.shutdown(cancel_futures=True)

    def _go_on(self, done: int, total: int) -> None:
        del done, total
        if self._closed.is_set():
            raise _Closed


def _failed(future: Future[Any]) -> bool:
    return future.done() and not future.cancelled() and future.exception() is not None


def workbench(
    progress: Callable[[str, int, int], None] = lambda stage, done, total: None,
) -> Workbench:
    """Read the textures, draw the frame, and compile what a drag will need.

    **Arguments:** `progress`: called with a stage, the steps done and their number.
    """
    progress("textures", 0, 2)
    found = textures()
    progress("textures", 1, 2)
    spectra = {name: Spectrum.from_texture(image) for name, image in found.items()}
    progress("textures", 2, 2)
    progress("frame", 0, 1)
    drawn = _frame_map.drawn_frame(_builtin(found), _builtin(spectra))
    progress("frame", 1, 1)
    bench = Workbench(found, spectra, drawn, Parameters.published())
    _warm(bench, lambda *steps: progress("compilation", *steps))
    return bench


def _builtin(by_name: dict[str, Any]) -> dict[str, Any]:
    """Of the built-in textures alone, which the frame shows."""
    return {n: x for n, x in by_name.items() if not n.startswith("jindal2021:")}


def _warm(bench: Workbench, progress: Callable[[int, int], None]) -> None:
    """Compile each figure once: nothing of it depends on values."""
    at, shading = Conditions(), _curves.shading("1x1", 0.0)
    spectrum = next(iter(bench.spectra.values()))
    model = spectrum, shading, bench.parameters

    def frame() -> None:
        shown = _frame_map.adapted(bench.drawn.frame, at)
        quality = _frame_map.qualities(bench.drawn.judge, shown, at)
        _frame_map.rate_map(quality, quality, 0.25, shown.shape)

    steps = (
        lambda: _curves.curves(_curves.pooled_texture(*model), at),
        lambda: _chain.stages(_chain.chain(*model), at),
        frame,
    )
    for done, step in enumerate(steps):
        progress(done, len(steps))
        jax.block_until_ready(step())
    progress(len(steps), len(steps))
