import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from alsarr._frame import (
    Frame,
    frame_from_jindal2021,
    load_frame,
    procedural_frame,
    save_frame,
)


def fields(**changes):
    values = {
        "texture": np.array([[0, 1, 2], [2, 1, 0]]),
        "mip_level": np.full((2, 3), 1.5),
        "velocity_x": np.arange(6.0).reshape(2, 3),
        "velocity_y": np.zeros((2, 3)),
        "luminance": np.full((2, 3), 50.0),
    }
    return values | changes


def motion(**changes):
    values = fields(**changes)
    return {k.replace("velocity", "motion"): v for k, v in values.items()}


def test_fields_are_kept_and_shape_is_rows_by_columns():
    frame = Frame(**fields())
    assert frame.shape == (2, 3)
    for name, value in fields().items():
        np.testing.assert_array_equal(getattr(frame, name), value)


def test_single_numbers_fill_the_frame():
    frame = Frame(**fields(luminance=20, velocity_y=3))
    np.testing.assert_array_equal(frame.luminance, np.full((2, 3), 20))
    np.testing.assert_array_equal(frame.velocity_y, np.full((2, 3), 3))


def test_half_precision_buffers_are_widened():
    frame = Frame(**fields(luminance=np.full((2, 3), 50, np.float16)))
    assert frame.luminance.dtype == jnp.result_type(float)


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"texture": np.zeros(3, int)}, r"`texture` must have shape \[rows, columns\]"),
        ({"texture": np.zeros((0, 3), int)}, r"none of them 0, got \(0, 3\)"),
        ({"texture": np.full((2, 3), -1)}, r"`texture` .* whole number >= 0, got -1"),
        ({"texture": np.full((2, 3), 0.5)}, r"`texture` must be a whole .*, got 0\.5"),
        ({"texture": np.full((2, 3), np.nan)}, "`texture` must be a whole .*, got nan"),
        (
            {"mip_level": np.zeros((3, 2))},
            r"`mip_level` must have the shape of `texture`, \(2, 3\), got \(3, 2\)",
        ),
        ({"mip_level": -1}, "`mip_level` must be >= 0 octaves and finite, got -1"),
        ({"velocity_x": -2.5}, r"`velocity_x` must be >= 0 deg/s and .*, got -2\.5"),
        ({"velocity_y": np.nan}, "`velocity_y` must be >= 0 deg/s and .*, got nan"),
        ({"luminance": np.inf}, r"`luminance` must be >= 0 cd/m\^2 and .*, got inf"),
    ],
)
def test_what_is_wrong_is_named(changes, message):
    with pytest.raises(ValueError, match=message):
        Frame(**fields(**changes))


def test_traced_values_are_checked_at_run_time():
    traced = eqx.filter_jit(
        lambda arrays: Frame(**arrays).luminance,
    )
    arrays = {k: jnp.asarray(v) for k, v in fields().items()}
    np.testing.assert_array_equal(traced(arrays), arrays["luminance"])
    with pytest.raises(RuntimeError, match="`luminance` must be >= 0"):
        traced(arrays | {"luminance": -arrays["luminance"]})


def test_signed_motion_becomes_speed():
    frame = Frame.from_degrees(**motion(velocity_x=np.full((2, 3), -4.0)))
    np.testing.assert_array_equal(frame.velocity_x, np.full((2, 3), 4))


@settings(deadline=None, max_examples=30)
@given(st.floats(-50, 50), st.floats(10, 100), st.floats(1, 500))
def test_pixels_per_frame_are_degrees_per_second(pixels, ppd, refresh_rate):
    frame = Frame.from_pixels_per_frame(
        **motion(velocity_x=np.full((2, 3), pixels)),
        ppd=ppd,
        refresh_rate=refresh_rate,
    )
    expected = abs(pixels) * refresh_rate / ppd
    np.testing.assert_allclose(frame.velocity_x, expected, rtol=1e-6, atol=1e-30)


@pytest.mark.parametrize("name", ["ppd", "refresh_rate"])
def test_a_display_without_pixels_or_frames_is_refused(name):
    display = {"ppd": 60, "refresh_rate": 60, name: 0}
    with pytest.raises(ValueError, match=f"`{name}` must be > 0 .*, got 0"):
        Frame.from_pixels_per_frame(**motion(), **display)


def test_jindal2021_motion_is_in_hundredths_of_the_screen():
    one = np.ones((1, 1))
    stored = {"motion_x": one, "motion_y": one, "material": one, "mip_level": one}
    frame = frame_from_jindal2021(**stored)
    # One hundredth of 1920 px (1080 px) at 60 frames/s and 60 px/deg.
    np.testing.assert_allclose(frame.velocity_x, 19.2, rtol=1e-6)
    np.testing.assert_allclose(frame.velocity_y, 10.8, rtol=1e-6)
    np.testing.assert_array_equal(frame.luminance, 50)
    other = frame_from_jindal2021(
        **stored, ppd=30, refresh_rate=120, resolution_px=(960, 540), luminance=7
    )
    np.testing.assert_allclose(other.velocity_x, 38.4, rtol=1e-6)
    np.testing.assert_allclose(other.velocity_y, 21.6, rtol=1e-6)
    np.testing.assert_array_equal(other.luminance, 7)


def test_procedural_frame_depends_on_its_arguments_alone():
    frame = procedural_frame(5, rows=34, columns=60, seed=3)
    again = procedural_frame(5, rows=34, columns=60, seed=3)
    other = procedural_frame(5, rows=34, columns=60, seed=4)
    assert eqx.tree_equal(frame, again)
    assert not np.array_equal(frame.luminance, other.luminance)
    assert not np.array_equal(frame.velocity_x, other.velocity_x)


@pytest.mark.parametrize("textures", [1, 2, 6, 40])
@pytest.mark.parametrize("size", [(1, 1), (34, 60), (68, 120)])
def test_procedural_frame_is_plausible(textures, size):
    rows, columns = size
    frame = procedural_frame(textures, rows=rows, columns=columns, seed=0)
    assert frame.shape == size
    assert 0 <= frame.texture.min() and frame.texture.max() < textures
    np.testing.assert_allclose(frame.luminance.min(), 1, rtol=1e-6)
    if rows * columns > 1:
        np.testing.assert_allclose(frame.luminance.max(), 300, rtol=1e-5)
    assert frame.velocity_x.max() < 60 and frame.velocity_y.max() < 60
    assert frame.mip_level.max() <= 11


def test_procedural_scene_has_distance_motion_light_and_shade():
    frame = procedural_frame(6, rows=68, columns=120, seed=0)
    assert set(np.unique(frame.texture)) == set(range(6))
    # The floor below the vanishing point comes nearer towards the viewer.
    floor = np.asarray(frame.mip_level)[35:, 60]
    assert np.all(np.diff(floor) <= 0) and floor[0] > floor[-1]
    assert frame.velocity_x.max() > 15 and frame.velocity_y.max() > 10
    assert 20 < np.median(frame.luminance) < 80
    top, bottom = np.asarray(frame.velocity_y)[[30, -1]].mean(axis=1)
    assert bottom > 5 * top


@pytest.mark.parametrize("name", ["textures", "rows", "columns"])
def test_procedural_frame_needs_a_size(name):
    sizes = {"textures": 1, "rows": 1, "columns": 1, name: 0}
    with pytest.raises(ValueError, match=f"`{name}` must be >= 1, got 0"):
        procedural_frame(**sizes, seed=0)


@pytest.mark.parametrize("name", ["frame.npz", "no_suffix"])
def test_round_trip_through_a_file(tmp_path, name):
    frame = procedural_frame(3, rows=5, columns=7, seed=0)
    save_frame(tmp_path / name, frame)
    assert eqx.tree_equal(load_frame(tmp_path / name), frame)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_files_that_are_no_frames_are_refused(tmp_path):
    path = tmp_path / "frame.npz"
    with pytest.raises(FileNotFoundError):
        load_frame(path)
    path.write_bytes(b"")
    with pytest.raises(ValueError, match="frame.npz: is no NPZ file"):
        load_frame(path)
    np.savez(path, texture=np.zeros((1, 1)), luminance=np.ones((1, 1)))
    with pytest.raises(ValueError, match="lacks the arrays mip_level, velocity_x, vel"):
        load_frame(path)
    np.savez(path, **fields(luminance=np.array([[None]])))
    with pytest.raises(ValueError, match="something else than whole, plain arrays"):
        load_frame(path)
    np.savez(path, **fields(luminance=np.full((2, 3), -1.0)))
    with pytest.raises(ValueError, match="`luminance` must be >= 0"):
        load_frame(path)


def test_a_damaged_file_is_refused(tmp_path):
    path = tmp_path / "frame.npz"
    save_frame(path, procedural_frame(3, rows=5, columns=7, seed=0))
    whole = bytearray(path.read_bytes())
    whole[100] ^= 0xFF
    path.write_bytes(whole)
    with pytest.raises(ValueError, match="frame.npz: "):
        load_frame(path)


def test_a_file_with_a_broken_directory_is_refused(tmp_path):
    """The end of an archive is whole, so that it looks like one."""
    path = tmp_path / "frame.npz"
    np.savez(path, **{name: np.ones((2, 2), int) for name in Frame.UNITS})
    content = path.read_bytes()
    path.write_bytes(content.replace(b"PK\x01\x02", b"PK\x01\x09"))
    with pytest.raises(ValueError, match="frame.npz: holds something else than whole"):
        load_frame(path)
