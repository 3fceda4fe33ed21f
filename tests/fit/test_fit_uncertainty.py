"""Profiles, refits to observers drawn again, and draws from the posterior."""

import functools

import jax
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

import invented
from camojab import fit, Parameters
from invented import FREE, SCALES, TRUTH


pytestmark = pytest.mark.float64  # a fit is to be run in double precision


@functools.cache
def many_votes():
    """So many that the likelihood is a parabola."""
    target = invented.expected_votes(1e4)
    return invented.fitted(invented.comparisons(), target=target)


@functools.cache
def noisy():
    given = invented.observations(noise=0.2)
    return given, invented.fitted(given)


@functools.cache
def panel():
    """300 observers, none of whom is like another: their votes are independent."""
    given = invented.comparisons(observers=300)
    return given, invented.fitted(given)


# ---- profile likelihood


@functools.cache
def likelihood_held(index, value):
    """Log likelihood of the noisy JND with one constant held, by SciPy."""
    given, found = noisy()
    rows = invented.table()
    counted = (rows["reference"] != rows.index).to_numpy()
    measured = given.table["quality_jnd"].to_numpy()
    start = np.log(np.abs(found.values))

    def residuals(others):
        values = np.exp(np.insert(others, index, np.log(np.abs(value))))
        constants = dict(zip(TRUTH, values * [-1, -1, 1, 1, 1], strict=False))
        scales = dict(zip(SCALES, values[3:], strict=True))
        return (invented.quality(constants, scales) - measured)[counted]

    best = least_squares(residuals, np.delete(start, index), xtol=1e-12, gtol=1e-12)
    count = counted.sum()
    return -0.5 * count * (np.log(2 * np.pi * 2 * best.cost / count) + 1)


@pytest.mark.parametrize("name", ["ws", "beta", "scale:refresh"])
def test_of_many_votes_the_interval_is_that_of_the_standard_error(name):
    found = many_votes()
    index = found.free.index(name)
    value, error = found.values[index], found.standard_error[index]
    profile = fit.profile(found, name)
    # A parabola in the logarithm too: errors are a hundredth of the values.
    assert error < 0.03 * abs(value)
    np.testing.assert_allclose(value - profile.low, 1.96 * error, rtol=0.05)
    np.testing.assert_allclose(profile.high - value, 1.96 * error, rtol=0.05)
    assert (profile.name, profile.level) == (name, 0.95)
    assert (np.diff(profile.values) > 0).all() and len(profile.values) == 25
    assert profile.deviance.min() < 1e-6
    np.testing.assert_allclose(profile.values[profile.deviance.argmin()], value)
    # Six standard errors are 36 units of deviance away.
    np.testing.assert_allclose(profile.deviance[[0, -1]], 36, rtol=0.2)


@pytest.mark.parametrize("name, level", [("ws", 0.95), ("beta", 0.8)])
def test_profile_of_jnd_is_that_of_another_search(name, level):
    _, found = noisy()
    index = found.free.index(name)
    profile = fit.profile(found, name, level=level)
    for place in (5, 17):
        held = likelihood_held(index, profile.values[place])
        expected = 2 * (found.log_likelihood - held)
        np.testing.assert_allclose(profile.deviance[place], expected, rtol=1e-5)
    # At the ends the deviance has its quantile; between points it is interpolated.
    for end in (profile.low, profile.high):
        deviance = 2 * (found.log_likelihood - likelihood_held(index, end))
        np.testing.assert_allclose(deviance, chi2.ppf(level, 1), rtol=0.01)
    assert profile.low < found.values[index] < profile.high


@pytest.mark.parametrize(
    "options, message",
    [
        ({"name": "ca"}, "`name` must be of ws, wt, beta, .*, got 'ca'"),
        ({"level": 1.0}, r"`level` must be in \(0, 1\), got 1\."),
        ({"level": 0.0}, r"`level` must be in \(0, 1\), got 0\."),
        ({"points": 4}, r"`points` must be >= 5, got 4\."),
    ],
)
def test_wrong_profiles(options, message):
    with pytest.raises(ValueError, match=message):
        fit.profile(many_votes(), **{"name": "beta", **options})


def test_a_constant_fitted_alone_has_a_profile():
    # Scales that are held need not be 1: only the exponent is left to find.
    data = invented.observations(noise=0.1)
    start = Parameters(**{**invented.TRUTH, "beta": 0.36})
    options = {"free": ["beta"], "start": start, "scales": invented.SCALES}
    found = invented.fitted(data, **options)
    assert found.scales == invented.SCALES
    np.testing.assert_allclose(found.values, invented.TRUTH["beta"], rtol=0.05)
    profile = fit.profile(found, "beta")
    half = 1.96 * found.standard_error[0]
    np.testing.assert_allclose(profile.high - profile.low, 2 * half, rtol=0.1)


# ---- bootstrap


@functools.cache
def refits(seed=0):
    return fit.bootstrap(panel()[1], key=jax.random.key(seed), resamples=400)


def test_same_key_same_numbers():
    again = fit.bootstrap(panel()[1], key=jax.random.key(0), resamples=400)
    np.testing.assert_array_equal(again.values, refits().values)
    assert not np.allclose(refits(1).values, refits().values)


def test_of_independent_voters_the_errors_are_fishers():
    """Of 400 draws a deviation is known to 3.5 %, of 300 observers to some 5 % more."""
    found = refits()
    assert found.free == FREE and found.converged.all()
    ratio = found.standard_error / panel()[1].standard_error
    np.testing.assert_allclose(ratio, 1.0, atol=0.2)
    np.testing.assert_allclose(found.values.std(axis=0, ddof=1), found.standard_error)
    ends = np.quantile(found.values, [0.025, 0.975], axis=0)
    np.testing.assert_allclose([found.low, found.high], ends)
    assert (found.low < panel()[1].values).all()
    assert (panel()[1].values < found.high).all()


def test_of_unknown_observers_the_votes_are_drawn():
    given, known = panel()
    votes = given.votes.assign(observer="all")
    found = invented.fitted(fit.Comparisons(given.table, votes, given.textures))
    np.testing.assert_array_equal(found.values, known.values)
    drawn = fit.bootstrap(found, key=jax.random.key(0), resamples=400)
    assert drawn.converged.all()
    np.testing.assert_allclose(drawn.standard_error / found.standard_error, 1, atol=0.2)


def test_observers_who_agree_are_one():
    """Ten copies of 30 observers: Fisher's errors shrink, those of observers do not."""
    given = invented.comparisons(observers=30)
    copies = given.votes.loc[np.repeat(given.votes.index, 10)].reset_index(drop=True)
    found = invented.fitted(fit.Comparisons(given.table, copies, given.textures))
    drawn = fit.bootstrap(found, key=jax.random.key(0), resamples=200)
    ratio = np.median(drawn.standard_error / found.standard_error)
    np.testing.assert_allclose(ratio, 10**0.5, rtol=0.35)


def test_refits_to_jnd_scale_the_votes_again():
    # The judder has no votes, its JND stay as they are.
    votes = invented.comparisons(observers=40, data_sets=("rates", "refresh"))
    scaled = fit.scaled(votes)
    whole = invented.observations()
    whole.table.loc[scaled.table.index, "quality_jnd"] = scaled.table["quality_jnd"]
    found = invented.fitted(whole)
    key = jax.random.key(3)
    drawn = fit.bootstrap(found, key=key, resamples=60, votes=votes, level=0.8)
    again = fit.bootstrap(found, key=key, resamples=60, votes=votes, level=0.8)
    np.testing.assert_array_equal(drawn.values, again.values)
    assert drawn.values.shape == (60, 5) and drawn.level == 0.8
    # Beside the errors of the votes themselves, which lose nothing by a scaling.
    direct = invented.fitted(invented.comparisons(observers=40))
    # The judder's JND are exact here, so that all but its own scale compare.
    ratio = drawn.standard_error[:4] / direct.standard_error[:4]
    assert (ratio > 0.4).all() and (ratio < 2.5).all()
    inside = (drawn.values > drawn.low) & (drawn.values < drawn.high)
    np.testing.assert_allclose(inside.mean(axis=0), 0.8, atol=0.05)


@pytest.mark.parametrize(
    "options, message",
    [
        ({"resamples": 1}, r"`resamples` must be >= 2, got 1\."),
        ({"batch_size": 0}, r"`batch_size` must be >= 1, got 0\."),
        ({"level": 1.0}, r"`level` must be in \(0, 1\), got 1\."),
        ({}, "`votes` must be given to draw observers behind JND, got None"),
    ],
)
def test_wrong_bootstraps(options, message):
    with pytest.raises(ValueError, match=message):
        fit.bootstrap(noisy()[1], key=jax.random.key(0), **options)


def test_votes_on_other_conditions_are_refused():
    votes = invented.comparisons()
    votes.table["rate_x"] *= 0.5
    with pytest.raises(ValueError, match="first conditions that were fitted, got oth"):
        fit.bootstrap(noisy()[1], key=jax.random.key(0), votes=votes, resamples=2)


def test_scaled_votes_have_intervals():
    given = invented.comparisons(observers=20)
    unknown = given.votes["group"] == "refresh"
    given.votes.loc[unknown, "observer"] = "all"
    plain, found = (
        fit.scaled(given, key=key, resamples=200).table
        for key in (None, jax.random.key(0))
    )
    ends = found[["low_jnd", "high_jnd"]].to_numpy()
    assert plain[["low_jnd", "high_jnd"]].isna().all().all()
    np.testing.assert_array_equal(plain["quality_jnd"], found["quality_jnd"])
    own = (found["data_set"] == "refresh").to_numpy()
    assert np.isnan(ends[own]).all() and np.isfinite(ends[~own]).all()
    quality = found["quality_jnd"].to_numpy()
    anchors = (found["reference"] == found.index).to_numpy()
    assert (ends[anchors & ~own] == 0).all() and (quality[anchors] == 0).all()
    moving = ~own & ~anchors
    assert (ends[moving, 0] < quality[moving]).all()
    assert (quality[moving] < ends[moving, 1]).all()
    # Of 20 observers 95 % intervals hold the truth in 92 % of cases: 14 conditions.
    truth = invented.quality()[moving]
    held = (ends[moving, 0] < truth) & (truth < ends[moving, 1])
    assert moving.sum() == 14 and held.sum() >= 10


# ---- posterior


def test_posterior_agrees_with_the_standard_errors():
    pytest.importorskip("blackjax")
    free = ("ws", "wt", "beta")
    target = invented.expected_votes(300)
    exact = invented.fitted(invented.comparisons(), target=target)
    found = invented.fitted(
        invented.comparisons(), free=free, target=target, start=exact.parameters
    )
    drawn = fit.posterior(found, key=jax.random.key(0), draws=1500, warmup=400)
    assert drawn.free == free and drawn.values.shape == (2, 1500, 3)
    assert (drawn.r_hat < 1.05).all() and (drawn.r_hat > 0.99).all()
    assert drawn.divergent < 0.01
    spread = drawn.values.reshape(-1, 3).std(axis=0)
    np.testing.assert_allclose(spread, found.standard_error, rtol=0.15)
    middle = drawn.values.reshape(-1, 3).mean(axis=0)
    assert (np.abs(middle - found.values) < 0.3 * found.standard_error).all()
    flat = np.corrcoef(drawn.values.reshape(-1, 3), rowvar=False)
    np.testing.assert_allclose(flat, found.correlation, atol=0.1)


@pytest.mark.parametrize("name", ["draws", "warmup", "chains"])
def test_wrong_posteriors(name):
    with pytest.raises(ValueError, match=rf"`{name}` must be >= 2, got 1\."):
        fit.posterior(noisy()[1], key=jax.random.key(0), **{name: 1})
