"""Frames from the buffers of an engine, in OpenEXR images."""

import equinox as eqx
import numpy as np
import pytest

from alsarr._frame import Frame, frame_from_exr, frame_from_jindal2021
from camojab import datasets


SHAPE = (3, 4)
DISPLAY = {"ppd": 60.0, "refresh_rate": 90.0, "resolution_px": (64, 48)}


def write(path, **channels):
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, dict(channels)) as image:
        image.write(str(path))


@pytest.fixture
def arrays():
    rng = np.random.default_rng(0)
    return {
        "texture": rng.integers(0, 300, SHAPE).astype(np.uint32),
        "mip_level": rng.uniform(0, 6, SHAPE).astype(np.float16),
        "motion_x": rng.uniform(-0.5, 0.5, SHAPE).astype(np.float32),
        "motion_y": rng.uniform(-0.5, 0.5, SHAPE).astype(np.float32),
        "luminance": rng.uniform(1, 300, SHAPE).astype(np.float32),
    }


@pytest.fixture
def channels(tmp_path, arrays):
    """All types of channels, their names those of layers, in two files."""
    one, other = tmp_path / "ids.exr", tmp_path / "rest.exr"
    write(one, Id=arrays["texture"], Mip=arrays["mip_level"])
    write(
        other,
        **{
            "motion.X": arrays["motion_x"],
            "motion.Y": arrays["motion_y"],
            "Y": arrays["luminance"],
        },
    )
    return {
        "texture": (one, "Id"),
        "mip_level": (str(one), "Mip"),
        "motion_x": (other, "motion.X"),
        "motion_y": (other, "motion.Y"),
        "luminance": (other, "Y"),
    }


@pytest.mark.parametrize(
    "unit, display, make",
    [
        ("deg/s", (), Frame.from_degrees),
        ("px/frame", ("ppd", "refresh_rate"), Frame.from_pixels_per_frame),
        ("px/frame", tuple(DISPLAY), Frame.from_pixels_per_frame),
        ("uv/frame", tuple(DISPLAY), Frame.from_uv_per_frame),
    ],
)
def test_buffers_become_the_frame_of_their_unit(arrays, channels, unit, display, make):
    display = {name: DISPLAY[name] for name in display}
    found = frame_from_exr(channels, motion_unit=unit, **display)
    assert eqx.tree_equal(found, make(**arrays, **display))


def test_a_hundredth_is_a_share(arrays, channels):
    found = frame_from_exr(channels, motion_unit="percent/frame", **DISPLAY)
    shares = arrays | {n: arrays[n] / 100 for n in ("motion_x", "motion_y")}
    expected = Frame.from_uv_per_frame(**shares, **DISPLAY)
    for name in Frame.UNITS:
        np.testing.assert_allclose(
            getattr(found, name), getattr(expected, name), rtol=1e-6
        )


def test_luminance_and_a_picture_may_come_from_elsewhere(channels):
    del channels["luminance"]
    image = np.full((48, 64, 3), 0.5)
    found = frame_from_exr(
        channels, motion_unit="deg/s", luminance=7.0, previous_image=image
    )
    np.testing.assert_array_equal(found.luminance, np.full(SHAPE, 7))
    np.testing.assert_array_equal(found.previous_image, image)
    with pytest.warns(UserWarning, match="`luminance` was not given"):
        frame_from_exr(channels, motion_unit="deg/s")


def test_the_authors_files(real_data):
    names = ("motion_n.exr", "materials_n.exr")
    names = [f"jindal2021/ALSaRR/sample_data/{name}" for name in names]
    real_data(*names)
    motion, material = (datasets.fetch(name) for name in names)
    stored = datasets.jindal2021_frame()
    for refresh_rate in (60.0, 97.0):
        found = frame_from_exr(
            {
                "texture": (material, "R"),
                "mip_level": (material, "G"),
                "motion_x": (motion, "R"),
                "motion_y": (motion, "G"),
            },
            motion_unit="percent/frame",
            ppd=60.0,
            refresh_rate=refresh_rate,
            resolution_px=(1920, 1080),
            luminance=50.0,
        )
        expected = frame_from_jindal2021(
            motion_x=stored.motion_x,
            motion_y=stored.motion_y,
            material=stored.material,
            mip_level=stored.mip_level,
            refresh_rate=refresh_rate,
        )
        assert found.shape == (67, 120)
        assert eqx.tree_equal(found, expected)


@pytest.mark.parametrize(
    "options, message",
    [
        ({"motion_unit": "px/frame"}, "`ppd` must be given for motion in px/frame"),
        (
            {"motion_unit": "uv/frame", "ppd": 60.0, "refresh_rate": 60.0},
            "`resolution_px` must be given for motion in uv/frame",
        ),
        ({"motion_unit": "deg/s", "luminance": 5.0}, "`luminance` must be left out"),
    ],
)
def test_requests_that_lack_or_repeat_something(channels, options, message):
    with pytest.raises(ValueError, match=message):
        frame_from_exr(channels, **options)


def test_buffers_that_are_missing_or_unknown(channels):
    without = {k: v for k, v in channels.items() if k != "motion_y"}
    with pytest.raises(ValueError, match="`channels` must be texture, .* perhaps"):
        frame_from_exr(without, motion_unit="deg/s")
    with pytest.raises(ValueError, match="`channels` must be .*, got .*, depth"):
        frame_from_exr(channels | {"depth": channels["luminance"]}, motion_unit="deg/s")
    channels["mip_level"] = channels["mip_level"][0], "Level"
    with pytest.raises(ValueError, match="ids.exr: must have the channel Level, got "):
        frame_from_exr(channels, motion_unit="deg/s")


def test_motion_in_the_wrong_unit_is_told(channels):
    channels["motion_x"] = channels["luminance"]
    with pytest.raises(ValueError, match="`motion_x` .* looks like pixels"):
        frame_from_exr(channels, motion_unit="uv/frame", **DISPLAY)


def test_files_that_cannot_be_read_are_named(tmp_path, channels):
    path = channels["texture"][0]
    whole = path.read_bytes()
    for content in (
        b"",
        b"no image" * 50,
        whole[:60],
        whole[:-20],
        # A name that is no text.
        whole.replace(b"Mip\0", b"\xffip\0"),
    ):
        path.write_bytes(content)
        with pytest.raises(ValueError, match="ids.exr: must be a whole OpenEXR image"):
            frame_from_exr(channels, motion_unit="deg/s")
    path.unlink()
    with pytest.raises(FileNotFoundError):
        frame_from_exr(channels, motion_unit="deg/s")


def test_images_that_leave_pixels_out_are_refused(tmp_path, channels):
    import OpenEXR

    window = (np.array([0, 0], np.int32), np.array([9, 9], np.int32))
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "displayWindow": window,
    }
    path = channels["texture"][0]
    pixels = {"Id": np.zeros(SHAPE, np.uint32), "Mip": np.zeros(SHAPE, np.float32)}
    with OpenEXR.File(header, pixels) as image:
        image.write(str(path))
    with pytest.raises(ValueError, match="ids.exr: must have pixels in all of its"):
        frame_from_exr(channels, motion_unit="deg/s")


def test_buffers_of_different_sizes_are_refused(tmp_path, channels):
    write(tmp_path / "small.exr", Y=np.ones((2, 2), np.float32))
    channels["luminance"] = (tmp_path / "small.exr", "Y")
    with pytest.raises(ValueError, match="`luminance` must have the shape of `text"):
        frame_from_exr(channels, motion_unit="deg/s")
