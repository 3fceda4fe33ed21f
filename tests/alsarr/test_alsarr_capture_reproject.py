"""Where a point was in the previous picture, and whether it was seen there."""

import jax.numpy as jnp
import numpy as np
import pytest

from alsarr.capture import (
    Animation,
    Camera,
    capture_view,
    Lights,
    Material,
    Mesh,
    Scene,
)


SIZE = 48, 32
BATCH = 512
# A box above a floor, each of which gives off light of one colour and reflects none.
LOW, HIGH = np.array([-0.6, 0.7, -0.5]), np.array([0.6, 1.5, 0.5])
HALF = 12.0
SHIFT = np.array([1.0, 0.0, 0.2])
INTERVAL = 0.5


def rectangle(corners, material, part=0):
    vertex = np.array(corners, np.float32)
    normal = np.cross(vertex[1] - vertex[0], vertex[2] - vertex[0])
    normal = np.tile(normal / np.linalg.norm(normal), (4, 1)).astype(np.float32)
    triangle = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Mesh(vertex, normal, np.zeros((4, 2), np.float32), triangle, material, part)


@pytest.fixture(scope="module")
def scene():
    """The box stands at 0 s and has moved by SHIFT at INTERVAL."""
    (a, b, c), (d, e, f) = LOW, HIGH
    sides = [
        [(a, e, f), (d, e, f), (d, e, c), (a, e, c)],
        [(a, b, f), (d, b, f), (d, e, f), (a, e, f)],
        [(d, b, c), (a, b, c), (a, e, c), (d, e, c)],
        [(d, b, f), (d, b, c), (d, e, c), (d, e, f)],
        [(a, b, c), (a, b, f), (a, e, f), (a, e, c)],
    ]
    ground = [(-HALF, 0, HALF), (HALF, 0, HALF), (HALF, 0, -HALF), (-HALF, 0, -HALF)]
    still = np.zeros((1, 3, 3))
    return Scene.of(
        "glowing",
        [rectangle(ground, 0), *(rectangle(side, 1, 1) for side in sides)],
        [
            Material((0, 0, 0), emissive=(0.1, 0.9, 0.2)),
            Material((0, 0, 0), emissive=(0.8, 0.1, 0.1)),
        ],
        {},
        lights=Lights(),
        start=(0, 1.5, 3),
        animation=Animation(
            [0.0, INTERVAL, 4.0], [(0, 0, 0)], [[(0, 0, 0), SHIFT, SHIFT]], still
        ),
    )


# From afar and steeply: at so few pixels, neighbours on the floor would else differ by
# more than the tolerance in depth.
NOW = Camera.look_at((2.0, 12.0, 9.0), (0.0, 0.6, 0.0), fov_y=17.0)
BEFORE = Camera.look_at((-1.0, 12.5, 9.0), (0.6, 0.6, 0.3), fov_y=17.0)


def capture(scene, now, before, time=0.0):
    return capture_view(
        scene, now, before, size=SIZE, time=time, interval=INTERVAL, batch=BATCH
    )


@pytest.fixture(scope="module")
def standing(scene):
    """Two viewpoints of the box where it stands."""
    return capture(scene.at(0.0), NOW, BEFORE)


def rays():
    y, x = np.mgrid[: SIZE[1], : SIZE[0]] + 0.5
    ways = NOW.rays(jnp.asarray(x), jnp.asarray(y), *SIZE)
    return np.stack([x, y], axis=2), np.asarray(ways, float)


def enters(origin, direction, low=LOW, high=HIGH):
    """Where rays enter a box; infinite where they pass by."""
    with np.errstate(divide="ignore"):
        ends = np.stack([(low - origin) / direction, (high - origin) / direction])
    enter, leave = ends.min(axis=0).max(axis=-1), ends.max(axis=0).min(axis=-1)
    return np.where((enter <= leave) & (leave > 0), enter, np.inf)


def floor():
    """Pixels that show the floor, and its points there."""
    _, ways = rays()
    origin = np.asarray(NOW.position, float)
    distance = -origin[1] / ways[..., 1]
    place = origin + distance[..., None] * ways
    within = (np.abs(place[..., [0, 2]]) < HALF).all(axis=-1) & (distance > 0)
    return within & np.isinf(enters(origin, ways, LOW - 0.01, HIGH + 0.01)), place


def projected(camera, place):
    """Pixel coordinates, in double precision."""
    axes = [np.asarray(v, float) for v in (camera.right, camera.up, camera.forward)]
    away = place - np.asarray(camera.position, float)
    x, y, depth = np.moveaxis(away @ np.array(axes).T, -1, 0)
    scale = SIZE[1] / 2 / np.tan(np.radians(float(camera.fov_y)) / 2) / depth
    return np.stack([SIZE[0] / 2 + scale * x, SIZE[1] / 2 - scale * y], axis=-1)


def test_motion_is_the_difference_of_two_projections(standing):
    shown, place = floor()
    pixel, _ = rays()
    expected = pixel - projected(BEFORE, place)
    np.testing.assert_allclose(standing.motion[shown], expected[shown], atol=2e-3)
    assert np.abs(expected[shown]).max() > 3


def test_seen_is_what_the_box_did_not_hide_and_the_picture_held(standing):
    shown, place = floor()
    before = projected(BEFORE, place)
    origin = np.asarray(BEFORE.position, float)
    sights = []
    # Edges of the box and of the picture are left out, by a pixel and a half.
    for dx, dy in ((0, 0), (1.5, 1.5), (-1.5, 1.5), (1.5, -1.5), (-1.5, -1.5)):
        x, y = (jnp.asarray(before[..., i] + d) for i, d in enumerate((dx, dy)))
        ways = np.asarray(BEFORE.rays(x, y, *SIZE), float)
        free = np.isinf(enters(origin, ways))
        inside = (before + (dx, dy) >= 0) & (before + (dx, dy) < SIZE)
        sights.append(free & inside.all(axis=-1))
    clear = shown & (np.all(sights, axis=0) | ~np.any(sights, axis=0))
    assert clear.sum() > 0.8 * shown.sum()
    expected = sights[0][clear]
    assert 40 < (~expected).sum() < expected.size - 40
    np.testing.assert_array_equal(standing.seen[clear], expected)


def test_colours_are_never_mixed_across_an_edge(standing):
    """Of two things of one colour each, only those colours are ever found."""
    origin = np.asarray(NOW.position, float)
    _, ways = rays()
    shown, _ = floor()
    block = np.isfinite(enters(origin, ways, LOW + 0.01, HIGH - 0.01))
    for part in (shown, block):
        found = standing.reprojected[part & standing.seen]
        assert len(found) > 50
        np.testing.assert_array_equal(found, np.tile(found[0], (len(found), 1)))
    np.testing.assert_array_equal(standing.reprojected[~standing.seen], 0)


def test_the_same_viewpoint_twice_is_the_same_picture(scene):
    view = capture(scene.at(0.0), NOW, NOW)
    assert view.seen.all()
    np.testing.assert_array_equal(view.reprojected, view.reference)
    # What is left is the rounding of single precision at this distance.
    np.testing.assert_allclose(view.motion, 0, atol=2e-3)


def test_a_part_that_moves_takes_its_points_with_it(scene):
    view = capture(scene, NOW, NOW, time=INTERVAL)
    origin = np.asarray(NOW.position, float)
    pixel, ways = rays()
    margin = 0.01
    low, high = LOW + SHIFT, HIGH + SHIFT
    inside = enters(origin, ways, low + margin, high - margin)
    block = np.isfinite(inside)
    distance = np.where(block, enters(origin, ways, low, high), 0)
    place = origin + distance[..., None] * ways
    expected = pixel - projected(NOW, place - SHIFT)
    np.testing.assert_allclose(view.motion[block], expected[block], atol=3e-3)
    assert view.seen[block].mean() > 0.6
    ground = np.isinf(enters(origin, ways, low - margin, high + margin))
    ground &= ways[..., 1] < -0.2
    np.testing.assert_allclose(view.motion[ground], 0, atol=2e-3)
    # Floor that the box stood before is new; a pixel is 0.14 m wide.
    hidden = np.isfinite(enters(origin, ways, LOW + 0.15, HIGH - 0.15)) & ground
    assert hidden.sum() > 10 and not view.seen[hidden].any()


def test_sky_moves_with_the_camera_alone(scene):
    still = scene.at(0.0)
    up = Camera((0.0, 3.0, 0.0), (0.0, 0.6, -1.0))
    moved = Camera((2.0, 4.0, -3.0), (0.0, 0.6, -1.0))
    view = capture(still, up, moved)
    sky = np.isinf(view.depth)
    assert sky.all() and view.seen.all()
    np.testing.assert_allclose(view.motion, 0, atol=2e-3)
    turned = capture(still, up, Camera((0.0, 3.0, 0.0), (0.15, 0.6, -1.0)))
    # The picture goes right as the view does, from one frame to the next.
    assert (turned.motion[..., 0] < -1).all() or (turned.motion[..., 0] > 1).all()
    assert 0.5 < turned.seen.mean() < 0.99


def test_what_was_behind_the_camera_is_unseen_and_still(scene):
    behind = Camera(NOW.position, -NOW.forward, fov_y=17.0)
    view = capture(scene.at(0.0), NOW, behind)
    assert not view.seen.any()
    np.testing.assert_array_equal(view.motion, 0)
    np.testing.assert_array_equal(view.reprojected, 0)
