"""Figures of oracles, solvers and training hold what they are given, with units."""

import io

import numpy as np
import pytest

from alsarr import RATES, TILE
from alsarr.network import Attribution
from alsarr.plotting import (
    input_shares,
    judged_twice,
    oracle_sheet,
    solver_gaps,
    training_history,
)


RNG = np.random.default_rng(3)


def drawn(figure):
    """It can be saved, its texts stay inside, and axes with ticks have both labels."""
    figure.savefig(io.BytesIO(), format="png", dpi=40)
    box = figure.get_tightbbox()
    width, height = figure.get_size_inches()
    assert box.x0 > -0.05 and box.y0 > -0.05
    assert box.x1 < width + 0.05 and box.y1 < height + 0.05
    return figure


def labels(figure):
    return [(axis.get_xlabel(), axis.get_ylabel()) for axis in figure.axes]


def legend_texts(axis):
    return [text.get_text() for text in axis.get_legend().get_texts()]


def sheet(count, *, size=(40, 30), **options):
    width, height = size
    tiles = -(-height // TILE), -(-width // TILE)
    names = [f"o{i}" for i in range(count)]
    maps = {name: RNG.integers(0, len(RATES), tiles) for name in names}
    picture = lambda: RNG.integers(0, 256, (height, width, 3)).astype(np.uint8)
    pictures = {name: picture() for name in names}
    errors = {name: RNG.uniform(0, 0.5, (height, width)) for name in names}
    figure = oracle_sheet(maps, pictures, errors, label="FLIP [1]", **options)
    return drawn(figure), maps, pictures, errors


@pytest.mark.parametrize("count, columns", [(1, 5), (3, 2), (5, 5)])
def test_a_sheet_has_three_panels_of_each_oracle(count, columns):
    figure, maps, pictures, errors = sheet(count, columns=columns)
    panels = [axis for axis in figure.axes if axis.images]
    assert len(panels) == 3 * count
    titled = {axis.get_title().split("\n")[0]: axis for axis in panels}
    for i, name in enumerate(maps):
        cost = RATES.cost[maps[name]].mean() / RATES.cost.max()
        expected = f"{name}\nFLIP [1] {errors[name].mean():.4f}, cost {cost:.1%}"
        assert titled[name].get_title() == expected
        # Pixels of the map are the tiles' colours, cut at the picture's edge.
        shown = np.asarray(titled[name].images[0].get_array())
        tile_of = np.arange(30)[:, None] // TILE, np.arange(40)[None] // TILE
        np.testing.assert_array_equal(shown, RATES.colour[maps[name]][tile_of])
        drawn_pictures = [np.asarray(axis.images[0].get_array()) for axis in panels]
        for values in (pictures[name], errors[name]):
            assert any(np.array_equal(values, x) for x in drawn_pictures), i
    assert ("", "FLIP [1]") in labels(figure)


def test_an_error_without_a_unit_is_a_pure_number():
    pixels = np.zeros((16, 16))
    picture = np.zeros((16, 16, 3), np.uint8)
    one = {"a": np.full((1, 1), RATES.names.index("1x1"))}
    figure = drawn(oracle_sheet(one, {"a": picture}, {"a": pixels}, label="FLIP"))
    assert ("", "FLIP [1]") in labels(figure)
    titles = [axis.get_title() for axis in figure.axes if axis.get_title()]
    assert titles == ["a\nFLIP 0.0000, cost 100.0%"]


def test_errors_of_a_sheet_have_one_scale():
    figure, _, _, errors = sheet(3)
    scales = {
        axis.images[0].get_clim()
        for axis in figure.axes
        if axis.images and np.asarray(axis.images[0].get_array()).ndim == 2
    }
    assert scales == {(0.0, max(e.max() for e in errors.values()))}


def test_a_detail_is_cut_out_and_marked():
    left, top, wide, high = detail = (5, 8, 20, 12)
    figure, _, pictures, _ = sheet(2, detail=detail)
    cut = [p[top : top + high, left : left + wide] for p in pictures.values()]
    shown = [
        np.asarray(axis.images[0].get_array()) for axis in figure.axes if axis.images
    ]
    for each in cut:
        assert any(np.array_equal(each, x) for x in shown)
    marks = [patch for axis in figure.axes if axis.images for patch in axis.patches]
    assert [(m.get_xy(), m.get_width(), m.get_height()) for m in marks] == [
        ((left, top), wide, high)
    ] * 2


def test_a_sheet_without_any_error():
    still = {"a": np.zeros((16, 16))}
    picture = {"a": np.zeros((16, 16, 3), np.uint8)}
    finest = {"a": np.full((1, 1), RATES.names.index("1x1"))}
    drawn(oracle_sheet(finest, picture, still, label="FLIP"))


def test_points_that_agree_share_a_marker():
    judged = {"a": (0.5, 0.1), "b": (0.50001, 0.1), "c": (0.7, 0.2)}
    figure = drawn(judged_twice(judged, labels=("loss [JND]", "FLIP [1]")))
    assert labels(figure) == [("loss [JND]", "FLIP [1]")]
    [axis] = figure.axes
    assert legend_texts(axis) == ["a, b", "c"]
    np.testing.assert_allclose(
        [line.get_xydata()[0] for line in axis.lines], [(0.5, 0.1), (0.7, 0.2)]
    )


def test_gaps_of_solvers_are_in_per_cent():
    shares, gaps = (0.1, 0.5), {"exact": (0.0, 0.0), "greedy": (0.04, 0.004)}
    figure = drawn(solver_gaps(shares, gaps, {"greedy": (0.05, 0.01)}))
    [(x, y)] = labels(figure)
    assert x == "budget [% of full rate everywhere]" and y.endswith("[%]")
    [axis] = figure.axes
    assert legend_texts(axis) == ["exact", "greedy", "greedy: at the most"]
    for line, gap in zip(axis.lines, (0, 4, 5), strict=True):
        assert line.get_ydata()[0] == pytest.approx(gap)
        np.testing.assert_allclose(line.get_xdata(), (10, 50))
    # Nothing lost is on the axis, however small the others are.
    assert axis.get_ylim()[0] < 0


@pytest.mark.parametrize("held_out", [True, False])
def test_history_of_training(held_out):
    last = (0.3, 0.25) if held_out else (np.nan, np.nan)
    history = np.column_stack([(10, 20), (0.4, 0.2), last])
    figure = drawn(training_history(history))
    [(x, y)] = labels(figure)
    assert x == "steps [1]" and y.endswith("[1]")
    lines = {line.get_label(): line for line in figure.axes[0].lines}
    assert list(lines) == ["training views", "held-out views"][: 1 + held_out]
    for name, column in zip(lines, (1, 2), strict=False):
        np.testing.assert_allclose(lines[name].get_xydata(), history[:, (0, column)])


def test_shares_of_inputs():
    shares = {"seen": (70.0, 30.0), "unseen": (0.0, 100.0)}
    found = Attribution(("reprojected_green", "seen"), **shares)
    figure = drawn(input_shares({"one": found, "two": found}))
    assert [axis.get_title() for axis in figure.axes] == ["one", "two"]
    for axis in figure.axes:
        assert axis.get_xlabel() == "share of the contributions [%]"
        bars = {b.get_label(): [r.get_width() for r in b] for b in axis.containers}
        assert bars == {name: list(values) for name, values in shares.items()}
    assert figure.axes[0].get_ylabel() == "input channel"
    names = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    assert names == ["reprojected green", "seen"]
