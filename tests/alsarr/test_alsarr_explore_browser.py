"""The explorer as people meet it: its page in a browser, its session without one."""

import asyncio
import io
import os
import shutil
import sys
import threading
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import pytest
from bokeh.document import Document
from PIL import Image

from alsarr import RATES
from alsarr.explore import _frame_map
from alsarr.explore._conditions import Conditions
from alsarr.explore._serve import bound, show
from alsarr.explore._session import Session, TABLES
from alsarr.explore._workbench import workbench
from alsarr.oracle import UniformOracle
from camojab import luminance


# What a browser shows does not depend on precision, and one is enough.
pytestmark = [
    pytest.mark.float64,
    pytest.mark.usefixtures("quick_compilation"),
]

PICTURES = Path(os.environ.get("CAMOJAB_ARTEFACTS", Path(__file__).parents[2] / "out"))

READY = "() => window.Bokeh?.documents[0]?.is_idle"

# A column of data of the page's figures, as it is in the browser.
COLUMN = """([name, column]) => Array.from(
    Bokeh.documents[0].get_model_by_name(name).data[column])
    .flatMap((x) => ArrayBuffer.isView(x) ? Array.from(x) : x)"""


def lacking(reason):
    """Skip, but where everything is said to be installed, fail."""
    if os.environ.get("CI") == "true" and sys.platform == "linux":
        pytest.fail(reason)
    pytest.skip(reason)


@pytest.fixture(scope="module")
def bench():
    stages = []
    made = workbench(lambda *steps: stages.append(steps))
    assert {stage for stage, *_ in stages} == {"textures", "frame", "compilation"}
    assert all(0 <= done <= total for _, done, total in stages)
    yield made
    made.close()


@pytest.fixture(scope="module")
def address(bench):
    """Where a server shows the explorer, in a thread of its own."""
    started, running = Future(), []

    def ready(address):
        running.extend([asyncio.get_running_loop(), asyncio.current_task()])
        started.set_result(address)

    def run(listening):
        try:
            asyncio.run(show(bench, listening, ready))
        except asyncio.CancelledError:
            pass

    with bound(0) as listening:
        thread = threading.Thread(target=run, args=(listening,))
        thread.start()
        yield started.result(timeout=60)
        loop, task = running
        loop.call_soon_threadsafe(task.cancel)
        thread.join(timeout=60)
        assert not thread.is_alive()


@pytest.fixture(scope="module")
def browser():
    path = shutil.which("chromium") or lacking(
        "chromium is not installed; .ci/tools installs it"
    )
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(
            executable_path=path, args=["--no-sandbox", "--disable-gpu"]
        )
        yield launched
        launched.close()


class Page:
    """A page of the explorer, and what it complained of and asked for."""

    def __init__(self, browser, address, folder):
        self.folder = folder
        self.wrong, self.requests = [], []
        self.context = browser.new_context(viewport={"width": 1440, "height": 900})
        self.page = self.context.new_page()
        self.page.set_default_timeout(60_000)
        self.page.on("console", self._complain)
        self.page.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("websocket", lambda opened: self.requests.append(opened.url))
        self.page.goto(address)
        self.page.wait_for_function(READY)

    def _complain(self, message):
        if message.type in ("error", "warning"):
            self.wrong.append(message.text)

    def column(self, name, column):
        values = self.page.evaluate(COLUMN, [name, column])
        return np.array([np.nan if v is None else v for v in values], object)

    def value(self, name):
        code = "name => Bokeh.documents[0].get_model_by_name(name).value"
        return self.page.evaluate(code, name)

    def changes(self, name, column, act):
        """What a column becomes when something is done that must change it."""
        before = self.column(name, column).tolist()
        act()
        code = (
            "([name, column, before]) => JSON.stringify("
            f"({COLUMN})([name, column])) != before"
        )
        text = self.page.evaluate("x => JSON.stringify(x)", before)
        self.page.wait_for_function(code, arg=[name, column, text])
        return self.column(name, column)

    def handle(self, name):
        """What a slider is drawn at."""
        return self.page.locator(f".{name} .noUi-handle")

    def choose(self, name, content):
        with self.page.expect_file_chooser() as chosen:
            self.page.get_by_role("button", name="Upload an image").click()
        path = self.folder / name
        path.write_bytes(content)
        chosen.value.set_files(path)

    def close(self):
        self.context.close()


@pytest.fixture(scope="module")
def page(browser, address, tmp_path_factory):
    opened = Page(browser, address, tmp_path_factory.mktemp("uploads"))
    yield opened
    opened.close()


def keep(page, name):
    """Keep a picture of the page, to be looked at; it is not blank."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    path = PICTURES / name
    page.page.screenshot(path=path)
    with Image.open(path) as picture:
        assert picture.size == (1440, 900)
        assert len(picture.convert("RGB").getcolors(2**21) or []) > 1000


def file_of(pixels):
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG")
    return stream.getvalue()


def test_the_page_is_whole_and_from_here_alone(page, address):
    assert page.page.title() == "CaMoJAB and ALSaRR"
    host = address.removeprefix("http://").rstrip("/")
    assert page.requests and all(url.split("/")[2] == host for url in page.requests)
    assert any(url.startswith("ws:") for url in page.requests)
    for name in ("quality", "spatial", "temporal", "full"):
        assert len(page.column("curves", f"velocity_{name}")) == 121
        assert len(page.column("curves", f"refresh_rate_{name}")) == 121
    assert len(page.column("spectrum", "perceived")) == 256
    assert len(page.column("rate_map", "image")) == 23 * 40
    np.testing.assert_allclose(page.column("shares", "share").astype(float).sum(), 100)
    assert page.wrong == []


def test_it_fits_a_usual_screen_and_a_picture_is_kept(page):
    code = "() => [document.body.scrollWidth, document.body.scrollHeight]"
    width, height = page.page.evaluate(code)
    assert width <= 1440 and height <= 1000
    keep(page, "explorer.png")


def test_a_heading_has_room_above_the_picture(page):
    heading = page.page.get_by_text("Texture", exact=True).first.bounding_box()
    picture = page.page.locator(".texture_picture").bounding_box()
    assert picture["x"] == heading["x"]
    assert picture["y"] >= heading["y"] + heading["height"]


def test_a_slider_moves_a_curve(page):
    by_refresh_rate = page.column("curves", "refresh_rate_quality")
    before = page.value("velocity")
    after = page.changes(
        "curves",
        "refresh_rate_quality",
        lambda: page.handle("velocity").press("ArrowRight"),
    )
    velocity = page.value("velocity")
    np.testing.assert_allclose(velocity, before + 0.5)
    # Faster motion is worse at every refresh rate.
    assert np.all(after <= by_refresh_rate)
    assert page.column("curves", "velocity_here")[0] == velocity
    assert page.wrong == []


def test_a_budget_changes_the_rate_map(page):
    before = page.column("shares", "share")
    full = RATES.names.index("1x1")
    after = page.changes("shares", "share", lambda: page.handle("budget").press("End"))
    assert after[full] > before[full] and after[0] < before[0]
    page.changes("shares", "share", lambda: page.handle("budget").press("Home"))


def test_an_upload_changes_the_texture(page):
    random = np.random.default_rng(11).integers(0, 256, (520, 600, 3), np.uint8)
    shown = page.column("curves", "velocity_quality")
    after = page.changes(
        "texture", "image", lambda: page.choose("noise.png", file_of(random))
    )
    assert page.value("texture_choice") == "uploaded: noise.png"
    page.page.get_by_text("noise.png: the top left 512 x 512 px are shown.").wait_for()
    light = luminance(random[:512, :512], encoding="sRGB")
    small = light.reshape(128, 4, 128, 4).mean(axis=(1, 3)) ** (1 / 2.2)
    found = after.astype(float).reshape(128, 128)[::-1] / 255
    np.testing.assert_allclose(found, small, rtol=0, atol=0.5 / 255 + 1e-9)
    assert not np.array_equal(page.column("curves", "velocity_quality"), shown)
    assert page.wrong == []


def test_a_picture_is_kept_of_a_page_in_use(page):
    y, x = np.mgrid[:200, :300]
    rings = (127.5 + 127.5 * np.cos(np.hypot(x - 150, y - 100) / 4)).astype(np.uint8)
    moved = lambda: page.handle("velocity").press("PageUp")
    page.changes("shares", "share", lambda: page.handle("budget").press("PageUp"))
    page.changes("curves", "refresh_rate_quality", moved)
    page.changes("texture", "image", lambda: page.choose("rings.png", file_of(rings)))
    page.page.get_by_text("rings.png: the 300 x 200 px are shown, padded").wait_for()
    assert page.value("texture_choice") == "uploaded: rings.png"
    page.page.wait_for_function(READY)
    keep(page, "explorer_used.png")
    assert page.wrong == []


BAD = {
    "notes.png": (b"not an image", "must be a PNG, JPEG, WebP, BMP, TIFF or GIF, got"),
    "empty.png": (b"", "empty.png: must have content, got 0 bytes."),
    "wide.png": (
        file_of(np.zeros((20, 20_000), np.uint8)),
        "wide.png: must be at most 8192 px wide and high, got 20000 x 20 px.",
    ),
    "tiny.png": (
        file_of(np.zeros((1, 1), np.uint8)),
        "tiny.png: must be at least 16 px wide and high, got 1 x 1 px.",
    ),
    "large.png": (
        bytes(30 * 2**20),
        "large.png: must be of at most 16 MiB, got 30.0 MiB.",
    ),
    "<b>bold.png": (b"", "<b>bold.png: must have content, got 0 bytes."),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_upload_shows_its_message(page, name):
    content, sentence = BAD[name]
    texture = page.value("texture_choice")
    page.choose(name, content)
    page.page.get_by_text(sentence).wait_for()
    assert page.value("texture_choice") == texture
    # The connection is still there.
    page.changes(
        "curves",
        "refresh_rate_quality",
        lambda: page.handle("velocity").press("ArrowRight"),
    )
    assert page.wrong == []


def test_two_pages_do_not_disturb_each_other(page, browser, address, tmp_path):
    other = Page(browser, address, tmp_path)
    try:
        assert (
            other.value("velocity") == Conditions().velocity != page.value("velocity")
        )
        mine = page.column("curves", "refresh_rate_quality")
        other.changes(
            "curves",
            "refresh_rate_quality",
            lambda: other.handle("velocity").press("ArrowRight"),
        )
        assert np.array_equal(page.column("curves", "refresh_rate_quality"), mine)
        options = "() => Bokeh.documents[0].get_model_by_name('texture_choice').options"
        assert not [x for x in other.page.evaluate(options) if "uploaded" in x]
        assert other.wrong == []
    finally:
        other.close()


@pytest.fixture
def session(bench):
    """A page without a browser: what it asks for is asked at once."""
    return Session(Document(), bench)


def note(session):
    return session._document.get_model_by_name("frame_note").text


def test_moves_are_answered_together(session, monkeypatch):
    answered = []
    monkeypatch.setattr(session, "_judge", lambda at: answered.append(at))
    for velocity in (20.0, 21.0, 22.0):
        session.controls.velocity.value = velocity
    assert len(session._document.session_callbacks) == 1 and answered == []
    session.refresh()
    assert [at.velocity for at in answered] == [22.0]


def test_every_oracle_has_a_map(session, bench):
    notes = []
    for name in bench.drawn.oracles:
        session.controls.oracle.value = name
        session.refresh()
        notes.append(note(session))
        assert f"Chosen by {name}:" in notes[-1]
    loss = [float(text.split(" loses ")[1].split()[0]) for text in notes]
    # Judged by the model nothing is better than what the model chose.
    assert len(set(notes)) == len(notes) and loss[0] == min(loss) < max(loss)


def have_tables(session):
    """What the page does as soon as the tables that it waits for have ended."""
    future = session._awaited
    future.exception(timeout=60)
    session._have_tables(future)
    session.refresh()


def test_tables_are_distilled_once_and_then_shown(session, bench, monkeypatch):
    monkeypatch.setattr(bench, "_tables", None)
    calls = []

    def distilled(drawn, spectra, progress):
        calls.append(list(spectra))
        progress(0, 1)
        return UniformOracle()

    monkeypatch.setattr(_frame_map, "distilled", distilled)
    for _ in range(2):
        session.controls.oracle.value = TABLES
        have_tables(session)
        assert note(session).startswith("Chosen by tables for 60 px/deg")
        session.controls.oracle.value = "CaMoJAB"
        session.refresh()
    assert len(calls) == 1 and not any(":" in name for name in calls[0])


def test_the_notice_stays_until_there_are_tables(session, bench, monkeypatch):
    monkeypatch.setattr(bench, "_tables", None)
    go_on = threading.Event()

    def distilled(drawn, spectra, progress):
        assert go_on.wait(60)
        return UniformOracle()

    monkeypatch.setattr(_frame_map, "distilled", distilled)
    of = session.controls
    of.oracle.value = "FidelityFX"
    session.refresh()
    of.oracle.value = TABLES
    moves = ((of.oracle, TABLES), (of.velocity, 33.0), (of.budget, 60.0))
    for control, value in (*moves, (of.mip_level, 2)):
        control.value = value
        session.refresh()
        first, second, _ = note(session).split("\n")
        assert first.startswith("Tables are being distilled")
        assert second.startswith("Still chosen by FidelityFX: ")
    go_on.set()
    have_tables(session)
    assert note(session).startswith("Chosen by tables for 60 px/deg")


def test_another_choice_takes_the_notice_away(session, bench, monkeypatch):
    monkeypatch.setattr(bench, "_tables", Future())
    session.controls.oracle.value = TABLES
    session.refresh()
    awaited = session._awaited
    session.controls.oracle.value = "uniform"
    session.refresh()
    assert note(session).startswith("Chosen by uniform: ")
    # Nobody waits for them any more.
    awaited.set_result(UniformOracle())
    session._have_tables(awaited)
    session.refresh()
    assert note(session).startswith("Chosen by uniform: ")


def test_tables_that_failed_are_a_sentence_and_tried_again(session, bench, monkeypatch):
    monkeypatch.setattr(bench, "_tables", None)
    errors = [MemoryError("Out of memory.\nTraceback"), MemoryError()]

    def distilled(drawn, spectra, progress):
        if errors:
            raise errors.pop(0)
        return UniformOracle()

    monkeypatch.setattr(_frame_map, "distilled", distilled)
    for reason in ("Out of memory.", "MemoryError"):
        session.controls.oracle.value = TABLES
        failed = session._awaited
        have_tables(session)
        assert session.controls.oracle.value == "CaMoJAB"
        session.controls.velocity.value += 1.0
        session.refresh()
        first, second, _ = note(session).split("\n")
        assert first == f"Tables could not be distilled: {reason}"
        assert second.startswith("Still chosen by CaMoJAB: ")
    session.controls.oracle.value = TABLES
    # That the earlier ones ended is no news.
    session._have_tables(failed)
    have_tables(session)
    assert note(session).startswith("Chosen by tables for 60 px/deg")
    assert session.controls.oracle.value == TABLES


def test_sliders_go_where_the_model_can_follow(session):
    of = session.controls
    for end in ("start", "end"):
        sliders = (of.velocity, of.refresh_rate, of.persistence, of.ppd, of.luminance)
        for slider in (*sliders, of.mip_level, of.budget):
            slider.value = getattr(slider, end)
        for texture in of.texture.options:
            of.texture.value = texture
            session.refresh()
            data = session._document.get_model_by_name("curves").data
            assert len(data) == 20 and set(map(len, data.values())) == {121}
            for column, values in data.items():
                shown = values[:1] if "here" in column else values
                assert np.all(np.isfinite(shown)), column
