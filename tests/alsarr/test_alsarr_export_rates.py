"""Rate maps in the files of engines: what is written, and that it decodes back."""

import json

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from imageio.v3 import imread, imwrite

from alsarr._rates import RATES
from alsarr.export import (
    adapt_rates,
    read_rates_bin,
    read_rates_godot,
    read_rates_grey,
    read_rates_json,
    write_rates_bin,
    write_rates_godot,
    write_rates_grey,
    write_rates_json,
)


INDEX = {name: i for i, name in enumerate(RATES.names)}
WITHOUT_ADDITIONAL = ("2x2", "1x2", "2x1", "1x1")
VULKAN_MANDATORY = ("2x2", "2x1", "1x1")

FORMS = {
    "bin": (lambda p, r: write_rates_bin(p, r, tile=16), read_rates_bin),
    "grey": (write_rates_grey, read_rates_grey),
    "godot": (write_rates_godot, read_rates_godot),
    "json": (write_rates_json, read_rates_json),
}


def named(text):
    """A rate map from names, one row a line."""
    rows = text.strip().splitlines()
    return np.array([[INDEX[name] for name in row.split()] for row in rows])


@pytest.mark.parametrize("form", FORMS)
@settings(deadline=None, max_examples=10)
@given(st.integers(1, 9), st.integers(1, 9), st.integers(0, 2**32 - 1))
def test_every_form_decodes_back(tmp_path_factory, form, rows, columns, seed):
    write, read = FORMS[form]
    path = tmp_path_factory.mktemp("map") / "rates"
    rate = np.random.default_rng(seed).integers(0, 7, (rows, columns))
    write(path, rate)
    np.testing.assert_array_equal(read(path), rate)
    extra = ["rates.json"] if form == "bin" else []
    assert sorted(p.name for p in path.parent.iterdir()) == ["rates", *extra]


@pytest.mark.parametrize("form", FORMS)
def test_what_is_no_rate_map_writes_nothing(tmp_path, form):
    with pytest.raises(ValueError, match="`rate` must be indices from 0 to 6, got 7"):
        FORMS[form][0](tmp_path / "rates", np.full((2, 2), 7))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("write", [write_rates_bin, write_rates_json])
def test_tile_must_be_one_of_hardware(tmp_path, write):
    with pytest.raises(ValueError, match="`tile` must be 8, 16 or 32 px, got 12"):
        write(tmp_path / "rates", np.zeros((2, 2), int), tile=12)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("form", FORMS)
def test_damaged_files_are_named(tmp_path, form):
    write, read = FORMS[form]
    path = tmp_path / "rates"
    rate = np.random.default_rng(0).integers(0, 7, (64, 64))
    write(path, rate)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(ValueError, match=f"{path}: must"):
        read(path)
    path.write_bytes(b"foreign")
    with pytest.raises(ValueError, match=f"{path}: must"):
        read(path)
    path.unlink()
    with pytest.raises(FileNotFoundError):
        read(path)


def test_grey_png_has_the_codes_of_direct3d_12(tmp_path):
    write_rates_grey(tmp_path / "r.png", np.arange(7)[None])
    np.testing.assert_array_equal(
        imread(tmp_path / "r.png"), [[0xA, 0x6, 0x9, 0x5, 0x1, 0x4, 0x0]]
    )


def test_godot_colours_are_those_of_its_documentation(tmp_path):
    # Godot documentation, Variable rate shading: the colour of each rate.
    colours = {
        "1x1": "000000",
        "1x2": "005500",
        "2x1": "550000",
        "2x2": "555500",
        "2x4": "55AA00",
        "4x2": "AA5500",
        "4x4": "AAAA00",
    }
    write_rates_godot(tmp_path / "r.png", np.array([[INDEX[n] for n in colours]]))
    pixels = imread(tmp_path / "r.png")
    assert [bytes(p).hex().upper() for p in pixels[0]] == list(colours.values())


def test_pixels_that_stand_for_no_rate_are_refused(tmp_path):
    path = tmp_path / "r.png"
    # 1x4, which Godot's shader would repair, and grey where a colour belongs.
    imwrite(path, np.array([[[0, 170, 0]]], np.uint8))
    with pytest.raises(ValueError, match="row 0, column 0 must stand .* got #00AA00"):
        read_rates_godot(path)
    with pytest.raises(ValueError, match="must be an 8-bit grey PNG"):
        read_rates_grey(path)
    imwrite(path, np.array([[0, 2]], np.uint8))
    with pytest.raises(ValueError, match="byte 1 must be the code .*, got 0x02"):
        read_rates_grey(path)
    with pytest.raises(ValueError, match="must be an 8-bit RGB PNG"):
        read_rates_godot(path)
    imwrite(path, np.array([[0, 2]], np.uint16))
    with pytest.raises(ValueError, match="must have 8 bits a channel"):
        read_rates_grey(path)


def test_what_the_bytes_do_not_tell_lies_beside_them(tmp_path):
    path = tmp_path / "rates.bin"
    write_rates_bin(path, named("4x4 2x1 1x1\n1x1 1x1 1x1"), tile=8)
    about = json.loads((tmp_path / "rates.bin.json").read_text())
    assert (about["rows"], about["columns"], about["tile_px"]) == (2, 3, 8)
    assert about["rates"] == {"4x4": 10, "2x1": 4, "1x1": 0}
    with pytest.raises(ValueError, match="`rows` and `columns` must be given both"):
        read_rates_bin(path, rows=2)


@pytest.mark.parametrize(
    "name, value, message",
    [
        ("rows", 3, "must have 3 x 3 = 9 bytes, got 6"),
        ("columns", 0, "`columns` must be a whole number >= 1, got 0"),
        ("rows", None, "`rows` must be a whole number >= 1, got None"),
        ("schema", "other", "`schema` must be 'alsarr-rate-image/1', got 'other'"),
    ],
)
def test_altered_json_beside_the_bytes(tmp_path, name, value, message):
    path = tmp_path / "rates.bin"
    write_rates_bin(path, np.zeros((2, 3), int), tile=16)
    beside = tmp_path / "rates.bin.json"
    beside.write_text(json.dumps(json.loads(beside.read_text()) | {name: value}))
    with pytest.raises(ValueError, match=f"rates.bin.*: {message}"):
        read_rates_bin(path)


def test_json_has_names_and_its_twin_upside_down(tmp_path):
    path = tmp_path / "rates.json"
    write_rates_json(path, named("4x4 2x1\n1x2 1x1"), tile=8)
    document = json.loads(path.read_text())
    assert document["map"] == [["4x4", "2x1"], ["1x2", "1x1"]]
    assert document["map_flipped_y"] == [["1x2", "1x1"], ["4x4", "2x1"]]
    assert (document["rows"], document["columns"], document["tile_px"]) == (2, 2, 8)
    assert document["origin"] == "top-left"
    two_by_four = {"width_px": 2, "height_px": 4, "d3d12_vulkan_code": 6}
    assert document["rates"]["2x4"] == two_by_four


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"schema": "other"}, "`schema` must be 'alsarr-rates/1', got 'other'"),
        ({"rates": {}}, "`rates` must be"),
        ({"map": 3}, "`map` must be 2 lists of 2 names of rates"),
        ({"map": [["4x4", "2x1"]]}, "`map` must be 2 lists of 2 names"),
        ({"map": [["4x4"], ["1x1", "1x1"]]}, "`map` must be 2 lists of 2 names"),
        ({"map": [["1x4", "1x1"]] * 2}, "`map` must be 2 lists of 2 names"),
        ({"map": [["1x1", "1x1"]] * 2}, "`map_flipped_y` must be `map` upside down"),
        ({"columns": True}, "`columns` must be a whole number >= 1, got True"),
    ],
)
def test_altered_json_is_refused(tmp_path, changes, message):
    path = tmp_path / "rates.json"
    write_rates_json(path, named("4x4 2x1\n1x2 1x1"))
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    with pytest.raises(ValueError, match=f"rates.json: {message}"):
        read_rates_json(path)
    path.write_text("[]")
    with pytest.raises(ValueError, match="rates.json: must hold one JSON object"):
        read_rates_json(path)


def test_missing_rates_become_the_nearest_finer():
    every = np.arange(7)[None]
    without = adapt_rates(every, available=WITHOUT_ADDITIONAL)[0]
    assert [RATES.names[i] for i in without] == "2x2 2x2 2x2 2x2 1x2 2x1 1x1".split()
    mandatory = adapt_rates(every, available=VULKAN_MANDATORY)[0]
    assert [RATES.names[i] for i in mandatory] == "2x2 2x2 2x2 2x2 1x1 2x1 1x1".split()
    np.testing.assert_array_equal(adapt_rates(every), every)


def test_tiles_of_8_px_repeat():
    expected = named("4x4 4x4 2x1 2x1\n4x4 4x4 2x1 2x1")
    np.testing.assert_array_equal(adapt_rates(named("4x4 2x1"), tile=8), expected)


@pytest.mark.parametrize(
    "four, expected",
    [
        ("4x4 4x4\n4x4 4x4", "4x4"),
        ("4x4 4x2\n4x4 2x4", "2x2"),
        ("4x4 1x2\n4x4 4x4", "1x2"),
        # 1 wide and 2 high for the first, 2 wide and 1 high for the second: 1x1.
        ("1x2 2x1\n4x4 4x4", "1x1"),
        ("2x4 2x4\n4x4 2x4", "2x4"),
        ("1x1 4x4\n4x4 4x4", "1x1"),
    ],
)
def test_tiles_of_32_px_have_the_finest_of_four(four, expected):
    np.testing.assert_array_equal(adapt_rates(named(four), tile=32), named(expected))


def test_part_of_a_tile_at_the_edge_counts():
    # 1920 x 1080 has 67.5 rows of 16 px, and 33.75 of 32 px.
    rate = np.random.default_rng(0).integers(0, 7, (68, 120))
    full_hd = (1920, 1080)
    assert adapt_rates(rate, tile=8, size_px=full_hd).shape == (135, 240)
    assert adapt_rates(rate, tile=16, size_px=full_hd).shape == (68, 120)
    assert adapt_rates(rate, tile=32, size_px=full_hd).shape == (34, 60)
    # A map of whole tiles only: the half row below has the rates of the last.
    short = adapt_rates(rate[:67], tile=16, size_px=full_hd)
    np.testing.assert_array_equal(short, rate[np.r_[:67, 66]])
    assert adapt_rates(rate[:67], tile=16).shape == (67, 120)


@settings(deadline=None, max_examples=30)
@given(
    st.integers(1, 70),
    st.integers(1, 70),
    st.sampled_from([8, 16, 32]),
    st.sets(st.sampled_from(RATES.names)),
    st.integers(0, 2**32 - 1),
)
def test_no_pixel_is_shaded_more_coarsely(width, height, tile, rates, seed):
    available = tuple(rates | {"1x1"})
    shape = -(-height // 16), -(-width // 16)
    rate = np.random.default_rng(seed).integers(0, 7, shape)
    adapted = adapt_rates(rate, tile=tile, size_px=(width, height), available=available)
    assert adapted.shape == (-(-height // tile), -(-width // tile))
    assert {RATES.names[i] for i in adapted.flat} <= set(available)
    y, x = np.mgrid[:height, :width]
    asked = RATES.size[rate[y // 16, x // 16]]
    given_ = RATES.size[adapted[y // tile, x // tile]]
    assert np.all(given_ <= asked)


@pytest.mark.parametrize(
    "options, message",
    [
        ({"tile": 64}, "`tile` must be 8, 16 or 32 px, got 64"),
        ({"available": ("2x2",)}, "`available` must be 1x1 and others of .*, got 2x2"),
        ({"available": ("1x1", "1x4")}, "`available` must be .*, got 1x1, 1x4"),
        ({"available": ()}, "`available` must be .*, got none"),
        ({"size_px": (64, 32)}, "`size_px` must be that of 3 x 2 tiles of 16 px"),
        ({"size_px": (48, 0)}, "`size_px` must be that of .*, got 48 x 0"),
    ],
)
def test_wrong_hardware_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        adapt_rates(np.zeros((2, 3), int), **options)
