"""Where what is seen now was seen before, and in what colour."""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Float32, Int

from ._camera import Camera
from ._interpolate import corners, held, mix, Surface
from ._scene import Scene


DEPTH_TOLERANCE = 0.01
"""How far a pixel of the previous picture may lie from the point, as a share of the
point's depth there."""


class Before(eqx.Module, strict=True):
    """The frame before.

    - `camera`, `scene`: as they stood then.
    - `image`: what was shown, as shares of white, sRGB-encoded. [1]
    - `depth`: along the view axis. [m], infinite for the sky.
    """

    camera: Camera
    scene: Scene
    image: Float32[Array, "height width 3"]
    depth: Float32[Array, "height width"]


class Reprojected(NamedTuple):
    """Of samples of this frame.

    - `colour`: of the previous picture. [1]; 0 where `seen` is not.
    - `seen`: whether the previous picture shows the same point.
    - `motion`: from the previous frame to this one, x right and y down. [px]; 0 for a
        point that was behind the camera.
    """

    colour: Float[Array, "n 3"]
    seen: Bool[Array, " n"]
    motion: Float[Array, "n 2"]


@functools.partial(jax.jit, static_argnames="size")
def reproject(
    before: Before, at: Surface, pixel: Float[Array, "n 2"], *, size: tuple[int, int]
) -> Reprojected:
    """Find points of this frame in the previous one.

    A point is taken back along the motion of its triangle; the sky is infinitely far.
    The colour is the bilinear mean of those of the four pixels around its place whose
    depth is that of the point to within `DEPTH_TOLERANCE`; it is unseen if none is, or
    if its place is outside of the picture.

    **Arguments:**

    - `pixel`: centres of the pixels that show the points now. [px], x and y
    - `size`: width and height of both pictures. [px]
    """
    sky = at.triangle < 0
    index = corners(before.scene, at.triangle)
    place = mix(at.weight, held(before.scene.vertex, index))
    # Any length will do for what the camera's motion cannot bring nearer.
    distant = before.camera.position[:, None] + at.direction
    place = jnp.where(sky[None], distant, place)
    x, y, depth = before.camera.project(place.T, *size)
    ahead = jnp.isfinite(x) & jnp.isfinite(y)
    where = jnp.where(ahead[:, None], jnp.stack([x, y], axis=1), -1.0)
    depth = jnp.where(sky, jnp.inf, depth)
    width, height = size
    within = ahead & jnp.all(where >= 0, axis=1)
    within &= (where[:, 0] < width) & (where[:, 1] < height)
    colour, weight = _taken(before, where, depth)
    seen = within & (weight > 0)
    colour = jnp.where(
        seen[:, None], colour / jnp.where(seen, weight, 1.0)[:, None], 0.0
    )
    motion = jnp.where(ahead[:, None], pixel - where, 0.0)
    return Reprojected(colour, seen, motion)


def _taken(
    before: Before, where: Float[Array, "n 2"], depth: Float[Array, " n"]
) -> tuple[Float[Array, "n 3"], Float[Array, " n"]]:
    """Weighted sum of the pixels that show the point, and of their weights."""
    height, width = before.depth.shape
    corner = jnp.floor(where - 0.5)
    share = where - 0.5 - corner
    # Far outside no number of a pixel would hold it.
    first = jnp.clip(corner, -2.0, 2.0 * max(width, height)).astype(jnp.int32)
    colour = jnp.zeros((len(where), 3), jnp.float32)
    total = jnp.zeros(len(where), jnp.float32)
    for right, down in ((0, 0), (1, 0), (0, 1), (1, 1)):
        x, y = first[:, 0] + right, first[:, 1] + down
        exists = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        x, y = jnp.clip(x, 0, width - 1), jnp.clip(y, 0, height - 1)
        weight = _part(share[:, 0], right) * _part(share[:, 1], down)
        weight = jnp.where(exists & _same_depth(before.depth[y, x], depth), weight, 0.0)
        colour += weight[:, None] * before.image[y, x]
        total += weight
    return colour, total


def _part(share: Float[Array, " n"], far: Int[Array, ""] | int) -> Float[Array, " n"]:
    return share if far else 1 - share


def _same_depth(
    found: Float[Array, " n"], expected: Float[Array, " n"]
) -> Bool[Array, " n"]:
    near = jnp.abs(found - expected) <= DEPTH_TOLERANCE * expected
    return jnp.where(jnp.isinf(expected), jnp.isinf(found), near)
