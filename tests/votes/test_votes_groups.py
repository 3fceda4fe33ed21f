"""Groups scaled at once, gauges, and how well one scale explains the votes."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from scipy.stats import chi2, norm

from camojab import datasets
from camojab._newton import minimise
from camojab.votes import (
    Gauge,
    goodness_of_fit,
    Prior,
    residuals,
    scale,
    scale_groups,
    simulate,
    votes_denes2020,
    votes_jindal2021,
)
from camojab.votes._scaling import _definite, _look


SIGMA = 1 / norm.ppf(0.75)
ATOL = 1e-6 if jax.config.read("jax_enable_x64") else 2e-5
WINS = np.array([[0, 9, 7, 12], [3, 0, 6, 8], [5, 4, 0, 7], [1, 2, 5, 0]])


def tidy(wins, names="abcd", **columns):
    """Votes that are counted to `wins`."""
    rows = [
        ("ann", names[i], names[j], True)
        for i, j in itertools.product(range(len(wins)), repeat=2)
        for _ in range(int(wins[i][j]))
    ]
    table = pd.DataFrame(
        rows, columns=["observer", "condition_a", "condition_b", "a_preferred"]
    )
    return table.assign(**columns)


def experiments(quality, *, observers, repetitions, seed):
    """Each observer votes once on every pair, in every repetition."""
    quality = np.asarray(quality)
    pairs = np.array(list(itertools.combinations(range(len(quality)), 2)))
    shape = (repetitions, observers, len(pairs))
    repetition, observer, pair = (x.ravel() for x in np.indices(shape))
    a, b = pairs[pair].T
    names = np.array(list("abcdefgh"))
    return pd.DataFrame(
        {
            "observer": observer,
            "repetition": repetition,
            "condition_a": names[a],
            "condition_b": names[b],
            "a_preferred": simulate(
                quality[a], quality[b], np.random.default_rng(seed)
            ),
        }
    )


# ---- gauges


@pytest.mark.parametrize("prior", Prior)
def test_gauges_differ_by_a_constant(prior):
    mean0 = scale(WINS, prior=prior)
    fix0 = scale(WINS, prior=prior, gauge=Gauge.FIX0)
    assert fix0.quality[0] == 0 and mean0.quality[0] > 0.5
    np.testing.assert_allclose(mean0.quality.mean(), 0, atol=ATOL)
    np.testing.assert_allclose(
        fix0.quality, mean0.quality - mean0.quality[0], atol=ATOL
    )
    np.testing.assert_allclose(fix0.log_likelihood, mean0.log_likelihood, rtol=1e-6)


# ---- groups


@pytest.mark.parametrize("prior", Prior)
def test_groups_of_different_sizes_are_scaled_as_if_alone(prior):
    small = WINS[:3, :3] + 1 - np.eye(3, dtype=int)
    votes = pd.concat([tidy(WINS, block="one"), tidy(small, "bda", block="two")])
    found = scale_groups(votes, by=["block"], prior=prior)
    assert list(found.table["condition"]) == ["a", "b", "c", "d", "a", "b", "d"]
    assert list(found.table["block"]) == ["one"] * 4 + ["two"] * 3
    order = [2, 0, 1]
    np.testing.assert_allclose(
        found.table["quality_jnd"],
        [
            *scale(WINS, prior=prior).quality,
            *np.asarray(scale(small, prior=prior).quality)[order],
        ],
        atol=ATOL,
    )
    alone = scale(small, prior=prior)
    row = found.groups.iloc[1]
    assert row["converged"] and row["block"] == "two" and row["observers"] == 1
    assert row["conditions"] == 3 and row["votes"] == small.sum()
    np.testing.assert_allclose(row["log_likelihood"], alone.log_likelihood, rtol=1e-6)
    fit = goodness_of_fit(small, alone.quality)
    assert row["degrees_of_freedom"] == fit.degrees_of_freedom == 1
    np.testing.assert_allclose(row["deviance"], fit.deviance, atol=1e-4)
    np.testing.assert_allclose(row["p_value"], fit.p_value, atol=1e-4)


def test_the_order_of_the_votes_does_not_matter():
    votes = pd.concat([tidy(WINS, block=10), tidy(WINS.T, block=9)])
    shuffled = votes.sample(frac=1, random_state=0)
    # Which side a condition was shown on does not either.
    sides = {"condition_a": "condition_b", "condition_b": "condition_a"}
    swapped = shuffled.rename(columns=sides).assign(a_preferred=False)
    plain = scale_groups(votes, by=["block"])
    assert list(plain.groups["block"]) == [9, 10]
    for other in (shuffled, swapped):
        again = scale_groups(other, by=["block"])
        pd.testing.assert_frame_equal(plain.table, again.table)
        pd.testing.assert_frame_equal(plain.groups, again.groups)


def test_the_reference_is_zero_and_first():
    names = ["100 Hz", "50 Hz", "75 Hz", "full"]
    votes = tidy(WINS, names)
    sorted_by_size = scale_groups(votes).table
    assert list(sorted_by_size["condition"]) == ["50 Hz", "75 Hz", "100 Hz", "full"]
    table = scale_groups(votes, reference="full").table
    assert list(table["condition"]) == ["full", "50 Hz", "75 Hz", "100 Hz"]
    assert table["quality_jnd"][0] == 0 and (table["quality_jnd"][1:] > 0).all()
    plain = sorted_by_size.set_index("condition")["quality_jnd"]
    np.testing.assert_allclose(
        table["quality_jnd"], plain[table["condition"]] - plain["full"], atol=ATOL
    )
    # Each vote has two conditions.
    assert table["votes"].sum() == 2 * WINS.sum()


@pytest.mark.parametrize(
    "prior", [Prior.NONE, Prior.BOUNDED, Prior.GAUSSIAN], ids=lambda p: p.name
)
def test_what_cannot_be_scaled_is_named(prior):
    good = tidy([[0, 2], [1, 0]], block=1, scene="sea")
    apart = pd.concat([good, good.replace({"a": "c", "b": "d"})])
    votes = pd.concat([good, apart.assign(block=2)])
    with pytest.raises(
        ValueError,
        match=r"`votes` of block 2, scene sea must connect all .* groups "
        r"\[\['a', 'b'\], \['c', 'd'\]\]",
    ):
        scale_groups(votes, by=["block", "scene"], prior=prior)
    with pytest.raises(ValueError, match=r"^`votes` must connect all"):
        scale_groups(apart, prior=prior)


def test_unanimous_votes_need_a_prior_that_bounds_them():
    wins = np.diag([5, 5, 5], 1)
    votes = tidy(wins, block=1)
    with pytest.raises(ValueError, match=r"block 1 has conditions that never lost"):
        scale_groups(votes, by=["block"])
    with pytest.raises(ValueError, match=r"block 1 must have some votes against"):
        scale_groups(votes, by=["block"], prior=Prior.GAUSSIAN)
    with pytest.raises(ValueError, match=r"^`wins` must have some votes against"):
        scale(wins, prior=Prior.GAUSSIAN)
    table = scale_groups(votes, by=["block"], prior=Prior.BOUNDED).table
    steps = -np.diff(table["quality_jnd"])
    assert (steps > 0.5).all() and (steps < 10).all()


@pytest.mark.parametrize("votes", [1, 5, 20])
def test_a_long_unanimous_chain_is_bounded(votes):
    wins = np.zeros((8, 8))
    wins[np.arange(7), np.arange(1, 8)] = votes
    found = scale(wins, prior=Prior.BOUNDED)
    assert found.converged and (np.diff(found.quality) < 0).all()


def test_a_condition_never_compared_is_a_group_of_its_own():
    wins = np.array([[0, 2, 0], [1, 0, 0], [0, 0, 0]])
    with pytest.raises(ValueError, match=r"separate groups \[\[0, 1\], \[2\]\]"):
        scale(wins)


def test_votes_of_a_condition_against_itself():
    with pytest.raises(ValueError, match="zeros on its diagonal, .* condition 1 ag"):
        scale(np.array([[0, 2], [1, 3]]))


def test_a_reference_that_a_group_lacks():
    votes = pd.concat([tidy(WINS, block="one"), tidy(WINS[:2, :2], block="two")])
    with pytest.raises(ValueError, match="of block two, which are of a, b, got 'd'"):
        scale_groups(votes, by=["block"], reference="d")


# ---- published scales


def test_all_nine_cells_have_the_published_jnd(real_data):
    real_data(
        "jindal2021/Experiment_Data/vrs_exp_data.csv",
        "jindal2021/Experiment_Data/vrs_exp_data_jnd.mat",
    )
    by = ["block", "velocity_deg_s"]
    found = scale_groups(
        votes_jindal2021(), by=by, prior=Prior.BOUNDED, reference="full"
    )
    assert len(found.groups) == 9 and found.groups["converged"].all()
    published = datasets.jindal2021_jnd()
    published["condition"] = [
        "full" if rate == 1 else f"{texture} {round(1 / rate)}x1"
        for texture, rate in zip(published["texture"], published["rate_x"], strict=True)
    ]
    both = published.merge(found.table, on=[*by, "condition"], suffixes=("", "_ours"))
    assert len(both) == 108
    # 1.5e-5 was found: the authors' search ended that far from the maximum.
    np.testing.assert_allclose(both["quality_jnd_ours"], both["quality_jnd"], atol=1e-4)


def test_denes_scales_rise_with_the_refresh_rate(real_data):
    real_data(
        "denes2020/data/pairwise_comparison_matrices.mat",
        "denes2020/data/exp1_scaled_results.csv",
    )
    found = scale_groups(
        votes_denes2020(), by=["stimulus"], prior=Prior.BOUNDED, reference="50 Hz"
    )
    published = datasets.denes2020_exp1_all()
    published["condition"] = [f"{f:g} Hz" for f in published["refresh_rate_hz"]]
    both = published.merge(
        found.table, on=["stimulus", "condition"], suffixes=("", "_ours")
    )
    assert len(both) == 144
    for _, rows in both.groupby("stimulus"):
        # The authors scaled them with votes across stimuli too, which are unpublished.
        assert rows["quality_jnd"].corr(rows["quality_jnd_ours"]) > 0.9


# ---- fit


def test_residuals_by_hand():
    wins = np.array([[0, 3, 5], [1, 0, 2], [0, 2, 0]])
    quality = np.array([1.0, 0.25, -0.5])
    found = residuals(wins, quality)
    # 3 of 4 is 1 JND, 2 of 4 is none; the pair (0, 2) is unanimous.
    expected = np.array(
        [[np.nan, -0.25, np.nan], [0.25, np.nan, 0.75], [np.nan, -0.75, np.nan]]
    )
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_residuals_vanish_where_one_scale_explains_all():
    quality = np.array([0.0, 1.0, -0.5])
    share = norm.cdf((quality[:, None] - quality) / SIGMA)
    found = np.asarray(residuals(10 * share * (1 - np.eye(3)), quality))
    np.testing.assert_allclose(found[~np.eye(3, dtype=bool)], 0, atol=1e-5)


def test_deviance_by_hand():
    """Three pairs, two differences: one degree of freedom, written out."""
    wins = np.array([[0, 8, 5], [2, 0, 9], [5, 1, 0]])
    quality = np.asarray(scale(wins).quality, float)
    expected = 0.0
    for i, j in ((0, 1), (0, 2), (1, 2)):
        p = norm.cdf((quality[i] - quality[j]) / SIGMA)
        for won, model in ((wins[i, j], p), (wins[j, i], 1 - p)):
            expected += 2 * won * np.log(won / 10 / model)
    found = goodness_of_fit(wins, quality)
    assert found.degrees_of_freedom == 1
    np.testing.assert_allclose(found.deviance, expected, rtol=1e-4)
    np.testing.assert_allclose(found.p_value, chi2.sf(expected, 1), rtol=1e-3)
    # A cycle: no scale explains it.
    assert found.p_value < 0.02


def test_a_unanimous_pair_adds_no_deviance_at_infinity():
    wins = np.array([[0, 5, 5], [0, 0, 4], [0, 4, 0]])
    found = goodness_of_fit(wins, np.array([40.0, 0.0, 0.0]))
    np.testing.assert_allclose(found.deviance, 0, atol=1e-5)
    np.testing.assert_allclose(found.p_value, 1, atol=1e-2)


def test_without_degrees_of_freedom_there_is_no_p_value():
    wins = np.array([[0, 3], [1, 0]])
    found = goodness_of_fit(wins, scale(wins).quality)
    assert found.degrees_of_freedom == 0 and np.isnan(found.p_value)
    np.testing.assert_allclose(found.deviance, 0, atol=1e-5)


def test_p_values_are_uniform_where_one_scale_holds():
    votes = experiments([0.0, 0.4, 0.8, 1.4], observers=30, repetitions=300, seed=5)
    groups = scale_groups(votes, by=["repetition"], prior=Prior.BOUNDED).groups
    assert (groups["degrees_of_freedom"] == 3).all()
    # Four standard deviations of a mean of 300, and of a share of 1/10 of them.
    assert abs(groups["p_value"].mean() - 0.5) < 4 * np.sqrt(1 / 12 / 300)
    assert abs((groups["p_value"] < 0.1).mean() - 0.1) < 4 * np.sqrt(0.09 / 300)


# ---- the search


def test_the_search_finds_minima_and_says_where_there_is_none():
    def search(function, start):
        def searched(factor):
            look = _look(lambda x: factor * function(x), jnp.zeros((2, 2)))
            found = minimise(look, start)
            return found.place.at, found.converged, _definite(found.place)

        return jax.jit(searched)

    valley = lambda x: (1 - x[0]) ** 2 + 100 * (x[1] - x[0] ** 2) ** 2
    walk = search(valley, jnp.array([-1.2, 1.0]))
    at, converged, definite = walk(1.0)
    assert converged and definite
    np.testing.assert_allclose(at, 1, atol=1e-3)
    _, converged, definite = walk(jnp.nan)
    assert not (converged or definite)
    slope = lambda x: jnp.exp(-x[0]) + x[1] ** 2
    assert not search(slope, jnp.zeros(2))(1.0)[2]
