"""The camera: pixels to rays and back."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from alsarr.capture._camera import Camera


WIDTH, HEIGHT = 64, 40


def around(seed):
    rng = np.random.default_rng(seed)
    forward = rng.normal(size=3)
    return Camera(rng.uniform(-5, 5, 3), forward, fov_y=rng.uniform(20, 110))


def test_the_middle_of_the_picture_looks_forward():
    camera = around(0)
    ray = camera.rays(jnp.array(WIDTH / 2), jnp.array(HEIGHT / 2), WIDTH, HEIGHT)
    np.testing.assert_allclose(ray, camera.forward, atol=1e-6)


def test_looking_along_minus_z_x_is_right_and_rows_go_down():
    camera = Camera((0, 0, 0), (0, 0, -2), fov_y=90)
    np.testing.assert_allclose(camera.right, [1, 0, 0], atol=1e-7)
    x, y, depth = camera.project(jnp.array([1.0, 1.0, -2.0]), 100, 100)
    # tan(45 deg) = 1: at depth 2 the picture spans -2 to 2 on both axes.
    np.testing.assert_allclose([x, y, depth], [75, 25, 2], rtol=1e-6)
    corner = camera.rays(jnp.array(0.0), jnp.array(0.0), 100, 100)
    np.testing.assert_allclose(corner, np.array([-1, 1, -1]) / 3**0.5, rtol=1e-6)


def test_the_angle_of_view_is_the_full_vertical_one():
    camera = Camera((0, 0, 0), (0, 0, -1), fov_y=50)
    y = jnp.array([0.0, HEIGHT])
    top, bottom = camera.rays(jnp.full(2, WIDTH / 2), y, WIDTH, HEIGHT)
    angle = np.degrees(np.arccos(np.dot(np.asarray(top), np.asarray(bottom))))
    assert angle == pytest.approx(50, rel=1e-5)


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 2**16))
def test_projecting_a_ray_gives_its_pixel_back(seed):
    camera, rng = around(seed), np.random.default_rng(seed + 1)
    x = jnp.asarray(rng.uniform(0, WIDTH, (3, 4)), jnp.float32)
    y = jnp.asarray(rng.uniform(0, HEIGHT, (3, 4)), jnp.float32)
    ray = camera.rays(x, y, WIDTH, HEIGHT)
    assert ray.shape == (3, 4, 3) and ray.dtype == jnp.float32
    np.testing.assert_allclose(jnp.linalg.norm(ray, axis=-1), 1, atol=1e-6)
    away = jnp.asarray(rng.uniform(0.5, 20, (3, 4, 1)), jnp.float32)
    seen_x, seen_y, depth = camera.project(
        jnp.broadcast_to(camera.position, ray.shape) + away * ray, WIDTH, HEIGHT
    )
    # Positions up to 25 m have steps of 2e-6 m; at 0.5 m that is about 1e-3 px.
    np.testing.assert_allclose(seen_x, x, atol=2e-3)
    np.testing.assert_allclose(seen_y, y, atol=2e-3)
    forward = np.asarray(ray) @ np.asarray(camera.forward)
    np.testing.assert_allclose(depth, away[..., 0] * forward, rtol=1e-4)


def test_axes_are_orthogonal_units_whatever_was_given():
    camera = Camera((1, 2, 3), (3, -1, 2), up=(0.2, 5, 0.1))
    axes = np.stack([camera.right, camera.up, camera.forward])
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-6)
    assert camera.up[1] > 0
    # Right-handed: right x up points backwards.
    np.testing.assert_allclose(np.cross(axes[0], axes[1]), -axes[2], atol=1e-6)


def test_look_at_puts_the_target_in_the_middle():
    camera = Camera.look_at((1, 2, 3), (4, 0, -3))
    x, y, depth = camera.project(jnp.array([4.0, 0.0, -3.0]), WIDTH, HEIGHT)
    np.testing.assert_allclose([x, y, depth], [WIDTH / 2, HEIGHT / 2, 7], rtol=1e-5)


def test_a_point_behind_has_no_place():
    camera = Camera((0, 0, 0), (0, 0, -1))
    behind = jnp.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    x, y, depth = camera.project(behind, WIDTH, HEIGHT)
    assert jnp.all(jnp.isnan(x)) and jnp.all(jnp.isnan(y))
    np.testing.assert_allclose(depth, [-1, 0], atol=1e-7)


def test_cameras_can_be_made_and_used_in_compiled_code():
    def ray(position, angle):
        camera = Camera(position, (0, 0, -1), fov_y=angle)
        return camera.rays(jnp.array(3.0), jnp.array(2.0), WIDTH, HEIGHT)

    position, angle = jnp.zeros(3, jnp.float32), jnp.float32(45)
    np.testing.assert_allclose(
        jax.jit(ray)(position, angle), ray(position, angle), rtol=1e-6
    )


@pytest.mark.parametrize(
    ("arguments", "options", "words"),
    [
        (((0, 0), (0, 0, -1)), {}, "`position` must have shape [3], got [2]."),
        (((0, 0, np.nan), (0, 0, -1)), {}, "`position` must be finite"),
        (((0, 0, 0), (0, 0, 0)), {}, "`forward` must be not 0"),
        (((0, 0, 0), (0, 1, 0)), {}, "`up` must be a direction other than"),
        (((0, 0, 0), (0, 0, 1)), {"fov_y": 180}, "`fov_y` must be in (0, 180) deg"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(arguments, options, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        Camera(*arguments, **options)
