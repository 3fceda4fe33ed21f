"""What every pixel's centre sees, at full resolution whatever the shading rate."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Int

from ._camera import Camera
from ._tracer import Tracer


def visible_triangles(
    tracer: Tracer, camera: Camera, *, size: tuple[int, int]
) -> Int[np.ndarray, "height width"]:
    """The triangle that the ray through each pixel's centre meets first; -1 is sky.

    **Arguments:**

    - `tracer`: of the scene as it stands.
    - `size`: width and height of the picture. [px]
    """
    width, height = size
    y, x = np.mgrid[:height, :width].astype(np.float32).reshape(2, -1) + np.float32(0.5)
    direction = np.asarray(
        camera.rays(jnp.asarray(x), jnp.asarray(y), width, height), np.float32
    )
    origin = np.asarray(camera.position, np.float32)
    triangle, _ = tracer.hit(np.broadcast_to(origin, direction.shape), direction)
    return np.asarray(triangle, np.int32).reshape(height, width)
