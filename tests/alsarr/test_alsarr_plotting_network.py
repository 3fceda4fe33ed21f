"""Figures of captured views and of predictions hold what they are given, with units."""

import io

import numpy as np
import pytest

from alsarr import RATES
from alsarr.capture import Camera, View
from alsarr.plotting import predicted_errors, view_buffers


RNG = np.random.default_rng(8)


def view(texture):
    """Ones everywhere, but for the index of each pixel's texture."""
    rates, colours, pairs = (len(RATES),), (3,), (2,)
    shapes = {"images": (*rates, *texture.shape, *colours), "invocations": rates}
    shapes |= {name: () for name in ("exposure", "time")}
    for name in ("normal", "diffuse", "specular", "reprojected"):
        shapes[name] = (*texture.shape, *colours)
    shapes |= {name: (*texture.shape, *pairs) for name in ("uv", "motion")}
    arrays = {
        name: np.ones(shapes.get(name, texture.shape), kind)
        for name, kind in View.ARRAYS.items()
    }
    camera = Camera((0.0, 1.0, 0.0), (0.0, 0.0, -1.0))
    given = arrays | {"texture": texture.astype(np.uint16), "scene": "ones"}
    return View(**given, camera=camera, previous_camera=camera)


@pytest.mark.parametrize("textures", [1, 3, 50])
def test_textures_of_a_view_are_counted(textures):
    figure = view_buffers(view(np.arange(64 * 48).reshape(48, 64) % textures))
    figure.savefig(io.BytesIO(), format="png", dpi=40)
    (axis,) = [a for a in figure.axes if a.get_title() == "texture [index]"]
    bar = axis.images[0].colorbar
    ticks = [tick for tick in bar.get_ticks() if bar.vmin <= tick <= bar.vmax]
    assert (bar.vmin, bar.vmax) == (-0.5, textures - 0.5)
    assert np.all(np.mod(ticks, 1) == 0) and min(textures, 3) <= len(ticks) < 12


def predictions(count=2, scale=1.0):
    measured = [scale * RNG.beta(1, 3, (2, 3)) for _ in range(count)]
    predicted = [scale * RNG.beta(3, 1, (2, 3)) for _ in range(count)]
    picture = lambda: RNG.integers(0, 256, (32, 48, 3)).astype(np.uint8)
    pictures = [picture() for _ in range(count)]
    seen = [np.ones((32, 48), bool) for _ in range(count)]
    return pictures, seen, measured, predicted


def drawn(given, label="FLIP of 2x1 [1]"):
    figure = predicted_errors(*given, label=label)
    figure.savefig(io.BytesIO(), format="png", dpi=40)
    return figure


def bars(figure):
    return [a.get_ylabel() for a in figure.axes if a.get_label() == "<colorbar>"]


@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_no_difference_is_beyond_its_scale(scale):
    given = predictions(scale=scale)
    *_, measured, predicted = given
    figure = drawn(given)
    rows = np.reshape([axis for axis in figure.axes if axis.images], (2, 4))
    farthest = np.abs(np.subtract(predicted, measured)).max()
    for row, p, m in zip(rows, predicted, measured, strict=True):
        shown = [axis.images[0] for axis in row]
        np.testing.assert_array_equal(shown[3].get_array(), p - m)
        # None is left out, and 0 is in the middle.
        assert shown[3].get_clim() == (-farthest, farthest)
        highest = max(x.max() for x in (*measured, *predicted))
        assert shown[1].get_clim() == shown[2].get_clim() == (0.0, highest)


def test_predictions_without_any_error():
    pictures, seen, measured, _ = predictions()
    figure = drawn((pictures, seen, measured, measured))
    last = [axis for axis in figure.axes if axis.images][3]
    assert last.images[0].get_clim() == (-1.0, 1.0)


@pytest.mark.parametrize(
    "label, expected",
    [
        ("FLIP of 2x1 [1]", ["FLIP of 2x1 [1]", "difference [1]"]),
        ("FLIP", ["FLIP [1]", "difference [1]"]),
        ("error [JND] of 2x1", ["error [JND] of 2x1", "difference [JND] of 2x1"]),
    ],
)
def test_both_scales_have_units(label, expected):
    assert bars(drawn(predictions(), label)) == expected
