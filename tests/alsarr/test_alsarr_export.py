import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from matplotlib.image import imread

from alsarr._rates import RATES
from alsarr.export import read_rates_bin, write_rates_bin, write_rates_png


def test_bytes_are_the_codes_row_by_row(tmp_path):
    path = tmp_path / "rates.bin"
    write_rates_bin(path, np.array([[0, 1, 2, 3], [4, 5, 6, 6]]))
    assert path.read_bytes() == bytes([0xA, 0x6, 0x9, 0x5, 0x1, 0x4, 0x0, 0x0])
    assert [p.name for p in tmp_path.iterdir()] == ["rates.bin"]


@settings(deadline=None, max_examples=30)
@given(st.integers(1, 9), st.integers(1, 9), st.integers(0, 2**32 - 1))
def test_bytes_are_read_back(tmp_path_factory, rows, columns, seed):
    path = tmp_path_factory.mktemp("map") / "rates.bin"
    rate = np.random.default_rng(seed).integers(0, 7, (rows, columns))
    write_rates_bin(path, rate)
    np.testing.assert_array_equal(
        read_rates_bin(path, rows=rows, columns=columns), rate
    )


def test_foreign_bytes_are_refused(tmp_path):
    path = tmp_path / "rates.bin"
    write_rates_bin(path, np.zeros((2, 3), int))
    with pytest.raises(ValueError, match="rates.bin: must have 2 x 2 = 4 bytes, got 6"):
        read_rates_bin(path, rows=2, columns=2)
    # 1x4 is no rate of the hardware, though its code can be written.
    path.write_bytes(bytes([0xA, 0x6, 0x2, 0x5]))
    with pytest.raises(ValueError, match="byte 2 must be the code of .*, got 0x02"):
        read_rates_bin(path, rows=2, columns=2)


@pytest.mark.parametrize("write", [write_rates_bin, write_rates_png])
@pytest.mark.parametrize(
    "rate, message",
    [
        (np.zeros(4, int), r"`rate` must be whole .*, got int64 of shape \(4,\)"),
        (np.zeros((0, 4), int), r"`rate` must be whole .* shape \(0, 4\)"),
        (np.zeros((2, 2)), "`rate` must be whole numbers .*, got float64"),
        (np.full((2, 2), 7), "`rate` must be indices from 0 to 6, got 7 to 7"),
        (np.array([[-1, 2]]), "`rate` must be indices from 0 to 6, got -1 to 2"),
    ],
)
def test_what_is_no_rate_map_is_refused(tmp_path, write, rate, message):
    with pytest.raises(ValueError, match=message):
        write(tmp_path / "map", rate)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("size", [(1, 1), (9, 16), (68, 120)])
@pytest.mark.parametrize("scale", [1, 8])
def test_picture_shows_every_tile_in_its_colour(tmp_path, size, scale):
    rate = np.random.default_rng(0).integers(0, 7, size)
    write_rates_png(tmp_path / "rates.png", rate, scale=scale)
    drawn = np.rint(255 * imread(tmp_path / "rates.png")[..., :3]).astype(np.uint8)
    expected = RATES.colour[rate].repeat(scale, axis=0).repeat(scale, axis=1)
    height, width = expected.shape[:2]
    left = (drawn.shape[1] - width) // 2
    np.testing.assert_array_equal(
        drawn[12 : 12 + height, left : left + width], expected
    )


def test_picture_has_a_legend(tmp_path):
    write_rates_png(tmp_path / "rates.png", np.zeros((4, 4), int), scale=8)
    drawn = np.rint(255 * imread(tmp_path / "rates.png")[..., :3]).astype(np.uint8)
    legend = drawn[12 + 32 :].reshape(-1, 3)
    for colour in RATES.colour:
        assert np.sum(np.all(legend == colour, axis=1)) >= 16 * 16
    # The names and shares are written in black.
    assert np.sum(np.all(legend < 60, axis=1)) > 200


def test_scale_must_be_a_pixel_or_more(tmp_path):
    with pytest.raises(ValueError, match="`scale` must be >= 1 px, got 0"):
        write_rates_png(tmp_path / "rates.png", np.zeros((2, 2), int), scale=0)
