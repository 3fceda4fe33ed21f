import jax
import jax.numpy as jnp
import numpy as np
import pytest

from camojab._filters import log_gaussian, log_lorentzian, log_sinc, LOG_TRANSFER
from camojab._math import safe_hypot, safe_power


X64 = jax.config.jax_enable_x64
RTOL = 1e-12 if X64 else 1e-5


@pytest.mark.parametrize("p", [0.2, 0.36, 1.0, 2.0])
def test_power(p):
    x = jnp.array([0.0, 1e-15, 1e-3, 1.0, 7.0, 1e15])
    exponent = jnp.asarray(p, float)
    expected = np.asarray(x, float) ** p
    np.testing.assert_allclose(safe_power(x, exponent), expected, rtol=RTOL)
    by_x, by_p = jax.grad(lambda x, p: safe_power(x, p).sum(), (0, 1))(x[2:], exponent)
    np.testing.assert_allclose(by_x, p * expected[2:] / np.asarray(x[2:]), rtol=RTOL)
    np.testing.assert_allclose(
        by_p, (expected[2:] * np.log(np.asarray(x[2:]))).sum(), rtol=RTOL
    )


def test_power_of_zero_has_no_slope():
    point = jnp.zeros(()), jnp.asarray(0.36, float)
    assert safe_power(*point) == 0
    assert jax.grad(safe_power, (0, 1))(*point) == (0, 0)
    assert jax.jacfwd(safe_power, (0, 1))(*point) == (0, 0)


def test_power_keeps_what_is_not_a_number():
    # Or an unknown texture would have the energy, and the quality, of a black one.
    assert jnp.isnan(safe_power(jnp.asarray(jnp.nan), jnp.asarray(0.36, float)))


def test_hypot():
    x, y = jnp.array([0.0, 3.0, -5.0, 0.0]), jnp.array([0.0, 4.0, 12.0, 2.0])
    np.testing.assert_allclose(safe_hypot(x, y), [0, 5, 13, 2], rtol=RTOL)
    by_x, by_y = jax.grad(lambda *a: safe_hypot(*a).sum(), (0, 1))(x, y)
    np.testing.assert_allclose(by_x, [0, 3 / 5, -5 / 13, 0], rtol=RTOL)
    np.testing.assert_allclose(by_y, [0, 4 / 5, 12 / 13, 1], rtol=RTOL)


FREQUENCY = np.array([-3.0, -0.1, 0.0, 0.5, 1.7, 20.0])
WIDTH = 0.2


def test_lorentzian_is_eq_6_and_7():
    sigma = np.pi / (2 * WIDTH)
    expected = sigma**2 / (sigma**2 + 4 * FREQUENCY**2)
    found = log_lorentzian(jnp.asarray(FREQUENCY, float), jnp.asarray(WIDTH, float))
    np.testing.assert_allclose(found, np.log(expected), rtol=RTOL, atol=1e-30)


def test_lorentzian_has_its_half_width():
    # L = 1/2 at sigma / 2, as a half-width has it.
    width = jnp.asarray(0.7, float)
    found = jnp.exp(log_lorentzian(jnp.pi / (4 * width), width))
    np.testing.assert_allclose(found, 0.5, rtol=RTOL)


def test_sinc_is_the_transform_of_a_box():
    """The mean of a wave over a box, by summation; zeros stay finite logarithms."""
    at = (np.arange(20000) + 0.5) / 20000 - 0.5
    box = np.cos(2 * np.pi * FREQUENCY[:, None] * WIDTH * at).mean(axis=1)
    found = log_sinc(jnp.asarray(FREQUENCY, float), jnp.asarray(WIDTH, float))
    # The last is a zero of the sinc, of which the floor is left.
    assert abs(box[-1]) < 1e-6 and np.isfinite(found).all()
    np.testing.assert_allclose(jnp.exp(found)[:-1], np.abs(box[:-1]), rtol=1e-5)
    assert jnp.exp(found)[-1] < 1e-6


def test_gaussian_is_the_transform_of_a_normal_blur_of_the_boxs_variance():
    deviation = WIDTH / np.sqrt(12)
    x = np.linspace(-8, 8, 4001) * deviation
    blur = np.exp(-0.5 * (x / deviation) ** 2)
    few = FREQUENCY[:-1]
    expected = (blur * np.cos(2 * np.pi * few[:, None] * x)).sum(axis=1) / blur.sum()
    found = log_gaussian(jnp.asarray(few, float), jnp.asarray(WIDTH, float))
    np.testing.assert_allclose(jnp.exp(found), expected, rtol=1e-5)


def test_all_low_passes_fall_alike_from_zero():
    """The Lorentzian's curvature is 16/pi^2, the others' pi^2/6: 1.5 % apart."""
    small = jnp.asarray(1e-2, float)
    one = jnp.ones(())
    fall = {kind: -float(f(small, one)) / 1e-4 for kind, f in LOG_TRANSFER.items()}
    lorentzian, sinc, gaussian = fall.values()
    # In single precision 1 - 1.6e-4 has three digits left of the fall.
    np.testing.assert_allclose(sinc, np.pi**2 / 6, rtol=1e-4 if X64 else 2e-3)
    np.testing.assert_allclose(gaussian, np.pi**2 / 6, rtol=RTOL)
    np.testing.assert_allclose(lorentzian, 16 / np.pi**2, rtol=2e-4)
    np.testing.assert_allclose(lorentzian, gaussian, rtol=0.02)


@pytest.mark.parametrize("function", LOG_TRANSFER.values())
def test_no_blur_is_no_filter_with_a_finite_slope(function):
    frequency, none = jnp.linspace(0.0, 60.0, 7), jnp.zeros(())
    np.testing.assert_array_equal(function(frequency, none), 0)
    slope = jax.jacfwd(lambda width: function(frequency, width))(none)
    np.testing.assert_array_equal(slope, 0)


@pytest.mark.parametrize("function", LOG_TRANSFER.values())
def test_slopes_of_the_low_passes_are_finite_everywhere(function):
    # A zero of the sinc, and widths beyond any texture.
    frequency = jnp.array([0.0, 0.5, 5.0, 60.0])
    for width in (0.2, 1.0, 1e6):
        slopes = jax.jacfwd(function, (0, 1))(frequency, jnp.asarray(width, float))
        assert all(np.isfinite(slope).all() for slope in slopes)
