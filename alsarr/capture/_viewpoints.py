"""Viewpoints worth rendering, and where the eye was a frame before."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float32

from ._camera import Camera
from ._free_space import blocked, free_space, FreeSpace
from ._scene import Scene
from ._surroundings import sphere
from ._tracer import Tracer


class Movement(NamedTuple):
    """How far the eye goes from one frame to the next, at most.

    - `shift`: as a share of the median distance of what it sees. [1], > 0
    - `turn`: of the view axis. [deg], in (0, 90)
    """

    shift: float
    turn: float


SLOW = Movement(shift=0.05, turn=8.0)
"""Leaves about one pixel in seven unseen, the slow motion of Cardoso et al. 2022."""

FAST = Movement(shift=0.15, turn=18.0)
"""Leaves nearly one pixel in three unseen, the fast motion of Cardoso et al. 2022."""

_BATCH = 32
_GRID = 16, 9
_TEMPLATE = 48


class ViewpointSampler:
    """Draws the viewpoints of a scene one by one, each from its own seed.

    Viewpoint `index` depends on the scene, the settings, `seed` and `index` alone, so
    any number of processes that share them out draw the same.

    The procedure is that of Cardoso et al. 2022, Appendix A. A candidate is a random
    point of the free space (`free_space`) with a random direction. It is valid if a
    template camera there does not touch the scene, and if at least `least_seen` of a
    coarse grid of rays through its picture meet something. The previous viewpoint is
    drawn near it until it is valid too and nothing lies on the straight line between.

    The template is a sphere of 48 spokes and the edges between neighbouring ends; what
    is thinner than the gaps between those (about half the radius) may be missed.

    **Arguments:**

    - `scene`: as it stands (`Scene.at`).
    - `seed`: >= 0.
    - `fov_y`: of every camera. [deg], in (0, 180)
    - `aspect`: width by height of the pictures. > 0
    - `radius`: of the template camera [m], > 0; by default 0.15 m, but at most a
        fiftieth of the diagonal of the scene's bounds.
    - `most_pitch`: how far the view axis may be from the horizon. [deg], in [0, 89]
    - `least_seen`: share of the picture that shows the scene. In [0, 1]
    - `movements`: one of them is drawn for each viewpoint. At least one.
    - `tries`: candidates to draw before giving up. >= 1
    - `voxels`: as in `free_space`.

    **Raises:** `ValueError` for a setting out of range, and as `free_space`.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        seed: int,
        fov_y: float | int = 60.0,
        aspect: float | int = 16 / 9,
        radius: float | int | None = None,
        most_pitch: float | int = 30.0,
        least_seen: float | int = 0.8,
        movements: tuple[Movement, ...] = (SLOW, FAST),
        tries: int = 20_000,
        voxels: int = 100_000,
    ):
        _check_settings(seed, fov_y, aspect, most_pitch, least_seen, movements, tries)
        if radius is None:
            diagonal = np.linalg.norm(np.ptp(np.asarray(scene.bounds), axis=0))
            radius = min(0.15, float(diagonal) / 50)
        if not radius > 0:
            raise ValueError(f"`radius` must be > 0 m, got {radius}.")
        self._tracer = Tracer(np.asarray(scene.vertex), np.asarray(scene.triangle))
        self._space: FreeSpace = free_space(scene, self._tracer, voxels=voxels)
        self._seed, self._fov_y, self._tries = seed, fov_y, tries
        self._most_pitch, self._least_seen = np.radians(most_pitch), least_seen
        self._movements, self._radius = movements, radius
        self._template = _template(radius)
        self._grid = _grid(fov_y, aspect)

    def first(self, count: int) -> list[tuple[Camera, Camera]]:
        """Viewpoints number 0 to `count` - 1, each with its previous one.

        **Raises:** `ValueError` for a negative count, and as `draw`.
        """
        if count < 0:
            raise ValueError(f"`count` must be >= 0, got {count}.")
        return [self.draw(index) for index in range(count)]

    def draw(self, index: int) -> tuple[Camera, Camera]:
        """Viewpoint number `index` (>= 0) and its previous one.

        **Raises:** `ValueError` if no candidate was valid.
        """
        rng = np.random.default_rng([self._seed, index])
        for _ in range(-(-self._tries // _BATCH)):
            pose, distance = self._valid(*self._candidates(rng))
            if not len(pose.point):
                continue
            previous = self._before(rng, pose.first(), float(np.median(distance[0])))
            if previous is not None:
                return self._camera(pose.first()), self._camera(previous)
        raise ValueError(
            f"`scene` must have viewpoints: number {index} of seed {self._seed} was "
            f"not found in {self._tries} tries, with a clearance of {self._radius:g} m "
            f"and {self._least_seen:.0%} of the picture filled."
        )

    def _candidates(self, rng: np.random.Generator) -> "_Poses":
        point = self._space.sample(self._tracer, rng, _BATCH)
        yaw = rng.uniform(-np.pi, np.pi, _BATCH)[: len(point)]
        pitch = rng.uniform(-1, 1, _BATCH)[: len(point)] * self._most_pitch
        return _Poses(point, yaw, pitch)

    def _valid(
        self, point: np.ndarray, yaw: np.ndarray, pitch: np.ndarray
    ) -> tuple["_Poses", np.ndarray]:
        """The valid ones of some poses, and the distances seen through their grids."""
        pose = _Poses(point, yaw, pitch)
        pose = pose.where(~self._touches(pose.point))
        distance = self._distances(pose)
        seen = np.isfinite(distance).mean(axis=1) >= self._least_seen
        return pose.where(seen), distance[seen]

    def _before(
        self, rng: np.random.Generator, pose: "_Poses", distance: float
    ) -> "_Poses | None":
        """A valid pose close to one pose, with a free way between; `None` for none."""
        movement = self._movements[rng.integers(len(self._movements))]
        way = rng.normal(size=(_BATCH, 3))
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        # Most frames of a walk are nearly as far apart as its speed lets them be.
        far = rng.uniform(0.5, 1.0, (_BATCH, 1)) * movement.shift
        turn = np.radians(rng.uniform(0.5, 1.0, _BATCH) * movement.turn)
        aim = rng.uniform(0, 2 * np.pi, _BATCH)
        point = pose.point + (min(distance, 1e6) * far * way).astype(np.float32)
        pitch = pose.pitch + turn * np.sin(aim)
        yaw = pose.yaw + turn * np.cos(aim) / np.cos(pose.pitch)
        origin = np.broadcast_to(pose.point, point.shape)
        free = ~blocked(self._tracer, origin, point)
        free &= np.abs(pitch) <= self._most_pitch
        near = _Poses(point[free], yaw[free], pitch[free])
        valid, _ = self._valid(*near)
        return valid.first() if len(valid.point) else None

    def _touches(self, point: np.ndarray) -> Bool[np.ndarray, " poses"]:
        start, end = self._template
        count, edges = len(point), len(start)
        origin = (point[:, None] + start[None]).reshape(-1, 3)
        target = (point[:, None] + end[None]).reshape(-1, 3)
        touching = blocked(self._tracer, origin, target)
        return np.any(touching.reshape(count, edges), axis=1)

    def _distances(self, pose: "_Poses") -> Float32[np.ndarray, "poses rays"]:
        count, rays = len(pose.point), len(self._grid)
        direction = np.einsum("rk,pkx->prx", self._grid, pose.axes())
        origin = np.repeat(pose.point, rays, axis=0)
        _, distance = self._tracer.hit(
            origin, direction.reshape(-1, 3).astype(np.float32)
        )
        return distance.reshape(count, rays)

    def _camera(self, pose: "_Poses") -> Camera:
        _, _, forward = pose.axes()[0]
        return Camera(
            jnp.asarray(pose.point[0]),
            jnp.asarray(forward, jnp.float32),
            fov_y=self._fov_y,
        )


class _Poses(NamedTuple):
    """Points [m] and where the eye looks: yaw from -z to the left, pitch up. [rad]"""

    point: np.ndarray
    yaw: np.ndarray
    pitch: np.ndarray

    def where(self, keep: np.ndarray) -> "_Poses":
        return _Poses(self.point[keep], self.yaw[keep], self.pitch[keep])

    def first(self) -> "_Poses":
        return _Poses(self.point[:1], self.yaw[:1], self.pitch[:1])

    def axes(self) -> np.ndarray:
        """Right, up and forward of each pose, [poses, 3, 3]."""
        zero = np.zeros_like(self.yaw)
        level = np.stack([-np.sin(self.yaw), zero, -np.cos(self.yaw)], axis=1)
        up = np.array([[0.0, 1.0, 0.0]])
        cosine, sine = np.cos(self.pitch)[:, None], np.sin(self.pitch)[:, None]
        forward = cosine * level + sine * up
        right = np.cross(level, up)
        return np.stack([right, np.cross(right, forward), forward], axis=1)


def _grid(fov_y: float | int, aspect: float | int) -> np.ndarray:
    """Rays through the middles of a coarse grid's cells, in right, up and forward."""
    columns, rows = _GRID
    high = np.tan(np.radians(fov_y) / 2)
    x = ((np.arange(columns) + 0.5) / columns * 2 - 1) * high * aspect
    y = (1 - (np.arange(rows) + 0.5) / rows * 2) * high
    across, down = np.meshgrid(x, y)
    return np.stack([across, down, np.ones_like(across)], axis=2).reshape(-1, 3)


def _template(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Both ends of the template's lines, about the origin: spokes, then edges."""
    from scipy.spatial import ConvexHull

    end = sphere(_TEMPLATE) * np.float32(radius)
    sides = ConvexHull(end).simplices
    edges = np.concatenate([sides[:, [0, 1]], sides[:, [1, 2]], sides[:, [2, 0]]])
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    start = np.concatenate([np.zeros_like(end), end[edges[:, 0]]])
    return start, np.concatenate([end, end[edges[:, 1]]])


def _check_settings(
    seed: int,
    fov_y: float | int,
    aspect: float | int,
    most_pitch: float | int,
    least_seen: float | int,
    movements: tuple[Movement, ...],
    tries: int,
) -> None:
    for name, value, good, rule in (
        ("seed", seed, seed >= 0, ">= 0"),
        ("fov_y", fov_y, 0 < fov_y < 180, "in (0, 180) deg"),
        ("aspect", aspect, aspect > 0, "> 0"),
        ("most_pitch", most_pitch, 0 <= most_pitch <= 89, "in [0, 89] deg"),
        ("least_seen", least_seen, 0 <= least_seen <= 1, "in [0, 1]"),
        ("movements", movements, len(movements) > 0, "at least one"),
        ("tries", tries, tries >= 1, ">= 1"),
    ):
        if not good:
            raise ValueError(f"`{name}` must be {rule}, got {value}.")
    for movement in movements:
        if not (movement.shift > 0 and 0 < movement.turn < 90):
            raise ValueError(
                "`movements` must have shifts > 0 and turns in (0, 90) deg, got "
                f"{movement}."
            )
