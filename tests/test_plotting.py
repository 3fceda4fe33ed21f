"""Figures hold the numbers they are given, with units, and leave no state behind."""

import io
import subprocess
import sys

import matplotlib
import numpy as np
import pandas as pd
import pytest

from alsarr import Frame
from alsarr.plotting import frame_buffers
from camojab import datasets
from camojab.plotting import quality_by_refresh_rate, quality_by_shading_rate


@pytest.fixture
def table():
    """The simulated experiments, measured without noise; intervals for one block."""
    table = datasets.simulated_conditions()
    table["quality_jnd"] = table["true_quality_jnd"]
    table["low_jnd"] = table["high_jnd"] = np.nan
    pc = table["block"] == "simulated PC"
    table.loc[pc, "low_jnd"] = table["quality_jnd"] - 0.25
    table.loc[pc, "high_jnd"] = table["quality_jnd"] + 0.5
    # Rows in no particular order: a line has to be sorted along its axis.
    return table.sample(frac=1, random_state=1)


def predicted(table):
    return np.random.default_rng(0).normal(-2, 1, len(table))


def panels(figure):
    return [axis for axis in figure.axes if axis.get_title()]


def lines(axis):
    """The lines of an axis that have a name, by their name."""
    labelled = zip(*axis.get_legend_handles_labels()[::-1], strict=True)
    return {label: line for label, line in labelled}


def dots(axis):
    """Points and the ends of their intervals, one array for each errorbar."""
    return [
        (container.lines[0].get_xydata(), container.lines[2][0].get_segments())
        for container in axis.containers
    ]


def check_points(axis, label, rows, x, position):
    """The line and the dots of one curve are the table's."""
    order = np.argsort(x)
    line = lines(axis)[label].get_xydata()
    np.testing.assert_array_equal(line[:, 0], x[order])
    np.testing.assert_array_equal(line[:, 1], rows["predicted"].to_numpy()[order])
    points, intervals = dots(axis)[position]
    np.testing.assert_array_equal(points[:, 0], x[order])
    measured = rows["quality_jnd"].to_numpy()[order]
    np.testing.assert_array_equal(points[:, 1], measured)
    for i, (low, high) in enumerate(intervals):
        below, above = (
            rows[name].fillna(rows["quality_jnd"]).to_numpy()[order][i]
            for name in ("low_jnd", "high_jnd")
        )
        np.testing.assert_allclose([low[1], high[1]], [below, above])


def test_quality_by_shading_rate(table):
    given = predicted(table)
    figure = quality_by_shading_rate(table, given)
    table = table.assign(predicted=given)
    titles = [
        f"simulated {block}, {velocity} deg/s"
        for block, velocities in (
            ("PC", (0, 10, 30)),
            ("Mobile", (3, 10, 20)),
            ("VR", (10, 45, 75)),
        )
        for velocity in velocities
    ]
    found = {axis.get_title(): axis for axis in panels(figure)}
    assert len(figure.axes) == 9 and sorted(found) == sorted(titles)
    for title, axis in found.items():
        block, velocity = title.removesuffix(" deg/s").split(", ")
        rows = table[
            (table["block"] == block) & (table["velocity_deg_s"] == float(velocity))
        ]
        textures = list(dict.fromkeys(rows["texture"]))
        assert sorted(lines(axis)) == sorted(textures) and len(textures) == 4
        for position, name in enumerate(lines(axis)):
            chosen = rows[rows["texture"] == name]
            x = 1 / chosen["rate_x"].to_numpy()
            check_points(axis, name, chosen, x, position)
        ticks = [label.get_text() for label in axis.get_xticklabels()]
        assert ticks == ["1x1", "2x1", "4x1"]
        assert list(axis.get_xticks()) == [1, 2, 4]


def test_a_texture_has_one_colour_everywhere_and_each_another(table):
    figure = quality_by_shading_rate(table, predicted(table))
    colours = {}
    for axis in panels(figure):
        for position, (name, line) in enumerate(lines(axis).items()):
            colours.setdefault(name, set()).add(line.get_color())
            colours[name].add(axis.containers[position].lines[0].get_color())
    assert {len(own) for own in colours.values()} == {1}
    assert len(set.union(*colours.values())) == len(colours) == 4


def test_quality_by_refresh_rate(table):
    given = predicted(table)
    figure = quality_by_refresh_rate(table, given)
    table = table.assign(predicted=given)
    titles = [axis.get_title() for axis in figure.axes]
    assert sorted(titles) == ["simulated judder", "simulated refresh"]
    for axis in figure.axes:
        rows = table[table["block"] == axis.get_title()]
        velocities = sorted(set(rows["velocity_deg_s"]))
        assert list(lines(axis)) == [f"{v:g} deg/s" for v in velocities]
        for position, velocity in enumerate(velocities):
            chosen = rows[rows["velocity_deg_s"] == velocity]
            x = chosen["refresh_rate_hz"].to_numpy()
            check_points(axis, f"{velocity:g} deg/s", chosen, x, position)


@pytest.mark.parametrize(
    "draw, column, of",
    [
        (quality_by_shading_rate, "texture", "texture {}"),
        (quality_by_refresh_rate, "velocity_deg_s", "{} deg/s"),
    ],
)
def test_no_curve_is_left_out(table, draw, column, of):
    """More curves than there are colours."""
    data_set = "rates" if column == "texture" else "refresh"
    one = table[table["data_set"] == data_set]
    one = one[
        (one["texture"] == "checkerboard") & (one["block"] == one["block"].iloc[0])
    ]
    one = one[one["velocity_deg_s"] == one["velocity_deg_s"].iloc[0]]
    names = [of.format(i) for i in range(9)]
    values = names if column == "texture" else range(9)
    many = pd.concat([one.assign(**{column: value}) for value in values])
    figure = draw(many, np.zeros(len(many)))
    (axis,) = panels(figure)
    assert sorted(lines(axis)) == names


@pytest.mark.parametrize(
    "draw, x_label",
    [
        (quality_by_shading_rate, "shading rate [px x px]"),
        (quality_by_refresh_rate, "refresh rate [Hz]"),
    ],
)
def test_axes_have_names_with_units(table, draw, x_label):
    figure = draw(table, predicted(table))
    rows = np.reshape(figure.axes, figure.axes[0].get_gridspec().get_geometry())
    assert [axis.get_ylabel() for axis in rows[:, 0]] == ["quality [JND]"] * len(rows)
    assert [axis.get_xlabel() for axis in rows[-1]] == [x_label] * rows.shape[1]
    (legend,) = figure.legends
    named = {text.get_text() for text in legend.get_texts()}
    assert named == set().union(*(lines(axis) for axis in figure.axes))
    assert "measured" in legend.get_title().get_text()


def frame():
    rng = np.random.default_rng(3)
    return Frame(
        texture=rng.integers(0, 4, (5, 7)),
        mip_level=rng.uniform(0, 6, (5, 7)),
        velocity_x=rng.uniform(0, 30, (5, 7)),
        velocity_y=rng.uniform(0, 40, (5, 7)),
        luminance=rng.uniform(1, 200, (5, 7)),
    )


def test_frame_buffers():
    given = frame()
    figure = frame_buffers(given)
    images = {axis.get_title(): axis.images[0] for axis in panels(figure)}
    assert list(images) == [
        "texture [index]",
        "mip level [octaves]",
        "slowest motion [deg/s]",
        "luminance [cd/m$^2$]",
    ]
    speed = np.hypot(given.velocity_x, given.velocity_y)
    expected = [given.texture, given.mip_level, speed, given.luminance]
    for image, values in zip(images.values(), expected, strict=True):
        np.testing.assert_allclose(image.get_array(), values, rtol=1e-6)
        # A square a tile, not blurred, the top row on top, with a scale beside it.
        assert image.get_interpolation() == "nearest" and image.origin == "upper"
        assert image.colorbar is not None
    image = images["texture [index]"]
    assert image.get_cmap().N == len(np.unique(given.texture))
    # A colour for each index, and a tick in the middle of it.
    assert image.get_clim() == (-0.5, 3.5)
    assert whole(image.colorbar) == [0, 1, 2, 3]


def whole(bar):
    """Ticks of a bar within its ends."""
    return [tick for tick in bar.get_ticks() if bar.vmin <= tick <= bar.vmax]


def test_many_textures_have_ticks_at_whole_numbers_too():
    many = Frame(
        texture=np.arange(77).reshape(7, 11),
        mip_level=0.0,
        velocity_x=0.0,
        velocity_y=0.0,
        luminance=100.0,
    )
    ticks = whole(frame_buffers(many).axes[0].images[0].colorbar)
    assert 4 < len(ticks) < 12 and np.all(np.mod(ticks, 1) == 0)


def test_a_frame_of_one_texture_at_rest():
    still = Frame(
        texture=np.full((2, 3), 5),
        mip_level=0.0,
        velocity_x=0.0,
        velocity_y=0.0,
        luminance=100.0,
    )
    buffer = io.BytesIO()
    figure = frame_buffers(still)
    figure.savefig(buffer, format="png")
    assert buffer.getvalue().startswith(b"\x89PNG")
    assert whole(figure.axes[0].images[0].colorbar) == [5]


@pytest.mark.parametrize("draw", [quality_by_shading_rate, quality_by_refresh_rate])
def test_figures_can_be_saved_and_leave_settings_alone(table, draw):
    before = dict(matplotlib.rcParams)
    columns = list(table.columns)
    buffer = io.BytesIO()
    draw(table, predicted(table)).savefig(buffer, format="png", dpi=40)
    assert buffer.getvalue().startswith(b"\x89PNG")
    assert dict(matplotlib.rcParams) == before
    assert list(table.columns) == columns


@pytest.mark.float64  # another process, which takes no notice of the precision here
def test_pyplot_is_not_imported():
    code = """
import io, sys
import numpy as np
from alsarr import procedural_frame
from alsarr.plotting import frame_buffers
from camojab import datasets
from camojab.plotting import quality_by_refresh_rate, quality_by_shading_rate
assert "matplotlib" not in sys.modules
table = datasets.simulated_conditions()
table["quality_jnd"] = table["low_jnd"] = table["high_jnd"] = table["true_quality_jnd"]
predicted = table["quality_jnd"].to_numpy()
figures = [
    quality_by_refresh_rate(table, predicted),
    quality_by_shading_rate(table, predicted),
    frame_buffers(procedural_frame(3, rows=4, columns=6, seed=0)),
]
for figure in figures:
    figure.savefig(io.BytesIO(), format="png", dpi=30)
assert "matplotlib.figure" in sys.modules
assert "matplotlib.pyplot" not in sys.modules
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
