"""Free space by flood fill, and viewpoints that fulfil what was asked."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest


pytest.importorskip("embreex")

from alsarr.capture._free_space import free_space
from alsarr.capture._hall import hall
from alsarr.capture._scene import Lights, Material, Scene
from alsarr.capture._shapes import box, quad
from alsarr.capture._tracer import Tracer
from alsarr.capture._viewpoints import (
    FAST,
    Movement,
    SLOW,
    ViewpointSampler,
)


# Rays are in single precision whatever the lane.
pytestmark = pytest.mark.float64


SETTINGS = {"voxels": 4000, "tries": 4000}


def scene_of(shapes, start, bounds=None):
    return Scene.of(
        "test",
        [shape.mesh(0) for shape in shapes],
        [Material()],
        {},
        lights=Lights(),
        start=start,
        bounds=bounds,
    )


def tracer_of(scene):
    return Tracer(np.asarray(scene.vertex), np.asarray(scene.triangle))


def wall(gap):
    """Across a room 8 m long at x = 0.3, with a door of some width in its middle."""
    if not gap:
        return [quad((0.3, 0, -2), (0, 0, 4), (0, 3, 0))]
    side = 2 - gap / 2
    return [
        quad((0.3, 0, -2), (0, 0, side), (0, 3, 0)),
        quad((0.3, 0, gap / 2), (0, 0, side), (0, 3, 0)),
    ]


def room(*others, start=(-2, 1.5, 0)):
    return scene_of([box((8, 3, 4)), *others], start)


@pytest.fixture(scope="module")
def furnished():
    """A room with a block of 1.6 m in its right half."""
    return room(box((1.6, 1.6, 1.6)).moved((2, 0.01, 0)))


@pytest.fixture(scope="module")
def drawn(furnished):
    return ViewpointSampler(furnished, seed=5, **SETTINGS).first(25)


def test_the_fill_stays_on_its_side_of_a_wall():
    closed, open_ = room(*wall(0)), room(*wall(1.0))
    for scene in (closed, open_):
        space = free_space(scene, tracer_of(scene), voxels=4000)
        assert space.side == pytest.approx((8 * 3 * 4 / 4000) ** (1 / 3))
        x = space.centre[:, 0]
        if scene is closed:
            assert x.max() < 0.3 and len(x) == pytest.approx(4000 * 4.3 / 8, rel=0.05)
        else:
            assert x.max() > 3.5 and len(x) == pytest.approx(4000, rel=0.05)


def test_the_fill_does_not_enter_a_closed_block(furnished):
    space = free_space(furnished, tracer_of(furnished), voxels=4000)
    inside = np.all(np.abs(space.centre - [2, 0.81, 0]) < 0.79, axis=1)
    assert not inside.any()
    assert len(space.centre) == pytest.approx(4000 * (1 - 1.6**3 / 96), rel=0.05)


def test_the_bounds_are_walls_that_cannot_be_seen():
    plane = quad((-50, 0, 50), (100, 0, 0), (0, 0, -100))
    scene = scene_of([plane], (0, 1, 0), bounds=[(-2, 0.5, -3), (2, 3, 3)])
    space = free_space(scene, tracer_of(scene), voxels=500)
    low, high = np.asarray(scene.bounds)
    assert np.all((low <= space.centre) & (space.centre <= high))
    assert len(space.centre) == pytest.approx(500, rel=0.25)


def test_points_of_a_split_voxel_stay_on_the_side_of_its_centre():
    scene = room(*wall(0))
    tracer = tracer_of(scene)
    # Seven voxels along the room: the wall is in the one from -0.55 to 0.55 m.
    space = free_space(scene, tracer, voxels=70)
    point = space.sample(tracer, np.random.default_rng(0), 4000)
    assert len(point) < 4000 and -4 < point[:, 0].min()
    assert 0.2 < point[:, 0].max() < 0.3


def test_no_viewpoint_touches_the_scene(drawn):
    place = np.array([camera.position for pair in drawn for camera in pair])
    walls = np.minimum(place - [-4, 0, -2], [4, 3, 2] - place).min(axis=1)
    block = np.abs(place - [2, 0.81, 0]) - 0.8
    to_block = np.linalg.norm(np.maximum(block, 0), axis=1)
    # 8 x 3 x 4 m: a fiftieth of the diagonal is 0.19 m, so the radius is 0.15 m.
    # Between the template's lines a wall may come nearer by a tenth.
    assert min(walls.min(), to_block.min()) > 0.9 * 0.15
    assert np.ptp(place, axis=0)[0] > 5


def test_views_are_upright_and_near_the_horizon(drawn):
    forward = np.array([camera.forward for camera, _ in drawn])
    pitch = np.degrees(np.arcsin(forward[:, 1]))
    assert 15 < np.abs(pitch).max() <= 30
    yaw = np.arctan2(forward[:, 0], -forward[:, 2])
    assert np.ptp(yaw) > 4
    up = np.array([camera.up for camera, _ in drawn])
    assert np.all(up[:, 1] > 0.8)
    assert all(float(camera.fov_y) == 60 for pair in drawn for camera in pair)


@pytest.mark.parametrize("movement", [SLOW, FAST])
def test_previous_viewpoints_are_close_and_in_sight(furnished, movement):
    tracer = tracer_of(furnished)
    pairs = ViewpointSampler(
        furnished, seed=6, movements=(movement,), **SETTINGS
    ).first(12)
    for camera, previous in pairs:
        step = np.asarray(previous.position) - np.asarray(camera.position)
        # Nothing is farther away than the room's diagonal, 9.5 m.
        assert 0 < np.linalg.norm(step) <= movement.shift * 9.5
        cosine = np.dot(np.asarray(camera.forward), np.asarray(previous.forward))
        turn = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        assert 0.45 * movement.turn < turn < 1.05 * movement.turn
        way = step.astype("f4")[None]
        origin = np.asarray(camera.position)[None]
        assert not tracer.occluded(origin, way, np.ones(1, "f4"))[0]


@pytest.fixture(scope="module")
def small_hall():
    return hall(0, triangles=20_000)


def unseen(tracer, camera, previous, size=(32, 18)):
    """Share of a grid of points that the previous picture does not show."""
    y, x = np.mgrid[: size[1], : size[0]].reshape(2, -1).astype("f4") + np.float32(0.5)
    way = np.asarray(camera.rays(jnp.asarray(x), jnp.asarray(y), *size))
    _, distance = tracer.hit(np.broadcast_to(camera.position, way.shape), way)
    # The sky keeps its direction.
    far = np.minimum(distance, np.float32(1e6))[:, None] * way
    point = np.asarray(camera.position) + far
    at_x, at_y, _ = previous.project(jnp.asarray(point), *size)
    within = (at_x >= 0) & (at_x < size[0]) & (at_y >= 0) & (at_y < size[1])
    back = point - np.asarray(previous.position)
    origin = np.broadcast_to(previous.position, back.shape)
    hidden = tracer.occluded(origin, back, np.full(len(back), 0.999, "f4"))
    return 1 - np.mean(within & ~hidden)


# The paper has 14 % and 31 %; of 24 viewpoints the means are 1 % and 2 % uncertain.
@pytest.mark.parametrize(
    ("movement", "low", "high"), [(SLOW, 0.11, 0.19), (FAST, 0.26, 0.37)]
)
def test_so_much_of_the_hall_was_unseen_before(small_hall, movement, low, high):
    sampler = ViewpointSampler(small_hall, seed=7, movements=(movement,), **SETTINGS)
    tracer = tracer_of(small_hall)
    shares = [unseen(tracer, *pair) for pair in sampler.first(24)]
    assert low < np.mean(shares) < high


def test_most_of_every_picture_shows_the_scene():
    plane = quad((-500, 0, 500), (1000, 0, 0), (0, 0, -1000))
    scene = scene_of([plane], (0, 1.5, 0), bounds=[(-2, 0.2, -3), (2, 3, 3)])
    pairs = ViewpointSampler(scene, seed=0, **SETTINGS).first(12)
    x, y = np.meshgrid(np.arange(32) + 0.5, np.arange(18) + 0.5)
    x, y = (jnp.asarray(v, jnp.float32) for v in (x, y))
    shares = [
        float(np.mean(np.asarray(camera.rays(x, y, 32, 18))[..., 1] < -0.004))
        for pair in pairs
        for camera in pair
    ]
    # The sampler's grid has half as many rays on each axis.
    assert min(shares) > 0.8 - 1 / 9 and min(shares) < 0.95


def test_a_viewpoint_depends_on_seed_and_index_alone(furnished, drawn):
    sampler = ViewpointSampler(furnished, seed=5, **SETTINGS)
    for index in (7, 2, 20):
        for one, other in zip(sampler.draw(index), drawn[index], strict=True):
            for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
                np.testing.assert_array_equal(a, b)
    other = ViewpointSampler(furnished, seed=6, **SETTINGS).draw(7)[0]
    assert not np.array_equal(other.position, drawn[7][0].position)


def test_what_cannot_be_found_is_said():
    plane = quad((-5, 0, 5), (10, 0, 0), (0, 0, -10))
    scene = scene_of([plane], (0, 30, 0), bounds=[(-2, 20, -3), (2, 40, 3)])
    with pytest.raises(
        ValueError, match="number 0 of seed 1 was not found in 64 tries"
    ):
        ViewpointSampler(scene, seed=1, voxels=100, tries=64).first(1)


@pytest.mark.parametrize(
    ("start", "words"),
    [
        ((9, 1, 0), "`scene.start` must lie within its bounds"),
        ((2, 0.5, 0), "`scene.start` must be in free space"),
    ],
)
def test_a_start_that_is_not_free_is_refused(start, words):
    # The box about the start is smaller than a voxel.
    scene = room(box((0.05, 0.05, 0.05)).moved((2, 0.475, 0)), start=start)
    with pytest.raises(ValueError, match=words):
        ViewpointSampler(scene, seed=0, voxels=500).first(1)


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ({"seed": -1}, "`seed` must be >= 0"),
        ({"fov_y": 180}, r"`fov_y` must be in \(0, 180\) deg, got 180"),
        ({"aspect": 0}, "`aspect` must be > 0"),
        ({"radius": 0}, "`radius` must be > 0 m"),
        ({"most_pitch": 90}, r"`most_pitch` must be in \[0, 89\] deg"),
        ({"least_seen": 1.1}, r"`least_seen` must be in \[0, 1\]"),
        ({"movements": ()}, "`movements` must be at least one"),
        ({"movements": (Movement(0.1, 90),)}, "shifts > 0 and turns in"),
        ({"tries": 0}, "`tries` must be >= 1"),
        ({"voxels": 1}, "`voxels` must be >= 8"),
    ],
)
def test_settings_out_of_range_are_refused(furnished, setting, words):
    with pytest.raises(ValueError, match=words):
        ViewpointSampler(furnished, **{"seed": 0, **setting})


def test_no_viewpoints_may_be_asked_for_but_not_fewer(furnished):
    assert ViewpointSampler(furnished, seed=0, **SETTINGS).first(0) == []
    with pytest.raises(ValueError, match="`count` must be >= 0, got -1"):
        ViewpointSampler(furnished, seed=0).first(-1)
