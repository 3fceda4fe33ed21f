"""PSNR, errors of luma, Weber's law, and what becomes of pixels in tiles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from alsarr.metrics import (
    estimate_yang2019,
    flip,
    jnflip,
    jnyang,
    METRICS,
    pool_tiles,
    psnr,
    psnr_tiles,
    squared_error,
    weber,
    yang2019,
)


LUMA = np.array([0.299, 0.587, 0.114])


def pair(height=37, width=50, seed=0):
    random = np.random.default_rng(seed)
    return random.uniform(0, 1, (2, height, width, 3))


def tiles(values, size):
    """Each tile's pixels that exist, row by row."""
    height, width = values.shape[:2]
    return [
        [values[y : y + size, x : x + size] for x in range(0, width, size)]
        for y in range(0, height, size)
    ]


def each(of, values, size=16):
    return np.array([[of(tile) for tile in row] for row in tiles(values, size)])


@settings(deadline=None, max_examples=8)
@given(
    st.integers(1, 20),
    st.integers(1, 20),
    st.sampled_from([1, 3, 16]),
    st.sampled_from(["max", "mean"]),
)
def test_tiles_pool_the_pixels_that_exist(height, width, tile, how):
    values = np.random.default_rng(height * width).normal(size=(height, width)) - 3
    expected = each(getattr(np, how), values, tile)
    found = pool_tiles(jnp.asarray(values, float), tile=tile, how=how)
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_pooling_refuses_what_it_cannot_pool():
    values = jnp.ones((4, 4))
    with pytest.raises(ValueError, match="`how` must be max or mean, got 'min'"):
        pool_tiles(values, how="min")
    with pytest.raises(ValueError, match="`tile` must be a whole number > 0 px, got 0"):
        pool_tiles(values, tile=0)
    with pytest.raises(ValueError, match="`values` must have shape"):
        pool_tiles(jnp.ones((0, 4)))


def test_psnr_is_of_pixels_and_channels_together():
    reference, test = pair()
    square = (reference - test) ** 2
    decibels = lambda part: -10 * np.log10(part.mean())
    np.testing.assert_allclose(
        squared_error(reference, test), square.mean(-1), rtol=1e-4, atol=1e-7
    )
    np.testing.assert_allclose(psnr(reference, test), decibels(square), rtol=1e-5)
    for size in (8, 16):
        found = psnr_tiles(reference, test, tile=size)
        np.testing.assert_allclose(found, each(decibels, square, size), rtol=1e-5)


def test_psnr_of_known_pictures():
    black, grey = np.zeros((16, 16, 3)), np.full((16, 16, 3), 0.1)
    np.testing.assert_allclose(psnr(black, grey), 20, rtol=1e-6)
    np.testing.assert_allclose(psnr(black, 1 - black), 0, atol=1e-6)
    assert np.isinf(psnr(grey, grey)) and np.isinf(psnr_tiles(grey, grey)).all()
    # Finite where a network is to learn it, and past the end of its transform.
    found = METRICS["psnr"](grey, grey, ppd=60)
    np.testing.assert_allclose(1 - 0.015 * found, 0, atol=1e-5)


def test_psnr_of_equal_pictures_has_no_slope():
    picture = jnp.asarray(pair(height=20, width=20)[0], float)
    for of in (psnr, psnr_tiles):
        whole = lambda x, of=of: of(picture, x).sum()
        value, slope = jax.value_and_grad(whole)(picture)
        assert np.isposinf(value)
        np.testing.assert_array_equal(slope, 0)
    # Tiles that are equal leave the slopes of the others as they are.
    test = picture.at[:16, :16].add(0.01 * (0.5 - picture[:16, :16]))
    finite = lambda x: psnr_tiles(picture, x)[0, 0]
    expected = jax.grad(lambda x: psnr(picture[:16, :16], x))(test[:16, :16])
    slope = jax.grad(finite)(test)
    np.testing.assert_allclose(slope[:16, :16], expected, rtol=1e-4)
    np.testing.assert_array_equal(slope[16:], 0)
    assert np.abs(expected).max() > 1e-3


def test_yang_is_the_difference_of_luma():
    reference, test = pair()
    expected = np.abs((reference - test) @ LUMA)
    np.testing.assert_allclose(yang2019(reference, test), expected, atol=1e-6)


def test_yangs_estimate_compares_within_coarse_pixels():
    reference, _ = pair(height=37, width=49)
    y = reference @ LUMA
    across, down = np.zeros_like(y), np.zeros_like(y)
    for i in range(0, 48, 2):
        across[:, i] = np.abs(y[:, i] - y[:, i + 1])
    for i in range(0, 36, 2):
        down[i] = np.abs(y[i] - y[i + 1])
    expected = np.stack([each(np.max, across), each(np.max, down)], axis=-1)
    np.testing.assert_allclose(estimate_yang2019(reference), expected, atol=1e-6)


def test_yangs_estimate_of_each_pixel_is_what_tiles_and_webers_law_take():
    reference, _ = pair()
    pixels = estimate_yang2019(reference, tile=1)
    assert pixels.shape == (37, 50, 2)
    largest = jnp.stack([pool_tiles(pixels[..., axis]) for axis in (0, 1)], axis=-1)
    np.testing.assert_array_equal(largest, estimate_yang2019(reference))
    across = np.abs(np.diff((reference @ LUMA)[:, :2]))[:, 0]
    level = each(np.mean, reference @ LUMA, 4).repeat(4, axis=0)[:37, 0]
    found = weber(pixels[..., 0], reference)
    np.testing.assert_allclose(found[:, 0], across / level, rtol=1e-4)


def test_yangs_estimate_tells_the_axes_apart():
    stripes = np.zeros((16, 16, 3))
    stripes[:, ::2] = 1
    np.testing.assert_allclose(estimate_yang2019(stripes), [[[1, 0]]], atol=1e-6)
    np.testing.assert_allclose(
        estimate_yang2019(stripes.swapaxes(0, 1)), [[[0, 1]]], atol=1e-6
    )


@pytest.mark.parametrize("environment_luminance", [1e-10, 0.1])
def test_weber_divides_by_the_mean_luma_of_four_by_four(environment_luminance):
    reference, test = pair()
    error = yang2019(reference, test)
    means = each(np.mean, reference @ LUMA, 4)
    means = means.repeat(4, axis=0).repeat(4, axis=1)[:37, :50]
    expected = np.asarray(error) / (means + environment_luminance)
    given = {"environment_luminance": environment_luminance}
    np.testing.assert_allclose(weber(error, reference, **given), expected, rtol=1e-5)
    np.testing.assert_allclose(jnyang(reference, test, **given), expected, rtol=1e-5)
    expected = np.asarray(flip(reference, test, ppd=9)) / (
        means + environment_luminance
    )
    found = jnflip(reference, test, ppd=9, **given)
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_weber_where_there_is_no_light():
    black = np.zeros((4, 4, 3))
    error = jnp.full((4, 4), 0.5).at[0, 0].set(0)
    found = np.asarray(weber(error, black))
    assert found[0, 0] == 0
    np.testing.assert_allclose(found[1], 0.5e10, rtol=1e-6)


def test_weber_refuses_what_does_not_fit():
    with pytest.raises(ValueError, match="`error` must have the pixels of `reference`"):
        weber(jnp.ones((4, 5)), np.ones((4, 4, 3)))
    with pytest.raises(ValueError, match="`environment_luminance` must be > 0, got 0"):
        weber(jnp.ones((4, 4)), np.ones((4, 4, 3)), environment_luminance=0)


def test_metrics_have_names_and_one_value_a_tile():
    reference, test = pair()
    expected = {
        "flip": each(np.max, np.asarray(flip(reference, test, ppd=9))),
        "jnflip": each(np.max, np.asarray(jnflip(reference, test, ppd=9))),
        "psnr": np.asarray(psnr_tiles(reference, test)),
        "jnyang": each(np.max, np.asarray(jnyang(reference, test))),
        "yang": each(np.max, np.asarray(yang2019(reference, test))),
    }
    assert list(METRICS) == list(expected)
    for name, metric in METRICS.items():
        found = metric(reference, test, ppd=9)
        np.testing.assert_allclose(found, expected[name], rtol=1e-5)


@pytest.mark.parametrize("name", list(METRICS))
def test_every_metric_asks_for_ppd_and_for_pictures_of_one_size(name):
    reference, test = pair()
    with pytest.raises(TypeError, match="ppd"):
        METRICS[name](reference, test)
    with pytest.raises(ValueError, match="`ppd` must be"):
        METRICS[name](reference, test, ppd=-1)
    with pytest.raises(ValueError, match="`test` must have the shape of `reference`"):
        METRICS[name](reference, test[:16], ppd=9)


# Single precision leaves too few digits for differences.
@pytest.mark.float64
@pytest.mark.parametrize("name", list(METRICS))
def test_slopes_are_those_of_differences(name):
    reference, test = (jnp.asarray(0.1 + 0.8 * p) for p in pair())
    along = jnp.asarray(np.random.default_rng(5).normal(size=test.shape))
    of = lambda h: METRICS[name](reference, test + h * along, ppd=9).sum()
    found = jax.grad(of)(0.0)
    np.testing.assert_allclose(found, (of(1e-6) - of(-1e-6)) / 2e-6, rtol=1e-5)


@pytest.mark.parametrize("name", list(METRICS))
def test_slopes_are_finite_where_pictures_are_equal_or_black(name):
    picture = jnp.asarray(pair()[0], float).at[:9, :9].set(0)
    of = jax.grad(lambda a, b: METRICS[name](a, b, ppd=9).sum(), (0, 1))
    for test in (picture, picture.at[:5].set(0.5)):
        assert all(np.isfinite(slope).all() for slope in of(picture, test))


# FLIP's own test has it under `vmap`.
@pytest.mark.parametrize("name", ["psnr", "jnyang", "yang"])
def test_metrics_vmap(name):
    reference, test = (jnp.asarray(p, float) for p in pair())
    first, second = (jnp.stack([p, p[::-1]]) for p in (reference, test))
    of = lambda a, b: METRICS[name](a, b, ppd=9)
    expected = [of(a, b) for a, b in zip(first, second, strict=True)]
    np.testing.assert_allclose(jax.vmap(of)(first, second), expected, rtol=1e-4)
