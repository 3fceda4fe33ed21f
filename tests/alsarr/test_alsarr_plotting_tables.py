"""Figures of tables hold the numbers they are given, with units."""

import io

import matplotlib
import numpy as np
import pandas as pd
import pytest

from alsarr import RATES
from alsarr.plotting import errors_by_size, table_errors, tile_rates
from alsarr.tables import Certificate, Conditions, Domain, Eq31, QualityTables


def drawn(figure):
    """It can be saved, its texts do not reach over the edge, and nothing is left."""
    backend = matplotlib.get_backend()
    figure.savefig(io.BytesIO(), format="png", dpi=40)
    box = figure.get_tightbbox()
    width, height = figure.get_size_inches()
    assert box.x0 > -0.05 and box.y0 > -0.05
    assert box.x1 < width + 0.05 and box.y1 < height + 0.05
    assert matplotlib.get_backend() == backend
    return figure


@pytest.fixture
def sizes():
    return pd.DataFrame(
        {
            "name": ["large", "small, old", "middle"],
            "numbers": [4200, 20, 400],
            "largest_jnd": [0.3, 7.0, 0.8],
            "percentile_99_jnd": [0.03, 1.0, 0.2],
            "median_jnd": [0.0, 0.004, 0.001],
        }
    )


@pytest.mark.parametrize("tolerance", [None, 0.5])
def test_errors_by_size(sizes, tolerance):
    figure = drawn(errors_by_size(sizes, tolerance_jnd=tolerance))
    (axis,) = figure.axes
    assert axis.get_xlabel() == "error against the model [JND]"
    assert axis.get_ylabel() == "tables"
    lines = {line.get_label(): line.get_xydata() for line in axis.lines}
    assert list(lines)[:3] == ["largest", "99 % are below", "median"]
    # Smallest first, from the top, whatever the order of the rows.
    assert [t.get_text() for t in axis.get_yticklabels()] == [
        "small, old\n20 numbers",
        "middle\n400 numbers",
        "large\n4 200 numbers",
    ]
    assert axis.get_ylim() == (2.5, -0.5)
    np.testing.assert_array_equal(lines["largest"], [[7.0, 0], [0.8, 1], [0.3, 2]])
    np.testing.assert_array_equal(lines["99 % are below"][:, 0], [1.0, 0.2, 0.03])
    # A median of 0 is drawn at the edge rather than nowhere.
    np.testing.assert_array_equal(lines["median"][:, 0], [0.004, 0.001, 1e-6])
    if tolerance:
        np.testing.assert_array_equal(lines["tolerance"][:, 0], [0.5, 0.5])
    assert len(lines) == 3 + (tolerance is not None)


def tables(largest):
    """Two textures at two levels, of which one pair does not occur."""
    largest = np.array(largest)[:, None, None] * np.ones((1, 7, 2))
    # The reference rate is exact: the square has to show the worst of all.
    largest[:, 0] = 0.0
    one = np.zeros(1)
    return QualityTables(
        coefficients=np.zeros((3, 7, 2, 10)),
        entry=np.array([[0, 1], [2, 2]]),
        occurs=np.array([[True, True], [True, False]]),
        constant=np.zeros(3, bool),
        mip_levels=(0, 3),
        domain=Domain(),
        certificate=Certificate(
            largest=largest,
            percentile_99=largest,
            median=largest,
            overall=np.zeros(3),
            sample=Conditions(one, one, one),
        ),
        basis=Eq31(),
        texture_names=("brick", "noise"),
        model="none",
    )


def test_table_errors():
    figure = drawn(table_errors(tables([0.25, 0.5, 2.0])))
    axis, bar = figure.axes
    assert axis.get_xlabel() == "mip level [octaves]"
    assert axis.get_ylabel() == "texture"
    assert bar.get_ylabel() == "largest error [JND]"
    assert [t.get_text() for t in axis.get_xticklabels()] == ["0", "3"]
    assert [t.get_text() for t in axis.get_yticklabels()] == ["brick", "noise"]
    shown = np.ma.filled(axis.images[0].get_array(), np.nan)
    np.testing.assert_array_equal(shown, [[0.25, 0.5], [2.0, np.nan]])
    assert [text.get_text() for text in axis.texts] == ["0.25", "0.5", "2"]
    ticks = [t.get_text() for t in bar.get_yticklabels()]
    assert (ticks[0], ticks[-1]) == ("0.25", "2")


def test_table_errors_of_exact_tables():
    axis, _ = drawn(table_errors(tables([0.0, 0.0, 0.0]))).axes
    assert {text.get_text() for text in axis.texts} == {"0"}


@pytest.mark.parametrize("count", [1, 2, 3])
def test_tile_rates(count):
    random = np.random.default_rng(count)
    maps = {f"map {i}": random.integers(0, 7, (4, 6)) for i in range(count)}
    figure = drawn(tile_rates(maps))
    shown = [axis for axis in figure.axes if axis.images]
    assert len(shown) == count
    for axis, (name, rate) in zip(shown, maps.items(), strict=True):
        np.testing.assert_array_equal(axis.images[0].get_array(), RATES.colour[rate])
        share = RATES.cost[rate].mean() / 256
        assert axis.get_title() == f"{name}: {share:.1%} of the cost of 1x1"
    (legend,) = figure.legends
    assert [t.get_text() for t in legend.get_texts()] == list(RATES.names)
