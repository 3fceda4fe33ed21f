"""Room and light for a scene that came without a word about them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ._numbers import Numbers
from ._scene import Lights, Mesh
from ._tracer import Tracer


_POINTS, _DIRECTIONS = 512, 64
_SUN, _SKY, _GROUND = (10.0, 9.2, 8.0), (0.9, 1.05, 1.3), (0.5, 0.45, 0.4)
_ROOM_SKY, _ROOM_GROUND = (0.35, 0.38, 0.42), (0.28, 0.26, 0.24)


class Surroundings(NamedTuple):
    start: np.ndarray
    bounds: np.ndarray
    lights: Lights


def surroundings(
    meshes: Sequence[Mesh], *, start: Numbers | None, bounds: Numbers | None
) -> Surroundings:
    """What `load_scene` assumes where it is not told; see there."""
    vertex = np.concatenate([mesh.vertex for mesh in meshes])
    first = np.cumsum([0] + [len(mesh.vertex) for mesh in meshes])[:-1]
    triangle = np.concatenate(
        [mesh.triangle + f for mesh, f in zip(meshes, first, strict=True)]
    ).astype(np.int32)
    look = _Look(vertex, triangle)
    box = _box(vertex, look) if bounds is None else np.asarray(bounds, float)
    if start is None:
        point = look.roomiest(box)
    else:
        point = np.asarray(start, float)
    return Surroundings(point, box, _lights(look, point))


class _Look:
    """Questions about a scene, asked by rays."""

    def __init__(self, vertex: np.ndarray, triangle: np.ndarray):
        self._tracer = Tracer(vertex, triangle)
        a, b, c = (vertex[triangle[:, i]] for i in range(3))
        self._normal = np.cross(b - a, c - a)

    def distance(self, origin: np.ndarray, direction: Numbers) -> np.ndarray:
        """To what is seen from each point in one direction; infinite for nothing."""
        way = np.broadcast_to(np.asarray(direction, np.float32), origin.shape)
        return self._tracer.hit(origin.astype(np.float32), way)[1]

    def roomiest(self, box: np.ndarray) -> np.ndarray:
        """The point in a box farthest from everything, outside of closed bodies."""
        rng = np.random.default_rng(0)
        point = rng.uniform(box[0], box[1], (_POINTS, 3)).astype(np.float32)
        way = sphere(_DIRECTIONS)
        origin = np.repeat(point, len(way), axis=0)
        direction = np.tile(way, (len(point), 1))
        triangle, distance = self._tracer.hit(origin, direction)
        away = np.sum(self._normal[triangle] * direction, axis=1) > 0
        behind = (away & (triangle >= 0)).reshape(len(point), -1).mean(axis=1)
        clearance = distance.reshape(len(point), -1).min(axis=1)
        # Where the box is empty all are infinitely far; the middle is as good as any.
        clearance = np.minimum(clearance, np.ptp(box, axis=0).max())
        return point[np.argmax(np.where(behind < 0.2, clearance, clearance - 1e9))]


def sphere(count: int) -> np.ndarray:
    """Unit vectors spread evenly over a sphere (Fibonacci's spiral), [count, 3]."""
    place = np.arange(count) + 0.5
    y = 1 - 2 * place / count
    angle = np.pi * (1 + 5**0.5) * place
    level = np.sqrt(1 - y**2)
    way = np.stack([level * np.cos(angle), y, level * np.sin(angle)], axis=1)
    return way.astype(np.float32)


def _box(vertex: np.ndarray, look: _Look) -> np.ndarray:
    """About all vertices, with room on every side of what does not fill it."""
    low, high = vertex.min(axis=0).astype(float), vertex.max(axis=0).astype(float)
    size = (high - low).max()
    grid = (np.arange(24) + 0.5) / 24
    x, z = np.meshgrid(
        low[0] + grid * (high[0] - low[0]), low[2] + grid * (high[2] - low[2])
    )
    above = np.stack([x, np.full_like(x, high[1] + size), z], axis=2).reshape(-1, 3)
    covered = np.mean(np.isfinite(look.distance(above, (0, -1, 0))))
    # A room or a landscape covers its ground; an object has open corners.
    margin = 0.0 if covered > 0.9 else size / 2
    return np.stack([low - margin, high + margin])


def _lights(look: _Look, start: np.ndarray) -> Lights:
    here = start[None, :]
    up, down = (float(look.distance(here, (0, y, 0))[0]) for y in (1, -1))
    sun_direction = (0.45, 0.8, 0.4)
    if not np.isfinite(up):
        return Lights(sun_direction=sun_direction, sun=_SUN, sky=_SKY, ground=_GROUND)
    height = up + (down if np.isfinite(down) else up)
    power = np.pi * (0.75 * height) ** 2
    return Lights(
        sun_direction=sun_direction,
        sun=_SUN,
        point_position=[start + np.array([0.0, 0.7 * up, 0.0])],
        point_intensity=[power * np.array([1.0, 0.93, 0.82])],
        sky=_ROOM_SKY,
        ground=_ROOM_GROUND,
    )
