"""Simulated observers vote as the scaling assumes, and votes are counted."""

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings, strategies as st
from scipy.stats import binomtest

from camojab._columns import TableError
from camojab.votes import count, preference, simulate


QUALITY = st.floats(-20, 20, width=32)


@settings(deadline=None)
@given(QUALITY, QUALITY)
def test_preferences_of_a_pair_add_up_to_one(a, b):
    a, b = jnp.asarray(a, float), jnp.asarray(b, float)
    forth, back = preference(a, b), preference(b, a)
    np.testing.assert_allclose(forth + back, 1.0, rtol=1e-6)
    assert 0 <= forth <= 1
    assert (forth > back) == (a > b) or abs(a - b) < 1e-6


@settings(deadline=None)
@given(QUALITY, st.floats(-3, 3, width=32))
def test_preference_depends_on_the_difference_alone(level, difference):
    shifted = preference(
        jnp.asarray(level + difference, float), jnp.asarray(level, float)
    )
    plain = preference(jnp.asarray(difference, float), jnp.zeros(()))
    # The difference of two numbers of up to 23 in single precision.
    np.testing.assert_allclose(shifted, plain, atol=1e-5)


@pytest.mark.parametrize("difference", [-3.0, -1.0, 0.0, 0.5, 1.0, 2.0])
def test_frequencies_are_the_preferences(difference):
    votes = 20_000
    a, b = np.full(votes, 5.0 + difference), np.full(votes, 5.0)
    preferred = simulate(a, b, np.random.default_rng(7))
    assert preferred.dtype == bool and preferred.shape == (votes,)
    expected = float(preference(jnp.asarray(difference), jnp.asarray(0.0)))
    # The seed is fixed, so this does not fail by chance; at 2 JND an observer whose
    # spread is wrong by 5 % is five standard deviations off.
    p_value = binomtest(int(preferred.sum()), votes, expected).pvalue
    assert p_value > 1e-3


def test_votes_are_independent_of_each_other():
    preferred = simulate(np.zeros(20_000), np.zeros(20_000), np.random.default_rng(3))
    together = np.mean(preferred[:-1] & preferred[1:])
    # Four standard deviations of a share of 1/4 among 20 000 neighbouring pairs.
    assert abs(together - 0.25) < 4 * np.sqrt(0.25 * 0.75 / 20_000)


def test_a_seed_repeats_the_votes():
    a, b = np.linspace(-1, 1, 50), np.zeros(50)
    first, again, other = (
        simulate(a, b, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def votes(*rows):
    return pd.DataFrame(rows, columns=["condition_a", "condition_b", "a_preferred"])


def test_counting():
    cast = votes(
        ("x", "y", True),
        ("x", "y", True),
        ("y", "x", True),
        ("y", "z", False),
        ("z", "x", False),
    )
    expected = [[0, 2, 1], [1, 0, 0], [0, 1, 0]]
    np.testing.assert_array_equal(count(cast, ["x", "y", "z"]), expected)
    order = [2, 0, 1]
    np.testing.assert_array_equal(
        count(cast, ["z", "x", "y"]), np.array(expected)[np.ix_(order, order)]
    )
    # A condition without votes has a row and a column of zeros.
    assert count(cast, ["x", "y", "z", "unseen"]).sum() == 5


def test_no_votes_are_counted_too():
    np.testing.assert_array_equal(count(votes(), ["x", "y"]), np.zeros((2, 2)))


@pytest.mark.parametrize("row", [("x", "q", True), ("q", "y", False)])
def test_unknown_names_are_refused(row):
    with pytest.raises(ValueError, match="known conditions only, got 'q'"):
        count(votes(("x", "y", True), row), ["x", "y"])


@pytest.mark.parametrize(
    "row, message",
    [
        (("x", "y", np.nan), "`votes`, row 1: `a_preferred` must be .*, got None"),
        (("x", "y", "no"), "`votes`, row 1: `a_preferred` must be .*, got 'no'"),
        (("x", None, True), "`votes`, row 1: `condition_b` must not be empty"),
        (("y", "y", True), "`votes`, row 1: a condition must be compared with another"),
    ],
)
def test_rows_that_are_no_votes_are_refused(row, message):
    with pytest.raises(TableError, match=message):
        count(votes(("x", "y", True), row), ["x", "y"])


def test_text_is_read_as_it_is_in_a_file():
    cast = votes(("x", "y", "False"), ("x", "y", "true"), ("x", "y", "0"))
    np.testing.assert_array_equal(count(cast, ["x", "y"]), [[0, 1], [2, 0]])


def test_a_column_that_is_missing_is_named():
    with pytest.raises(TableError, match="column `condition_b`, got condition_a, a_pr"):
        count(votes(("x", "y", True)).drop(columns="condition_b"), ["x", "y"])


def test_names_that_are_there_twice_are_refused():
    with pytest.raises(ValueError, match="`conditions` must .* once, got 'x' again"):
        count(votes(("x", "y", True)), ["x", "y", "x"])


@settings(deadline=None, max_examples=30)
@given(
    st.lists(
        st.tuples(st.sampled_from(["ab", "ba", "bc", "cb", "ca", "ac"]), st.booleans()),
        max_size=40,
    )
)
def test_every_vote_is_counted_once(rows):
    rows = [(*pair, preferred) for pair, preferred in rows]
    wins = count(votes(*rows), ["a", "b", "c"])
    assert wins.sum() == len(rows)
    for i, name in enumerate("abc"):
        won = sum((a if preferred else b) == name for a, b, preferred in rows)
        assert wins[i].sum() == won
