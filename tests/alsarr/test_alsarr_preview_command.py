"""`alsarr preview`: a picture as its rate map would leave it."""

import re

import imageio.v3
import numpy as np
import pytest

from alsarr import RATES
from alsarr._preview import coarse
from alsarr.cli import main


SIZE = (40, 64)


def run(*arguments):
    return main(["preview", *map(str, arguments)])


@pytest.fixture
def image(tmp_path):
    pixels = np.random.default_rng(0).integers(0, 256, (*SIZE, 3), np.uint8)
    imageio.v3.imwrite(tmp_path / "frame.png", pixels)
    return tmp_path / "frame.png"


@pytest.fixture
def rates(tmp_path):
    rate = np.arange(12).reshape(3, 4) % 7
    np.savez(tmp_path / "rates.npz", rate=rate.ravel())
    return tmp_path / "rates.npz"


def shown(path):
    """The two pictures of a preview, which is wider than they need."""
    pixels = imageio.v3.imread(path)[..., :3]
    start = (pixels.shape[1] - 2 * SIZE[1] - 12) // 2
    rows = pixels[12 : 12 + SIZE[0]]
    return [rows[:, x : x + SIZE[1]] for x in (start, start + SIZE[1] + 12)]


def test_both_are_drawn(image, rates, tmp_path, capsys):
    output = tmp_path / "new" / "seen.png"
    assert run(image, rates, "-o", output) == 0
    with np.load(rates) as stored:
        rate = stored["rate"].reshape(3, 4)
    left, right = shown(output)
    expected = coarse(imageio.v3.imread(image), rate)
    np.testing.assert_array_equal(left, np.round(np.asarray(expected) * 255))
    tiles = RATES.colour[rate].repeat(16, 0).repeat(16, 1)
    np.testing.assert_array_equal(right, tiles[: SIZE[0]])
    cost = RATES.cost[rate].mean() / 256
    words = f"{output}: 12 tiles, shading cost {cost:.1%} of full rate\n"
    assert capsys.readouterr().out == words


def test_a_map_of_whole_tiles_has_its_last_row_again(image, rates, tmp_path):
    """Engines leave out the tiles that the picture fills in part."""
    np.savez(rates, rate=np.arange(8) % 7)
    assert run(image, rates, "-o", tmp_path / "whole.png") == 0
    np.savez(rates, rate=np.array([[0, 1, 2, 3], [4, 5, 6, 0], [4, 5, 6, 0]]))
    assert run(image, rates, "-o", tmp_path / "all.png") == 0
    for one, other in zip(
        shown(tmp_path / "whole.png"), shown(tmp_path / "all.png"), strict=True
    ):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("channels", ["grey", "transparent"])
def test_grey_and_transparent_pictures(image, rates, tmp_path, channels):
    pixels = imageio.v3.imread(image)
    if channels == "grey":
        imageio.v3.imwrite(image, pixels[..., 0])
        pixels = pixels[..., :1].repeat(3, axis=-1)
    else:
        opaque = np.full((*SIZE, 1), 255, np.uint8)
        imageio.v3.imwrite(image, np.concatenate([pixels, opaque], axis=-1))
    assert run(image, rates, "-o", tmp_path / "seen.png") == 0
    with np.load(rates) as stored:
        expected = coarse(pixels, stored["rate"].reshape(3, 4))
    left, _ = shown(tmp_path / "seen.png")
    np.testing.assert_array_equal(left, np.round(np.asarray(expected) * 255))


@pytest.mark.parametrize(
    "rate, options, message",
    [
        (np.zeros(5, int), [], "`--columns` must divide the 5 tiles of .*, got None"),
        (np.zeros((3, 5), int), [], "frame.png must be that of 5 x 3 tiles of 16 px, "),
        (np.zeros((4, 4), int), [], "frame.png must be .* tiles of 16 px, got 64 x 40"),
        (np.zeros(12, int), ["--columns", "6"], "must be that of 6 x 2 tiles"),
        (np.full((3, 4), 7), [], "rates.npz: `rate` must be indices from 0 to 6"),
        (np.array([None]), [], "rates.npz: must hold whole, plain arrays"),
    ],
)
def test_maps_that_do_not_fit(image, rates, tmp_path, capsys, rate, options, message):
    np.savez(rates, rate=rate)
    assert run(image, rates, "-o", tmp_path / "seen.png", *options) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and re.search(message, error), error
    assert not (tmp_path / "seen.png").exists()


def test_files_that_are_none(image, rates, tmp_path, capsys):
    output = tmp_path / "seen.png"
    assert run(tmp_path / "none.png", rates, "-o", output) == 1
    assert f"{tmp_path / 'none.png'}: No such file" in capsys.readouterr().err
    assert run(image, tmp_path / "none.npz", "-o", output) == 1
    assert f"{tmp_path / 'none.npz'}: No such file" in capsys.readouterr().err
    image.write_bytes(image.read_bytes()[:200])
    assert run(image, rates, "-o", output) == 1
    assert f"{image}: must be an image that can be read" in capsys.readouterr().err
    for bad in (tmp_path, tmp_path / "seen.jpg"):
        assert run(image, rates, "-o", bad) == 1
        assert "must be a file to write that ends in .png" in capsys.readouterr().err
    assert not output.exists()
