import functools
import itertools
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr._rates import RATES
from alsarr.solve import dynamic_programme


GOLDEN = Path(__file__).parents[1] / "golden" / "knapsack_scifi.npz"


@functools.cache
def every_choice(tiles, rates):
    return np.array(list(itertools.product(range(rates), repeat=tiles)))


def brute_force(quality, cost, budget):
    """Of all choices that fit the best, then the cheapest, then by the last tile."""
    tiles, rates = quality.shape
    choices = every_choice(tiles, rates)
    cost = np.broadcast_to(cost, quality.shape)
    at = np.arange(tiles), choices
    spent, gained = cost[at].sum(axis=1), quality[at].sum(axis=1)
    fits = np.flatnonzero(spent <= budget)
    # The last key decides first.
    keys = (*choices[fits].T, spent[fits], -gained[fits])
    best = fits[np.lexsort(keys)[0]]
    return choices[best], gained[best], spent[best]


def plain_programme(quality, cost, budget):
    """The most that whole costs allow: the recursion of the textbooks, in doubles."""
    most = np.zeros(budget + 1)
    for tile_quality, tile_cost in zip(quality, cost, strict=True):
        now = np.full(budget + 1, -np.inf)
        for q, c in zip(tile_quality, tile_cost, strict=True):
            now[c:] = np.maximum(now[c:], most[: budget + 1 - c] + q)
        most = now
    return most[budget]


def drawn(seed, shape, *, ties, shared):
    """An instance; with ties qualities are few, equal and negative ones included."""
    rng = np.random.default_rng(seed)
    tiles, rates = shape
    if ties:
        quality = rng.integers(-3, 6, shape) / 4
    else:
        quality = rng.normal(size=shape)
    quality = quality.astype(jnp.result_type(float))
    if shared and rates == 7:
        cost = RATES.relative_cost
    else:
        # Neither sorted nor different: a coarser rate may cost more.
        cost = rng.integers(1, 10, rates if shared else shape)
    each = np.broadcast_to(cost, shape)
    low, high = each.min(axis=1).sum(), each.max(axis=1).sum()
    # The ends are no slack at all and everything.
    budget = [low, high, *rng.integers(low, high + 3, 8)][seed % 10]
    return quality, cost, int(budget)


@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize("shape", [(4, 7), (12, 2)])
def test_the_best_of_all_choices(shape, shared):
    for seed in range(50):
        quality, cost, budget = drawn(seed, shape, ties=False, shared=shared)
        found = dynamic_programme(quality, cost, budget)
        rate, total, spent = brute_force(quality, cost, budget)
        np.testing.assert_array_equal(found.rate, rate)
        # Only the final sum is rounded.
        np.testing.assert_allclose(found.quality, total, rtol=2e-6, atol=2e-6)
        assert int(found.cost) == spent <= budget
        assert found.gap == 0 and found.bound == found.quality and found.feasible


@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize("shape", [(4, 7), (12, 2)])
def test_of_equally_good_choices_the_cheapest_and_then_the_first(shape, shared):
    for seed in range(50):
        quality, cost, budget = drawn(seed, shape, ties=True, shared=shared)
        found = dynamic_programme(quality, cost, budget)
        rate, total, spent = brute_force(quality, cost, budget)
        assert (float(found.quality), int(found.cost)) == (total, spent)
        np.testing.assert_array_equal(found.rate, rate)


@pytest.fixture(scope="module")
def scifi():
    """The authors' frame: 8 040 tiles, budgets of 10, 25 and 50 % of full cost.

    Provenance: the authors' tables and frame (gfxdisp/ALSaRR at d06b3e0) evaluated in
    GNU Octave 7.3 on 2026-11-22; optimum by dynamic programming.
    """
    with np.load(GOLDEN) as stored:
        return dict(stored)


@pytest.mark.parametrize("which", [0, 1, 2])
def test_authors_frame_gets_the_known_optimum(scifi, which):
    quality, budget = scifi["quality_jnd"], scifi["budget"][which]
    found = dynamic_programme(quality, scifi["cost"], budget)
    rate = np.asarray(found.rate)
    exact = quality[np.arange(len(quality)), rate].sum()
    # The choice is as good in single precision, though its own sum is rounded.
    np.testing.assert_allclose(exact, scifi["optimum_jnd"][which], rtol=1e-9)
    rtol = 1e-9 if found.quality.dtype == jnp.float64 else 1e-6
    np.testing.assert_allclose(found.quality, exact, rtol=rtol)
    assert int(found.cost) == scifi["cost"][rate].sum() <= budget


@pytest.mark.parametrize("share", [0.1, 0.6])
def test_same_total_as_the_plain_recursion(share):
    # Several blocks, each of which can spend less than the whole budget.
    rng = np.random.default_rng(7)
    quality = rng.gamma(1, size=(230, 5)).astype(jnp.result_type(float))
    cost = rng.integers(20, 52, quality.shape)
    low, high = cost.min(axis=1).sum(), cost.max(axis=1).sum()
    budget = int(low + share * (high - low))
    found = dynamic_programme(quality, cost, budget)
    expected = plain_programme(quality.astype(float), cost, budget)
    np.testing.assert_allclose(found.quality, expected, rtol=5e-7)
    at = np.arange(len(quality)), np.asarray(found.rate)
    assert int(found.cost) == cost[at].sum() <= budget


def test_more_budget_is_never_worse():
    quality, _, _ = drawn(1, (4, 7), ties=True, shared=True)
    before = -np.inf
    for budget in range(4, 66):
        found = dynamic_programme(quality, RATES.relative_cost, budget)
        # Sums of quarters are exact.
        assert before <= float(found.quality)
        before = float(found.quality)
    assert before == quality.max(axis=1).sum()


def test_order_of_tiles_does_not_matter():
    quality, cost, _ = drawn(3, (12, 7), ties=False, shared=False)
    found = dynamic_programme(quality, cost, 50)
    order = np.random.default_rng(5).permutation(12)
    shuffled = dynamic_programme(quality[order], cost[order], 50)
    np.testing.assert_array_equal(np.asarray(found.rate)[order], shuffled.rate)


def test_unit_of_cost_does_not_matter():
    quality, _, _ = drawn(4, (12, 7), ties=True, shared=True)
    found = dynamic_programme(quality, RATES.relative_cost, 70)
    for unit, budget in ((16, 70 * 16 + 15), (0.25, 70 * 0.25 + 0.2), (1e-3, 0.070)):
        if unit == 1e-3:
            # Decimals are no whole multiples; rounded to microseconds they are.
            cost = np.round(RATES.relative_cost * unit * 1e6)
            budget = round(budget * 1e6)
        else:
            cost = RATES.relative_cost * unit
        same = dynamic_programme(quality, cost, budget)
        np.testing.assert_array_equal(found.rate, same.rate)


def test_equal_costs_give_every_tile_its_best():
    quality = np.array([[1.0, 3, 2], [0, -1, 0]])
    found = dynamic_programme(quality, np.full(3, 2.5), 5)
    np.testing.assert_array_equal(found.rate, [1, 0])
    assert found.quality == 3 and found.cost == 5


def test_one_tile_and_one_rate():
    found = dynamic_programme(np.array([[-2.5]]), np.array([3]), np.inf)
    np.testing.assert_array_equal(found.rate, [0])
    assert found.quality == -2.5 and found.cost == 3


def test_great_qualities_and_small_differences():
    # Plain sums of these would lose the differences in single precision.
    quality, cost, _ = drawn(5, (12, 7), ties=True, shared=True)
    found = dynamic_programme(quality, cost, 60)
    lifted = dynamic_programme(quality + np.asarray(2**17, quality.dtype), cost, 60)
    np.testing.assert_array_equal(found.rate, lifted.rate)


QUALITY = np.arange(14.0).reshape(2, 7)


def test_too_small_a_budget_can_be_read_from_the_result():
    cost = np.array([[3, 2, 9, 2, 9, 9, 9], [4, 5, 6, 7, 8, 9, 10]])
    for budget in (5, -np.inf):
        found = dynamic_programme(QUALITY, cost, budget, throw=False)
        assert not found.feasible and found.gap == 0 and found.cost == 6
        np.testing.assert_array_equal(found.rate, [3, 0])


@pytest.mark.parametrize(
    "quality, cost, budget, message",
    [
        (np.full((2, 7), np.nan), RATES.cost, 99, "`quality` must be finite, got nan"),
        (QUALITY[0], RATES.cost, 99, r"`quality` must have shape \[tiles, rates\]"),
        (QUALITY, RATES.cost[:6], 99, r"`cost` must have shape \(7,\) or \(2, 7\)"),
        (QUALITY, -RATES.cost, 99, "`cost` must be > 0 and finite, got -16"),
        (QUALITY, RATES.cost, np.nan, "`budget` must be a number, not NaN, got nan"),
        (QUALITY, RATES.cost, 31, "every tile can have its cheapest rate"),
        (
            QUALITY,
            RATES.cost / 30,
            9,
            "`cost` must be whole multiples of a common unit .*, got .* units of",
        ),
    ],
)
def test_what_is_wrong_is_named(quality, cost, budget, message):
    with pytest.raises(ValueError, match=message):
        dynamic_programme(quality, cost, budget)


@pytest.mark.parametrize("name", ["cost", "budget"])
def test_what_sets_the_size_must_be_known(name):
    given = {"cost": jnp.asarray(RATES.cost, float), "budget": jnp.asarray(99.0)}
    traced = {name: given.pop(name)}
    solve = lambda changing: dynamic_programme(QUALITY, **given, **changing)
    with pytest.raises(ValueError, match=f"`{name}` must be known before"):
        eqx.filter_jit(solve)(traced)


def test_compiled_and_mapped_over_qualities():
    instances = [drawn(seed, (12, 7), ties=False, shared=True) for seed in range(3)]
    quality, cost = np.stack([q for q, _, _ in instances]), instances[0][1]
    solve = lambda q: dynamic_programme(q, cost, 40)
    mapped = eqx.filter_jit(jax.vmap(solve))(jnp.asarray(quality))
    for i, each in enumerate(quality):
        alone = solve(each)
        np.testing.assert_array_equal(mapped.rate[i], alone.rate)
        np.testing.assert_allclose(mapped.quality[i], alone.quality, rtol=1e-6)
