"""Votes as residuals: against SciPy's distributions, and smooth where it is hard."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.special import logsumexp
from scipy.stats import binom, norm

from camojab.fit._deviance import (
    deviance_residual,
    log_odds,
    log_preference,
    saturated_log_likelihood,
)
from camojab.fit._targets import vote_target, VoteTarget
from camojab.votes._simulation import SIGMA


X64 = jax.config.jax_enable_x64
RTOL = 1e-10 if X64 else 2e-4

residual = jax.jit(deviance_residual)
preference = jax.jit(log_preference)


def arrays(*values):
    return tuple(jnp.asarray(value, float) for value in values)


def log_share(difference, lapse):
    """Log probability of a vote for A by SciPy, without ever leaving the logarithm."""
    if lapse == 0:
        return norm.logcdf(difference)
    guess = np.full_like(difference, np.log(lapse / 2))
    return logsumexp([guess, np.log1p(-lapse) + norm.logcdf(difference)], axis=0)


@pytest.mark.parametrize("lapse", [0.0, 1e-6, 0.03, 0.5])
def test_preference_and_odds(lapse):
    difference = np.array([-50.0, -8.0, -1.0, 0.0, 0.3, 4.0, 50.0])
    d, rate = arrays(difference, lapse)
    expected = log_share(difference, lapse)
    # Beside 0, logarithms of probabilities near 1 have absolute errors.
    np.testing.assert_allclose(preference(d, rate), expected, rtol=RTOL, atol=RTOL)
    np.testing.assert_allclose(
        log_odds(d, rate), expected - log_share(-difference, lapse), rtol=RTOL
    )


@settings(deadline=None, max_examples=60)
@given(
    difference=st.floats(-6, 6),
    lapse=st.sampled_from([0.0, 0.02, 0.3]),
    votes=st.integers(0, 300),
    part=st.floats(0, 1),
)
def test_half_the_squares_is_what_the_likelihood_lacks(difference, lapse, votes, part):
    wins = round(part * votes)
    args = arrays([difference], lapse, [wins], [votes])
    found = np.asarray(residual(*args), np.float64)[0]
    # The rarer side's share, of which SciPy loses no digits. It counts the orders of
    # the votes, which both sides of the ratio share.
    rarer = np.exp(log_share(-np.abs(difference), lapse))
    seen = wins if difference < 0 else votes - wins
    best = seen / max(votes, 1)
    lacking = binom.logpmf(seen, votes, best) - binom.logpmf(seen, votes, rarer)
    tolerance = 1e-11 if X64 else 3e-6
    bound = tolerance * (1 + votes * abs(np.log(rarer)))
    np.testing.assert_allclose(0.5 * found**2, lacking, rtol=RTOL, atol=bound)
    if lacking > 1e3 * bound:
        assert np.sign(found) == np.sign(rarer - best) * (1 if difference < 0 else -1)
    if not votes:
        assert found == 0


def test_saturated_likelihood_is_that_of_the_shares():
    wins, votes = np.array([0.0, 3.0, 7.0, 5.0, 0.0]), np.array([4.0, 3.0, 9.0, 9.0, 0])
    some = votes > 0
    orders = -binom.logpmf(wins, votes, 0.5)[some] - votes[some] * np.log(2)
    share = wins[some] / votes[some]
    expected = np.sum(binom.logpmf(wins[some], votes[some], share) + orders)
    found = saturated_log_likelihood(*arrays(wins, votes))
    np.testing.assert_allclose(found, expected, rtol=RTOL)


def test_target_has_the_likelihood_of_the_votes():
    quality = np.array([0.0, -1.0, 2.0, 0.5])
    a, b = np.array([0, 0, 1, 2]), np.array([1, 2, 3, 3])
    wins, votes = np.array([3.0, 0.0, 2.0, 0.0]), np.array([4.0, 5.0, 7.0, 0.0])
    target = VoteTarget(jnp.asarray(a), jnp.asarray(b), *arrays(wins, votes))
    q, lapse = arrays(quality, 0.04)
    p = 0.02 + 0.96 * norm.cdf((quality[a] - quality[b]) / SIGMA)
    expected = np.sum(wins * np.log(p) + (votes - wins) * np.log1p(-p))
    found = target.log_likelihood(target.residuals(q, lapse))
    np.testing.assert_allclose(found, expected, rtol=RTOL)
    assert target.size() == 16


@pytest.mark.float64  # central differences
@pytest.mark.parametrize("lapse", [0.0, 0.02])
def test_score_and_information_are_derivatives_along_the_odds(lapse):
    target = VoteTarget(jnp.array([0]), jnp.array([1]), *arrays([3.0], [8.0]))
    odds, h = jnp.array([0.7]), 1e-5
    value = lambda o: float(3 * jax.nn.log_sigmoid(o) + 5 * jax.nn.log_sigmoid(-o))
    up, mid, down = (value(odds[0] + step) for step in (h, 0.0, -h))
    np.testing.assert_allclose(target.score(odds), [(up - down) / 2 / h], rtol=1e-8)
    second = -(up - 2 * mid + down) / h**2
    np.testing.assert_allclose(target.information(odds), [second], rtol=1e-4)


def test_shares_are_counted_whichever_side_is_named_first():
    import pandas as pd

    votes = pd.DataFrame(
        {"a": [0, 1, 2, 0, 1], "b": [1, 0, 0, 2, 2], "a_preferred": [1, 1, 0, 1, 0]}
    )
    target = vote_target(votes, np.array([True, True, True, True, False]))
    assert target.a.tolist() == [0, 0, 1] and target.b.tolist() == [1, 2, 2]
    assert target.wins.tolist() == [1, 2, 0] and target.votes.tolist() == [2, 2, 0]


# ---- slopes


@functools.cache
def slopes():
    one = lambda d, lapse, wins, votes: deviance_residual(d, lapse, wins, votes)
    return jax.jit(jax.grad(one, (0, 1))), jax.jit(jax.jacfwd(one, (0, 1)))


CASES = [(3.0, 7.0), (0.0, 5.0), (5.0, 5.0), (150.0, 300.0), (1.0, 300.0)]


@pytest.mark.float64  # central differences
@pytest.mark.parametrize("wins, votes", CASES)
@pytest.mark.parametrize("lapse", [0.02, 0.3])
@pytest.mark.parametrize("difference", [-5.0, -0.4, 0.0, 2.1])
def test_slopes_are_the_differences(wins, votes, lapse, difference):
    point = arrays(difference, lapse, wins, votes)
    backward, forward = (f(*point) for f in slopes())
    np.testing.assert_allclose(forward, backward, rtol=1e-10, atol=1e-12)
    h = 1e-6
    for i in range(2):
        up, down = (
            residual(*(p + step * (k == i) for k, p in enumerate(point)))
            for step in (h, -h)
        )
        np.testing.assert_allclose(
            backward[i], (up - down) / (2 * h), rtol=1e-5, atol=1e-8
        )


@pytest.mark.parametrize("lapse", [0.0, 0.02])
@pytest.mark.parametrize("wins, votes", [(3.0, 10.0), (5.0, 10.0), (29.0, 30.0)])
def test_smooth_where_the_model_meets_the_votes(lapse, wins, votes):
    """There the deviance is 0, its root has a kink and a naive slope is not finite."""
    share = (wins / votes - lapse / 2) / (1 - lapse)
    meets = norm.ppf(share)
    point = arrays(meets, lapse, wins, votes)
    slope, _ = slopes()[0](*point)
    density = (1 - lapse) * norm.pdf(meets)
    spread = np.sqrt(wins / votes * (1 - wins / votes) / votes)
    np.testing.assert_allclose(slope, density / spread, rtol=RTOL * 10)
    near = jnp.asarray(meets + np.linspace(-0.3, 0.3, 241), float)
    cast = (jnp.full_like(near, count) for count in (wins, votes))
    values = np.asarray(residual(near, point[1], *cast), np.float64)
    # No step where the series hands over to the logarithms.
    steps = np.diff(values)
    assert (steps > 0).all()
    assert np.abs(np.diff(steps)).max() < 0.02 * steps.max()


@pytest.mark.parametrize("lapse", [0.0, 1e-4, 0.5])
@pytest.mark.parametrize("wins", [0.0, 2.0, 4.0])
@pytest.mark.parametrize("difference", [-50.0, 0.0, 50.0])
def test_finite_at_the_extremes(lapse, wins, difference):
    point = arrays(difference, lapse, wins, 4.0)
    assert np.isfinite(residual(*point))
    for part in slopes():
        assert np.isfinite(part(*point)).all()


def test_without_votes_nothing_pulls():
    point = arrays(1.3, 0.02, 0.0, 0.0)
    assert residual(*point) == 0
    assert np.asarray(slopes()[0](*point)).tolist() == [0.0, 0.0]
