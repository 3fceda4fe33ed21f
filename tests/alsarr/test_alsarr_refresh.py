"""Eq. 24 as a table: the refresh rate and resolution that a budget buys most with."""

import equinox as eqx
import imageio.v3
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from alsarr._refresh import _affordable, every_rate, refresh_table, RefreshTable
from alsarr.plotting import refresh_rates
from camojab import (
    datasets,
    Display,
    Formulation,
    luminance,
    Pooled,
    quality,
    Shading,
    Spectrum,
    Viewing,
)


RATES = (30.0, 45.0, 60.0, 90.0, 120.0)
VELOCITIES = (0.0, 4.0, 20.0, 60.0)
SIZE = (320, 180)
FULL = 320 * 180 * 120.0
SPEEDS = (0, 1, 2, 5, 10, 20, 30, 40, 60)


@pytest.fixture(scope="module")
def spectrum():
    # Steps of brightness with an edge between: something at every frequency.
    steps = np.random.default_rng(0).uniform(0.2, 0.9, (16, 16))
    return Spectrum.from_texture(steps.repeat(32, axis=0).repeat(32, axis=1))


def table(spectrum, **changes):
    given_values = {
        "ppd": 45.0,
        "luminance": 100.0,
        "pixels_per_second": FULL / 16,
        "resolution_px": SIZE,
        # The last is left out: not even 4x4 is within the budget.
        "refresh_rates": (*RATES, 150.0),
        "velocities": VELOCITIES,
        "persistence": 0.5,
    }
    return refresh_table(spectrum, **given_values | changes)


@pytest.fixture(scope="module")
def exact(spectrum):
    return table(spectrum)


def test_every_entry_is_the_best_of_all_candidates(spectrum, exact):
    resolution = np.sqrt(FULL / 16 / (np.array(RATES) * np.prod(SIZE)))
    one = eqx.filter_jit(
        lambda f, r, v: quality(
            spectrum,
            Display(ppd=45.0, refresh_rate=f, luminance=100.0, persistence=0.5),
            Viewing(v),
            Shading(rate_x=r, rate_y=r),
        )
    )
    number = lambda x: jnp.asarray(float(x))
    every = np.array(
        [
            [
                one(number(f), number(r), number(v))
                for f, r in zip(RATES, resolution, strict=True)
            ]
            for v in VELOCITIES
        ]
    )
    # Sums of 262 144 powers in single precision.
    np.testing.assert_allclose(exact.candidate_quality, every, rtol=2e-4, atol=2e-4)
    best = np.asarray(exact.candidate_quality).argmax(axis=1)
    np.testing.assert_array_equal(exact.refresh_rate, np.array(RATES)[best])
    np.testing.assert_allclose(exact.resolution, resolution[best], rtol=1e-6)
    np.testing.assert_array_equal(exact.quality, exact.candidate_quality.max(axis=1))
    np.testing.assert_array_equal(exact.candidates, RATES)
    np.testing.assert_allclose(exact.candidate_resolution, resolution, rtol=1e-6)
    np.testing.assert_array_equal(exact.velocity, VELOCITIES)
    # The choice is one: neither end is best everywhere.
    assert len(set(best)) > 1


def test_order_and_repetition_do_not_matter(spectrum, exact):
    rates = (150.0, *RATES[::-1], *RATES[:2])
    other = table(spectrum, refresh_rates=rates, velocities=(60, 0, 20, 4, 4))
    assert float(exact.highest) == 150
    assert eqx.tree_equal(other, exact)


@settings(deadline=None, max_examples=50)
@given(st.floats(1 / 64, 1.5), st.integers(1, 8000), st.integers(1, 8000))
def test_the_budget_is_spent_unless_every_pixel_is_shaded(share, width, height):
    budget = share * width * height * 120
    rates, resolution = _affordable(np.array(RATES), budget, (width, height))
    spent = resolution**2 * rates * width * height
    np.testing.assert_allclose(spent[resolution < 1], budget, rtol=1e-9)
    assert np.all(spent[resolution == 1] <= budget * (1 + 1e-9))
    assert np.all((resolution >= 0.25) & (resolution <= 1))
    # Left out is what costs too much even at 4x4.
    dear = np.setdiff1d(RATES, rates)
    assert np.all(dear * width * height / 16 > budget)


def test_a_budget_beyond_every_pixel_leaves_full_resolution(spectrum):
    found = table(spectrum, pixels_per_second=10 * FULL, refresh_rates=RATES)
    np.testing.assert_array_equal(found.candidate_resolution, np.ones(5))
    # Nothing is bought by frames that are not shown.
    assert found.refresh_rate[-1] == 120


def test_rates_that_4x4_cannot_meet_are_left_out():
    # At 120 Hz 4x4 everywhere costs this much, at 30 Hz a quarter of it.
    exactly = FULL / 16
    for budget, last in ((exactly, 120), (exactly * 0.999, 90), (exactly / 4, 30)):
        rates, resolution = _affordable(np.array(RATES), budget, SIZE)
        assert rates[-1] == last and rates[0] == 30
    np.testing.assert_array_equal(resolution, [0.25])


def test_the_lowest_of_equals_is_taken():
    black = Spectrum(jnp.zeros((512, 512), float))
    found = table(black)
    np.testing.assert_array_equal(found.candidate_quality, np.zeros((4, 5)))
    np.testing.assert_array_equal(found.refresh_rate, np.full(4, 30.0))


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"refresh_rates": ()}, "`refresh_rates` must be a list .*> 0 Hz, got none"),
        ({"refresh_rates": (60, 0)}, "`refresh_rates` must be > 0 Hz and .*, got 0"),
        ({"refresh_rates": (60, np.inf)}, "`refresh_rates` must be .*, got inf"),
        ({"velocities": ()}, "`velocities` must be a list .*>= 0 deg/s, got none"),
        ({"velocities": (1, -2)}, "`velocities` must be >= 0 deg/s .*, got -2"),
        ({"velocities": (np.nan,)}, "`velocities` must be .*, got nan"),
        ({"pixels_per_second": 0}, "`pixels_per_second` must be > 0 px/s .*, got 0"),
        ({"pixels_per_second": -5}, "`pixels_per_second` must be > 0 px/s .*, got -5"),
        ({"pixels_per_second": np.inf}, "`pixels_per_second` must be .*, got inf"),
        (
            {"pixels_per_second": 107999},
            "`pixels_per_second` must be at least 108000, those of 4x4 everywhere at "
            "30 Hz, got 107999",
        ),
        ({"resolution_px": (0, 9)}, "`resolution_px` must be a width .*, got 0 x 9"),
        ({"ppd": 0}, "`ppd` must be finite and > 0"),
        ({"luminance": -1}, "`luminance` must be finite and > 0"),
        ({"persistence": 2}, r"`persistence` must be in \(0, 1\]"),
    ],
)
def test_what_is_wrong_is_named(spectrum, changes, message):
    with pytest.raises(ValueError, match=message):
        table(spectrum, **changes)


def test_every_whole_rate():
    np.testing.assert_array_equal(every_rate(4), [1, 2, 3, 4])
    np.testing.assert_array_equal(every_rate(50, 48), [48, 49, 50])
    np.testing.assert_array_equal(every_rate(60, 60), [60])


@pytest.mark.parametrize("ends", [(0,), (5, 6), (5, 0)])
def test_ends_that_leave_no_rate(ends):
    with pytest.raises(ValueError, match="`lowest` must be from 1 to `highest` Hz"):
        every_rate(*ends)


def made(velocity):
    """A table of numbers that tell their entry."""
    n = len(velocity)
    entry = jnp.arange(n, dtype=float)
    return RefreshTable(
        velocity=jnp.asarray(velocity, float),
        refresh_rate=entry + 10,
        resolution=entry / n,
        quality=-entry,
        candidates=jnp.ones(1),
        candidate_resolution=jnp.ones(1),
        candidate_quality=jnp.zeros((n, 1)),
        highest=jnp.asarray(1.0),
        pixels_per_second=jnp.asarray(1.0),
    )


@settings(deadline=None, max_examples=50)
@given(
    st.lists(st.integers(0, 100), min_size=5, max_size=5, unique=True),
    st.floats(0, 200, width=32),
)
def test_lookup_takes_the_nearest_velocity(velocity, asked):
    velocity = sorted(velocity)
    found = made(velocity).lookup(asked)
    distance = np.abs(np.array(velocity) - asked)
    # Of two as near, the first, which is the slower.
    entry = int(np.argmin(distance))
    assert found.velocity == velocity[entry]
    assert found.refresh_rate == entry + 10
    assert found.quality == -entry
    np.testing.assert_allclose(found.resolution, entry / 5, rtol=1e-6)


def test_lookup_between_and_beyond_entries():
    small = made([0, 2, 10])
    asked = jnp.array([[0.0, 1.0, 1.001], [6.0, 6.001, 1e6]])
    expected = np.array([[10, 10, 11], [11, 12, 12]])
    np.testing.assert_array_equal(small.lookup(asked).refresh_rate, expected)
    assert made([5]).lookup(0.0).refresh_rate == 10
    assert small.lookup(3).refresh_rate == 11


def test_lookup_compiles_and_maps():
    small = made([0, 2, 10])
    asked = jnp.array([0.3, 1.7, 8.0, 40.0])
    expected = small.lookup(asked)
    assert eqx.tree_equal(
        eqx.filter_jit(lambda t, v: t.lookup(v))(small, asked), expected
    )
    assert eqx.tree_equal(jax.vmap(small.lookup)(asked), expected)


def test_lookup_refuses_what_is_no_speed():
    small = made([0, 2, 10])
    for bad in (-1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="`velocity` must be finite and >= 0 deg"):
            small.lookup(bad)
    with pytest.raises(RuntimeError, match="`velocity` must be finite and >= 0 deg"):
        eqx.filter_jit(small.lookup)(jnp.asarray(-1.0))


@pytest.fixture(scope="module")
def snapshot(module_data):
    """Tables of the released example: 6.25 % and 25 % of 1920 x 1080 at 120 Hz."""
    name = "jindal2021/ALSaRR/sample_data/scene_snapshot.png"
    module_data(name)
    picture = imageio.v3.imread(datasets.fetch(name))
    scene = Spectrum.from_texture(luminance(picture, encoding="sRGB"))
    return lambda share, **more: refresh_table(
        scene,
        ppd=45.0,
        luminance=100.0,
        pixels_per_second=share * 1920 * 1080 * 120,
        resolution_px=(1920, 1080),
        **{"refresh_rates": range(30, 121, 5), "velocities": SPEEDS} | more,
    )


def check_shape(small, large):
    """What Figure 8 and the released example show of two budgets."""
    for each in (small, large):
        assert np.all(np.diff(each.refresh_rate) >= 0)
        assert np.all(np.diff(each.resolution) <= 0)
        assert each.refresh_rate[0] == 30 and each.refresh_rate[-1] >= 85
        assert each.resolution[-1] <= 0.6 * each.resolution[0]
    assert np.all(large.refresh_rate >= small.refresh_rate)
    assert np.all(large.resolution >= small.resolution)
    assert np.all(large.quality > small.quality)
    # In the middle of the range the larger budget goes into the refresh rate too.
    middle = np.flatnonzero((large.velocity >= 2) & (large.velocity <= 20))
    assert np.all(large.refresh_rate[middle] >= small.refresh_rate[middle] + 10)


def test_the_released_example_has_its_shape(snapshot):
    small, large = snapshot(0.0625), snapshot(0.25)
    check_shape(small, large)
    # Exact values, so that a change of them is seen; of this program, 2026-11.
    np.testing.assert_array_equal(
        small.refresh_rate, [30, 30, 35, 50, 50, 70, 85, 85, 85]
    )
    np.testing.assert_array_equal(
        large.refresh_rate, [30, 45, 45, 60, 85, 100, 100, 120, 120]
    )
    quick = snapshot(0.25, fidelity=Pooled(5000))
    np.testing.assert_array_equal(quick.refresh_rate, large.refresh_rate)
    np.testing.assert_allclose(quick.quality, large.quality, atol=0.005)


def test_the_equations_as_printed_have_the_same_shape(snapshot):
    # A part of the table, because each condition takes longer.
    some = {"refresh_rates": range(30, 121, 15), "velocities": SPEEDS[::2]}
    some["formulation"] = Formulation.PAPER
    check_shape(snapshot(0.0625, **some), snapshot(0.25, **some))


def test_the_figure_holds_the_numbers_of_the_tables(exact):
    figure = refresh_rates({"one": exact, "other": made([0, 2, 10])})
    curves, other, rates, resolutions = figure.axes
    assert [curves.get_title(), other.get_title()] == ["budget one", "budget other"]
    lines = {line.get_label(): line for line in curves.get_lines()}
    for velocity, quality_jnd in zip(VELOCITIES, exact.candidate_quality, strict=True):
        found = lines[f"{velocity:g}"].get_xydata()
        np.testing.assert_array_equal(found, np.stack([RATES, quality_jnd], axis=1))
    marks = [
        line.get_xydata()[0]
        for line in curves.get_lines()
        if not line.get_label() or line.get_label().startswith("_")
    ]
    best = np.stack([exact.refresh_rate, exact.quality], axis=1)
    np.testing.assert_array_equal(marks, best)
    for axis, values in ((rates, exact.refresh_rate), (resolutions, exact.resolution)):
        line, second = axis.get_lines()
        np.testing.assert_array_equal(line.get_xdata(), VELOCITIES)
        np.testing.assert_array_equal(line.get_ydata(), values)
        assert (line.get_label(), second.get_label()) == ("one", "other")
        assert axis.get_xlabel() == "velocity [deg/s]"
        # An entry reaches halfway to its neighbours, as in a look-up.
        assert line.get_drawstyle() == "steps-mid"
    assert curves.get_xlabel() == "refresh rate [Hz]"
    assert curves.get_ylabel() == "quality [JND]"
    assert rates.get_ylabel() == "best refresh rate [Hz]"
