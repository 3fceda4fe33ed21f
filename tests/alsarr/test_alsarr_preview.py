"""What coarse shading leaves of a picture."""

import io

import equinox as eqx
import imageio.v3
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from alsarr import RATES
from alsarr._preview import coarse
from alsarr.plotting import shading_preview
from camojab import luminance


FULL_RATE = RATES.names.index("1x1")
# Two rows and three columns of tiles, the last of both cut by the edge.
SIZE = (25, 38)
TILES = (2, 3)


def picture(seed=0, size=SIZE):
    return np.random.default_rng(seed).uniform(0, 1, (*size, 3))


def rates(seed=0, tiles=TILES):
    return np.random.default_rng(seed).integers(0, 7, tiles)


def light(values):
    """Of each channel, by colour-science."""
    rows = [luminance(values[..., i], encoding="sRGB") for i in range(3)]
    return np.stack(rows, axis=-1)


def coarse_pixels(rate, size=SIZE):
    """Rows and columns of every coarse pixel, tile by tile."""
    for row, column in np.ndindex(rate.shape):
        wide, high = RATES.size[rate[row, column]]
        for y in range(16 * row, min(16 * row + 16, size[0]), high):
            for x in range(16 * column, min(16 * column + 16, size[1]), wide):
                yield np.s_[y : y + high, x : x + wide]


@pytest.mark.parametrize("seed", range(4))
def test_each_coarse_pixel_has_the_mean_light_of_its_pixels(seed):
    image, rate = picture(seed), rates(seed)
    before, after = light(image), light(np.asarray(coarse(image, rate), np.float64))
    for block in coarse_pixels(rate):
        assert before[block].size
        expected = np.broadcast_to(before[block].mean(axis=(0, 1)), before[block].shape)
        np.testing.assert_allclose(after[block], expected, rtol=5e-6, atol=1e-7)


def test_every_rate_replaces_by_blocks_of_its_size():
    image = picture()
    for index, (wide, high) in enumerate(RATES.size):
        found = np.asarray(coarse(image, np.full(TILES, index)))
        blocks = found[::high, ::wide].repeat(high, 0).repeat(wide, 1)
        np.testing.assert_array_equal(blocks[: SIZE[0], : SIZE[1]], found)
        # No block is any larger than that.
        pixels = found[:16:high, :16:wide, 0]
        assert len(np.unique(pixels)) == pixels.size == RATES.cost[index]


def test_black_and_white_make_half_of_the_light():
    image = np.zeros((16, 16, 3))
    image[:, ::2] = 1
    found = coarse(image, np.array([[RATES.names.index("2x1")]]))
    # 0.735 is how sRGB writes half of white's light.
    np.testing.assert_allclose(found, np.full((16, 16, 3), 0.7353569), rtol=1e-5)


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_full_rate_everywhere_changes_no_bit(seed):
    image = picture(seed)
    found = coarse(image, np.full(TILES, FULL_RATE))
    np.testing.assert_array_equal(found, jnp.asarray(image, found.dtype))


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_what_is_coarse_stays_as_it_is(seed):
    rate = rates(seed)
    once = coarse(picture(seed), rate)
    assert 0 <= once.min() and once.max() <= 1
    # One rounding of the encoding to and fro.
    eps = 8 * jnp.finfo(once.dtype).eps
    np.testing.assert_allclose(coarse(once, rate), once, rtol=eps, atol=eps)


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_black_and_white_stay(value):
    image = np.full((16, 16, 3), value)
    np.testing.assert_allclose(coarse(image, np.zeros((1, 1), int)), image, atol=1e-6)


def test_integers_count_to_the_largest_of_their_type():
    image = np.random.default_rng(0).integers(0, 65536, (16, 16, 3), np.uint16)
    rate = np.array([[3]])
    np.testing.assert_allclose(
        coarse(image, rate), coarse(image / 65535, rate), rtol=1e-6
    )


def test_compiles_and_maps_over_frames():
    images = jnp.stack([jnp.asarray(picture(seed)) for seed in range(3)])
    maps = jnp.stack([jnp.asarray(rates(seed)) for seed in range(3)])
    found = eqx.filter_jit(jax.vmap(coarse))(images, maps)
    for each, image, rate in zip(found, images, maps, strict=True):
        np.testing.assert_allclose(each, coarse(image, rate), rtol=1e-5, atol=1e-6)


def test_gradient_is_finite_from_black_to_white():
    image = jnp.linspace(0, 1, 16 * 16 * 3).reshape(16, 16, 3)
    image = image.at[:4, :4].set(0.0)
    total = lambda x: coarse(x, np.zeros((1, 1), int)).sum()
    gradient = eqx.filter_jit(jax.grad(total))(image)
    assert np.all(np.isfinite(gradient)) and np.all(gradient > 0)


@pytest.mark.parametrize(
    "image, rate, message",
    [
        (picture()[..., 0], rates(), r"`image` must have shape \[height, width, 3\]"),
        (picture() + 1, rates(), r"`image` must be in \[0, 1\], got 1"),
        (
            picture(),
            np.zeros((1, 3), int),
            r"`rate` must have the tiles of `image`, \(2, 3\) for 38 x 25 px, got \(1,",
        ),
        (picture(), rates().ravel(), r"`rate` must have the tiles .*, got \(6,\)"),
        (picture(), rates() + 7, "`rate` must be an index from 0 to 6, got"),
        (picture(), rates() - 7, "`rate` must be an index from 0 to 6, got -"),
        (picture(), rates() * 1.0, "`rate` must be whole numbers, got float"),
    ],
)
def test_what_does_not_fit_is_refused(image, rate, message):
    with pytest.raises(ValueError, match=message):
        coarse(image, rate)


@pytest.mark.parametrize("size", [(25, 38), (48, 400), (100, 1003)])
def test_the_figure_has_the_pixels_of_both(size):
    tiles = -(-size[0] // 16), -(-size[1] // 16)
    image, rate = picture(size=size), rates(tiles=tiles)
    buffer = io.BytesIO()
    figure = shading_preview(image, rate)
    figure.savefig(buffer, format="png", dpi=figure.dpi)
    pixels = imageio.v3.imread(buffer.getvalue(), extension=".png")[..., :3]
    expected = [
        np.round(image * 255).astype(np.uint8),
        RATES.colour[rate].repeat(16, 0).repeat(16, 1)[: size[0], : size[1]],
    ]
    unit = max(1, size[1] / 500)
    margin = round(12 * unit)
    start = (pixels.shape[1] - 2 * size[1] - margin) // 2
    for x, whole in zip((start, start + size[1] + margin), expected, strict=True):
        found = pixels[margin : margin + size[0], x : x + size[1]]
        np.testing.assert_array_equal(found, whole)
    shares = np.bincount(rate.ravel(), minlength=7) / rate.size
    words = [text.get_text() for text in figure.texts]
    for name, share in zip(RATES.names, shares, strict=True):
        assert f"{name}  {share:.1%}" in words
