import itertools
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from alsarr import RATES
from alsarr.solve import common_threshold, greedy_jindal2021, hull, lagrangian, uniform


GOLDEN = Path(__file__).parents[1] / "golden" / "knapsack_scifi.npz"

SOLVERS = [lagrangian, hull, common_threshold, uniform]
BEST = [lagrangian, hull]


@pytest.fixture(scope="module")
def scifi():
    """The authors' frame; provenance in `test_alsarr_greedy.scifi`."""
    with np.load(GOLDEN) as stored:
        return dict(stored)


@pytest.mark.parametrize("solve", BEST)
def test_authors_frame_is_within_a_thousandth_of_a_percent(solve, scifi):
    each = jax.vmap(solve, in_axes=(None, None, 0))
    arrays = [jnp.asarray(scifi[k], float) for k in ("quality_jnd", "cost", "budget")]
    found = eqx.filter_jit(each)(*arrays)
    short = 1 - np.asarray(found.quality) / scifi["optimum_jnd"]
    # Single precision adds up 8 040 qualities to 1e-7.
    rounding = 3e-7 if found.quality.dtype == jnp.float32 else 1e-11
    assert np.all(short < 1e-5) and np.all(short > -rounding)
    assert np.all(np.asarray(found.cost) <= scifi["budget"])
    bound = np.asarray(found.bound) / scifi["optimum_jnd"] - 1
    assert np.all(bound > -rounding) and np.all(bound < 1e-5)


def random_instances(tiles, count, seed):
    """Qualities and costs on coarse grids, so that ties are common.

    A quarter each: any qualities, qualities that rise with finer rates, tiles all
    alike, and any costs, which need not fall with coarser rates.
    """
    rng = np.random.default_rng(seed)
    quality = rng.integers(-8, 13, size=(count, tiles, 7)) / 4
    cost = np.tile(RATES.relative_cost, (count, tiles, 1))
    _, rising, alike, costs = np.array_split(np.arange(count), 4)
    quality[rising] = np.sort(quality[rising], axis=2)
    quality[alike] = quality[alike, :1]
    cost[costs] = rng.integers(1, 10, size=(costs.size, tiles, 7))
    cost[..., 0] = cost.min(axis=2)
    low, high = cost.min(axis=2).sum(axis=1), cost.max(axis=2).sum(axis=1)
    budget = low + np.floor(rng.random(count) * (high - low + 2))
    return tuple(x.astype(jnp.result_type(float)) for x in (quality, cost, budget))


@pytest.mark.parametrize("tiles", [1, 3, 20])
def test_never_worse_than_the_paper_and_always_feasible(tiles):
    quality, cost, budget = random_instances(tiles, 4000, seed=tiles)
    greedy = eqx.filter_jit(jax.vmap(greedy_jindal2021))(quality, cost, budget)
    for solve in BEST:
        found = eqx.filter_jit(jax.vmap(solve))(quality, cost, budget)
        # Quarters and whole numbers add up without rounding.
        assert np.all(np.asarray(found.quality) >= np.asarray(greedy.quality))
        assert np.all(np.asarray(found.cost) <= budget) and np.all(found.feasible)
        at = np.asarray(found.rate)[..., None]
        for name, values in (("quality", quality), ("cost", cost)):
            total = np.take_along_axis(values, at, axis=2)[..., 0].sum(axis=1)
            np.testing.assert_array_equal(getattr(found, name), total)
        if tiles == 1:
            affordable = np.where(cost <= budget[:, None, None], quality, -np.inf)
            np.testing.assert_array_equal(found.quality, affordable.max(axis=(1, 2)))
        if tiles == 3:
            check_bounds(found, quality, cost, budget)
    if tiles == 3:
        check_bounds(greedy, quality, cost, budget)


def check_bounds(found, *instances):
    """A gap of 0 is a proof, and no choice is beyond the bound."""
    some = slice(None, None, 8)
    each = zip(*(x[some] for x in instances), strict=True)
    optimum = np.array([brute_force(*one) for one in each])
    quality, gap = np.asarray(found.quality)[some], np.asarray(found.gap)[some]
    assert np.all(quality <= optimum) and np.all(gap >= 0)
    # The price itself is rounded.
    assert np.all(quality + gap >= optimum - 1e-5)
    np.testing.assert_array_equal(quality[gap == 0], optimum[gap == 0])
    assert np.mean(gap == 0) > 0.1


def brute_force(quality, cost, budget):
    """The best of every choice of rates; shares nothing with the package."""
    every = np.array(list(itertools.product(range(7), repeat=len(quality))))
    tiles = np.arange(len(quality))
    fits = cost[tiles, every].sum(axis=1) <= budget
    return quality[tiles, every].sum(axis=1)[fits].max()


@pytest.mark.parametrize("shape", ["one row", "a row a tile"])
def test_feasible_however_the_price_is_rounded(shape):
    # A rule that is compiled twice may round twice: found with 8 160 tiles, 19 budgets.
    rng = np.random.default_rng(0)
    quality = jnp.asarray(rng.gamma(1, 1, size=(19, 2000, 7)).cumsum(axis=2), float)
    cost = jnp.asarray(RATES.cost, float)
    if shape == "a row a tile":
        cost = jnp.broadcast_to(cost, quality.shape[1:])
    budget = jnp.linspace(0.07, 1, 19) * 2000 * 256
    found = jax.jit(jax.vmap(lagrangian, in_axes=(0, None, 0)))(quality, cost, budget)
    spent = RATES.cost[np.asarray(found.rate)].sum(axis=1)
    np.testing.assert_array_equal(found.cost, spent)
    assert np.all(spent <= np.asarray(budget))


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**31), st.sampled_from([1e-30, 1e-3, 1.0, 1e6, 1e30]))
def test_any_scale_of_quality_and_any_spread(seed, scale):
    rng = np.random.default_rng(seed)
    dtype = jnp.result_type(float)
    quality = (rng.lognormal(0, 3, size=(20, 7)).cumsum(1) * scale).astype(dtype)
    budget = rng.uniform(20, 320)
    found = lagrangian(quality, RATES.relative_cost, budget)
    greedy = greedy_jindal2021(quality, RATES.relative_cost, budget)
    assert np.isfinite(found.quality) and np.isfinite(found.gap)
    # Sums are rounded, but not in the same order in both programs.
    slack = 20 * np.finfo(dtype).eps
    assert found.quality >= greedy.quality * (1 - slack) and found.cost <= budget
    sorted_out = hull(quality, RATES.relative_cost, budget)
    for one, other in ((found, sorted_out), (sorted_out, found)):
        assert one.quality <= other.bound * (1 + slack)
    np.testing.assert_allclose(found.bound, sorted_out.bound, rtol=1e-5)


@pytest.mark.parametrize("solve", SOLVERS)
def test_no_limit_and_no_budget_at_all(solve):
    quality = np.sort(np.random.default_rng(3).normal(size=(20, 7)), axis=1)
    everything = solve(quality, RATES.relative_cost, np.inf)
    np.testing.assert_allclose(everything.quality, quality[:, 6].sum(), rtol=1e-5)
    np.testing.assert_array_equal(everything.rate, 6)
    assert everything.gap == 0
    nothing = solve(quality, RATES.relative_cost, 19, throw=False)
    assert not nothing.feasible and nothing.gap == 0 and nothing.cost == 20
    np.testing.assert_array_equal(nothing.rate, 0)
    with pytest.raises(ValueError, match="every tile can have its cheapest rate"):
        solve(quality, RATES.relative_cost, 19)


@pytest.mark.parametrize("solve", SOLVERS)
def test_costs_need_not_fall_with_coarser_rates(solve):
    quality = np.array([[0.0, 1, 2], [0, 1, 2]])
    cost = np.array([[3.0, 1, 2], [2, 2, 2]])
    found = solve(quality, cost, 4)
    assert found.quality == 4 and found.cost == 4
    assert solve(quality, cost, 3).cost == 3


@pytest.mark.parametrize("solve", SOLVERS)
def test_one_compilation_for_all_budgets_and_the_same_as_one_by_one(solve):
    quality, cost, budget = random_instances(20, 8, seed=1)
    instances = zip(quality, cost, budget, strict=True)
    counted = eqx.filter_jit(eqx.debug.assert_max_traces(solve, max_traces=1))
    alone = [counted(*instance) for instance in instances]
    together = eqx.filter_jit(jax.vmap(solve))(quality, cost, budget)
    for i, one in enumerate(alone):
        np.testing.assert_array_equal(together.rate[i], one.rate)
        np.testing.assert_allclose(together.gap[i], one.gap, rtol=1e-5, atol=1e-6)
    with pytest.raises(RuntimeError, match="`quality` must be finite"):
        counted(quality[0] * np.nan, cost[0], budget[0])


@pytest.mark.parametrize("solve", SOLVERS)
@pytest.mark.parametrize(
    "quality, cost, budget, message",
    [
        (np.full((2, 7), np.nan), RATES.cost, 99, "`quality` must be finite, got nan"),
        (np.zeros(7), RATES.cost, 99, r"`quality` must have shape \[tiles, rates\]"),
        (np.zeros((2, 7)), RATES.cost[1:], 99, r"`cost` must have shape \(7,\)"),
        (np.zeros((2, 7)), 0 * RATES.cost, 99, "`cost` must be > 0 and finite, got 0"),
        (np.zeros((2, 7)), RATES.cost, np.nan, "`budget` must be a number, not NaN"),
    ],
)
def test_what_is_wrong_is_named(solve, quality, cost, budget, message):
    with pytest.raises(ValueError, match=message):
        solve(quality, cost, budget)


def test_tiles_that_are_all_alike_share_a_budget():
    quality = np.tile([0.0, 1, 1.1, 2, 2.5, 2.6, 3], (20, 1))
    # The hull goes from 4x4 to 4x2, 2x2 and further, each worth less a pixel.
    found = lagrangian(quality, RATES.cost, 20 * 64 + 24)
    np.testing.assert_array_equal(found.rate, 3)
    half = lagrangian(quality, RATES.cost, 10 * (64 + 32))
    assert half.cost == 10 * (64 + 32)


def test_uniform_is_the_best_single_rate_that_fits():
    quality = np.array([[0.0, 3, 1, 2, 0, 0, 9], [0, 3, 1, 5, 0, 0, 9]])
    for budget, rate in ((32, 0), (64, 1), (127, 1), (128, 3), (512, 6)):
        found = uniform(quality, RATES.cost, budget)
        np.testing.assert_array_equal(found.rate, [rate, rate])


def test_no_tile_loses_more_while_another_loses_less():
    rng = np.random.default_rng(5)
    quality = np.sort(rng.normal(size=(20, 7)), axis=1) + rng.normal(size=(20, 1))
    quality = np.asarray(jnp.asarray(quality, float))
    tiles, cost = np.arange(20), RATES.cost.astype(float)
    loss = quality.max(axis=1, keepdims=True) - quality
    for budget in (750.0, 1500.0, 3000.0):
        found = common_threshold(quality, cost, budget)
        expected = smallest_tolerance(loss, cost, budget)
        # Tiles that lose just what is tolerated are served until the budget ends.
        assert np.all(loss[tiles, found.rate] <= loss[tiles, expected])
        assert cost[expected].sum() <= found.cost <= budget


def smallest_tolerance(loss, cost, budget):
    """Each loss that occurs is tried; the cheapest rate within it, tile by tile."""
    fits = []
    for tolerated in np.unique(loss):
        rate = np.where(loss <= tolerated, cost, np.inf).argmin(axis=1)
        if cost[rate].sum() <= budget:
            fits.append(rate)
    return fits[0]
