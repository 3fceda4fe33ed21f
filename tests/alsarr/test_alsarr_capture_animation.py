"""Moving parts, the lights on them, and camera paths."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr.capture._animation import Animation, camera_path
from alsarr.capture._camera import Camera
from alsarr.capture._scene import Lights, Material, Mesh, Scene


def triangle(part):
    return Mesh(
        vertex=np.array([[1, 0, 0], [2, 0, 0], [1, 1, 0]], np.float32),
        normal=np.tile(np.array([[0, 0, 1]], np.float32), (3, 1)),
        uv=np.zeros((3, 2), np.float32),
        triangle=np.array([[0, 1, 2]], np.int32),
        material=0,
        part=part,
    )


@pytest.fixture(scope="module")
def moving():
    """Part 1 turns about x = 1 once in 4 s, part 2 goes up and comes back."""
    animation = Animation(
        time=[0, 1, 4],
        pivot=[[1, 0, 0], [0, 0, 0]],
        translation=[[[0, 0, 0]] * 3, [[0, 0, 0], [0, 2, 0], [0, 0, 0]]],
        rotation=[[[0, 0, 0], [0, np.pi / 2, 0], [0, 2 * np.pi, 0]], [[0, 0, 0]] * 3],
        light_part=[0, 2],
    )
    lights = Lights(
        point_position=[(5, 5, 5), (5, 5, 5)], point_intensity=np.ones((2, 3))
    )
    return Scene.of(
        "moving",
        [triangle(part) for part in range(3)],
        [Material()],
        {},
        lights=lights,
        start=(0, 0, 1),
        animation=animation,
    )


def test_what_stands_still_does_not_change_by_a_bit(moving):
    for time in (0, 0.3, 2.7, 100.1):
        now = moving.at(time)
        np.testing.assert_array_equal(now.vertex[:3], moving.vertex[:3])
        np.testing.assert_array_equal(now.normal[:3], moving.normal[:3])
        np.testing.assert_array_equal(now.lights.point_position[0], [5, 5, 5])
    np.testing.assert_array_equal(moving.at(0).vertex, moving.vertex)


def test_parts_turn_about_their_pivot_and_carry_their_normals(moving):
    now = moving.at(1)
    # A quarter turn about y takes x to -z and z to x.
    np.testing.assert_allclose(
        now.vertex[3:6], [[1, 0, 0], [1, 0, -1], [1, 1, 0]], atol=1e-6
    )
    np.testing.assert_allclose(now.normal[3:6], [[1, 0, 0]] * 3, atol=1e-6)
    half = moving.at(0.5).vertex[4]
    np.testing.assert_allclose(half, [1 + 0.5**0.5, 0, -(0.5**0.5)], atol=1e-6)


def test_parts_shift_and_lights_go_with_them(moving):
    now = moving.at(0.5)
    np.testing.assert_allclose(
        now.vertex[6:], np.asarray(moving.vertex[6:]) + [[0, 1, 0]]
    )
    np.testing.assert_allclose(now.lights.point_position[1], [5, 6, 5])
    np.testing.assert_allclose(moving.at(2.5).lights.point_position[1], [5, 6, 5])


def test_motion_repeats_and_shapes_keep_their_size(moving):
    for time in (0.4, 3.1):
        now = moving.at(time)
        np.testing.assert_allclose(now.vertex, moving.at(time + 8).vertex, atol=1e-5)
        sides = jnp.diff(now.vertex.reshape(3, 3, 3), axis=1)
        np.testing.assert_allclose(
            jnp.linalg.norm(sides, axis=-1), [[1, 2**0.5]] * 3, rtol=1e-5
        )
    again = now.at(1)
    assert again is now and now.animation is None


def test_a_pose_can_be_compiled_and_differentiated(moving):
    height = lambda time: moving.animation.pose(time).shift[2, 1]
    slope = jax.jit(jax.grad(height))(jnp.float32(0.25))
    assert float(slope) == pytest.approx(2)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"time": [0]}, "at least two increasing"),
        ({"time": [0, 2, 1]}, "at least two increasing"),
        ({"time": [1, 2, 3]}, "must start at 0 s, got 1"),
        ({"pivot": np.zeros((2, 3))}, r"`translation` must have shape \(2, 3, 3\)"),
        ({"rotation": np.full((1, 3, 3), np.inf)}, "`rotation` must be finite"),
        ({"light_part": [2]}, r"`light_part` must be in \[0, 1\], got 2 to 2"),
    ],
)
def test_an_animation_that_cannot_be_is_refused(change, words):
    keys = {
        "time": [0, 1, 2],
        "pivot": np.zeros((1, 3)),
        "translation": np.zeros((1, 3, 3)),
        "rotation": np.zeros((1, 3, 3)),
    }
    with pytest.raises(ValueError, match=words):
        Animation(**{**keys, **change})


def straight(count=4):
    return [Camera((x, 0.0, 0.0), (0, 0, -1), fov_y=40) for x in range(count)]


def test_a_path_passes_through_its_cameras():
    cameras = [
        Camera((0, 1, 0), (0, 0, -1), fov_y=40),
        Camera((1, 1, -2), (1, 0.2, -1), fov_y=50),
        Camera((4, 2, -2), (1, -0.2, 1), fov_y=60),
    ]
    path = camera_path([0, 1, 3], cameras)
    for time, camera in zip([0, 1, 3], cameras, strict=True):
        got = path.at(time)
        for a, b in zip(jax.tree.leaves(got), jax.tree.leaves(camera), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-6)
    np.testing.assert_allclose(path.at(-1).position, cameras[0].position)
    np.testing.assert_allclose(path.at(99).position, cameras[2].position)


def test_evenly_spaced_cameras_give_an_even_speed():
    path = camera_path([0, 1, 2, 3], straight())
    for time in np.linspace(0, 3, 13):
        np.testing.assert_allclose(path.at(time).position, [time, 0, 0], atol=1e-6)


def test_speed_is_continuous_at_a_key():
    cameras = [Camera((x, 0, 0), (0, 0, -1)) for x in (0.0, 1.0, 1.5, 5.0)]
    path = camera_path([0, 1, 3, 4], cameras)
    speed = lambda time: jax.grad(lambda t: path.at(t).position[0])(jnp.float32(time))
    assert float(speed(1 - 1e-3)) == pytest.approx(float(speed(1 + 1e-3)), abs=0.02)
    # The slope at a key is that from neighbour to neighbour: 1.5 m in 3 s.
    assert float(speed(1 + 1e-3)) == pytest.approx(0.5, abs=0.02)


def test_a_path_needs_a_camera_for_each_time():
    with pytest.raises(ValueError, match="one for each of 3 times, got 4"):
        camera_path([0, 1, 2], straight())
