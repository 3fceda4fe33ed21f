"""Meshes of simple shapes, with normals and texture coordinates."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int32

from ._numbers import Numbers
from ._scene import Mesh


Points = Float[np.ndarray, "rows columns 3"]
Bumps = Callable[[np.ndarray], np.ndarray]


class Shape(NamedTuple):
    """Triangles without a material; fields as those of `Mesh`. uv is in metres or in
    repeats of a texture, as its maker says."""

    vertex: Float32[np.ndarray, "vertices 3"]
    normal: Float32[np.ndarray, "vertices 3"]
    uv: Float32[np.ndarray, "vertices 2"]
    triangle: Int32[np.ndarray, "triangles 3"]

    def mesh(self, material: int, *, repeats: float | int = 1.0, part: int = 0) -> Mesh:
        """The shape in a material, its uv times `repeats`."""
        return Mesh(
            self.vertex,
            self.normal,
            self.uv * np.float32(repeats),
            self.triangle,
            material,
            part,
        )

    def moved(self, offset: Numbers, turn: float | int = 0.0) -> "Shape":
        """Turned about the y axis [rad], then shifted [m]."""
        c, s = np.cos(turn), np.sin(turn)
        matrix = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]], np.float32)
        vertex = self.vertex @ matrix + np.asarray(offset, np.float32)
        return self._replace(vertex=vertex, normal=self.normal @ matrix)


def joined(shapes: Sequence[Shape]) -> Shape:
    """Several shapes as one."""
    first = np.cumsum([0] + [len(shape.vertex) for shape in shapes])
    return Shape(
        np.concatenate([shape.vertex for shape in shapes]),
        np.concatenate([shape.normal for shape in shapes]),
        np.concatenate([shape.uv for shape in shapes]),
        np.concatenate(
            [s.triangle + f for s, f in zip(shapes, first[:-1], strict=True)]
        ).astype(np.int32),
    )


def patch(
    point: Points,
    uv: Float[np.ndarray, "rows columns 2"],
    *,
    closed: bool = False,
    round_up: bool = False,
) -> Shape:
    """A surface through a grid of points, seen from where columns go right, rows up.

    **Arguments:**

    - `closed`: the last column lies on the first, and normals go on across.
    - `round_up`: the same of the rows.
    """
    rows, columns = point.shape[:2]
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    c, d = index[1:, 1:].ravel(), index[1:, :-1].ravel()
    triangle = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    vertex = np.asarray(point, np.float32).reshape(-1, 3)
    return Shape(
        vertex,
        np.asarray(
            normals(point, closed=closed, round_up=round_up), np.float32
        ).reshape(-1, 3),
        np.asarray(uv, np.float32).reshape(-1, 2),
        triangle[_areas(vertex, triangle) > 0],
    )


def normals(point: Points, *, closed: bool = False, round_up: bool = False) -> Points:
    """Unit normals of a grid of points; those of a pole are its neighbours' mean."""
    normal = np.cross(_slope(point, 1, closed), _slope(point, 0, round_up))
    length = np.linalg.norm(normal, axis=2, keepdims=True)
    for pole, beside in ((0, 1), (-1, -2)):
        if np.any(length[pole] < 1e-9):
            normal[pole] = normal[beside].mean(axis=0)
            length[pole] = np.linalg.norm(normal[pole], axis=1, keepdims=True)
    return normal / np.maximum(length, 1e-12)


def quad(corner: Numbers, right: Numbers, up: Numbers) -> Shape:
    """A parallelogram from its lower left corner; uv in metres, 0 at the corner."""
    corner_, right_, up_ = (np.asarray(v, float) for v in (corner, right, up))
    point = np.array(
        [[corner_, corner_ + right_], [corner_ + up_, corner_ + right_ + up_]]
    )
    wide, high = np.linalg.norm(right_), np.linalg.norm(up_)
    uv = np.array([[[0, 0], [wide, 0]], [[0, -high], [wide, -high]]])
    return patch(point, uv)


def picture(corner: Numbers, right: Numbers, up: Numbers) -> Shape:
    """A parallelogram that shows a texture once."""
    shape = quad(corner, right, up)
    uv = np.array([[0, 1], [1, 1], [0, 0], [1, 0]], np.float32)
    return shape._replace(uv=uv)


def box(size: Numbers, *, once: bool = False) -> Shape:
    """A box [m] that stands on the origin; uv in metres, or each side 0 to 1 `once`."""
    x, y, z = np.asarray(size, float)
    sides = [
        ((-x / 2, 0, z / 2), (x, 0, 0), (0, y, 0)),
        ((x / 2, 0, -z / 2), (-x, 0, 0), (0, y, 0)),
        ((x / 2, 0, z / 2), (0, 0, -z), (0, y, 0)),
        ((-x / 2, 0, -z / 2), (0, 0, z), (0, y, 0)),
        ((-x / 2, y, z / 2), (x, 0, 0), (0, 0, -z)),
        ((-x / 2, 0, -z / 2), (x, 0, 0), (0, 0, z)),
    ]
    return joined([(picture if once else quad)(*side) for side in sides])


def lathe(
    height: Float[np.ndarray, " rows"],
    radius: Float[np.ndarray, " rows"] | Float[np.ndarray, "rows columns"],
    columns: int,
    *,
    bumps: Bumps | None = None,
    repeats: int = 1,
) -> Shape:
    """A body of revolution about y, or nearly one.

    **Arguments:**

    - `height`, `radius`: its profile from below [m]; the radius may differ round about,
        for `columns` + 1 angles of which the last is the first.
    - `bumps`: how far points are pushed outwards, by where they are. [m]
    - `repeats`: of the texture round about; upwards as much in metres, at the mean
        radius.
    """
    angle = np.linspace(0, 2 * np.pi, columns + 1)
    away = np.broadcast_to(radius.reshape(len(height), -1), (len(height), columns + 1))
    point = np.stack(
        [
            away * np.sin(angle),
            np.broadcast_to(height[:, None], away.shape),
            away * np.cos(angle),
        ],
        axis=2,
    )
    if bumps is not None:
        point = point + bumps(point)[..., None] * normals(point, closed=True)
        point[:, -1] = point[:, 0]
    girth = 2 * np.pi * max(float(np.mean(away)), 1e-6)
    u = np.broadcast_to(angle / (2 * np.pi) * repeats, away.shape)
    v = np.broadcast_to(-height[:, None] / girth * repeats, away.shape)
    return patch(point, np.stack([u, v], axis=2), closed=True)


def ball(
    radius: float, columns: int, *, bumps: Bumps | None = None, repeats: int = 2
) -> Shape:
    """A sphere about the origin, with half as many rows as columns."""
    polar = np.linspace(0, np.pi, max(columns // 2, 4) + 1)
    # At a pole the radius is 0 and not 1e-17, or normals would be noise.
    away = radius * np.where((polar == 0) | (polar == np.pi), 0, np.sin(polar))
    return lathe(-radius * np.cos(polar), away, columns, bumps=bumps, repeats=repeats)


def ring(
    radius: float,
    thickness: float,
    columns: int,
    *,
    bumps: Bumps | None = None,
    repeats: int = 4,
) -> Shape:
    """A torus about the y axis; `thickness` is the radius of its tube. [m]"""
    around = np.linspace(0, 2 * np.pi, columns + 1)
    tube = np.linspace(0, 2 * np.pi, max(columns // 2, 6) + 1)[:, None]
    away = radius - thickness * np.cos(tube)
    point = np.stack(
        np.broadcast_arrays(
            away * np.sin(around), -thickness * np.sin(tube), away * np.cos(around)
        ),
        axis=2,
    )
    if bumps is not None:
        normal = normals(point, closed=True, round_up=True)
        point = point + bumps(point)[..., None] * normal
        point[:, -1], point[-1] = point[:, 0], point[0]
    u, v = np.broadcast_arrays(around / (2 * np.pi) * repeats, -tube / (2 * np.pi))
    return patch(point, np.stack([u, v], axis=2), closed=True, round_up=True)


def waves(
    rng: np.random.Generator, *, size: float, depth: float, octaves: int = 4
) -> Bumps:
    """Smooth bumps: waves in random directions, each octave half as long and deep.

    **Arguments:**

    - `size`: length of the longest waves. [m]
    - `depth`: their amplitude. [m]
    """
    direction = rng.normal(size=(octaves, 3, 3))
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    octave = 2.0 ** np.arange(octaves)
    wave = 2 * np.pi / size * octave[:, None, None] * direction
    phase = rng.uniform(0, 2 * np.pi, (octaves, 3))

    def bumps(point: np.ndarray) -> np.ndarray:
        angles = np.tensordot(point, wave, axes=(2, 2)) + phase
        return np.tensordot(np.sin(angles).mean(axis=3), depth / octave, axes=(2, 0))

    return bumps


def _slope(point: np.ndarray, axis: int, closed: bool) -> np.ndarray:
    if not closed:
        return np.gradient(point, axis=axis)
    along = np.moveaxis(point, axis, 0)
    wide = np.concatenate([along[-2:-1], along, along[1:2]])
    return np.moveaxis(np.gradient(wide, axis=0)[1:-1], 0, axis)


def _areas(vertex: np.ndarray, triangle: np.ndarray) -> np.ndarray:
    a, b, c = (vertex[triangle[:, i]].astype(float) for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1)
