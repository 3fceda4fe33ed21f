import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from jax.test_util import check_grads

from alsarr.network import adaptive_error, ClampedTransform, LogisticTransform


UNIT = np.linspace(0, 1, 101)


def test_the_clamped_transform_is_equation_4():
    y = np.linspace(-0.5, 1.5, 41)
    got = ClampedTransform.from_mean(0.25)(jnp.asarray(y))
    np.testing.assert_allclose(got, np.clip(y / 0.5, 0, 1), atol=1e-7)
    # The released factor for FLIP is that of a mean of one quarter.
    assert float(ClampedTransform.from_mean(0.25).factor) == 2


def test_psnr_is_turned_around():
    transform = ClampedTransform(-0.015, 1.0)
    decibels = jnp.asarray([-10.0, 0.0, 20.0, 40.0, 80.0, jnp.inf])
    np.testing.assert_allclose(transform(decibels), [1, 1, 0.7, 0.4, 0, 0], atol=1e-6)
    np.testing.assert_allclose(
        transform.inverse(jnp.asarray([0.7, 0.4])), [20, 40], rtol=1e-6
    )


@settings(deadline=None, max_examples=15)
@given(
    st.floats(0.01, 10),
    st.booleans(),
    st.floats(-1, 1),
    st.lists(st.floats(0, 1), min_size=1, max_size=8),
)
def test_the_clamped_transform_is_undone_within_its_range(size, falls, offset, values):
    transform = ClampedTransform(-size if falls else size, offset)
    y = jnp.asarray(values, float)
    # A difference of numbers of up to 2 is divided by the factor and multiplied again.
    tolerance = 8 * float(jnp.finfo(y.dtype).eps)
    np.testing.assert_allclose(transform(transform.inverse(y)), y, atol=tolerance)


def test_what_is_clamped_is_lost():
    transform = ClampedTransform.from_mean(0.25)
    beyond = jnp.asarray([0.5, 0.7, 1.0])
    np.testing.assert_allclose(transform.inverse(transform(beyond)), 0.5)
    slope = jax.vmap(jax.grad(transform))(jnp.asarray([0.25, 0.7]))
    np.testing.assert_allclose(slope, [2, 0])


def test_the_logistic_transform_is_equations_5_and_6():
    mean, growth = 0.25, 10.0
    s = lambda y: 1 / (1 + np.exp(-growth * (y - mean)))
    expected = (s(UNIT) - s(0)) / (s(1) - s(0))
    got = LogisticTransform(mean)(jnp.asarray(UNIT))
    np.testing.assert_allclose(got, expected, atol=1e-6)
    assert float(got[0]) == 0 and float(got[-1]) == 1
    # Its slope is largest at the mean.
    slope = jax.vmap(jax.grad(LogisticTransform(mean)))(jnp.asarray(UNIT))
    assert np.argmax(slope) == 25


@pytest.mark.parametrize("growth", [0.1, 1.0, 10.0, 30.0])
@pytest.mark.parametrize("mean", [0.0, 0.05, 0.25, 0.5, 1.0])
def test_the_logistic_transform_is_undone(growth, mean):
    transform = LogisticTransform(mean, growth)
    y = jnp.asarray(UNIT)
    back = transform.inverse(transform(y))
    # Where the curve is flat a rounding of T is a longer way in y; see the docstring.
    eps = float(jnp.finfo(y.dtype).eps)
    allowed = eps * (4 + 8 * np.exp(growth * max(mean, 1 - mean)) / growth)
    np.testing.assert_allclose(back, UNIT, atol=min(allowed, 0.5))
    values = np.asarray(transform.inverse(y))
    assert np.isfinite(values).all() and np.all(np.diff(values) > 0)


@pytest.mark.parametrize("growth", [1e-3, 10.0, 80.0])
def test_logistic_values_and_slopes_are_finite_at_the_extremes(growth):
    for mean in (0.0, 0.5, 1.0):
        transform = LogisticTransform(mean, growth)
        for f in (transform, transform.inverse):
            ends = jnp.asarray([0.0, 0.5, 1.0], jnp.float32)
            assert np.isfinite(f(ends)).all()
            assert np.isfinite(jax.vmap(jax.grad(f))(ends)).all()


@pytest.mark.float64  # Differences cancel in float32.
@pytest.mark.parametrize(
    "transform", [LogisticTransform(0.25), ClampedTransform(1.3, -0.1)]
)
def test_gradients_match_differences(transform):
    y = jnp.asarray([0.15, 0.4, 0.7])
    for f in (transform, transform.inverse):
        check_grads(lambda y, f=f: f(jnp.asarray(y)), (y,), 1, ["fwd", "rev"])


@pytest.mark.parametrize("dtype", [jnp.float16, jnp.float32])
def test_a_transform_keeps_the_precision_of_what_it_is_given(dtype):
    y = jnp.asarray([0.0, 0.5, 1.0], dtype)
    for transform in (LogisticTransform(0.25), ClampedTransform(2.0)):
        assert transform(y).dtype == dtype
        assert transform.inverse(y).dtype == dtype


def test_a_transform_follows_another_mean():
    follow = ClampedTransform(7.0).at_mean(0.2)
    np.testing.assert_allclose(follow.factor, ClampedTransform.from_mean(0.2).factor)
    turned = ClampedTransform(-0.015, 1.0).at_mean(30.0)
    np.testing.assert_allclose(turned(jnp.asarray(30.0)), 0.5, rtol=1e-6)
    np.testing.assert_allclose(turned.offset, 1)
    logistic = LogisticTransform(0.5, 4.0).at_mean(0.125)
    assert (float(logistic.mean), float(logistic.growth)) == (0.125, 4.0)


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: ClampedTransform(0.0), "`factor` must be finite and not 0, got 0"),
        (lambda: ClampedTransform(np.inf), "`factor` must be finite and not 0"),
        (lambda: ClampedTransform(1.0, np.nan), "`offset` must be finite"),
        (lambda: ClampedTransform.from_mean(0), "`mean` must be > 0 and finite, got 0"),
        (lambda: ClampedTransform(1.0).at_mean(-1), "`mean` must be > 0 and finite"),
        (lambda: ClampedTransform(1.0, 0.5).at_mean(1), "`factor` must be finite and"),
        (lambda: LogisticTransform(1.5), r"`mean` must be in \[0, 1\], got 1.5"),
        (lambda: LogisticTransform(0.5, 0), r"`growth` must be in \(0, 80\], got 0"),
        (lambda: LogisticTransform(0.5, 81), r"`growth` must be in \(0, 80\], got 81"),
    ],
)
def test_out_of_range_names_the_argument(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_the_loss_is_equation_3():
    random = np.random.default_rng(0)
    target, predicted = random.uniform(0, 1, (2, 3, 4, 5))
    transform = ClampedTransform.from_mean(0.3)
    expected = np.mean(np.abs(np.clip(target / 0.6, 0, 1) - predicted))
    got = adaptive_error(transform, jnp.asarray(target), jnp.asarray(predicted))
    np.testing.assert_allclose(got, expected, rtol=1e-6)
