"""NAS: check values of its curves, tiles whose rates are known, its quality."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from camojab import Display, Viewing
from camojab.baselines import (
    half_rate_error_yang2019,
    half_rate_motion_yang2019,
    pixels_per_frame,
    quality_yang2019,
    quarter_rate_motion_yang2019,
    rates_yang2019,
    texture_error_yang2019,
    threshold_yang2019,
)


RTOL = 1e-12 if jax.config.jax_enable_x64 else 2e-6


def stripes(amplitude, size=16, axis=1):
    """Alternating lines, across x (axis 1) or down y (axis 0)."""
    line = 0.5 + amplitude * (np.arange(size) % 2 - 0.5)
    tile = np.broadcast_to(line, (size, size))
    return np.asarray(tile if axis == 1 else tile.T, float)


# ---- curves


@pytest.mark.parametrize(
    "speed, half, quarter",
    # The formulas by hand, four digits; at 16 px/frame GameTechDev/VALAR-API ends its
    # straight lines at exactly these values, 0.0468 and 0.1629.
    [
        (0, 1.0, 2.13),
        (1, 0.7633, 1.9194),
        (2, 0.4324, 1.4290),
        (4, 0.2099, 0.7841),
        (8, 0.0993, 0.3653),
        (16, 0.0468, 0.1629),
    ],
)
def test_motion_check_values(speed, half, quarter):
    np.testing.assert_allclose(half_rate_motion_yang2019(speed), half, atol=5e-5)
    np.testing.assert_allclose(quarter_rate_motion_yang2019(speed), quarter, atol=5e-5)


def test_motion_falls_and_has_finite_slopes():
    speed = jnp.asarray(np.r_[0.0, np.logspace(-3, 4, 50)])
    for curve in (half_rate_motion_yang2019, quarter_rate_motion_yang2019):
        values, slopes = jax.vmap(jax.value_and_grad(curve))(speed)
        # Below 1e-3 px/frame single precision no longer tells the values from 1.
        assert (np.diff(values) <= 0).all() and values[-1] < values[0] / 1e3
        assert slopes[0] == 0 and np.isfinite(slopes).all()
        assert (slopes <= 0).all()


# ---- errors


def test_error_of_stripes():
    error = half_rate_error_yang2019(
        np.stack([stripes(0.3), stripes(0.3, axis=0), np.full((16, 16), 0.7)])
    )
    # Every pair of neighbours across the stripes differs by 0.3, halved by Eq. 2.
    expected = [[0.15, 0], [0, 0.15], [0, 0]]
    np.testing.assert_allclose(error, expected, rtol=RTOL, atol=1e-7)
    assert (error[2] == 0).all()


def test_error_of_one_edge():
    tile = np.zeros((16, 16))
    tile[:, 8:] = 1.0
    error = half_rate_error_yang2019(tile)
    # One of the 15 pairs in each row differs, by 1.
    np.testing.assert_allclose(error[0], np.sqrt(0.25 / 15), rtol=RTOL)
    assert error[1] == 0


def test_error_of_a_flat_tile_has_a_finite_gradient():
    slope = jax.grad(lambda x: half_rate_error_yang2019(x).sum())(jnp.ones((4, 4)))
    np.testing.assert_array_equal(slope, 0)


@settings(deadline=None, max_examples=30)
@given(st.floats(0.1, 10), st.integers(0, 1000))
def test_error_scales_and_turns_with_the_tile(factor, seed):
    tile = np.random.default_rng(seed).random((16, 16))
    error = half_rate_error_yang2019(tile)
    scaled = half_rate_error_yang2019(factor * tile)
    np.testing.assert_allclose(scaled, factor * np.asarray(error), rtol=1e-5)
    turned = half_rate_error_yang2019(np.ascontiguousarray(tile.T))
    np.testing.assert_allclose(turned, error[::-1], rtol=1e-5)


def test_texture_error_is_the_error_over_the_threshold():
    texture = stripes(0.4, size=64)
    # Means of 4096 terms keep five digits in single precision.
    rtol = 10 * RTOL
    error = texture_error_yang2019(texture)
    # 0.4 / 2 over 0.5 + 0.1; then with an environment as bright as the texture.
    np.testing.assert_allclose(error, [0.2 / 0.6, 0], rtol=rtol, atol=1e-7)
    bright = texture_error_yang2019(texture, environment_luma=0.5)
    np.testing.assert_allclose(bright[0], 0.2, rtol=rtol)


# ---- rates


@pytest.mark.parametrize(
    "error, speed, expected",
    [
        # The threshold is 1: 1x from 1 on, 4x below 1/2.13 = 0.4695, else 2x.
        ((0.1, 0.1), (0, 0), (4, 4)),
        ((0.46, 0.48), (0, 0), (4, 2)),
        ((0.48, 0.46), (0, 0), (2, 4)),
        ((0.99, 0.99), (0, 0), (2, 2)),
        ((1.0, 0.99), (0, 0), (1, 2)),
        ((0.99, 1.01), (0, 0), (2, 1)),
        ((3.0, 2.0), (0, 0), (1, 1)),
        # 4x1 and 1x4 do not exist.
        ((0.1, 1.5), (0, 0), (2, 1)),
        ((1.5, 0.1), (0, 0), (1, 2)),
        ((0.0, 0.0), (0, 0), (4, 4)),
        # At 2 px/frame the half-rate error is 0.4324 of that at rest, and the
        # quarter-rate error 1.4290: 1x from 2.3127 on, 4x below 0.6998.
        ((2.32, 2.32), (2, 0), (1, 1)),
        ((2.30, 2.30), (2, 0), (2, 1)),
        ((0.69, 0.69), (2, 0), (4, 2)),
        ((0.71, 0.69), (2, 2), (2, 4)),
    ],
)
def test_rate_of_a_tile(error, speed, expected):
    got = rates_yang2019(
        jnp.asarray(error, float), jnp.ones(()), jnp.asarray(speed, float)
    )
    assert tuple(got.tolist()) == expected


def test_rates_of_tiles_as_a_picture():
    tiles = np.stack([stripes(0.3), stripes(0.04), np.full((16, 16), 0.5)])
    threshold = threshold_yang2019(
        tiles.mean((1, 2)), sensitivity=0.2, environment_luma=0.1
    )
    # Along x 0.15, 0.02 and 0 against 0.2 x 0.6 = 0.12; along y nothing.
    rates = rates_yang2019(
        half_rate_error_yang2019(tiles), threshold, jnp.zeros((3, 2))
    )
    assert rates.tolist() == [[1, 2], [4, 4], [4, 4]]


@settings(deadline=None, max_examples=100)
@given(*[st.floats(0, 10)] * 2, *[st.floats(0, 50)] * 2)
def test_rates_exist_and_motion_never_refines(error_x, error_y, speed_x, speed_y):
    error = jnp.asarray([error_x, error_y], float)
    at = lambda *v: rates_yang2019(error, jnp.ones(()), jnp.asarray(v, float)).tolist()
    still, moving = at(0, 0), at(speed_x, speed_y)
    assert moving not in ([1, 4], [4, 1])
    assert set(moving) <= {1, 2, 4}
    assert moving[0] >= still[0] and moving[1] >= still[1]


def test_threshold_is_webers():
    t = threshold_yang2019(np.array([0.0, 0.5]), sensitivity=0.5, environment_luma=0.02)
    np.testing.assert_allclose(t, [0.01, 0.26], rtol=RTOL)


# ---- quality


def test_quality_is_minus_the_error():
    q = quality_yang2019(0.2, np.array([1.0, 0.5, 0.25]), 2.0)
    # The check values above have four digits.
    np.testing.assert_allclose(q, [0, -0.2 * 0.4324, -0.2 * 1.4290], atol=1e-5)
    # At rest the quarter-rate error is k = 2.13 times the half-rate error.
    np.testing.assert_allclose(quality_yang2019(0.2, 0.25, 0.0), -0.426, rtol=RTOL)


def test_pixels_per_frame():
    display = Display(ppd=59, refresh_rate=np.array([60.0, 120.0]), luminance=300)
    np.testing.assert_allclose(
        pixels_per_frame(display, Viewing(6)), [5.9, 2.95], rtol=RTOL
    )


@pytest.mark.parametrize(
    "call, message",
    [
        (
            lambda: quality_yang2019(1.0, 0.3, 0.0),
            "`rate` must be 1, 1/2 or 1/4, got 0.3",
        ),
        (lambda: quality_yang2019(-1.0, 0.5, 0.0), "`error` must be .*>= 0, got -1"),
        (
            lambda: quality_yang2019(1.0, 0.5, -2.0),
            "`pixels_per_frame` must be .*got -2",
        ),
        (
            lambda: half_rate_error_yang2019(np.ones((1, 16))),
            r"`luma` must have 2 x 2 pixels or more, got \[1, 16\]",
        ),
        (
            lambda: half_rate_error_yang2019(np.full((4, 4), np.nan)),
            "`luma` must be finite, got nan",
        ),
        (
            lambda: threshold_yang2019(0.5, sensitivity=0.0, environment_luma=0.1),
            "`sensitivity` must be finite and > 0, got 0",
        ),
        (
            lambda: texture_error_yang2019(np.ones((4, 4)), environment_luma=-1.0),
            "`environment_luma` must be finite and > 0, got -1",
        ),
    ],
)
def test_wrong_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
