"""Pages open without a network, and hold what they are given, escaped."""

import base64
import re
from html.parser import HTMLParser

import matplotlib.figure
import numpy as np
import pandas as pd
import pytest

from camojab._page import cells, page, picture, table, text


class Reader(HTMLParser):
    """Text and attributes of a page; fails where a tag is closed that is not open."""

    VOID = ("meta", "img", "br")

    def __init__(self, source):
        super().__init__()
        self.open, self.found, self.attributes = [], [], []
        self.feed(source)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.attributes += [(tag, *pair) for pair in attrs]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.found.append((self.open[-1] if self.open else "", data))

    def texts(self, tag):
        return [data for inside, data in self.found if inside == tag]


HOSTILE = "<script>'x' & \"y\"</script>"


def test_a_page_holds_its_parts_in_order():
    whole = page(
        "Votes", [("One", [text("first")]), ("Two", [])], quote="camojab 1; n=3"
    )
    read = Reader(whole)
    assert whole.startswith("<!doctype html>")
    assert read.texts("title") == read.texts("h1") == ["Votes"]
    assert read.texts("h2") == ["One", "Two", "To quote"]
    assert read.texts("p") == ["first"]
    assert read.texts("code") == ["camojab 1; n=3"]


def test_everything_is_escaped():
    frame = pd.DataFrame({HOSTILE: [HOSTILE]})
    parts = [text(HOSTILE), table(frame), picture(b"png", HOSTILE)]
    whole = page(HOSTILE, [(HOSTILE, parts)], quote=HOSTILE, simulated=HOSTILE)
    assert "<script" not in whole
    read = Reader(whole)
    for tag in ("title", "h1", "p", "td", "th", "code"):
        assert any(HOSTILE in found for found in read.texts(tag)), tag
    assert HOSTILE in read.texts("h2")
    assert ("img", "alt", HOSTILE) in read.attributes


def test_nothing_comes_from_elsewhere():
    figure = matplotlib.figure.Figure(figsize=(1, 1))
    whole = page("x", [("y", [picture(figure, "a figure")])], quote="z")
    assert "http" not in whole and "url(" not in whole and "@import" not in whole
    sources = [v for _, name, v in Reader(whole).attributes if name in ("src", "href")]
    assert len(sources) == 1 and sources[0].startswith("data:image/png;base64,")
    png = base64.b64decode(sources[0].partition(",")[2], validate=True)
    assert png.startswith(b"\x89PNG")


def test_only_simulated_data_have_the_note():
    plain, noted = (page("x", [], quote="y", simulated=words) for words in ("", "So."))
    assert "no person" not in plain
    assert "<b>simulated</b>" in noted and "no person took part. So.</p>" in noted


def test_numbers_have_three_decimals_and_nan_is_empty():
    frame = pd.DataFrame(
        {
            "block": ["a", None],
            "quality_jnd": [-1.23456, np.nan],
            "p_value": [1.25e-7, 0.5],
            "votes": [3, 12],
        }
    )
    assert cells(frame, {"p_value": ".2g"}) == {
        "block": ["a", ""],
        "quality [JND]": ["-1.235", ""],
        "p value": ["1.2e-07", "0.5"],
        "votes": ["3", "12"],
    }


@pytest.mark.parametrize(
    "value, shown",
    [(-0.0, "0.000"), (-0.0004, "0.000"), (-0.0006, "-0.001"), (np.inf, "inf")],
)
def test_no_number_is_minus_zero(value, shown):
    assert cells(pd.DataFrame({"x": [value]})) == {"x": [shown]}


@pytest.mark.parametrize(
    "name, heading",
    [
        ("velocity_deg_s", "velocity [deg/s]"),
        ("refresh_rate_hz", "refresh rate [Hz]"),
        ("mean_luminance_cd_m2", "mean luminance [cd/m2]"),
        ("RMSE [JND]", "RMSE [JND]"),
    ],
)
def test_headings_have_units(name, heading):
    assert list(cells(pd.DataFrame({name: [1.0]}))) == [heading]


def test_columns_of_numbers_are_aligned_to_the_right():
    frame = pd.DataFrame(
        {
            "condition": ["50 Hz", "60 Hz"],
            "jnd": [1.0, np.nan],
            "share": ["10.0%", "9.5%"],
            "printed": ["0.74", ""],
            "nothing": ["", ""],
        }
    )
    rows = re.findall(r"<tr>.*?</tr>", table(frame))
    assert len(rows) == 3
    for row in rows:
        kinds = ["class='n'" in cell for cell in re.findall(r"<t[dh][^>]*>", row)]
        assert kinds == [False, True, True, True, False]


def test_a_picture_of_bytes_is_kept_as_it_is():
    data = bytes(range(256))
    (source,) = re.findall(r"base64,([^']*)", picture(data, "bytes"))
    assert base64.b64decode(source, validate=True) == data
