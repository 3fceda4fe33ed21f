"""Rays against triangles, by Embree."""

import numpy as np
from jaxtyping import Bool, Float32, Int32

from camojab._extras import needed


class Tracer:
    """The triangles of a scene at one moment, ready to be asked by rays.

    Everything is in float32 and on the host. Embree (through embreex) holds Python's
    global lock while it traces, so several processes are faster than one and several
    threads are not; an instance cannot be sent to another process. Textures are not
    asked: a texel whose alpha is 0 stops rays as any other.

    **Arguments:**

    - `vertex`: positions. [m], finite.
    - `triangle`: three indices into `vertex` each; at least one triangle.

    **Raises:** `ValueError` for no triangle, an index out of range or a position that
    is not finite; `ImportError` without the extra `capture` (embreex).
    """

    def __init__(
        self,
        vertex: Float32[np.ndarray, "vertices 3"],
        triangle: Int32[np.ndarray, "triangles 3"],
    ):
        if not len(triangle):
            raise ValueError("`triangle` must hold at least one triangle, got none.")
        if triangle.min() < 0 or triangle.max() >= len(vertex):
            raise ValueError(
                f"`triangle` must hold indices of the {len(vertex)} vertices, got "
                f"{triangle.min()} to {triangle.max()}."
            )
        if not np.all(np.isfinite(vertex)):
            raise ValueError("`vertex` must be finite, got a value that is not.")
        scene_type, mesh_type = _embree()
        self._scene = scene_type()
        # Embree reads these arrays when it builds its tree, at the first ray.
        self._vertex = np.ascontiguousarray(vertex)
        self._triangle = np.ascontiguousarray(triangle)
        self._mesh = mesh_type(self._scene, self._vertex, self._triangle)

    def hit(
        self,
        origin: Float32[np.ndarray, "rays 3"],
        direction: Float32[np.ndarray, "rays 3"],
    ) -> tuple[Int32[np.ndarray, " rays"], Float32[np.ndarray, " rays"]]:
        """The first triangle that each ray meets, from either side.

        A ray that starts on a triangle meets it at distance 0: the caller moves the
        origin off the surface.

        **Arguments:**

        - `origin`: where the rays start. [m]
        - `direction`: not 0; distances are in units of its length.

        **Returns:** index of the triangle, -1 where there is none, and the distance to
        it, infinite where there is none.
        """
        if not len(origin):
            return np.empty(0, np.int32), np.empty(0, np.float32)
        found = self._scene.run(*_rays(origin, direction), query="INTERSECT", output=1)
        triangle = np.asarray(found["primID"], np.int32)
        distance = np.where(triangle < 0, np.float32(np.inf), found["tfar"])
        return triangle, distance

    def occluded(
        self,
        origin: Float32[np.ndarray, "rays 3"],
        direction: Float32[np.ndarray, "rays 3"],
        distance: Float32[np.ndarray, " rays"],
    ) -> Bool[np.ndarray, " rays"]:
        """Whether anything lies on each ray, from its origin to `distance`.

        **Arguments:**

        - `origin`, `direction`: as in `hit`.
        - `distance`: the far limit, itself included; may be infinite. In units of the
            direction's length, >= 0.
        """
        if not len(origin):
            return np.empty(0, bool)
        limit = np.ascontiguousarray(distance, np.float32)
        rays = _rays(origin, direction)
        # Embree says 0 for a ray that is stopped and -1 for one that is free.
        return self._scene.run(*rays, dists=limit, query="OCCLUDED") == 0


def _rays(origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return (
        np.ascontiguousarray(origin, np.float32),
        np.ascontiguousarray(direction, np.float32),
    )


def _embree() -> tuple[type, type]:
    load = lambda name: needed("capture", f"embreex.{name}", "tracing rays")
    return load("rtcore_scene").EmbreeScene, load("mesh_construction").TriangleMesh
