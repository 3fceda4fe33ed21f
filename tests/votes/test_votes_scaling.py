"""Votes to JND: pwcmp's numbers, closed forms, symmetries."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import norm

from camojab.votes import Gauge, preference, Prior, scale


# Computed with pw_scale.m of mantiuk/pwcmp at 07876b2 in GNU Octave 7.3 on 2026-11-22,
# its optimiser at a tolerance of 1e-12, from the votes of Jindal et al. 2021.
GOLDEN = Path(__file__).parents[1] / "golden" / "pw_scale.json"
CELLS = json.loads(GOLDEN.read_text())

X64 = jax.config.read("jax_enable_x64")
# Both precisions find the goldens to 1e-5 JND; where conditions are many JND apart, so
# that a vote in a thousand decides, single precision is within 5e-4 JND.
ATOL = 2e-5 if X64 else 1e-3
SIGMA = 1 / norm.ppf(0.75)


@pytest.mark.parametrize(
    "cell", CELLS, ids=lambda c: f"{c['block']}-{c['velocity_deg_s']}"
)
def test_golden(cell):
    wins = np.array(cell["wins"])
    for prior, gauge in (
        (Prior.NONE, Gauge.MEAN0),
        (Prior.GAUSSIAN, Gauge.MEAN0),
        (Prior.GAUSSIAN, Gauge.FIX0),
    ):
        found = scale(wins, prior=prior, gauge=gauge)
        assert found.converged
        expected = cell[f"jod_{prior.value}_{gauge.value}"]
        np.testing.assert_allclose(found.quality, expected, atol=2e-5)


def test_golden_priors_can_be_told_apart():
    apart = [
        np.abs(np.subtract(c["jod_none_mean0"], c["jod_gaussian_mean0"])).max()
        for c in CELLS
    ]
    assert len(apart) == 5 and min(apart) > 0.02


# ---- closed forms


@pytest.mark.parametrize("won, lost", [(3, 1), (1, 1), (1, 14), (300, 100)])
def test_two_conditions(won, lost):
    found = scale(np.array([[0, won], [lost, 0]]))
    share = won / (won + lost)
    expected = SIGMA * norm.ppf(share) / 2
    np.testing.assert_allclose(found.quality, [expected, -expected], atol=ATOL)
    likelihood = won * np.log(share) + lost * np.log(1 - share)
    np.testing.assert_allclose(found.log_likelihood, likelihood, rtol=1e-5)


def test_three_of_four_is_one_jnd():
    quality = scale(np.array([[0, 3], [1, 0]])).quality
    np.testing.assert_allclose(quality[0] - quality[1], 1.0, atol=ATOL)


@pytest.mark.parametrize("votes", [1, 2, 5, 12])
def test_a_unanimous_pair_under_the_bounded_prior(votes):
    """Written out for a difference d: the winner's density is 1/(d + 1) - n/(d + 1)^2,
    or 0 where that is negative; the loser has no votes to subtract."""
    d = np.linspace(0, 10, 100_001)
    winner = np.maximum(1 / (d + 1) - votes / (d + 1) ** 2, 0)
    prior = 0.5 * (np.log(winner + 0.1) + np.log(1 / (d + 1) + 0.1))
    best = d[np.argmax(votes * norm.logcdf(d / SIGMA) + prior)]
    found = scale(np.array([[0, votes], [0, 0]]), prior=Prior.BOUNDED).quality
    np.testing.assert_allclose(found[0] - found[1], best, atol=2 * ATOL)


qualities = arrays(np.float64, 4, elements=st.floats(-2.5, 2.5))


@settings(deadline=None, max_examples=30)
@given(qualities)
def test_expected_votes_give_the_quality_back(quality):
    share = norm.cdf((quality[:, None] - quality[None, :]) / SIGMA)
    wins = 20 * share * (1 - np.eye(4))
    found = scale(wins)
    np.testing.assert_allclose(found.quality, quality - quality.mean(), atol=ATOL)


# ---- symmetries

counts = arrays(np.int64, (4, 4), elements=st.integers(1, 30)).map(
    lambda wins: wins * (1 - np.eye(4, dtype=int))
)


@pytest.mark.parametrize("prior", Prior)
@settings(deadline=None, max_examples=20)
@given(wins=counts, order=st.permutations(range(4)))
def test_permuting_the_conditions_permutes_the_result(prior, wins, order):
    whole = scale(wins, prior=prior)
    permuted = scale(wins[np.ix_(order, order)], prior=prior)
    assert whole.converged
    np.testing.assert_allclose(
        permuted.quality, whole.quality[np.array(order)], atol=2 * ATOL
    )
    np.testing.assert_allclose(
        permuted.log_likelihood, whole.log_likelihood, rtol=1e-5, atol=1e-5
    )


@pytest.mark.parametrize("prior", Prior)
@settings(deadline=None, max_examples=20)
@given(wins=counts)
def test_mean_is_zero_and_swapping_sides_swaps_signs(prior, wins):
    found = scale(wins, prior=prior)
    eps = jnp.finfo(found.quality.dtype).eps
    assert abs(jnp.mean(found.quality)) <= 8 * eps
    np.testing.assert_allclose(
        scale(wins.T, prior=prior).quality, -found.quality, atol=2 * ATOL
    )


@settings(deadline=None, max_examples=20)
@given(wins=counts)
def test_without_a_prior_more_of_the_same_votes_change_nothing(wins):
    once, often = scale(wins), scale(7 * wins)
    np.testing.assert_allclose(often.quality, once.quality, atol=2 * ATOL)
    np.testing.assert_allclose(often.log_likelihood, 7 * once.log_likelihood, rtol=1e-5)


def test_a_bounded_prior_leaves_split_votes_alone():
    wins = np.array([[0, 3, 9], [2, 0, 4], [1, 5, 0]])
    np.testing.assert_allclose(
        scale(wins, prior=Prior.BOUNDED).quality, scale(wins).quality, atol=ATOL
    )


# ---- what cannot be scaled


@pytest.mark.parametrize("prior", Prior)
@pytest.mark.parametrize(
    "wins, message",
    [
        ([[0, 1, 2], [1, 0, 1]], r"`wins` must be square, got \[2, 3\]"),
        ([0, 1], r"`wins` must be square, got \[2\]"),
        ([[0, 2], [-1, 0]], "`wins` must hold non-negative counts only"),
        ([[0, 2], [np.nan, 0]], "`wins` must hold non-negative counts only"),
        ([[0, 2], [np.inf, 0]], "`wins` must hold non-negative counts only"),
        (
            [[0, 2, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1], [0, 0, 3, 0]],
            r"`wins` must connect all .* groups \[\[0, 1\], \[2, 3\]\]",
        ),
        (np.zeros((3, 3)), r"groups \[\[0\], \[1\], \[2\]\]"),
    ],
)
def test_tables_that_cannot_be_scaled(prior, wins, message):
    with pytest.raises(ValueError, match=message):
        scale(np.array(wins), prior=prior)


UNANIMOUS = np.array([[0, 5, 4], [0, 0, 3], [0, 2, 0]])


def test_unanimous_votes_need_a_prior():
    with pytest.raises(ValueError, match=r"infinite without a prior: groups .*\[0\]"):
        scale(UNANIMOUS)
    for prior in (Prior.BOUNDED, Prior.GAUSSIAN):
        found = scale(UNANIMOUS, prior=prior)
        assert found.converged and np.isfinite(found.quality).all()
        assert 0 < found.quality[0] - max(found.quality[1:]) < 10


def test_a_cycle_of_unanimous_pairs_needs_none():
    found = scale(np.array([[0, 4, 0], [0, 0, 4], [4, 0, 0]]))
    np.testing.assert_allclose(found.quality, 0, atol=ATOL)


@pytest.mark.parametrize("prior", Prior)
@pytest.mark.parametrize("conditions", [0, 1])
def test_fewer_than_two_conditions_are_refused(prior, conditions):
    with pytest.raises(ValueError, match="`wins` must"):
        scale(np.zeros((conditions, conditions)), prior=prior)


# ---- the other side of the same coin


def test_preference_is_what_the_scale_means():
    one = jnp.asarray([1.0, 0.0, 3.0])
    other = jnp.asarray([0.0, 0.0, 4.0])
    np.testing.assert_allclose(preference(one, other), [0.75, 0.5, 0.25], rtol=1e-6)
