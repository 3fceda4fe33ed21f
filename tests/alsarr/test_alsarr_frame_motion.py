"""The units of motion: degrees a second, pixels a frame, shares of the picture."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from alsarr._frame import Frame


DISPLAY = {"ppd": 60.0, "refresh_rate": 90.0}


def tiles(**changes):
    values = {
        "texture": np.zeros((2, 3), int),
        "mip_level": 0.0,
        "motion_x": 0.0,
        "motion_y": 0.0,
        "luminance": 80.0,
    }
    return values | changes


@settings(deadline=None, max_examples=30)
@given(
    st.floats(-1, 1),
    st.floats(-1, 1),
    st.integers(1, 8000),
    st.integers(1, 8000),
    st.floats(10, 100),
    st.floats(1, 500),
)
def test_three_units_of_one_motion(u, v, width, height, ppd, refresh_rate):
    display = {"ppd": ppd, "refresh_rate": refresh_rate}
    size = {"resolution_px": (width, height)}
    share = Frame.from_uv_per_frame(**tiles(motion_x=u, motion_y=v), **display, **size)
    pixels = tiles(motion_x=u * width, motion_y=v * height)
    degrees = tiles(
        motion_x=u * width * refresh_rate / ppd,
        motion_y=v * height * refresh_rate / ppd,
    )
    for other in (
        # Rounding may take a share of 1 beyond it.
        Frame.from_pixels_per_frame(**pixels, **display),
        Frame.from_degrees(**degrees),
    ):
        for name in ("velocity_x", "velocity_y"):
            np.testing.assert_allclose(
                getattr(share, name), getattr(other, name), rtol=3e-6, atol=1e-30
            )


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("value", [1.5, -40, np.nan, np.inf])
def test_shares_beyond_the_picture_look_like_pixels(axis, value):
    motion = {f"motion_{axis}": np.array([[0, 0.1, 0], [0, 0, value]])}
    with pytest.raises(
        ValueError, match=rf"`motion_{axis}` .* within \+-1 .*pixels.*, got"
    ):
        Frame.from_uv_per_frame(**tiles(**motion), **DISPLAY, resolution_px=(48, 32))


@pytest.mark.parametrize("axis, most", [("x", 48), ("y", 32)])
def test_pixels_beyond_a_known_picture_look_like_degrees(axis, most):
    size = {"resolution_px": (48, 32)}
    edge = tiles(**{f"motion_{axis}": -float(most)})
    Frame.from_pixels_per_frame(**edge, **DISPLAY, **size)
    beyond = tiles(**{f"motion_{axis}": most + 1.0})
    with pytest.raises(
        ValueError,
        match=rf"`motion_{axis}` must be within \+-{most} px.*deg/s.*, got {most + 1}",
    ):
        Frame.from_pixels_per_frame(**beyond, **DISPLAY, **size)
    # Nothing is known of the picture, so nothing can be said.
    Frame.from_pixels_per_frame(**beyond, **DISPLAY)


@pytest.mark.parametrize("size", [(0, 32), (48, -1)])
def test_a_picture_without_pixels_is_refused(size):
    for make in (Frame.from_uv_per_frame, Frame.from_pixels_per_frame):
        with pytest.raises(ValueError, match="`resolution_px` must be a width and a"):
            make(**tiles(), **DISPLAY, resolution_px=size)


def test_traced_motion_is_checked_at_run_time():
    def speed(u):
        frame = Frame.from_uv_per_frame(
            **tiles(motion_x=u), **DISPLAY, resolution_px=(48, 32)
        )
        return frame.velocity_x

    traced = eqx.filter_jit(speed)
    np.testing.assert_allclose(traced(jnp.asarray(0.5)), speed(0.5), rtol=1e-6)
    with pytest.raises(RuntimeError, match="looks like pixels"):
        traced(jnp.asarray(20.0))


def test_half_precision_motion_is_widened_first():
    motion = np.full((2, 3), 0.1, np.float16)
    found = Frame.from_uv_per_frame(
        **tiles(motion_x=motion), **DISPLAY, resolution_px=(7680, 4320)
    )
    exact = float(np.float16(0.1)) * 7680 * 90 / 60
    np.testing.assert_allclose(found.velocity_x, exact, rtol=1e-6)
