"""Which part of a scene can be walked to."""

import equinox as eqx
import numpy as np
from jaxtyping import Float32

from ._scene import Scene
from ._tracer import Tracer


class FreeSpace(eqx.Module, strict=True):
    """The voxels of a scene that can be reached from its start.

    - `centre`: of the reachable voxels, in a fixed order. [m]
    - `side`: of a voxel. [m]
    """

    centre: Float32[np.ndarray, "voxels 3"]
    side: float

    def sample(
        self, tracer: Tracer, rng: np.random.Generator, count: int
    ) -> Float32[np.ndarray, "points 3"]:
        """At most `count` random points, even over the voxels, that can be reached.

        Points of a voxel that something separates from its centre are left out.
        """
        centre = self.centre[rng.integers(len(self.centre), size=count)]
        offset = rng.uniform(-0.5, 0.5, (count, 3)) * self.side
        point = centre + offset.astype(np.float32)
        return point[~blocked(tracer, centre, point)]


def free_space(scene: Scene, tracer: Tracer, *, voxels: int = 100_000) -> FreeSpace:
    """Flood-fill a scene's bounds from its start (Cardoso et al. 2022, Appendix A).

    A step between the centres of two neighbouring voxels is free where nothing lies on
    the straight line between. `scene.bounds` are the invisible walls that the paper
    adds to open scenes by hand.

    **Arguments:**

    - `tracer`: of the scene's vertices and triangles.
    - `voxels`: about how many cubes to divide the bounds into. >= 8

    **Raises:** `ValueError` for a start outside of the bounds, or one from which no
    voxel's centre is to be seen.
    """
    if voxels < 8:
        raise ValueError(f"`voxels` must be >= 8, got {voxels}.")
    low, high = np.asarray(scene.bounds, float)
    start = np.asarray(scene.start, float)
    if not np.all((low <= start) & (start <= high)):
        raise ValueError(
            f"`scene.start` must lie within its bounds, {low} to {high}, got {start}."
        )
    side = float(np.prod(np.maximum(high - low, 1e-6)) / voxels) ** (1 / 3)
    count = np.maximum(np.rint((high - low) / side), 1).astype(int)
    # Centred in the bounds, so that no voxel's centre lies outside.
    place = np.indices(count).reshape(3, -1).T
    centre = (low + high) / 2 + (place + 0.5 - count / 2) * side
    centre = np.clip(centre, low, high).astype(np.float32)
    group = _connected(tracer, centre, count)
    return FreeSpace(centre[group == group[_first(tracer, centre, start)]], side)


def blocked(tracer: Tracer, origin: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Whether something lies on the straight lines between points, [n] of [n, 3]."""
    # The direction is the whole way, so its end is at distance 1.
    whole = np.ones(len(origin), np.float32)
    return tracer.occluded(origin, target - origin, whole)


def _connected(tracer: Tracer, centre: np.ndarray, count: np.ndarray) -> np.ndarray:
    """A number for each voxel, the same for those with a free way between them."""
    import scipy.sparse as sparse

    index = np.arange(len(centre)).reshape(count)
    pairs = [
        np.stack(
            [
                np.take(index, range(n - 1), axis).ravel(),
                np.take(index, range(1, n), axis).ravel(),
            ]
        )
        for axis, n in enumerate(count)
    ]
    one, other = np.concatenate(pairs, axis=1)
    free = ~blocked(tracer, centre[one], centre[other])
    one, other = one[free], other[free]
    steps = sparse.coo_array(
        (np.ones(len(one), bool), (one, other)), (len(centre), len(centre))
    )
    return sparse.csgraph.connected_components(steps, directed=False)[1]


def _first(tracer: Tracer, centre: np.ndarray, start: np.ndarray) -> int:
    """The nearest voxel whose centre can be seen from the start."""
    near = np.argsort(np.sum((centre - start) ** 2, axis=1), kind="stable")[:64]
    origin = np.broadcast_to(start, (len(near), 3)).astype(np.float32)
    seen = ~blocked(tracer, origin, centre[near])
    if not np.any(seen):
        raise ValueError(
            "`scene.start` must be in free space, got a point from which no voxel of "
            "the free space can be seen: choose another, or more voxels."
        )
    return int(near[np.argmax(seen)])
