from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from alsarr._rates import RATES
from alsarr.solve import greedy_jindal2021


GOLDEN = Path(__file__).parents[1] / "golden" / "knapsack_scifi.npz"


def algorithm_1(quality, cost, budget):
    """Algorithm 1 step by step, with the two rules of the authors' program.

    It shares nothing with the package: a list is sorted and visited entry by entry.
    """
    tiles, rates = quality.shape
    cost = np.broadcast_to(cost, quality.shape)
    current = [0] * tiles
    left = budget - cost[:, 0].sum()
    entries = [
        (quality[j, k] / cost[j, k], j, k)
        for j in range(tiles)
        for k in range(1, rates)
    ]
    entries.sort(key=lambda entry: -entry[0])
    for _, j, k in entries:
        if not left > 0:
            break
        if not quality[j, k] > quality[j, current[j]]:
            continue
        after = left - cost[j, k] + cost[j, current[j]]
        if after < 0:
            break
        left, current[j] = after, k
    return np.array(current)


@pytest.fixture(scope="module")
def scifi():
    """The authors' frame: 8 040 tiles, budgets of 10, 25 and 50 % of full cost.

    Provenance: the authors' tables and frame (gfxdisp/ALSaRR at d06b3e0) evaluated in
    GNU Octave 7.3 on 2026-11-22; optimum by dynamic programming.
    """
    with np.load(GOLDEN) as stored:
        return dict(stored)


def test_authors_frame_is_as_far_from_the_optimum_as_known(scifi):
    solve = jax.vmap(greedy_jindal2021, in_axes=(None, None, 0))
    arrays = [jnp.asarray(scifi[k]) for k in ("quality_jnd", "cost", "budget")]
    found = eqx.filter_jit(solve)(*arrays)
    shortfall = 1 - np.asarray(found.quality) / scifi["optimum_jnd"]
    # Single precision adds up 8 040 qualities to 1e-7.
    np.testing.assert_allclose(shortfall, [0.0360826, 0.0146189, 0.0038626], atol=3e-7)
    np.testing.assert_array_equal(found.cost, [12864, 32160, 64318])
    np.testing.assert_array_equal(found.feasible, True)


def test_authors_frame_gets_the_map_of_algorithm_1(scifi):
    quality = np.asarray(jnp.asarray(scifi["quality_jnd"]))
    for budget in scifi["budget"]:
        found = greedy_jindal2021(quality, scifi["cost"], budget)
        expected = algorithm_1(quality, scifi["cost"].astype(quality.dtype), budget)
        np.testing.assert_array_equal(found.rate, expected)


def test_unit_of_cost_does_not_matter(scifi):
    relative = greedy_jindal2021(scifi["quality_jnd"], RATES.relative_cost, 32160)
    pixels = greedy_jindal2021(scifi["quality_jnd"], RATES.cost, 32160 * 16)
    np.testing.assert_array_equal(relative.rate, pixels.rate)
    assert pixels.cost == 16 * relative.cost


@st.composite
def instances(draw):
    """Small instances with ties, equal and negative qualities, and any costs."""
    tiles = draw(st.sampled_from([1, 4, 9]))
    grid = st.integers(-6, 12).map(lambda i: i / 4)
    quality = draw(st.lists(grid, min_size=7 * tiles, max_size=7 * tiles))
    quality = np.array(quality, jnp.result_type(float)).reshape(tiles, 7)
    if draw(st.booleans()):
        cost = RATES.relative_cost.astype(quality.dtype)
    else:
        whole = st.lists(st.integers(1, 9), min_size=7 * tiles, max_size=7 * tiles)
        cost = np.array(draw(whole), quality.dtype).reshape(tiles, 7)
        cost[:, 0] = cost.min(axis=1)
    each = np.broadcast_to(cost, quality.shape)
    low, high = int(each[:, 0].sum()), int(each.max(axis=1).sum())
    return quality, cost, draw(st.integers(low, high + 2))


@settings(deadline=None, max_examples=400)
@given(instances())
def test_same_choice_as_algorithm_1(instance):
    quality, cost, budget = instance
    found = greedy_jindal2021(quality, cost, budget)
    expected = algorithm_1(quality, cost, budget)
    np.testing.assert_array_equal(found.rate, expected)
    tiles = np.arange(len(quality))
    np.testing.assert_allclose(found.quality, quality[tiles, expected].sum(), rtol=1e-6)
    each = np.broadcast_to(cost, quality.shape)
    assert found.cost == each[tiles, expected].sum() <= budget
    assert found.quality >= quality[:, 0].sum()


@settings(deadline=None, max_examples=50)
@given(instances())
def test_without_a_limit_every_tile_has_its_best(instance):
    quality, cost, _ = instance
    for budget in (1e6, np.inf):
        found = greedy_jindal2021(quality, cost, budget)
        np.testing.assert_allclose(found.quality, quality.max(axis=1).sum(), rtol=1e-6)


def test_equal_ratios_keep_the_order_of_tiles_then_of_rates():
    quality, cost = np.array([[0.0, 2, 2], [0, 2, 2]]), np.array([1, 2, 2])
    np.testing.assert_array_equal(greedy_jindal2021(quality, cost, 3).rate, [1, 0])
    np.testing.assert_array_equal(greedy_jindal2021(quality, cost, 4).rate, [1, 1])


def test_equal_quality_keeps_the_rate_that_came_first():
    found = greedy_jindal2021(np.array([[1.0, 1, 1]]), np.array([1, 2, 4]), 100)
    np.testing.assert_array_equal(found.rate, [0])


def test_signed_zeros_are_one_number():
    quality = np.array([[-1.0, -0.0, 0.0], [-1.0, 0.0, -0.0]])
    found = greedy_jindal2021(quality, np.array([1, 2, 2]), 3)
    np.testing.assert_array_equal(found.rate, [1, 0])


def test_first_that_does_not_fit_ends_the_search():
    quality = np.array([[0.0, 9, 10], [0, 1, 1.5], [0, 0.5, 0.7]])
    cost = np.array([[1, 2, 9], [1, 4, 9], [1, 2, 9]])
    # Left after the first tile's 9: 1. The 1 of tile 1 costs 3 more and ends it, though
    # the 0.5 of tile 2 would fit.
    np.testing.assert_array_equal(greedy_jindal2021(quality, cost, 5).rate, [1, 0, 0])


def test_search_ends_when_exactly_nothing_is_left():
    quality, cost = np.array([[-5, -1, -0.5]]), np.array([1, 8, 2])
    np.testing.assert_array_equal(greedy_jindal2021(quality, cost, 8).rate, [1])
    np.testing.assert_array_equal(greedy_jindal2021(quality, cost, 9).rate, [2])


def test_smallest_budget_gives_the_first_rate_everywhere():
    found = greedy_jindal2021(np.arange(21.0).reshape(3, 7), RATES.cost, 48)
    np.testing.assert_array_equal(found.rate, [0, 0, 0])
    assert found.feasible and found.cost == 48


def test_one_tile_and_one_rate():
    found = greedy_jindal2021(np.array([[2.5]]), np.array([3]), 4)
    np.testing.assert_array_equal(found.rate, [0])
    assert found.quality == 2.5 and found.cost == 3


QUALITY = np.arange(14.0).reshape(2, 7)


@pytest.mark.parametrize(
    "quality, cost, budget, message",
    [
        (np.full((2, 7), np.nan), RATES.cost, 99, "`quality` must be finite, got nan"),
        (np.full((2, 7), np.inf), RATES.cost, 99, "`quality` must be finite, got inf"),
        (QUALITY[0], RATES.cost, 99, r"`quality` must have shape \[tiles, rates\]"),
        (QUALITY[:0], RATES.cost, 99, r"none of them 0, got \(0, 7\)"),
        (QUALITY, RATES.cost[:6], 99, r"`cost` must have shape \(7,\) or \(2, 7\)"),
        (QUALITY, -RATES.cost, 99, "`cost` must be > 0, finite and lowest .*, got -16"),
        (QUALITY, RATES.cost * np.nan, 99, "`cost` must be > 0, finite"),
        (QUALITY, RATES.cost[::-1], 999, "lowest at the first rate, got 128"),
        (QUALITY, RATES.cost, np.nan, "`budget` must be a number, not NaN, got nan"),
        (
            QUALITY,
            RATES.cost,
            np.array([50, 60]),
            r"`budget` must be one number, got shape",
        ),
        (
            QUALITY,
            RATES.cost,
            31,
            r"`budget - sum\(min\(cost, axis=1\)\)` .*>= 0.*, got -1\.",
        ),
    ],
)
def test_what_is_wrong_is_named(quality, cost, budget, message):
    with pytest.raises(ValueError, match=message):
        greedy_jindal2021(quality, cost, budget)


def test_too_small_a_budget_can_be_read_from_the_result():
    found = greedy_jindal2021(QUALITY, RATES.cost, 31, throw=False)
    assert not found.feasible
    np.testing.assert_array_equal(found.rate, [0, 0])
    assert found.cost == 32


def test_compiled_once_and_checked_at_run_time():
    solve = eqx.filter_jit(eqx.debug.assert_max_traces(greedy_jindal2021, max_traces=1))
    quality, cost = jnp.asarray(QUALITY), jnp.asarray(RATES.cost)
    budgets = [32.0, 100.0, 512.0]
    for budget in budgets:
        found = solve(quality, cost, jnp.asarray(budget))
        alone = greedy_jindal2021(QUALITY, RATES.cost, budget)
        assert eqx.tree_equal(found, alone)
    with pytest.raises(RuntimeError, match="every tile can have its cheapest rate"):
        solve(quality, cost, jnp.asarray(31.0))
    with pytest.raises(RuntimeError, match="`quality` must be finite"):
        solve(quality * jnp.nan, cost, jnp.asarray(100.0))


def test_arguments_may_be_constants_of_a_compiled_function():
    solve = eqx.filter_jit(lambda b: greedy_jindal2021(QUALITY, RATES.cost, b).rate)
    found = solve(jnp.asarray(300.0))
    np.testing.assert_array_equal(found, algorithm_1(QUALITY, RATES.cost, 300))
