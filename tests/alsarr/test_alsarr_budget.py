"""What a frame may take and what its rates cost, against numbers by hand."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr import Budget, Frame, MeasuredCost, PixelCost, RATES, TileCost


PIXELS = [16, 32, 32, 64, 128, 128, 256]
# Three textures: the first needs less time at 4x4 than at 2x4, and least at 2x2.
TIMES = np.array(
    [
        [0.5, 0.625, 0.5, 0.25, 0.75, 0.75, 1.0],
        [0.125, 0.25, 0.25, 0.5, 1.0, 1.0, 2.0],
        [3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0],
    ]
)


def frame(texture):
    return Frame(
        texture=np.asarray(texture),
        mip_level=0.0,
        velocity_x=0.0,
        velocity_y=0.0,
        luminance=50.0,
    )


HD = frame(np.zeros((68, 120), int))
SMALL = frame([[0, 1, 2], [2, 1, 1]])


def allowed(budget, cost, refresh_rate, highest=120.0):
    number = lambda x: jnp.asarray(x, float)
    return budget.of_frame(cost, number(refresh_rate), number(highest))


@pytest.mark.parametrize(
    "refresh_rate, expected",
    [(120.0, 391_680.0), (60.0, 783_360.0), (30.0, 1_566_720.0), (96.0, 489_600.0)],
)
def test_a_share_is_of_full_rate_at_the_highest_refresh_rate(refresh_rate, expected):
    """3/16 of 8160 whole tiles of 256 pixels, 120 times a second."""
    cost = PixelCost().of(HD)
    got = allowed(Budget.share(0.1875), cost, refresh_rate)
    np.testing.assert_allclose(got, expected, rtol=1e-6)
    per_second = float(got) * refresh_rate
    np.testing.assert_allclose(per_second, 0.1875 * 8160 * 256 * 120, rtol=1e-6)


def test_a_share_of_time_is_of_the_time_at_full_rate():
    cost = MeasuredCost(TIMES).of(SMALL)
    # One tile of the first texture, three of the second and two of the third.
    full = 1.0 + 3 * 2.0 + 2 * 3.0
    assert allowed(Budget.share(0.5), cost, 120.0) == full / 2
    assert allowed(Budget.share(0.5), cost, 40.0) == full / 2 * 3


@pytest.mark.parametrize(
    "budget, expected",
    [
        (Budget.pixels_per_frame(1000), {30.0: 1000.0, 64.0: 1000.0, 120.0: 1000.0}),
        # Eq. 25: B/f.
        (Budget.pixels_per_second(7680), {30.0: 256.0, 64.0: 120.0, 120.0: 64.0}),
    ],
    ids=["px", "px/s"],
)
def test_pixels_per_frame_and_per_second(budget, expected):
    cost = PixelCost().of(SMALL)
    for refresh_rate, pixels in expected.items():
        assert allowed(budget, cost, refresh_rate) == pixels


def test_milliseconds_are_those_of_every_frame():
    cost = MeasuredCost(TIMES).of(SMALL)
    for refresh_rate in (30.0, 120.0):
        assert allowed(Budget.milliseconds(2.5), cost, refresh_rate) == 2.5


def test_a_budget_has_the_dtype_of_the_costs():
    single = jnp.asarray(PIXELS, jnp.float32)[None]
    for budget in (Budget.share(0.5), Budget.pixels_per_second(120.0)):
        got = budget.of_frame(single, jnp.float32(60), jnp.float32(120))
        assert got.dtype == jnp.float32


@pytest.mark.parametrize(
    "make, wrong, rule",
    [
        (Budget.share, [0, -0.1, 1.01, np.nan], r"`share` must be in \(0, 1\], got"),
        (
            Budget.pixels_per_frame,
            [0, -1, np.inf, np.nan],
            "`pixels` must be > 0 px and finite, got",
        ),
        (
            Budget.pixels_per_second,
            [0, -1, np.inf, np.nan],
            "`pixels` must be > 0 px/s and finite, got",
        ),
        (
            Budget.milliseconds,
            [0, -1, np.inf, np.nan],
            "`milliseconds` must be > 0 ms and finite, got",
        ),
    ],
    ids=["share", "px", "px/s", "ms"],
)
def test_budgets_out_of_range(make, wrong, rule):
    for amount in wrong:
        with pytest.raises(ValueError, match=rule):
            make(amount)
    traced = eqx.filter_jit(lambda x: make(x).amount)
    assert traced(jnp.asarray(1.0)) == 1
    with pytest.raises(RuntimeError, match=rule.split(", got")[0]):
        traced(jnp.asarray(-1.0))


def test_a_budget_is_of_the_unit_of_the_costs():
    pixels = (PixelCost(), TileCost(np.ones((6, 7))))
    time = MeasuredCost(TIMES)
    for cost in (*pixels, time):
        Budget.share(0.5).check_unit(cost)
    for cost in pixels:
        Budget.pixels_per_frame(1).check_unit(cost)
        Budget.pixels_per_second(1).check_unit(cost)
        with pytest.raises(ValueError, match="in the unit of the costs, px, got ms"):
            Budget.milliseconds(1).check_unit(cost)
    Budget.milliseconds(1).check_unit(time)
    for budget in (Budget.pixels_per_frame(1), Budget.pixels_per_second(1)):
        with pytest.raises(
            ValueError, match="a share or in the unit of the costs, ms, got px"
        ):
            budget.check_unit(time)


def test_whole_tiles_cost_256_over_mn():
    got = PixelCost().of(SMALL)
    np.testing.assert_array_equal(got, np.tile(PIXELS, (6, 1)))


def test_tiles_that_the_edge_cuts_cost_what_is_left_of_them():
    """Of 1080 rows the last tiles have 8; 1920 columns are whole tiles."""
    got = np.asarray(PixelCost((1920, 1080)).of(HD)).reshape(68, 120, 7)
    np.testing.assert_array_equal(got[:67], np.broadcast_to(PIXELS, (67, 120, 7)))
    np.testing.assert_array_equal(
        got[67], np.broadcast_to(np.array(PIXELS) / 2, (120, 7))
    )
    assert got[..., -1].sum() == 1920 * 1080


def test_both_edges_may_cut():
    """35 x 20 pixels: columns of 16, 16 and 3, rows of 16 and 4."""
    got = np.asarray(PixelCost((35, 20)).of(SMALL))
    areas = np.array([256, 256, 48, 64, 64, 12])
    np.testing.assert_array_equal(got, areas[:, None] / 256 * np.array(PIXELS))
    assert got[:, -1].sum() == 35 * 20


@pytest.mark.parametrize("size", [(49, 20), (35, 16), (20, 35), (1920, 1080)])
def test_a_picture_of_another_size_is_refused(size):
    with pytest.raises(ValueError, match="a picture with 2 rows and 3 columns of"):
        PixelCost(size).of(SMALL)


@pytest.mark.parametrize("size", [(0, 16), (16, 0), (-5, 16)])
def test_a_picture_without_pixels_is_refused(size):
    with pytest.raises(ValueError, match="`size_px` must be a width and a height >= 1"):
        PixelCost(size)


def test_measured_times_are_those_of_each_texture():
    got = MeasuredCost(TIMES).of(SMALL)
    np.testing.assert_array_equal(got, TIMES[[0, 1, 2, 2, 1, 1]])
    # They need not fall with coarser rates, and are kept as they are.
    assert got[0, 0] > got[0, 3]


def test_a_texture_without_times_is_refused():
    cost = MeasuredCost(TIMES[:2])
    rule = "`frame.texture` must be a texture with measured times, of which there are 2"
    with pytest.raises(ValueError, match=rule + ", got 2"):
        cost.of(SMALL)
    with pytest.raises(RuntimeError, match=rule):
        eqx.filter_jit(lambda c, f: c.of(f))(cost, SMALL)


@pytest.mark.parametrize("wrong", [0, -1, np.nan, np.inf])
def test_costs_out_of_range(wrong):
    bad = TIMES.copy()
    bad[1, 2] = wrong
    with pytest.raises(ValueError, match="`milliseconds` must be > 0 ms and finite"):
        MeasuredCost(bad)
    with pytest.raises(ValueError, match="`cost` must be > 0 px and finite"):
        TileCost(bad)


@pytest.mark.parametrize("shape", [(7,), (2, 6), (1, 2, 7)])
def test_costs_of_another_shape(shape):
    with pytest.raises(ValueError, match=r"`milliseconds` must have shape \[textures"):
        MeasuredCost(np.ones(shape))
    with pytest.raises(ValueError, match=r"`cost` must have shape \[tiles, 7\]"):
        TileCost(np.ones(shape))


def test_costs_of_ones_own():
    own = np.arange(1.0, 43.0).reshape(6, 7)
    np.testing.assert_array_equal(TileCost(own).of(SMALL), own)
    with pytest.raises(ValueError, match="a row for each of 6 tiles, got 5"):
        TileCost(own[:5]).of(SMALL)


def test_costs_map_over_frames():
    frames = jax.tree.map(lambda *x: jnp.stack(x), SMALL, frame(np.ones((2, 3), int)))
    got = jax.vmap(MeasuredCost(TIMES).of)(frames)
    np.testing.assert_array_equal(got[0], MeasuredCost(TIMES).of(SMALL))
    np.testing.assert_array_equal(got[1], np.tile(TIMES[1], (6, 1)))
    whole = jax.vmap(PixelCost().of)(frames)
    np.testing.assert_array_equal(whole, np.broadcast_to(PIXELS, (2, 6, len(RATES))))


def test_tiles_cost_alike_only_where_nothing_tells_them_apart():
    assert PixelCost().shared and not PixelCost((35, 20)).shared
    assert not MeasuredCost(TIMES).shared
    assert not TileCost(np.ones((6, 7))).shared
