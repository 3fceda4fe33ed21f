"""Where the eye is, and which ray belongs to which pixel."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from camojab._errors import check

from ._numbers import Numbers


_SHORTEST = 1e-6


class Camera(eqx.Module, strict=True):
    """A pinhole camera, in right-handed coordinates with y up.

    Pixel coordinates run from (0, 0), the top left corner of the picture, x to the
    right and y down; the centre of the first pixel is (0.5, 0.5). All arithmetic is
    in float32.

    **Arguments:**

    - `position`: of the pinhole. [m], finite.
    - `forward`: view axis, of any length but 0; kept as a unit vector.
    - `up`: any direction not along `forward`; kept as the unit vector nearest to it
        that is orthogonal to `forward`.
    - `fov_y`: full vertical angle of view. [deg], in (0, 180).

    **Raises:** `ValueError` for a value out of range; under a JAX transformation at run
    time.
    """

    position: Float[Array, "3"]
    forward: Float[Array, "3"]
    up: Float[Array, "3"]
    fov_y: Float[Array, ""]

    def __init__(
        self,
        position: Numbers,
        forward: Numbers,
        up: Numbers = (0.0, 1.0, 0.0),
        *,
        fov_y: ArrayLike = 60.0,
    ):
        finite = jnp.isfinite
        self.position = check(
            "position", _vector("position", position), finite, "finite"
        )
        self.forward = _unit("forward", _vector("forward", forward), "not 0")
        upright = _vector("up", up)
        upright = upright - jnp.sum(upright * self.forward) * self.forward
        self.up = _unit("up", upright, "a direction other than `forward`'s")
        angle = jnp.asarray(fov_y, jnp.float32)
        self.fov_y = check(
            "fov_y", angle, lambda v: (v > 0) & (v < 180), "in (0, 180) deg"
        )

    @classmethod
    def look_at(
        cls,
        position: Numbers,
        target: Numbers,
        up: Numbers = (0.0, 1.0, 0.0),
        *,
        fov_y: ArrayLike = 60.0,
    ) -> "Camera":
        """The camera at `position` [m] with `target` [m] in the middle of its picture.

        **Raises:** as the class, also if both points are one.
        """
        forward = _vector("target", target) - _vector("position", position)
        return cls(position, forward, up, fov_y=fov_y)

    @property
    def right(self) -> Float[Array, "3"]:
        """Unit vector to the right of the picture."""
        return jnp.cross(self.forward, self.up)

    @partial(jax.jit, static_argnames=("width", "height"))
    def rays(
        self, x: Float[Array, "*n"], y: Float[Array, "*n"], width: int, height: int
    ) -> Float[Array, "*n 3"]:
        """Unit directions through points of a picture of `width` x `height` pixels.

        **Arguments:**

        - `x`, `y`: pixel coordinates; outside of the picture too. [px]

        **Returns:** directions in the world, from `position`. Pixels are square.
        """
        across, down = _tangents(self, width, height)
        tangent_x = (2 * x.astype(jnp.float32) / width - 1) * across
        tangent_y = (2 * y.astype(jnp.float32) / height - 1) * down
        direction = (
            _times(jnp.ones_like(tangent_x), self.forward)
            + _times(tangent_x, self.right)
            - _times(tangent_y, self.up)
        )
        length = jnp.sqrt(1 + tangent_x**2 + tangent_y**2)
        return direction / length[..., None]

    @partial(jax.jit, static_argnames=("width", "height"))
    def project(
        self, point: Float[Array, "*n 3"], width: int, height: int
    ) -> tuple[Float[Array, "*n"], Float[Array, "*n"], Float[Array, "*n"]]:
        """Where points of the world lie in a picture of `width` x `height` pixels.

        **Arguments:**

        - `point`: in the world. [m]

        **Returns:** x and y [px], and the depth along `forward` [m]. A point whose
        depth is not > 0 lies behind the camera and has no place: x and y are NaN.
        """
        across, down = _tangents(self, width, height)
        away = point.astype(jnp.float32) - jnp.broadcast_to(self.position, point.shape)
        depth = _along(away, self.forward)
        near = jnp.where(depth > 0, depth, jnp.nan)
        x = (_along(away, self.right) / (near * across) + 1) * (width / 2)
        y = (1 - _along(away, self.up) / (near * down)) * (height / 2)
        return x, y, depth


def _tangents(
    camera: Camera, width: int, height: int
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Tangents of half the horizontal and half the vertical angle of view."""
    down = jnp.tan(jnp.deg2rad(camera.fov_y) / 2)
    return down * (width / height), down


def _times(factor: Float[Array, "*n"], vector: Float[Array, "3"]) -> Array:
    return factor[..., None] * jnp.broadcast_to(vector, (*factor.shape, 3))


def _along(vectors: Float[Array, "*n 3"], axis: Float[Array, "3"]) -> Array:
    # A matrix product would be rounded to fewer digits on some accelerators.
    return jnp.sum(vectors * jnp.broadcast_to(axis, vectors.shape), axis=-1)


def _vector(name: str, value: Numbers) -> Float[Array, "3"]:
    vector = jnp.asarray(value, jnp.float32)
    if vector.shape != (3,):
        raise ValueError(f"`{name}` must have shape [3], got {list(vector.shape)}.")
    return vector


def _unit(name: str, vector: Float[Array, "3"], rule: str) -> Float[Array, "3"]:
    length = jnp.sqrt(jnp.sum(vector**2))
    length = check(name, length, lambda v: (v > _SHORTEST) & jnp.isfinite(v), rule)
    return vector / length
