import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from alsarr import coarse, RATES
from alsarr.network import as_error, choose_mode, extrapolate


BASIC = ("1x2", "2x1")
FOUR = ("1x2", "2x1", "2x4", "4x2")


def _values(count, seed=0):
    return jnp.asarray(np.random.default_rng(seed).uniform(0, 1, (count, 3, 5)))


def _named(values, rates):
    got = np.asarray(extrapolate(values, rates))
    assert got.shape == (7, 3, 5)
    return dict(zip(RATES.names, got, strict=True))


def test_two_outputs_make_all_rates():
    """The released program's formula, which is Eq. 10 with 2x2 put in."""
    high, wide = values = _values(2)
    got = _named(values, BASIC)
    k = 2.13
    expected = {
        "1x1": np.zeros((3, 5)),
        "1x2": high,
        "2x1": wide,
        "2x2": np.maximum(high, wide),
        "2x4": np.maximum(k * high, wide),
        "4x2": np.maximum(high, k * wide),
        "4x4": k * np.maximum(high, wide),
    }
    for name, error in expected.items():
        np.testing.assert_allclose(got[name], error, rtol=1e-6, err_msg=name)


def test_four_outputs_are_kept_and_make_the_squares():
    values = _values(4)
    got = _named(values, FOUR)
    for name, error in zip(FOUR, values, strict=True):
        np.testing.assert_array_equal(got[name], error)
    np.testing.assert_array_equal(got["2x2"], np.maximum(values[0], values[1]))
    np.testing.assert_array_equal(got["4x4"], np.maximum(values[2], values[3]))
    turned = _named(values[::-1], FOUR[::-1])
    for name in RATES.names:
        np.testing.assert_array_equal(got[name], turned[name])


@pytest.mark.parametrize(
    "stripes, without_error", [("columns", "1x2"), ("rows", "2x1")]
)
def test_the_names_of_the_rates_are_width_by_height(stripes, without_error):
    """Stripes cost nothing at the rate that is coarse along them only."""
    along = np.tile([0.2, 0.8], 8)
    picture = np.broadcast_to(
        along[None, :] if stripes == "columns" else along[:, None], (16, 16)
    )
    picture = np.repeat(picture[..., None], 3, axis=2)
    rate = lambda name: np.full((1, 1), RATES.names.index(name))
    error = lambda name: np.abs(np.asarray(coarse(picture, rate(name))) - picture).max()
    measured = jnp.asarray([[[error(name)]] for name in BASIC], float)
    got = dict(zip(RATES.names, extrapolate(measured, BASIC)[:, 0, 0], strict=True))
    assert got[without_error] < 1e-6
    other = "2x1" if without_error == "1x2" else "1x2"
    coarser = "4x2" if other == "2x1" else "2x4"
    np.testing.assert_allclose(got[coarser], 2.13 * got[other], rtol=1e-6)
    assert got[other] > 0.1


@pytest.mark.parametrize(
    "rates, count",
    [
        *[(("1x2",), 1), (("2x2", "2x4"), 2), (("1x2", "2x1", "1x1"), 3)],
        *[(("1x2", "2x1", "2x1"), 3), (("1x2", "2x1", "4x1"), 3)],
    ],
)
def test_outputs_that_cannot_be_extrapolated(rates, count):
    with pytest.raises(ValueError, match="`rates` must be 1x2, 2x1 and others of"):
        extrapolate(_values(count), rates)


def test_outputs_and_values_must_match():
    with pytest.raises(ValueError, match="`values` must have one entry for each of 2"):
        extrapolate(_values(3), BASIC)


def test_psnr_becomes_an_error():
    decibels = jnp.asarray([0.0, 20.0, 60.0, jnp.inf])
    np.testing.assert_allclose(as_error(decibels, "psnr"), [1, 0.1, 1e-3, 0], rtol=1e-5)
    np.testing.assert_array_equal(as_error(decibels, "flip"), decibels)


def _chosen_as_printed(errors, threshold):
    """The paper's chooseMode, the modes in increasing cost."""
    for mode in np.argsort(RATES.cost, kind="stable")[:-1]:
        if errors[mode] < threshold:
            return mode
    return RATES.names.index("1x1")


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**31), st.floats(0, 1))
def test_the_mode_is_that_of_the_papers_loop(seed, threshold):
    errors = np.random.default_rng(seed).uniform(0, 1, (20, 7))
    errors[:, 6] = 0
    got = choose_mode(jnp.asarray(errors), threshold)
    threshold = float(jnp.asarray(threshold, float))
    expected = [
        _chosen_as_printed(e, threshold) for e in np.asarray(jnp.asarray(errors))
    ]
    np.testing.assert_array_equal(got, expected)


def test_where_nothing_is_good_enough_the_rate_is_full():
    errors = jnp.asarray([[0.5] * 6 + [0.0], [jnp.nan] * 7, [0.0] * 7])
    full = RATES.names.index("1x1")
    np.testing.assert_array_equal(choose_mode(errors, 0.5), [full, full, 0])
    np.testing.assert_array_equal(choose_mode(errors, 0.0), [full, full, full])
    traced = jax.jit(choose_mode)(errors, 0.6)
    np.testing.assert_array_equal(traced, [0, full, 0])


@pytest.mark.parametrize("threshold", [-0.1, np.nan])
def test_a_threshold_below_nothing_is_refused(threshold):
    with pytest.raises(ValueError, match="`threshold` must be >= 0"):
        choose_mode(jnp.zeros((1, 7)), threshold)


def test_a_threshold_is_one_number():
    with pytest.raises(ValueError, match=r"`threshold` must be one number, got shape"):
        choose_mode(jnp.zeros((2, 7)), jnp.ones(2))
