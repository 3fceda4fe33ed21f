import jax
import jax.numpy as jnp
import numpy as np
import pytest

from camojab._filters import log_lorentzian, lorentzian
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


def test_lorentzian_is_eq_6_and_7():
    frequency = jnp.array([-3.0, 0.0, 0.5, 20.0])
    width = jnp.asarray(0.2, float)
    sigma = np.pi / (2 * 0.2)
    expected = sigma**2 / (sigma**2 + 4 * np.asarray(frequency) ** 2)
    np.testing.assert_allclose(lorentzian(frequency, width), expected, rtol=RTOL)
    np.testing.assert_allclose(
        log_lorentzian(frequency, width), np.log(expected), rtol=RTOL, atol=1e-30
    )


def test_lorentzian_has_its_half_width():
    # L = 1/2 at sigma / 2, as a half-width has it.
    width = jnp.asarray(0.7, float)
    np.testing.assert_allclose(lorentzian(jnp.pi / (4 * width), width), 0.5, rtol=RTOL)


def test_no_blur_is_no_filter_with_a_finite_slope():
    frequency, none = jnp.linspace(0.0, 60.0, 7), jnp.zeros(())
    np.testing.assert_array_equal(lorentzian(frequency, none), 1)
    np.testing.assert_array_equal(log_lorentzian(frequency, none), 0)
    for function in (lorentzian, log_lorentzian):
        slope = jax.jacfwd(lambda width, f=function: f(frequency, width))(none)
        np.testing.assert_array_equal(slope, 0)
