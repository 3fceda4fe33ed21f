"""The picture before a frame, and the luminance of its tiles."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from alsarr._frame import Frame, load_frame, save_frame, tile_luminance
from camojab import luminance


SHAPE = (3, 2)


def frame(**changes):
    values = {
        "texture": np.zeros(SHAPE, int),
        "mip_level": 0.0,
        "velocity_x": 1.0,
        "velocity_y": 2.0,
        "luminance": 80.0,
    }
    return Frame(**values | changes)


def picture(height, width, seed=0):
    return np.random.default_rng(seed).uniform(0, 1, (height, width, 3))


@pytest.mark.parametrize("height", [33, 40, 48])
@pytest.mark.parametrize("width", [17, 32])
def test_pictures_may_end_within_the_last_tiles(height, width):
    image = picture(height, width)
    kept = frame(previous_image=image).previous_image
    np.testing.assert_allclose(kept, image, rtol=1e-6)
    assert kept.dtype == jnp.result_type(float)


@pytest.mark.parametrize(
    "image, message",
    [
        (picture(32, 32), r"must have the tiles of `texture`, \(3, 2\), got \(2, 2\)"),
        (picture(49, 32), r"got \(4, 2\), those of 32 x 49 px"),
        (picture(48, 33), r"got \(3, 3\)"),
        (picture(48, 32)[..., 0], r"shape \[height, width, 3\], .* got \(48, 32\)"),
        (np.ones((48, 32, 4)), r"shape \[height, width, 3\], .* got \(48, 32, 4\)"),
        (np.ones((0, 32, 3)), "none of them 0"),
        (picture(48, 32) + 1, r"must be in \[0, 1\], got 1"),
        (-picture(48, 32), r"must be in \[0, 1\], got -"),
        (np.full((48, 32, 3), np.nan), r"must be in \[0, 1\], got nan"),
        (np.full((48, 32, 3), -1), r"must be in \[0, 1\], got -"),
    ],
)
def test_pictures_that_do_not_fit_are_refused(image, message):
    with pytest.raises(ValueError, match="`previous_image` .*" + message):
        frame(previous_image=image)


def test_integers_count_to_the_largest_of_their_type():
    image = np.random.default_rng(0).integers(0, 256, (48, 32, 3), np.uint8)
    kept = frame(previous_image=image).previous_image
    np.testing.assert_allclose(kept, image / 255, rtol=1e-6)


def test_frames_with_pictures_stack_and_map():
    frames = [frame(previous_image=picture(40, 20, seed)) for seed in range(3)]
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *frames)
    found = jax.vmap(lambda f: tile_luminance(f.previous_image, 100.0))(stacked)
    for each, one in zip(found, frames, strict=True):
        np.testing.assert_allclose(
            each, tile_luminance(one.previous_image, 100.0), rtol=1e-5
        )


def test_a_picture_is_part_of_the_file(tmp_path):
    path = tmp_path / "frame.npz"
    with_picture, without = frame(previous_image=picture(40, 20)), frame()
    for given_frame in (with_picture, without):
        save_frame(path, given_frame)
        assert eqx.tree_equal(load_frame(path), given_frame)
    with np.load(path) as stored:
        assert set(stored.files) == set(Frame.UNITS)


def buffers(height=40, width=20, seed=0):
    random = np.random.default_rng(seed)
    return {"seen": random.random((height, width)), "normal_z": -np.ones((48, 32))}


def test_channels_are_kept_by_name_and_part_of_the_file(tmp_path):
    given_frame = frame(channels=buffers())
    assert given_frame.channels.keys() == {"seen", "normal_z"}
    np.testing.assert_allclose(given_frame.channels["seen"], buffers()["seen"], 1e-6)
    save_frame(tmp_path / "frame.npz", given_frame)
    assert eqx.tree_equal(load_frame(tmp_path / "frame.npz"), given_frame)


@pytest.mark.parametrize(
    "channel, message",
    [
        (
            np.ones((32, 32)),
            r"must have the tiles of `texture`, \(3, 2\), got \(2, 2\)",
        ),
        (np.ones((48, 32, 1)), r"shape \[height, width\], .* got \(48, 32, 1\)"),
        (np.ones((0, 0)), "none of them 0"),
        (np.full((48, 32), np.inf), "must be finite, got inf"),
    ],
)
def test_channels_that_do_not_fit_are_refused(channel, message):
    with pytest.raises(ValueError, match=r'`channels\["depth"\]` .*' + message):
        frame(channels={"depth": channel})


def test_luminance_left_out_has_a_default_and_a_warning(tmp_path):
    message = r"`luminance` was not given and is taken as 50 cd/m\^2"
    tiles = {"texture": np.zeros(SHAPE, int), "mip_level": 0}
    motion = {"motion_x": 0.5, "motion_y": 0.5}
    display = {"ppd": 60, "refresh_rate": 60}
    size = {"resolution_px": (32, 48)}
    for make in (
        lambda: frame(luminance=None),
        lambda: Frame.from_degrees(**tiles, **motion),
        lambda: Frame.from_pixels_per_frame(**tiles, **motion, **display),
        lambda: Frame.from_uv_per_frame(**tiles, **motion, **display, **size),
    ):
        with pytest.warns(UserWarning, match=message):
            made = make()
        np.testing.assert_array_equal(made.luminance, np.full(SHAPE, 50))
    arrays = {n: np.asarray(getattr(made, n)) for n in Frame.UNITS if n != "luminance"}
    np.savez(tmp_path / "frame.npz", **arrays)
    with pytest.warns(UserWarning, match=message):
        assert eqx.tree_equal(load_frame(tmp_path / "frame.npz"), made)


@pytest.mark.parametrize("size", [(48, 32), (40, 20), (33, 31)])
def test_luminance_is_the_mean_light_of_the_pixels_that_exist(size):
    image = picture(*size)
    # Of colour-science, whose weights of red, green and blue have as many digits.
    light = luminance(image, encoding="sRGB")
    expected = [
        [light[y : y + 16, x : x + 16].mean() for x in range(0, size[1], 16)]
        for y in range(0, size[0], 16)
    ]
    found = tile_luminance(image, 300)
    np.testing.assert_allclose(found, 300 * np.array(expected), rtol=2e-6)


@settings(deadline=None, max_examples=20)
@given(st.floats(0, 1), st.floats(1e-3, 1e4))
def test_a_uniform_grey_has_its_luminance_in_every_tile(value, peak):
    found = tile_luminance(np.full((17, 35, 3), value), peak)
    exact = peak * float(luminance(np.full((1, 1, 3), value), encoding="sRGB")[0, 0])
    np.testing.assert_allclose(found, np.full((2, 3), exact), rtol=1e-5, atol=1e-12)


def test_black_and_white():
    np.testing.assert_array_equal(tile_luminance(np.zeros((5, 5, 3)), 1e4), 0)
    white = tile_luminance(np.ones((5, 5, 3)), 1e4)
    np.testing.assert_allclose(white, 1e4, rtol=1e-6)


def test_gradient_of_luminance_is_finite_from_black_to_white():
    image = np.linspace(0, 1, 17 * 16 * 3).reshape(17, 16, 3)
    gradient = jax.grad(lambda x: tile_luminance(x, 100.0).sum())(jnp.asarray(image))
    assert np.all(np.isfinite(gradient)) and np.all(gradient > 0)


@pytest.mark.parametrize("peak", [0, -1, np.inf, np.nan])
def test_a_display_without_a_peak_is_refused(peak):
    with pytest.raises(ValueError, match="`peak_luminance` must be > 0 cd/m"):
        tile_luminance(picture(16, 16), peak)


def test_a_picture_out_of_range_has_no_luminance():
    with pytest.raises(ValueError, match=r"`image` must be in \[0, 1\], got 2"):
        tile_luminance(np.full((4, 4, 3), 2.0), 100)
