"""Rays against triangles whose answers are known in closed form."""

import numpy as np
import pytest

from alsarr.capture._tracer import Tracer


embreex = pytest.importorskip("embreex")


# The unit cube, each side two triangles, side by side in the order -x +x -y +y -z +z.
CORNER = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], "f4")
SIDE = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
CUBE = np.concatenate([SIDE[:, [0, 1, 2]], SIDE[:, [0, 2, 3]]], 1).reshape(-1, 3)
CUBE = CUBE.astype(np.int32)


def slabs(origin, direction):
    """Distance to the unit cube from outside (Kay and Kajiya 1986), or infinite."""
    with np.errstate(divide="ignore"):
        near, far = (0 - origin) / direction, (1 - origin) / direction
    enter = np.minimum(near, far).max(axis=1)
    leave = np.maximum(near, far).min(axis=1)
    return np.where((enter <= leave) & (enter > 0), enter, np.inf)


@pytest.fixture(scope="module")
def rays():
    rng = np.random.default_rng(3)
    origin = rng.normal(size=(4000, 3))
    origin *= 3 / np.linalg.norm(origin, axis=1, keepdims=True)
    origin += 0.5
    direction = rng.uniform(-0.2, 1.2, (4000, 3)) - origin
    return origin.astype("f4"), direction.astype("f4")


@pytest.fixture(scope="module")
def cube():
    return Tracer(CORNER, CUBE)


def clear_of_edges(origin, direction):
    """Rays that come within 1e-3 of an edge of the cube may go either way."""
    enter = slabs(origin, direction)
    point = origin + np.where(np.isinf(enter), 0, enter)[:, None] * direction
    edge = np.sort(np.minimum(abs(point), abs(point - 1)), axis=1)[:, 1]
    scaled = [slabs((origin - 0.5) * s + 0.5, direction * s) for s in (0.998, 1.002)]
    same = np.isinf(scaled[0]) == np.isinf(scaled[1])
    return same & (np.isinf(enter) | (edge > 1e-3))


def test_hits_of_a_cube_are_those_of_its_slabs(cube, rays):
    origin, direction = rays
    triangle, distance = cube.hit(origin, direction)
    assert triangle.dtype == np.int32 and distance.dtype == np.float32
    keep, expected = clear_of_edges(origin, direction), slabs(origin, direction)
    assert 0.5 < np.mean(np.isfinite(expected)) < 0.9 and np.mean(keep) > 0.97
    np.testing.assert_allclose(distance[keep], expected[keep], rtol=1e-5)
    np.testing.assert_array_equal(triangle[keep] < 0, np.isinf(expected[keep]))
    hit = keep & (triangle >= 0)
    point = origin + distance[:, None] * direction
    axis, high = np.divmod(triangle // 2, 2)
    on = np.take_along_axis(point, axis[:, None], axis=1)[:, 0]
    np.testing.assert_allclose(on[hit], high[hit], atol=1e-5)


def test_occlusion_is_a_hit_before_the_limit(cube, rays):
    origin, direction = rays
    keep, expected = clear_of_edges(origin, direction), slabs(origin, direction)
    for limit in (0.3, 0.8, 1.0, np.inf):
        far = np.full(len(origin), limit, np.float32)
        blocked = cube.occluded(origin, direction, far)
        assert blocked.dtype == bool
        sure = keep & ((expected < limit - 1e-4) | (expected > limit + 1e-4))
        sure |= keep & np.isinf(limit)
        np.testing.assert_array_equal(blocked[sure], expected[sure] < limit)


def test_embree_says_0_for_occluded_and_minus_1_for_free(cube):
    origin = np.array([[0.5, 0.5, -1], [0.5, 0.5, -1], [5, 5, 5]], "f4")
    direction = np.array([[0, 0, 1]] * 3, "f4")
    far = np.array([2.0, 0.5, np.inf], "f4")
    raw = cube._scene.run(origin, direction, dists=far.copy(), query="OCCLUDED")
    np.testing.assert_array_equal(raw, [0, -1, -1])
    blocked = cube.occluded(origin, direction, far)
    np.testing.assert_array_equal(blocked, [True, False, False])


def test_distances_are_in_units_of_the_direction_and_limits_are_not_changed():
    single = Tracer(
        np.array([[0, 0, 2], [1, 0, 2], [0, 1, 2]], "f4"), np.array([[0, 1, 2]], "i4")
    )
    origin = np.tile(np.array([[0.25, 0.25, 0]], "f4"), (2, 1))
    direction = np.array([[0, 0, 1], [0, 0, 4]], "f4")
    np.testing.assert_allclose(single.hit(origin, direction)[1], [2, 0.5])
    limit = np.array([1.9, 0.6], "f4")
    np.testing.assert_array_equal(
        single.occluded(origin, direction, limit), [False, True]
    )
    np.testing.assert_array_equal(limit, np.array([1.9, 0.6], "f4"))
    back = origin + [0, 0, 4], -direction
    np.testing.assert_array_equal(single.hit(*(b.astype("f4") for b in back))[0], 0)


def test_no_rays_and_strided_rays(cube, rays):
    none = np.empty((0, 3), "f4")
    assert [len(a) for a in cube.hit(none, none)] == [0, 0]
    assert len(cube.occluded(none, none, np.empty(0, "f4"))) == 0
    origin, direction = rays
    backwards = cube.hit(origin[::-1], direction[::-1])
    for once, again in zip(cube.hit(origin, direction), backwards, strict=True):
        np.testing.assert_array_equal(once, again[::-1])


@pytest.mark.parametrize(
    ("vertex", "triangle", "words"),
    [
        (CORNER, CUBE[:0], "at least one triangle"),
        (CORNER[:4], CUBE, "indices of the 4 vertices, got 0 to 7"),
        (CORNER * np.float32(np.nan), CUBE, "`vertex` must be finite"),
    ],
)
def test_triangles_that_cannot_be_traced_are_refused(vertex, triangle, words):
    with pytest.raises(ValueError, match=words):
        Tracer(vertex, triangle)


def test_without_embreex_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "embreex.rtcore_scene", None)
    with pytest.raises(ImportError, match=r"`alsarr\[capture\]` is not installed"):
        Tracer(CORNER, CUBE)
