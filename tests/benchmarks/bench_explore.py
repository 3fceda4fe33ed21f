"""What the explorer takes from a moved slider to new data, and to a redrawn page.

    python tests/benchmarks/bench_explore.py [PART ...]

of start, callback and browser; all if none is named. A drag is scripted: every control
goes through its values one by one. Medians and worst times are shown. The browser is
the system's chromium, without a window.
"""

import asyncio
import functools
import os
import shutil
import sys
import threading
import time
from concurrent.futures import Future

import jax
import jax.numpy as jnp
import numpy as np
from bokeh.document import Document

from alsarr import RATES
from alsarr.explore._serve import bound, show
from alsarr.explore._session import Session
from alsarr.explore._workbench import workbench


TARGET_MS = 100

DRAGS = {
    "velocity": np.linspace(0, 60, 61),
    "refresh_rate": np.linspace(24, 240, 55),
    "persistence": np.linspace(0.05, 1, 39),
    "ppd": np.linspace(10, 120, 56),
    "luminance": np.linspace(-1, 3, 41),
    "budget": np.linspace(6.25, 100, 76),
    "mip_level": np.arange(9),
    "rate": RATES.names,
}

# Moves a control, and waits for the last data that it changes and for two frames.
MOVE = """async ([name, last, values]) => {
  const page = Bokeh.documents[0]
  const control = page.get_model_by_name(name)
  const source = page.get_model_by_name(last)
  const times = []
  for (const value of values) {
    if (control.value === value)
      continue
    const start = performance.now()
    await new Promise((done) => {
      const changed = () => {
        source.properties.data.change.disconnect(changed)
        requestAnimationFrame(() => requestAnimationFrame(done))
      }
      source.properties.data.change.connect(changed)
      control.value = value
    })
    times.push(performance.now() - start)
  }
  return times
}"""


def row(*cells):
    widths = (18, 8, 14, 14, 10)
    print("".join(str(c).ljust(w) for c, w in zip(cells, widths, strict=False)))


def show_times(name, times):
    times = np.asarray(times)
    worst = times.max()
    verdict = "" if worst <= TARGET_MS else f"over {TARGET_MS}"
    row(name, len(times), f"{np.median(times):.1f}", f"{worst:.1f}", verdict)


@functools.cache
def bench():
    """What all pages share, with the time that its parts took on the way."""
    print("\nFrom nothing to a page")
    row("stage", "steps", "[s]")
    began = {}

    def progress(stage, done, total):
        began.setdefault(stage, time.perf_counter())
        if done == total:
            row(stage, total, f"{time.perf_counter() - began[stage]:.2f}")

    return workbench(progress)


def show_start():
    bench()


def show_callback():
    """From the value of a control to the new data of the figures."""
    session = Session(Document(), bench())
    print("\nCallback, from a value to new data [ms]")
    row("control", "moves", "median", "worst")
    for name, values in DRAGS.items():
        times = []
        for value in values:
            start = time.perf_counter()
            getattr(session.controls, name).value = plain(value)
            session.refresh()
            times.append(1e3 * (time.perf_counter() - start))
        show_times(name, times)


def plain(value):
    return value if isinstance(value, str) else np.asarray(value).item()


def show_browser():
    """From the value of a control in the browser to the redrawn page."""
    path = shutil.which("chromium")
    if path is None:
        print("\nchromium is not installed")
        return
    from playwright.sync_api import sync_playwright

    with served(bench()) as address, sync_playwright() as playwright:
        options = {"executable_path": path, "args": ["--no-sandbox", "--disable-gpu"]}
        browser = playwright.chromium.launch(**options)
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        start = time.perf_counter()
        page.goto(address)
        page.wait_for_function("() => window.Bokeh?.documents[0]?.is_idle")
        print(f"\nPage, from its address to idle: {time.perf_counter() - start:.2f} s")
        print("In the browser, from a value to the redrawn page [ms]")
        row("control", "moves", "median", "worst")
        for name, values in DRAGS.items():
            last = "spectrum" if name in ("mip_level", "rate") else "shares"
            moves = [plain(value) for value in values]
            show_times(name, page.evaluate(MOVE, [name, last, moves]))
        browser.close()


class served:
    """A server in a thread, as a context that is its address."""

    def __init__(self, shared):
        self._shared = shared

    def __enter__(self):
        started, self._listening = Future(), bound(0)
        listening = self._listening.__enter__()

        def ready(address):
            self._loop, self._task = asyncio.get_running_loop(), asyncio.current_task()
            started.set_result(address)

        def run():
            try:
                asyncio.run(show(self._shared, listening, ready))
            except asyncio.CancelledError:
                pass

        self._thread = threading.Thread(target=run)
        self._thread.start()
        return started.result()

    def __exit__(self, *error):
        self._loop.call_soon_threadsafe(self._task.cancel)
        self._thread.join()
        self._listening.__exit__(*error)


if __name__ == "__main__":
    asked = sys.argv[1:] or ["start", "callback", "browser"]
    load = f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
    print(f"jax {jax.__version__}, {jnp.result_type(float)}, {jax.devices()}, {load}")
    try:
        for part in asked:
            globals()[f"show_{part}"]()
    finally:
        bench().close()
