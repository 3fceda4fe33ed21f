"""Curves and maps hold the numbers they are given, with names and units on the axes."""

import matplotlib
import numpy as np
import pandas as pd
import pytest

from camojab.plotting import contour_map, curves


VELOCITY = np.array([0.0, 5.0, 20.0, 40.0])


def quality(velocity, rate):
    return -velocity * 60 / rate - 0.25


@pytest.fixture
def table():
    """Two textures, three refresh rates, rows in no particular order."""
    rows = [
        {"velocity_deg_s": v, "refresh_rate_hz": f, "texture": t}
        | {"quality_jnd": quality(v, f) - (t == "noise")}
        for t in ("grass", "noise")
        for f in (120.0, 30.0, 60.0)
        for v in VELOCITY
    ]
    return pd.DataFrame(rows).sample(frac=1, random_state=2)


def lines(axis):
    handles, labels = axis.get_legend_handles_labels()
    return dict(zip(labels, handles, strict=True))


def panels(figure):
    """The axes that are not a colour bar, by their titles."""
    return {a.get_title(): a for a in figure.axes if a.get_label() != "<colorbar>"}


def test_every_line_is_a_column_of_the_table(table):
    figure = curves(
        table, "velocity_deg_s", by="refresh_rate_hz", panel="texture", log_x=False
    )
    assert set(panels(figure)) == {"grass", "noise"}
    for name, axis in panels(figure).items():
        assert axis.get_xlabel() == "velocity [deg/s]"
        assert axis.get_ylabel() == "quality [JND]"
        drawn = lines(axis)
        assert set(drawn) == {"30 Hz", "60 Hz", "120 Hz"}
        for rate in (30, 60, 120):
            xy = drawn[f"{rate} Hz"].get_xydata()
            np.testing.assert_array_equal(xy[:, 0], VELOCITY)
            expected = quality(VELOCITY, rate) - (name == "noise")
            np.testing.assert_array_equal(xy[:, 1], expected)
    (legend,) = figure.legends
    assert legend.get_title().get_text() == "refresh rate [Hz]"


def test_bright_lines_are_large_numbers(table):
    (axis,) = panels(
        curves(
            table[table["texture"] == "grass"], "velocity_deg_s", by="refresh_rate_hz"
        )
    ).values()
    bright = {
        name: sum(matplotlib.colors.to_rgb(line.get_color()))
        for name, line in lines(axis).items()
    }
    assert sorted(bright, key=bright.get) == ["30 Hz", "60 Hz", "120 Hz"]


def test_an_interval_is_a_band_from_its_low_to_its_high_end(table):
    one = table[(table["texture"] == "grass") & (table["refresh_rate_hz"] == 60)]
    one = one.assign(low_jnd=one["quality_jnd"] - 1, high_jnd=one["quality_jnd"] + 3)
    (axis,) = panels(curves(one, "velocity_deg_s", by="texture")).values()
    (band,) = axis.collections
    corners = band.get_paths()[0].vertices
    middle = quality(VELOCITY, 60)
    for x, y in zip(VELOCITY, middle, strict=True):
        found = corners[corners[:, 0] == x][:, 1]
        np.testing.assert_allclose([found.min(), found.max()], [y - 1, y + 3])
    plain = one.drop(columns=["low_jnd", "high_jnd"])
    (axis,) = panels(curves(plain, "velocity_deg_s", by="texture")).values()
    assert not axis.collections


@pytest.mark.parametrize("log_x", [False, True])
def test_a_tangent_touches_with_the_slope_that_was_given(log_x):
    x = np.linspace(1.0, 9.0, 9)
    table = pd.DataFrame({"persistence": x, "crossing_deg_s": x**2, "texture": "a"})
    table["slope"] = np.where(x == 4, 8.0, np.nan)
    figure = curves(table, "persistence", "crossing_deg_s", by="texture", log_x=log_x)
    (axis,) = panels(figure).values()
    assert axis.get_xscale() == ("log" if log_x else "linear")
    assert axis.get_xlabel() == "persistence [1]"
    _, tangent, touch = axis.get_lines()
    np.testing.assert_array_equal(touch.get_xydata(), [[4.0, 16.0]])
    across, up = tangent.get_xydata().T
    assert across[0] < 4 < across[-1]
    # It goes through the point and has no bend, in what the axis shows of x.
    shown = np.log(across / 4) if log_x else across - 4
    slope = 4 * 8.0 if log_x else 8.0
    np.testing.assert_allclose(up, 16 + slope * shown)
    near = 1e-3
    at, step = (4 * np.exp(near), near) if log_x else (4 + near, near)
    np.testing.assert_allclose((at**2 - 16) / step, slope, rtol=2e-3)


def test_a_pure_number_has_a_unit_and_a_name_has_none(table):
    table = table.assign(resolution=np.where(table["refresh_rate_hz"] > 50, 1.0, 0.5))
    table = table[table["texture"] == "grass"].drop_duplicates(
        ["velocity_deg_s", "resolution"]
    )
    figure = curves(table, "velocity_deg_s", by="resolution")
    (axis,) = panels(figure).values()
    assert set(lines(axis)) == {"0.5", "1"}
    assert figure.legends[0].get_title().get_text() == "resolution [1]"
    rates = table["resolution"].map({0.5: "2x2", 1.0: "1x1"})
    named = curves(
        table.assign(shading_rate=rates), "velocity_deg_s", by="shading_rate"
    )
    assert named.legends[0].get_title().get_text() == "shading rate"


def test_a_panel_of_a_number_says_what_it_is_of(table):
    figure = curves(table, "velocity_deg_s", by="texture", panel="refresh_rate_hz")
    titles = {f"refresh rate {rate} Hz" for rate in (30, 60, 120)}
    assert set(panels(figure)) == titles


def grid_table():
    x, y = np.meshgrid([60.0, 120.0, 240.0], [0.1, 0.5, 0.7, 1.0])
    return pd.DataFrame(
        {"refresh_rate_hz": x.ravel(), "persistence": y.ravel()}
        | {"worth_jnd": (x / 60 + 10 * y).ravel()}
    )


def test_a_map_has_its_grid_its_unit_and_its_ways():
    steps = pd.DataFrame(
        {"refresh_rate_hz": [60.0, 100.0, 90.0], "persistence": [1.0, 0.5, 0.2]}
        | {"path": "start at 60 Hz"}
    )
    shuffled = grid_table().sample(frac=1, random_state=1)
    figure = contour_map(
        shuffled,
        "refresh_rate_hz",
        "persistence",
        "worth_jnd",
        paths=steps,
        log_x=True,
        levels=6,
    )
    axis, bar = figure.axes
    assert (axis.get_xlabel(), axis.get_ylabel()) == (
        "refresh rate [Hz]",
        "persistence [1]",
    )
    assert bar.get_ylabel() == "worth [JND]"
    assert (axis.get_xscale(), axis.get_yscale()) == ("log", "linear")
    way, start, end = axis.get_lines()
    # In the order of the steps, not along the axis.
    np.testing.assert_array_equal(
        way.get_xydata(), steps[["refresh_rate_hz", "persistence"]]
    )
    np.testing.assert_array_equal(start.get_xydata(), [[60.0, 1.0]])
    np.testing.assert_array_equal(end.get_xydata(), [[90.0, 0.2]])
    filled = axis.collections[0]
    assert filled.levels[0] <= 2.0
    assert filled.levels[-1] >= 14.0


def test_contours_are_where_the_values_are():
    (axis,) = panels(
        contour_map(grid_table(), "refresh_rate_hz", "persistence", "worth_jnd")
    ).values()
    _, contours = axis.collections
    for level, path in zip(contours.levels, contours.get_paths(), strict=True):
        x, y = path.vertices.T
        # The value is linear in both, so interpolation is exact.
        np.testing.assert_allclose(x / 60 + 10 * y, level, atol=1e-9)


def test_contours_are_labelled_in_what_their_place_sets_off():
    figure = contour_map(grid_table(), "refresh_rate_hz", "persistence", "worth_jnd")
    figure.draw_without_rendering()
    (axis,) = panels(figure).values()
    filled = axis.collections[0]
    inks = set()
    for label in axis.texts:
        behind = filled.cmap(filled.norm(float(label.get_text())))[:3]
        linear = lambda colour: np.dot(np.power(colour, 2.2), (0.2126, 0.7152, 0.0722))
        ink = linear(matplotlib.colors.to_rgb(label.get_color()))
        bright, dark = sorted((ink, linear(behind)), reverse=True)
        # What is asked of small text; white on yellow has 1.3.
        assert (bright + 0.05) / (dark + 0.05) > 4.5
        inks.add(round(ink))
    assert inks == {0, 1}


def test_each_panel_of_a_map_has_its_own_values_and_ways():
    table = pd.concat(
        grid_table().assign(light_jnd=a, worth_jnd=lambda t, a=a: t["worth_jnd"] * a)
        for a in (1.0, 2.0)
    )
    ways = pd.DataFrame(
        {"refresh_rate_hz": [60.0, 120.0], "persistence": 0.5, "path": "way"}
        | {"light_jnd": 2.0}
    )
    figure = contour_map(
        table,
        "refresh_rate_hz",
        "persistence",
        "worth_jnd",
        panel="light_jnd",
        paths=ways,
    )
    found = panels(figure)
    assert {name: len(a.get_lines()) for name, a in found.items()} == {
        "light 1 JND": 0,
        "light 2 JND": 3,
    }
    # One scale of colours for all panels, but contours of their own.
    first, second = (a.collections[1] for a in found.values())
    np.testing.assert_array_equal(first.levels, second.levels)
    level = int(np.flatnonzero(first.levels > 14)[0])
    assert not first.get_paths()[level].vertices.size
    assert second.get_paths()[level].vertices.size


@pytest.mark.parametrize(
    "draw",
    [
        lambda table, x: curves(table, x, by="texture"),
        lambda table, x: contour_map(table, x, "refresh_rate_hz"),
    ],
)
def test_what_cannot_be_drawn_is_a_sentence(draw, table):
    with pytest.raises(ValueError, match=r"`table` must have a column 'nought'"):
        draw(table, "nought")
    with pytest.raises(ValueError, match=r"`table` must have at least one row"):
        draw(table[:0], "velocity_deg_s")


def test_a_map_of_points_that_are_no_grid_is_refused():
    for broken in (grid_table()[1:], pd.concat([grid_table(), grid_table()[:1]])):
        with pytest.raises(
            ValueError, match=r"must have each pair of `refresh_rate_hz`"
        ):
            contour_map(broken, "refresh_rate_hz", "persistence", "worth_jnd")
