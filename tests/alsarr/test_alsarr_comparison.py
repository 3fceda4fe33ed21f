"""Methods on the same frames and budgets: judged alike, within the budget, in order."""

import dataclasses
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from alsarr import (
    _comparison,
    Frame,
    JointRefresh,
    procedural_frame,
    RATES,
    tile_luminance,
)
from alsarr._comparison import compare, Judged, methods, Setting
from alsarr._frame._procedural import procedural_picture
from alsarr._refresh import refresh_table_denes2020
from alsarr.oracle import AbstractQualityOracle, UniformOracle
from alsarr.plotting import methods_compared
from camojab import Display, quality, Shading, Spectrum, Viewing
from camojab.baselines import quality_denes2020


BUDGETS = (0.0625, 0.3, 1.0)
CHOICE = (30.0, 60.0, 120.0)
PPD, ROWS, COLUMNS = 50.0, 12, 16


class Known(AbstractQualityOracle, strict=True):
    """Qualities that were made up, larger losses at lower refresh rates."""

    value: Float[Array, "tiles 7"]

    unit: ClassVar[str] = "JND"

    def quality(self, frame, refresh_rate):
        rate = jnp.asarray(refresh_rate, self.value.dtype)
        return self.value * (60 / rate) ** 0.5

    def count_outside(self, frame, refresh_rate):
        return jnp.zeros((), int)


def draw(seed):
    """Qualities that rise with the rate, but for a few, by very different amounts."""
    of = np.random.default_rng(seed)
    size = of.lognormal(2, 1, (ROWS * COLUMNS, 1))
    return np.cumsum(of.normal(0.3, 0.4, (ROWS * COLUMNS, 7)), axis=1) * size


def frame(seed):
    of, shape = np.random.default_rng(seed), (ROWS, COLUMNS)
    pixels = of.random((ROWS * 16, COLUMNS * 16, 3)).round(1)
    return Frame(
        texture=np.zeros(shape, int),
        mip_level=0.0,
        velocity_x=of.uniform(0, 8, shape),
        velocity_y=of.uniform(0, 2, shape),
        luminance=of.uniform(10, 200, shape),
        previous_image=pixels,
    )


def without_image(given):
    return Frame(**{name: getattr(given, name) for name in Frame.UNITS})


VALUE = draw(0)
JUDGE = Known(jnp.asarray(VALUE, float))
# As much as single precision loses of sums over the tiles.
CLOSE = 2e-5


def by_method(rows):
    """The judged, in the order of the budgets, by method."""
    names = dict.fromkeys(row.method for row in rows)
    return {name: [row for row in rows if row.method == name] for name in names}


pytestmark = pytest.mark.usefixtures("quick_compilation")


@pytest.fixture(scope="module")
def fixed():
    return by_method(compare(Setting([frame(1)], JUDGE, PPD, 60.0), BUDGETS))


@pytest.fixture(scope="module")
def picture():
    steps = np.random.default_rng(3).uniform(0.2, 0.9, (32, 32))
    return Spectrum.from_texture(steps.repeat(16, axis=0).repeat(16, axis=1))


@pytest.fixture(scope="module")
def setting(picture):
    return Setting([frame(1)], JUDGE, PPD, 60.0, CHOICE, picture=picture)


@pytest.fixture(scope="module")
def chosen(setting):
    """Where three refresh rates may be chosen, of the methods that differ by it."""
    kept = ("ALSaRR", "ALSaRR, two stages", "uniform")
    of = lambda *given: [m for m in methods(*given) if m.name in kept]
    # The others take as long to compile as these.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_comparison, "methods", of)
        return by_method(compare(setting, BUDGETS))


def test_methods_and_budgets_are_all_there(fixed, chosen, setting):
    ours = ["ALSaRR", "ALSaRR, hull", "ALSaRR, greedy", "ALSaRR, exact"]
    seen = ["NAS", "NAS knapsack", "FidelityFX", "FidelityFX knapsack"]
    assert list(fixed) == [*ours, "uniform", *seen, "MARRR"]
    for rows in (*fixed.values(), *chosen.values()):
        assert tuple(row.budget for row in rows) == BUDGETS

    names = lambda setting, moving: [m.name for m in methods(setting, [0.3], moving)]
    two = ["ALSaRR, CaMoJAB", "ALSaRR, two stages"]
    more = dataclasses.replace(setting, oracles={"CaMoJAB": JUDGE})
    moving = JointRefresh(jnp.zeros(1), jnp.asarray(CHOICE), jnp.zeros((1, 3)))
    assert names(more, moving) == [*ours, *two, "uniform", *seen, "MARRR"]
    blind = dataclasses.replace(setting, frames=[without_image(frame(1))])
    assert names(blind, moving) == [*ours, two[1], "uniform", "MARRR"]
    # The dynamic programme would take minutes.
    buffers = dict.fromkeys(["mip_level", "velocity_x", "velocity_y", "luminance"], 1.0)
    wide = Frame(texture=np.zeros((100, 201), int), **buffers)
    found = names(Setting([wide], JUDGE, PPD, 60.0), None)
    assert found == [*ours[:3], "uniform", "MARRR"]


def test_the_best_single_rate_is_judged_as_by_hand(fixed):
    total, cost = VALUE.sum(axis=0), RATES.cost / RATES.cost.max()
    for row in fixed["uniform"]:
        affordable = np.where(cost <= row.budget, total, -np.inf)
        best = int(affordable.argmax())
        loss = (total[-1] - total[best]) / len(VALUE)
        np.testing.assert_allclose(row.loss, loss, CLOSE, CLOSE)
        assert row.quality == -row.loss
        assert row.refresh_rate == 60
        assert row.shares == tuple(np.eye(7)[best])
        np.testing.assert_allclose(row.cost, cost[best], rtol=1e-6)


def test_numbers_agree_with_each_other(fixed, chosen):
    relative = RATES.cost / RATES.cost.max()
    for rows, highest in ((fixed, 60), (chosen, 120)):
        for row in sum(rows.values(), []):
            np.testing.assert_allclose(sum(row.shares), 1, rtol=1e-9)
            spent = np.dot(row.shares, relative) * row.refresh_rate / highest
            np.testing.assert_allclose(row.cost, spent, rtol=1e-6)
            # More than the budget is never spent, whatever the method.
            assert row.cost <= row.budget * (1 + 1e-6)


def test_no_method_is_better_than_the_exact_one(fixed):
    for method, rows in fixed.items():
        for row, best in zip(rows, fixed["ALSaRR, exact"], strict=True):
            assert row.loss >= best.loss - 2e-6, method
            if method.startswith("ALSaRR") or method == "uniform":
                # The bound holds, and tells of what was missed.
                assert best.loss >= row.loss - row.gap - 2e-6
            else:
                assert np.isnan(row.gap)
    assert all(row.gap == 0 for row in fixed["ALSaRR, exact"])


@pytest.mark.parametrize("solver", ["ALSaRR", "ALSaRR, hull"])
def test_the_model_is_never_worse_than_what_does_not_know_it(fixed, solver):
    # True of this frame; of any frame within the gap, as above.
    for i, row in enumerate(fixed[solver]):
        for method in ("ALSaRR, greedy", "uniform", "NAS", "FidelityFX", "MARRR"):
            assert row.loss <= fixed[method][i].loss + 2e-6
    assert fixed[solver][1].loss < fixed["ALSaRR, greedy"][1].loss - 1e-3
    for other in ("uniform", "NAS", "NAS knapsack", "FidelityFX", "MARRR"):
        assert fixed[solver][1].loss < fixed[other][1].loss - 0.05


def test_methods_that_see_pixels_use_them(fixed):
    assert fixed["NAS"][1].shares != fixed["NAS knapsack"][1].shares
    assert fixed["NAS"][1].shares != fixed["FidelityFX"][1].shares
    assert max(fixed["NAS"][1].shares) < 1


def test_both_rates_at_once_are_never_worse_than_in_two_stages(chosen):
    joint, stages = chosen["ALSaRR"], chosen["ALSaRR, two stages"]
    for ours, theirs in zip(joint, stages, strict=True):
        assert ours.quality >= theirs.quality - 2e-6
    assert max(a.quality - b.quality for a, b in zip(joint, stages, strict=True)) > 0.01
    for row in sum(chosen.values(), []):
        assert row.refresh_rate in CHOICE
    assert len({row.refresh_rate for row in joint}) > 1


def test_the_moving_picture_is_added_at_each_ones_own_refresh_rate(chosen, picture):
    plain = frame(1)
    speed = np.hypot(np.asarray(plain.velocity_x), np.asarray(plain.velocity_y)).mean()
    moving = {
        rate: float(
            quality(
                picture,
                Display(
                    ppd=PPD,
                    refresh_rate=rate,
                    luminance=float(np.mean(plain.luminance)),
                ),
                Viewing(float(speed)),
            )
        )
        for rate in CHOICE
    }
    for row in sum(chosen.values(), []):
        # Sums of 262 144 powers in single precision.
        wanted = moving[row.refresh_rate]
        np.testing.assert_allclose(row.quality + row.loss, wanted, 2e-4, atol=2e-4)
    for row in chosen["uniform"]:
        assert row.refresh_rate == 60


def test_the_same_pixels_a_second_buy_methods_without_choice_more(fixed, chosen):
    # At 60 of 120 Hz a frame has twice the share, and more than all is left.
    best = fixed["uniform"][2]
    assert chosen["uniform"][2].cost == best.cost / 2 <= 0.5
    assert chosen["uniform"][2].shares == best.shares
    total, cost = VALUE.sum(axis=0), RATES.cost / RATES.cost.max()
    loss = (total[-1] - total[cost <= 0.125].max()) / len(VALUE)
    np.testing.assert_allclose(chosen["uniform"][0].loss, loss, CLOSE, CLOSE)


def test_marrr_follows_its_own_table(setting):
    moving = JointRefresh(jnp.zeros(1), jnp.asarray(CHOICE), jnp.zeros((1, 3)))
    marrr = methods(setting, BUDGETS, moving)[-1]
    for share in BUDGETS:
        wanted = refresh_table_denes2020(
            ppd=PPD,
            pixels_per_second=share * ROWS * COLUMNS * 256 * 120,
            resolution_px=(COLUMNS * 16, ROWS * 16),
            refresh_rates=CHOICE,
            velocities=setting.velocities,
        )
        found = marrr.controller(setting, share).refresh
        assert eqx.tree_equal(found, wanted, rtol=1e-6)


def test_frames_are_averaged(fixed):
    budgets = BUDGETS[1:]
    one, two = frame(1), frame(2)
    of = lambda *frames: by_method(compare(Setting(frames, JUDGE, PPD, 60.0), budgets))
    both, second = of(one, two), of(two)
    for method, rows in both.items():
        for i, row in enumerate(rows):
            a, b = fixed[method][i + 1], second[method][i]
            for name in ("loss", "cost", "gap", "shares"):
                mean = np.mean([getattr(a, name), getattr(b, name)], axis=0)
                np.testing.assert_allclose(getattr(row, name), mean, rtol=1e-6)
    assert both["NAS"][0].loss != fixed["NAS"][1].loss


def test_other_oracles_are_judged_by_the_judge(fixed):
    other = {"guess": Known(jnp.asarray(draw(7), float))}
    known = Setting([frame(1)], JUDGE, PPD, 60.0, oracles=other)
    rows = by_method(compare(known, [0.3]))
    found = rows["ALSaRR, guess"][0]
    assert np.isnan(found.gap) and found.cost <= 0.3
    assert found.loss > rows["ALSaRR"][0].loss + 0.05
    assert rows["ALSaRR"] == fixed["ALSaRR"][1:2]
    # A mean over tiles with the same rates is within what these rates can lose.
    assert 0 < found.loss < (VALUE.max(axis=1) - VALUE.min(axis=1)).mean()


def test_progress_goes_to_the_end():
    seen = []
    plain = Setting([frame(1)], JUDGE, PPD, 60.0)
    rows = compare(plain, [0.3], progress=lambda *step: seen.append(step))
    assert seen == [(i, len(rows)) for i in range(len(rows) + 1)]


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"frames": []}, "`frames` must have at least one frame, got none"),
        ({"judge": UniformOracle()}, "`judge` must tell JND, got octaves"),
        (
            {"refresh_rates": (30.0, 48.0)},
            "`refresh_rate` must be at most the highest of `refresh_rates`, 48 Hz, got",
        ),
        (
            {"refresh_rates": CHOICE},
            "`picture` must be given where there are ref",
        ),
        ({"refresh_rates": (90.0,)}, "`picture` must be given where there are refresh"),
        ({"refresh_rates": (0.0, 90.0)}, "`refresh_rates` must be > 0 Hz and finite"),
    ],
)
def test_what_is_wrong_with_a_setting_is_named(changes, message):
    given = {"frames": [frame(1)], "judge": JUDGE, "ppd": PPD, "refresh_rate": 60.0}
    with pytest.raises(ValueError, match=message):
        Setting(**given | changes)


@pytest.mark.parametrize("budgets", [(0.06,), (1.01,), (0.5, np.nan), ()])
def test_budgets_out_of_range(budgets):
    plain = Setting([frame(1)], JUDGE, PPD, 60.0)
    with pytest.raises(ValueError, match=r"`budgets` must be in \[0.0625, 1\], from"):
        compare(plain, budgets)


def test_the_table_of_marrr_has_the_best_of_its_candidates():
    rates, speeds, size = (30.0, 60.0, 120.0), (0.0, 5.0, 40.0), (320, 180)
    budget = 320 * 180 * 120 / 8
    found = refresh_table_denes2020(
        ppd=PPD,
        pixels_per_second=budget,
        resolution_px=size,
        refresh_rates=rates,
        velocities=speeds,
        persistence=0.5,
    )
    side = [min(1.0, (budget / (rate * 320 * 180)) ** 0.5) for rate in rates]
    one = lambda v, f, r: float(
        quality_denes2020(
            Display(ppd=PPD, refresh_rate=f, luminance=7.0, persistence=0.5),
            Viewing(v),
            Shading(rate_x=r, rate_y=r),
        )
    )
    pairs = list(zip(rates, side, strict=True))
    every = np.array([[one(v, *pair) for pair in pairs] for v in speeds])
    np.testing.assert_allclose(found.candidate_quality, every, rtol=1e-4, atol=1e-4)
    np.testing.assert_array_equal(found.refresh_rate, np.take(rates, every.argmax(1)))
    np.testing.assert_allclose(found.resolution, np.take(side, every.argmax(1)), 1e-6)
    assert len(set(every.argmax(axis=1))) > 1


def shown(texture, mip_level, luminance, peak=100.0):
    luminance = np.asarray(luminance, float)
    shape = luminance.shape
    drawn = Frame(
        texture=np.broadcast_to(texture, shape),
        mip_level=np.broadcast_to(np.asarray(mip_level, float), shape),
        velocity_x=0.0,
        velocity_y=0.0,
        luminance=luminance,
    )
    steps = np.indices((64, 64)).sum(axis=0) % 2 * 0.5 + 0.25
    ramp = np.broadcast_to(np.arange(64) / 64, (64, 64))
    return drawn, procedural_picture(drawn, [steps, ramp], peak_luminance=peak)


def test_a_picture_has_the_frames_luminance():
    # Level 1 of squares of one texel is flat, so no light is above the mean.
    drawn, image = shown(0, 1, [[10.0, 100.0], [0.0, 37.0], [0.1, 2.0]])
    assert image.shape == (48, 32, 3)
    np.testing.assert_allclose(
        tile_luminance(image, 100.0), drawn.luminance, rtol=1e-5, atol=1e-6
    )
    assert np.ptp(image, axis=2).max() == 0
    assert np.ptp(image[:16, :16]) == 0 and np.ptp(image[:16]) > 0.1


def decoded(image):
    """Light of sRGB values, IEC 61966-2-1."""
    return np.where(image <= 0.04045, image / 12.92, ((image + 0.055) / 1.055) ** 2.4)


def test_a_picture_shows_texels_where_the_tiles_lie():
    _, image = shown(0, 0, [[20.0, 40.0]])
    light = 100 * decoded(image[..., 0])
    wanted = np.where(np.indices((16, 32)).sum(axis=0) % 2, 1.5, 0.5)
    wanted[:, :16] *= 20
    wanted[:, 16:] *= 40
    np.testing.assert_allclose(light, wanted, rtol=1e-9)
    # Eight tiles of a level with four texels each way, which begin again with each.
    _, image = shown(1, [[4.0] * 8], np.full((1, 8), 10.0))
    light = 100 * decoded(image[..., 0])
    means = (np.arange(64) / 64).reshape(4, 16).mean(axis=1)
    wanted = np.tile(10 * means / means.mean(), 32)
    np.testing.assert_allclose(light, np.broadcast_to(wanted, (16, 128)), rtol=1e-9)


def test_a_picture_has_an_end_of_its_range_and_of_its_levels():
    _, image = shown(0, 0, [[90.0]])
    np.testing.assert_allclose(image.max(), 1, rtol=1e-15)
    assert image.max() <= 1 and 0 < image.min() < 0.8
    _, image = shown(1, 30, [[50.0]])
    np.testing.assert_allclose(decoded(image), 0.5, rtol=1e-9)


def test_the_drawn_frame_has_a_picture_that_is_always_the_same():
    textures = [np.random.default_rng(i).random((64, 64)) for i in range(3)]
    drawn = procedural_frame(3, rows=5, columns=7, seed=4)
    image = procedural_picture(drawn, textures, peak_luminance=600)
    again = procedural_picture(drawn, textures, peak_luminance=600)
    np.testing.assert_array_equal(image, again)
    assert image.shape == (80, 112, 3) and 0 <= image.min() < image.max() <= 1


def test_a_picture_needs_a_peak_and_every_texture():
    drawn, _ = shown(1, 0, [[1.0]])
    with pytest.raises(ValueError, match="`peak_luminance` must be > 0 cd/m.2, got 0"):
        procedural_picture(drawn, [np.ones((4, 4))] * 2, peak_luminance=0)
    with pytest.raises(ValueError, match="`textures` must be one for every index to 1"):
        procedural_picture(drawn, [np.ones((4, 4))], peak_luminance=1)


def invented(several):
    shares = [0.5, 0.2, 0.1, 0.1, 0.1, 0.0, 0.0]
    own = lambda i: (1.0, 0.1, 0.0, tuple(np.roll(shares, i).tolist()))
    return [
        Judged(f"m{i}", budget, 60.0 + several * i, -i - budget, *own(i))
        for i in range(9)
        for budget in (0.5, 0.125, 0.25, 1.0)
    ]


def test_the_figure_holds_every_number():
    rows = invented(True)
    curves, rates, bars = methods_compared(rows).axes
    for axis, name in ((curves, "quality"), (rates, "refresh_rate")):
        lines = {line.get_label(): line.get_xydata() for line in axis.get_lines()}
        for method in {row.method for row in rows}:
            own = sorted(
                (r for r in rows if r.method == method), key=lambda r: r.budget
            )
            wanted = [[100 * row.budget, getattr(row, name)] for row in own]
            np.testing.assert_array_equal(lines[method], wanted)
        assert (
            axis.get_xlabel() == "budget [% of full rate at the highest refresh rate]"
        )
    assert curves.get_ylabel() == "quality [JND]"
    assert rates.get_ylabel() == "refresh rate [Hz]"
    styles = {
        (line.get_color(), line.get_linestyle(), line.get_marker())
        for line in curves.get_lines()
    }
    assert len(styles) == 9
    middle = [row for row in rows if row.budget == 0.25]
    widths = np.array([[bar.get_width() for bar in one] for one in bars.containers]).T
    np.testing.assert_allclose(widths, [np.multiply(100, r.shares) for r in middle])
    assert [label.get_text() for label in bars.get_yticklabels()] == [
        row.method for row in middle
    ]
    assert bars.get_xlabel() == "share of the tiles [%] at a budget of 25 %"
    assert bars.texts[1].get_text() == "-1.25 JND, 61 Hz"


def test_the_figure_leaves_out_refresh_rates_that_do_not_differ():
    assert len(methods_compared(invented(False)).axes) == 2
