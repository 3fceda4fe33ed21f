"""Observers drawn again: bootstrap, coverage, and observers unlike the others."""

import itertools

import jax
import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom, norm
from test_votes_groups import experiments

from camojab import datasets
from camojab.votes import (
    bootstrap,
    count,
    outliers,
    Prior,
    resample,
    scale,
    scale_groups,
    votes_denes2020,
    votes_jindal2021,
)


KEY = jax.random.key(7)
QUALITY = np.array([0.0, 0.4, 0.8, 1.4])
ATOL = 1e-6 if jax.config.read("jax_enable_x64") else 2e-3
NAMES = ["a", "b", "c", "d"]


@pytest.fixture(scope="module")
def votes():
    return experiments(QUALITY, observers=12, repetitions=2, seed=3)


def drawn(votes, weights):
    """The votes as if each observer had given them `weight` times."""
    times = np.asarray(weights)[votes["observer"]]
    return votes.loc[np.repeat(votes.index, times)]


# ---- drawing


def test_every_draw_has_as_many_observers():
    weights = np.asarray(resample(KEY, observers=13, resamples=4000))
    assert weights.shape == (4000, 13) and weights.min() == 0
    np.testing.assert_array_equal(weights.sum(axis=1), 13)
    # Five standard deviations of the mean of 4000 binomial counts.
    np.testing.assert_allclose(weights.mean(axis=0), 1, atol=5 * np.sqrt(1 / 4000))
    np.testing.assert_allclose(weights.var(axis=0), 12 / 13, atol=0.15)


def test_a_key_repeats_the_draws_in_either_precision():
    first = resample(KEY, observers=5, resamples=3)
    np.testing.assert_array_equal(first, resample(KEY, observers=5, resamples=3))
    with jax.enable_x64(not jax.config.read("jax_enable_x64")):
        other = resample(jax.random.key(7), observers=5, resamples=3)
    np.testing.assert_array_equal(first, other)
    assert (first != resample(jax.random.key(8), observers=5, resamples=3)).any()


# ---- bootstrap


def test_resamples_are_the_votes_scaled_anew(votes):
    found = bootstrap(
        votes, by=["repetition"], key=KEY, resamples=40, prior=Prior.BOUNDED
    )
    weights = np.asarray(resample(KEY, observers=12, resamples=40))
    for r in (0, 17, 39):
        for repetition in (0, 1):
            mine = votes[votes["repetition"] == repetition]
            wins = count(drawn(mine, weights[r]), NAMES)
            rows = found.table["repetition"] == repetition
            np.testing.assert_allclose(
                found.samples[r, rows],
                scale(wins, prior=Prior.BOUNDED).quality,
                atol=ATOL,
            )


def test_what_is_returned_comes_from_the_samples(votes):
    options = dict(by=["repetition"], prior=Prior.BOUNDED, reference="b")
    found = bootstrap(votes, key=KEY, resamples=50, level=0.8, **options)
    table, samples = found.table, found.samples
    point = scale_groups(votes, **options).table
    pd.testing.assert_frame_equal(table[list(point)], point)
    assert samples.shape == (50, 8) and found.level == 0.8
    for k in range(8):
        low, high = np.quantile(samples[:, k], [0.1, 0.9])
        row = table.iloc[k]
        np.testing.assert_allclose([row["low_jnd"], row["high_jnd"]], [low, high])
        np.testing.assert_allclose(
            row["standard_error_jnd"], samples[:, k].std(ddof=1), atol=1e-12
        )
    np.testing.assert_allclose(found.covariance, np.cov(samples.T), atol=1e-12)
    assert (table["resamples"] == 50).all()
    zero = table["condition"] == "b"
    assert (samples[:, zero] == 0).all() and (table.loc[zero, "high_jnd"] == 0).all()


def test_groups_of_the_same_votes_move_together(votes):
    """Observers are drawn once for all groups."""
    same = votes[votes["repetition"] == 0]
    both = pd.concat([same, same.assign(repetition=1)])
    found = bootstrap(
        both, by=["repetition"], key=KEY, resamples=30, prior=Prior.BOUNDED
    )
    np.testing.assert_allclose(found.samples[:, :4], found.samples[:, 4:], atol=ATOL)
    np.testing.assert_allclose(
        found.covariance[:4, :4], found.covariance[:4, 4:], atol=ATOL
    )


def test_resamples_that_are_unanimous_are_left_out():
    """One observer alone votes for d: without her, d never wins."""
    rows = [
        (observer, *pair, flag)
        for observer in range(4)
        for pair in ("ab", "bc", "ca")
        for flag in (True, False)
    ]
    rows += [(observer, "a", "d", observer > 0) for observer in range(4)]
    columns = ["observer", "condition_a", "condition_b", "a_preferred"]
    votes = pd.DataFrame(rows, columns=columns)
    found = bootstrap(votes, key=KEY, resamples=200)
    weights = np.asarray(resample(KEY, observers=4, resamples=200))
    usable = (weights[:, 0] > 0) & (weights[:, 0] < 4)
    np.testing.assert_array_equal(np.isnan(found.samples[:, 0]), ~usable)
    assert (found.table["resamples"] == usable.sum()).all() and 0 < usable.sum() < 200
    assert np.isfinite(found.covariance).all()
    bounded = bootstrap(votes, key=KEY, resamples=200, prior=Prior.BOUNDED)
    assert np.isfinite(bounded.samples).all()


@pytest.mark.parametrize(
    "options, message",
    [
        ({"resamples": 1}, "`resamples` must be >= 2, got 1"),
        ({"level": 1.0}, r"`level` must be in \(0, 1\), got 1.0"),
    ],
)
def test_options_out_of_range(votes, options, message):
    with pytest.raises(ValueError, match=message):
        bootstrap(votes, key=KEY, **options)


def test_a_single_observer_can_be_scaled_and_no_more(votes):
    alone = votes[votes["observer"] == 0]
    table = scale_groups(alone, by=["repetition"], prior=Prior.BOUNDED).table
    assert np.isfinite(table["quality_jnd"]).all()
    for compares in (lambda v: bootstrap(v, key=KEY, prior=Prior.BOUNDED), outliers):
        with pytest.raises(ValueError, match="two observers or more, got only 0"):
            compares(alone.replace({"a_preferred": True}).pipe(both_ways))


def both_ways(votes):
    """Every vote and its opposite, which no prior is needed for."""
    return pd.concat([votes, votes.assign(a_preferred=False)])


def test_unknown_observers_are_refused(real_data):
    real_data("denes2020/data/pairwise_comparison_matrices.mat")
    with pytest.raises(ValueError, match="two observers or more, got only 'unknown'"):
        outliers(votes_denes2020(), by=["stimulus"], prior=Prior.BOUNDED)


def test_intervals_hold_the_truth_as_often_as_stated():
    votes = experiments(QUALITY, observers=20, repetitions=200, seed=1)
    found = bootstrap(
        votes,
        by=["repetition"],
        key=KEY,
        resamples=300,
        prior=Prior.BOUNDED,
    )
    table = found.table
    truth = np.tile(QUALITY - QUALITY.mean(), 200)
    held = (table["low_jnd"] <= truth) & (truth <= table["high_jnd"])
    # 92 % as documented. The four intervals of an experiment are not independent, so
    # the band is three standard deviations of 200 independent ones.
    assert abs(held.mean() - 0.92) < 3 * np.sqrt(0.92 * 0.08 / 200)
    # The JND themselves come back, but for a bias of a few hundredths outwards.
    error = (table["quality_jnd"] - truth).to_numpy().reshape(200, 4)
    np.testing.assert_allclose(error.mean(axis=0), 0, atol=0.06)
    spread = table["standard_error_jnd"].to_numpy().reshape(200, 4).mean(axis=0)
    np.testing.assert_allclose(spread / error.std(axis=0), 1, atol=0.15)


def test_intervals_of_jindal_are_as_wide_as_published(real_data):
    real_data(
        "jindal2021/Experiment_Data/vrs_exp_data.csv",
        "jindal2021/Experiment_Data/vrs_exp_data_jnd.mat",
    )
    by = ["block", "velocity_deg_s"]
    found = bootstrap(
        votes_jindal2021(), by=by, key=KEY, resamples=200, prior=Prior.BOUNDED
    )
    published = datasets.jindal2021_jnd()
    published["condition"] = [
        "full" if rate == 1 else f"{texture} {round(1 / rate)}x1"
        for texture, rate in zip(published["texture"], published["rate_x"], strict=True)
    ]
    both = published.drop_duplicates([*by, "condition"]).merge(
        found.table, on=[*by, "condition"], suffixes=("", "_ours")
    )
    assert len(both) == 81 and (both["resamples"] == 200).all()
    ours = both["high_jnd_ours"] - both["low_jnd_ours"]
    theirs = both["high_jnd"] - both["low_jnd"]
    # Theirs are percentiles of 100 resamples, about 15 % uncertain each.
    assert abs(np.median(ours / theirs) - 1) < 0.1
    assert np.corrcoef(ours, theirs)[0, 1] > 0.9


# ---- outliers


def test_likelihood_of_an_observer_by_hand(votes):
    found = outliers(votes, by=["repetition"], prior=Prior.BOUNDED)
    assert list(found["observer"]) == list(range(12))
    assert (found["pairs"] == 12).all() and (found["votes"] == 12).all()
    total = 0.0
    for repetition in (0, 1):
        mine = votes[votes["repetition"] == repetition]
        others = count(mine[mine["observer"] != 4], NAMES)
        own = count(mine[mine["observer"] == 4], NAMES)
        q = np.asarray(scale(others, prior=Prior.BOUNDED).quality, float)
        for i, j in itertools.combinations(range(4), 2):
            p = norm.cdf((q[i] - q[j]) * norm.ppf(0.75))
            total += np.log10(binom.pmf(own[i, j], own[i, j] + own[j, i], p))
    np.testing.assert_allclose(found["log10_likelihood"][4], total / 12, atol=1e-4)
    values = found["log10_likelihood"].to_numpy()
    # MATLAB's quartiles of twelve lie midway between neighbours.
    ordered = np.sort(values)
    low, high = ordered[2:4].mean(), ordered[8:10].mean()
    expected = np.maximum(low - values, 0) / (high - low)
    np.testing.assert_allclose(found["distance"], expected, atol=1e-5)


def test_an_observer_who_votes_the_other_way_stands_out():
    votes = experiments([0.0, 1.0, 2.0, 3.0], observers=20, repetitions=2, seed=2)
    odd = votes["observer"] == 6
    votes.loc[odd, "a_preferred"] = ~votes.loc[odd, "a_preferred"]
    found = outliers(votes, by=["repetition"], prior=Prior.BOUNDED)
    assert found["distance"].idxmax() == 6 and found["distance"][6] > 2
    assert found["log10_likelihood"].idxmin() == 6
    assert (found["distance"].drop(6) < 2).all()


def test_an_observer_without_whom_nothing_can_be_scaled_has_no_score():
    one = [("ann", "a", "b", True), ("ann", "a", "b", False), ("ann", "b", "c", True)]
    rest = [
        (name, "a", other, flag)
        for name in ("bob", "cat", "dan")
        for other in ("b", "d")
        for flag in (True, False)
    ]
    columns = ["observer", "condition_a", "condition_b", "a_preferred"]
    found = outliers(pd.DataFrame(one + rest, columns=columns), prior=Prior.BOUNDED)
    # Nobody but ann compared c.
    assert list(found["observer"]) == ["ann", "bob", "cat", "dan"]
    for column in ("log10_likelihood", "distance"):
        np.testing.assert_array_equal(found[column].isna(), [True, False, False, False])
