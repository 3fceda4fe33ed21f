"""The procedural hall, and the shapes it is made of."""

import socket

import numpy as np
import pytest


pytest.importorskip("embreex")

from alsarr.capture import _shapes as shapes
from alsarr.capture._hall import hall
from alsarr.capture._surroundings import sphere
from alsarr.capture._tracer import Tracer


# Scenes are in single precision whatever the lane.
pytestmark = pytest.mark.float64


SMALL = 20_000


def arrays(scene):
    names = ("vertex", "normal", "uv", "triangle", "material", "part")
    return {name: np.asarray(getattr(scene, name)) for name in names}


def cross_products(vertex, triangle):
    a, b, c = (vertex[triangle[:, i]].astype(float) for i in range(3))
    return np.cross(b - a, c - a)


@pytest.fixture(scope="module")
def small():
    """Built where no connection can be made."""

    def refuse(*arguments, **options):
        raise AssertionError("the hall must not use the network")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(socket.socket, "connect", refuse)
        return hall(3, triangles=SMALL, animated=True)


@pytest.fixture(scope="module")
def tracer(small):
    return Tracer(np.asarray(small.vertex), np.asarray(small.triangle))


@pytest.fixture(scope="module")
def seen(small, tracer):
    """What 4000 rays from the start meet."""
    direction = sphere(4000)
    origin = np.tile(np.asarray(small.start)[None], (len(direction), 1))
    triangle, distance = tracer.hit(origin, direction)
    return direction, triangle, distance


def test_the_same_arguments_give_the_same_hall(small):
    again, other = hall(3, triangles=SMALL), hall(4, triangles=SMALL)
    for name, values in arrays(again).items():
        if name != "part":
            np.testing.assert_array_equal(values, arrays(small)[name])
    np.testing.assert_array_equal(again.texels.texel, small.texels.texel)
    assert again.animation is None and not np.any(again.part)
    assert other.name == "hall 4"
    assert not np.array_equal(other.lights.sun_direction, small.lights.sun_direction)
    assert other.vertex.shape != again.vertex.shape or not np.array_equal(
        other.vertex, again.vertex
    )


def test_there_are_about_as_many_triangles_as_were_asked_for(small):
    for wanted, scene in ((SMALL, small), (400_000, hall(3))):
        assert 0.85 * wanted < len(scene.triangle) < 1.35 * wanted


def test_the_arrays_are_sound(small):
    found = arrays(small)
    assert all(np.all(np.isfinite(values)) for values in found.values())
    np.testing.assert_allclose(np.linalg.norm(found["normal"], axis=1), 1, atol=1e-5)
    area = np.linalg.norm(cross_products(found["vertex"], found["triangle"]), axis=1)
    assert np.all(area > 0)
    assert found["material"].max() == len(small.materials.metallic) - 1
    assert len(small.texture_name) == len(small.texels.levels)


def test_surfaces_face_the_hall(small, seen):
    direction, triangle, _ = seen
    hit = triangle >= 0
    found = arrays(small)
    corner = found["triangle"][triangle[hit]]
    front = cross_products(found["vertex"], corner)
    # Lamp shades are open below, where one sees their inside.
    assert np.mean(np.sum(front * direction[hit], axis=1) < 0) > 0.985
    smooth = found["normal"][corner].sum(axis=1)
    assert np.mean(np.sum(front * smooth, axis=1) > 0) > 0.999


def test_one_stands_in_a_room_with_windows(small, seen):
    _, triangle, distance = seen
    low, high = np.asarray(small.bounds)
    assert np.all((low < small.start) & (small.start < high))
    assert 0.93 < np.mean(triangle >= 0) < 1
    assert distance.min() > 0.3


def test_the_sun_falls_on_a_part_of_the_floor_and_lamps_hang_free(small, tracer):
    x, z = np.meshgrid(np.linspace(-7, 7, 57), np.linspace(-8, 13, 85))
    floor = np.stack([x, np.full_like(x, 0.02), z], axis=2).reshape(-1, 3).astype("f4")
    sun = np.tile(np.asarray(small.lights.sun_direction)[None], (len(floor), 1))
    lit = ~tracer.occluded(floor, sun, np.full(len(floor), np.inf, "f4"))
    assert 0.01 < lit.mean() < 0.5
    lamp = np.asarray(small.lights.point_position)
    down = np.tile(np.array([[0.02, -1, 0.01]], "f4"), (len(lamp), 1))
    _, distance = tracer.hit(lamp, down)
    assert np.all(distance > 1)


def test_mip_levels_from_0_to_4_occur(small, seen):
    _, triangle, distance = seen
    hit = triangle >= 0
    found, texels = arrays(small), small.texels
    corner = found["triangle"][triangle[hit]]
    world = np.linalg.norm(cross_products(found["vertex"], corner), axis=1)
    (a, b), (c, d) = (
        (found["uv"][corner[:, i]] - found["uv"][corner[:, 0]]).T for i in (1, 2)
    )
    texture = np.asarray(small.materials.colour_texture)[
        found["material"][triangle[hit]]
    ]
    size = np.asarray(texels.width * texels.height)[texture, 0]
    texels_per_metre = np.sqrt(np.abs(a * d - b * c) * size / world)
    # A pixel of a picture 368 high that spans 60 degrees, seen straight on.
    pixel = 2 * np.tan(np.radians(30)) / 368 * distance[hit]
    level = np.log2(np.maximum(texels_per_metre * pixel, 1))[texture > 1]
    share = np.bincount(np.floor(level).astype(int), minlength=5) / len(level)
    assert np.all(share[:4] > 0.02) and share[4:].sum() > 0.002


def test_parts_move_and_all_else_stands(small):
    part = np.asarray(small.part)
    assert set(part) == {0, 1, 2, 3}
    now, later = np.asarray(small.at(0).vertex), np.asarray(small.at(1.3).vertex)
    np.testing.assert_array_equal(now[part == 0], later[part == 0])
    np.testing.assert_array_equal(now, small.vertex)
    for moving in (1, 2, 3):
        step = np.linalg.norm((later - now)[part == moving], axis=1)
        assert step.max() > 0.1
    lights = small.at(1.3).lights.point_position
    assert float(np.linalg.norm(lights[0] - small.lights.point_position[0])) > 0.1
    np.testing.assert_array_equal(lights[1:], small.lights.point_position[1:])
    np.testing.assert_allclose(small.at(8).vertex, now, atol=1e-4)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"seed": -1}, "`seed` must be >= 0, got -1"),
        ({"triangles": 100}, r"`triangles` must be in \[20000, 5000000\], got 100"),
    ],
)
def test_numbers_out_of_range_are_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        hall(**arguments)


def outward(shape, centre=(0, 0, 0)):
    """Share of triangles, then of vertices, that face away from a point."""
    front = cross_products(shape.vertex, shape.triangle)
    middle = shape.vertex[shape.triangle].mean(axis=1) - centre
    corner = shape.vertex - np.asarray(centre)
    return (
        np.mean(np.sum(front * middle, axis=1) > 0),
        np.mean(np.sum(shape.normal * corner, axis=1) > 0),
    )


def test_convex_shapes_face_outwards():
    ball, box = shapes.ball(2.0, 24), shapes.box((1, 2, 3))
    assert outward(ball) == (1, 1)
    assert outward(box, (0, 1, 0)) == (1, 1)
    np.testing.assert_allclose(ball.vertex, 2 * ball.normal, atol=0.03)
    np.testing.assert_allclose(box.vertex.min(axis=0), [-0.5, 0, -1.5])
    np.testing.assert_allclose(box.vertex.max(axis=0), [0.5, 2, 1.5])


def test_a_ring_faces_away_from_the_circle_in_it():
    ring = shapes.ring(1.0, 0.25, 48)
    level = ring.vertex * [1, 0, 1]
    core = level / np.linalg.norm(level, axis=1, keepdims=True)
    away = ring.vertex - core
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 0.25, atol=1e-6)
    assert np.all(np.sum(ring.normal * away, axis=1) > 0.24)
    front = cross_products(ring.vertex, ring.triangle)
    assert np.all(np.sum(front * away[ring.triangle].mean(axis=1), axis=1) > 0)


def test_closed_surfaces_have_no_seam():
    rng = np.random.default_rng(0)
    bumps = shapes.waves(rng, size=1.0, depth=0.1)
    vase = shapes.lathe(np.linspace(0, 2, 9), np.full(9, 0.5), 20, bumps=bumps)
    vertex, normal = (a.reshape(9, 21, 3) for a in (vase.vertex, vase.normal))
    np.testing.assert_array_equal(vertex[:, 0], vertex[:, -1])
    np.testing.assert_allclose(normal[:, 0], normal[:, -1], atol=1e-6)
    assert np.std(np.hypot(vertex[..., 0], vertex[..., 2])) > 0.01


def test_a_picture_shows_its_top_at_the_top():
    picture = shapes.picture((0, 0, 0), (2, 0, 0), (0, 1, 0))
    top = picture.vertex[:, 1] == 1
    np.testing.assert_array_equal(picture.uv[top][:, 1], 0)
    np.testing.assert_array_equal(picture.uv[:, 0], picture.vertex[:, 0] / 2)
    np.testing.assert_allclose(picture.normal, [[0, 0, 1]] * 4)


def test_shapes_turn_about_y_with_their_normals():
    wall = shapes.quad((0, 0, 0), (1, 0, 0), (0, 1, 0)).moved((0, 0, 5), np.pi / 2)
    np.testing.assert_allclose(wall.normal, [[1, 0, 0]] * 4, atol=1e-6)
    np.testing.assert_allclose(wall.vertex[1], [0, 0, 4], atol=1e-6)
