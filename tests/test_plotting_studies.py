"""Figures of scaled votes and of models beside each other hold what they are given."""

import io

import matplotlib
import numpy as np
import pandas as pd
import pytest

from camojab.fit import Profile
from camojab.fit._profile import _ends
from camojab.plotting import (
    error_and_throughput,
    measured_and_predicted,
    outlier_distances,
    pair_residuals,
    preferences,
    profile_likelihood,
    rmse_by_block,
    scaled_quality,
)


RNG = np.random.default_rng(5)


def points(container):
    """Points of an errorbar, and the ends of the intervals along its bars."""
    bars = container.lines[2]
    ends = np.array(bars[0].get_segments()) if bars else None
    return container.lines[0].get_xydata(), ends


def drawn(figure):
    """It can be saved, and its texts do not reach over the edge."""
    figure.savefig(io.BytesIO(), format="png", dpi=40)
    box = figure.get_tightbbox()
    width, height = figure.get_size_inches()
    assert box.x0 > -0.05 and box.y0 > -0.05
    assert box.x1 < width + 0.05 and box.y1 < height + 0.05
    return figure


def scale(groups, *, conditions=4, intervals=True):
    quality = RNG.normal(-1, 2, groups * conditions)
    table = pd.DataFrame(
        {
            "block": np.repeat([f"b{i}" for i in range(groups)], conditions),
            "velocity_deg_s": 2.5,
            "condition": [f"c{i}" for i in range(conditions)] * groups,
            "quality_jnd": quality,
        }
    )
    if not intervals:
        return table
    return table.assign(low_jnd=quality - 0.5, high_jnd=quality + 0.25)


@pytest.mark.parametrize("groups", [1, 2, 7])
def test_scaled_quality(groups):
    table = scale(groups)
    figure = drawn(scaled_quality(table, ["block", "velocity_deg_s"]))
    assert len(figure.axes) == groups
    limits = {axis.get_xlim() for axis in figure.axes}
    assert len(limits) == 1
    for i, axis in enumerate(figure.axes):
        assert axis.get_title() == f"block b{i}, velocity_deg_s 2.5"
        assert axis.get_xlabel() == "quality [JND]"
        rows = table[table["block"] == f"b{i}"]
        (container,) = axis.containers
        found, ends = points(container)
        np.testing.assert_array_equal(found[:, 0], rows["quality_jnd"])
        np.testing.assert_array_equal(found[:, 1], range(4))
        np.testing.assert_allclose(ends[:, 0, 0], rows["low_jnd"], rtol=1e-12)
        np.testing.assert_allclose(ends[:, 1, 0], rows["high_jnd"], rtol=1e-12)
        names = [label.get_text() for label in axis.get_yticklabels()]
        # Panels of the same conditions have the names once a line.
        assert names == (["c0", "c1", "c2", "c3"] if i % 3 == 0 else [])
        # The first on top, and nothing outside.
        assert axis.yaxis_inverted()
        low, high = axis.get_xlim()
        assert low < table["low_jnd"].min() and table["high_jnd"].max() < high


def test_scaled_quality_without_groups_or_intervals():
    table = scale(1, intervals=False).drop(columns="block")
    (axis,) = drawn(scaled_quality(table)).axes
    assert axis.get_title() == "" and axis.get_ylabel() == "condition"
    found, ends = points(axis.containers[0])
    np.testing.assert_array_equal(found[:, 0], table["quality_jnd"])
    assert ends is None


def test_an_interval_that_is_not_known_or_beside_its_estimate():
    table = scale(1)
    table.loc[0, ["low_jnd", "high_jnd"]] = np.nan
    table.loc[1, "low_jnd"] = table.loc[1, "quality_jnd"] + 0.1
    (axis,) = drawn(scaled_quality(table, ["block"])).axes
    _, ends = points(axis.containers[0])
    np.testing.assert_allclose(ends[0, :, 0], table.loc[0, "quality_jnd"])
    np.testing.assert_allclose(ends[1, 0, 0], table.loc[1, "quality_jnd"])


def test_groups_of_other_conditions_have_their_own_names():
    few = scale(1, conditions=2).assign(block="few", condition=["x", "y"])
    figure = drawn(scaled_quality(pd.concat([scale(1), few]), ["block"]))
    names = [[t.get_text() for t in axis.get_yticklabels()] for axis in figure.axes]
    assert names == [["c0", "c1", "c2", "c3"], ["x", "y"]]
    assert [axis.get_ylabel() for axis in figure.axes] == ["condition", "condition"]


def test_outlier_distances():
    table = pd.DataFrame(
        {
            "observer": ["a", "b", "c", "d", "e"],
            "distance": [0.0, 0.5, 1.7, np.nan, np.inf],
        }
    )
    (axis,) = drawn(outlier_distances(table)).axes
    near, far, limit = axis.lines
    np.testing.assert_array_equal(near.get_xydata(), [[0, 0], [0.5, 1], [0, 3]])
    np.testing.assert_array_equal(far.get_xydata(), [[1.7, 2], [0, 4]])
    assert near.get_color() != far.get_color()
    np.testing.assert_array_equal(limit.get_xdata(), [1, 1])
    said = {round(t.get_position()[1]): t.get_text() for t in axis.texts}
    assert said == {3: "not known", 4: "infinite"}
    names = [label.get_text() for label in axis.get_yticklabels()]
    assert names == list(table["observer"])
    assert "interquartile" in axis.get_xlabel()


@pytest.mark.parametrize("groups, conditions", [(1, 3), (2, 3), (5, 3), (1, 13)])
def test_pair_residuals(groups, conditions):
    names = [f"c{i}" for i in range(conditions)]
    matrices = {}
    for i in range(groups):
        values = RNG.normal(0, 1, (conditions, conditions))
        values[0, 0] = np.nan
        matrices[f"group {i}"] = pd.DataFrame(values, names, names)
    figure = drawn(pair_residuals(matrices))
    axes = [axis for axis in figure.axes if axis.get_title()]
    assert [axis.get_title() for axis in axes] == list(matrices)
    largest = max(np.nanmax(np.abs(frame)) for frame in matrices.values())
    for axis, frame in zip(axes, matrices.values(), strict=True):
        (image,) = axis.images
        np.testing.assert_array_equal(
            np.ma.filled(image.get_array(), np.nan), frame.to_numpy()
        )
        assert image.get_clim() == (-largest, largest)
        written = {t.get_position(): t.get_text() for t in axis.texts}
        if conditions > 12:
            assert written == {}
            continue
        assert len(written) == conditions**2 - 1
        # Row and column are not exchanged.
        assert float(written[2, 1]) == pytest.approx(frame.iloc[1, 2], abs=0.051)
    (bar,) = [axis for axis in figure.axes if not axis.get_title()]
    assert "[JND]" in bar.get_xlabel()


def test_pairs_that_are_all_unanimous():
    frame = pd.DataFrame(np.full((2, 2), np.nan), ["a", "b"], ["a", "b"])
    drawn(pair_residuals({"all": frame}))


def models(unit="JND", blocks=("one", "two")):
    rows = [
        {"model": m, "block": b, "rmse": RNG.uniform(0.1, 2), "unit": unit}
        for m in ("CaMoJAB", "MARRR", "NAS")
        for b in blocks
    ]
    return pd.DataFrame(rows).assign(setting="fair", printed=np.nan)


def test_rmse_by_block():
    jnd, score = models(), models("points", ["opinion"])
    paper = pd.concat([jnd, score]).assign(setting="paper", printed=0.7)
    table = pd.concat([paper, jnd, score], ignore_index=True)
    figure = drawn(rmse_by_block(table))
    assert [a.get_title() for a in figure.axes] == ["paper", "paper", "fair", "fair"]
    assert [a.get_ylabel() for a in figure.axes[:2]] == [
        "RMSE [JND]",
        "RMSE [points of the score]",
    ]
    for axis, part in zip(
        figure.axes, [paper.iloc[:6], paper.iloc[6:], jnd, score], strict=True
    ):
        bars = [bar for each in axis.containers for bar in each]
        heights = [bar.get_height() for bar in bars]
        np.testing.assert_array_equal(heights, part["rmse"])
        ticks = [label.get_text() for label in axis.get_xticklabels()]
        assert ticks == list(dict.fromkeys(part["block"]))
        centres = [round(bar.get_x() + bar.get_width() / 2) for bar in bars]
        assert centres == [ticks.index(b) for b in part["block"]]
        assert len(axis.lines) == (3 if axis.get_title() == "paper" else 0)
    named = {t.get_text() for t in figure.legends[0].get_texts()}
    assert named == {"CaMoJAB", "MARRR", "NAS", "printed"}


def test_more_models_than_colours_are_drawn():
    one = models().query("model == model.iloc[0]")
    table = pd.concat([one.assign(model=f"model {i}") for i in range(9)])
    (axis,) = drawn(rmse_by_block(table)).axes
    assert len(axis.containers) == 9
    assert axis.get_xlabel() == "block"


def test_blocks_may_be_called_something_else():
    score = models("points", ["opinion"])
    figure = drawn(rmse_by_block(pd.concat([models(), score]), x_label="experiment"))
    assert [a.get_xlabel() for a in figure.axes] == ["experiment", "experiment"]


def test_a_model_without_a_number_leaves_a_gap():
    table = models().iloc[1:]
    (axis,) = drawn(rmse_by_block(table)).axes
    heights = [[bar.get_height() for bar in each] for each in axis.containers]
    # "two" comes first now, and CaMoJAB has no bar for "one".
    assert heights[0][0] == table["rmse"].iloc[0] and np.isnan(heights[0][1])


@pytest.mark.parametrize("blocks, intervals", [(1, True), (4, False), (5, True)])
def test_measured_and_predicted(blocks, intervals):
    rows = [
        {
            "model": model,
            "block": f"b{i}",
            "unit": "JND",
            "measured": RNG.normal(),
            "predicted": RNG.normal(),
        }
        for i in range(blocks)
        for model in ("m", "n")
        for _ in range(3)
    ]
    table = pd.DataFrame(rows)
    if intervals:
        table = table.assign(low=table["measured"] - 1, high=table["measured"] + 0.5)
    figure = drawn(measured_and_predicted(table))
    assert [a.get_title() for a in figure.axes] == [f"b{i}" for i in range(blocks)]
    for axis in figure.axes:
        assert axis.get_xlabel() == "measured [JND]"
        assert axis.get_ylabel() == "predicted [JND]"
        assert [c.get_label() for c in axis.containers] == ["m", "n"]
        for container in axis.containers:
            rows = table[table["block"] == axis.get_title()]
            rows = rows[rows["model"] == container.get_label()]
            found, ends = points(container)
            np.testing.assert_array_equal(found, rows[["measured", "predicted"]])
            if intervals:
                np.testing.assert_allclose(ends[:, 0, 0], rows["low"])
                np.testing.assert_allclose(ends[:, 1, 0], rows["high"])
            else:
                assert ends is None


@pytest.mark.parametrize("scenes", [0, 3])
def test_preferences(scenes):
    budgets = [0.0625, 0.125]
    table = pd.DataFrame(
        {
            "budget": budgets * max(scenes, 1),
            "against": "uniform",
            "votes": 20,
            "preferred": 12,
            "preference": RNG.uniform(0.3, 0.9, 2 * max(scenes, 1)),
        }
    )
    table = table.assign(
        low=table["preference"] - 0.1, high=table["preference"] + 0.05, p_value=0.1
    )
    if scenes:
        table.insert(0, "scene", np.repeat([f"s{i}" for i in range(scenes)], 2))
    figure = drawn(preferences(table))
    assert len(figure.axes) == max(scenes, 1)
    for i, axis in enumerate(figure.axes):
        rows = table.iloc[2 * i : 2 * i + 2]
        assert axis.get_title() == (f"s{i}" if scenes else "")
        assert axis.get_xlabel() == "share of votes for ALSaRR [1]"
        found, ends = points(axis.containers[0])
        np.testing.assert_array_equal(found[:, 0], rows["preference"])
        np.testing.assert_allclose(ends[:, 0, 0], rows["low"])
        np.testing.assert_allclose(ends[:, 1, 0], rows["high"])
        (half,) = [line for line in axis.lines if line.get_linestyle() == "--"]
        np.testing.assert_array_equal(half.get_xdata(), [0.5, 0.5])
    names = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert names == ["budget 0.0625, uniform", "budget 0.125, uniform"]


def profile_of(points):
    """Of a likelihood that is no parabola, at few values of the constant."""
    values = np.geomspace(0.2, 0.7, points)
    deviance = (8 * np.log(values / values[points // 2])) ** 2
    return Profile("beta", 0.95, values, deviance, *_ends(values, deviance, 0.95))


@pytest.mark.parametrize("points", [5, 11])
def test_a_profile_crosses_its_bound_where_the_interval_ends(points):
    found = profile_of(points)
    figure = drawn(profile_likelihood([found], np.array([0.05]), ["1"]))
    (axis,) = figure.axes
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("beta [1]", "deviance [1]")
    curves = [line for line in axis.lines if line.get_label() == "profile"]
    values, deviance = curves[0].get_xydata().T
    bound = 3.841458820694124
    for end in (found.low, found.high):
        np.testing.assert_allclose(np.interp(end, values, deviance), bound, rtol=2e-3)
    # What was fitted is on it.
    dots = next(line for line in axis.lines if line.get_marker() == ".").get_xydata()
    np.testing.assert_array_equal(dots[:, 0], found.values)
    np.testing.assert_array_equal(dots[:, 1], found.deviance)
    on_curve = np.interp(found.values, values, deviance)
    np.testing.assert_allclose(on_curve, found.deviance, rtol=0.01, atol=0.02)
    ends = [x.get_xdata()[0] for x in axis.lines if x.get_label() == "interval"]
    assert ends == [found.low, found.high]


def rungs():
    """As a machine measured them: single precision is twice as fast."""
    cases = {"exact": (0.0, 600.0), "10000 cells": (6e-5, 8e4)}
    cases |= {"1000 cells": (6.5e-4, 9e5), "tensor 4x3x4": (0.09, 1.2e7)}
    cases |= {"Eq. 31": (6.0, 2.8e8)}
    rows = [
        {"formulation": "released", "precision": precision, "fidelity": name}
        | {"error_jnd": max(error, floor), "conditions_per_s": speed / slower}
        for name, (error, speed) in cases.items()
        for precision, floor, slower in (("float64", 0.0, 2), ("float32", 6e-6, 1))
    ]
    exact = lambda row: row["error_jnd"] == 0 or row["precision"] == "float32"
    return pd.DataFrame(rows).assign(front=["yes" if exact(r) else "" for r in rows])


def test_names_of_points_stay_off_the_front():
    figure = drawn(error_and_throughput(rungs()))
    (axis,) = figure.axes
    assert axis.get_xlabel() == "throughput after pooling [conditions/s]"
    front = axis.lines[0].get_transform().transform_path(axis.lines[0].get_path())
    assert len(front.vertices) == 6 and len(axis.texts) == 10
    for text in axis.texts:
        box = text.get_window_extent()
        assert not front.intersects_bbox(box, filled=False), text.get_text()


def test_settings_and_tables_are_left_alone():
    before, table = dict(matplotlib.rcParams), scale(2)
    copy = table.copy()
    scaled_quality(table, ["block"])
    rows = models()
    own = rows.copy()
    rmse_by_block(rows)
    assert dict(matplotlib.rcParams) == before
    pd.testing.assert_frame_equal(table, copy)
    pd.testing.assert_frame_equal(rows, own)
