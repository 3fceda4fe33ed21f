"""Where a ray meets a triangle's plane, and what the vertices say of that point."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Float32, Int, Int32

from ._scene import Scene


# A footprint where the next ray does not meet the plane: no mip level is too coarse.
_ENDLESS = 1e6

# Cosine to the viewer that no normal falls below.
_EDGE_ON = 0.05


class Crossing(NamedTuple):
    """Of rays with the planes of triangles.

    `second` and `third` are the weights of those vertices, that of the first is the
    rest of 1. `distance` is along the ray, negative behind its origin. [m]
    """

    second: Float[Array, " n"]
    third: Float[Array, " n"]
    distance: Float[Array, " n"]

    def inside(self) -> Bool[Array, " n"]:
        """Whether the ray meets the triangle itself, its edge included."""
        within = (self.second >= 0) & (self.third >= 0)
        return within & (self.second + self.third <= 1) & (self.distance > 0)


def crossing(
    corner: Float[Array, "vertex axis n"],
    origin: Float[Array, " 3"],
    direction: Float[Array, "3 n"],
) -> Crossing:
    """Where rays from one origin meet the planes of triangles.

    A ray along the plane gives numbers that are large or no numbers.

    **Arguments:**

    - `corner`: the vertices of a triangle for each ray. [m]

    **Source:** Moeller and Trumbore (1997), Fast, Minimum Storage Ray/Triangle
    Intersection, Journal of Graphics Tools 2(1).
    """
    first, second = corner[1] - corner[0], corner[2] - corner[0]
    across = cross(direction, second)
    start = origin[:, None] - corner[0]
    turned = cross(start, first)
    scale = 1 / dot(first, across)
    return once(
        Crossing(
            dot(start, across) * scale,
            dot(direction, turned) * scale,
            dot(second, turned) * scale,
        )
    )


class Surface(eqx.Module, strict=True):
    """Points on triangles, and how far apart their neighbours' rays fall.

    Axes come before points everywhere: arithmetic on threes is slow where they are
    the innermost.

    - `triangle`: -1 where the ray meets none; all else then means nothing but
        `direction`.
    - `direction`: of the ray. Unit.
    - `weight`: of the triangle's three vertices. [1], in [0, 1], of sum 1.
    - `position`: [m].
    - `plane_normal`, `normal`: of the triangle, and interpolated from the vertices;
        both on the viewer's side. Unit.
    - `tangent`, `bitangent`: of the texture's x axis and of its upward y axis
        (glTF 2.0, 3.9.3), unit, and orthogonal to `normal`; 0 where uv are degenerate.
    - `uv`: [1].
    - `footprint_x`, `footprint_y`: what uv change by to the next ray to the right and
        below. [1]
    """

    triangle: Int32[Array, " n"]
    direction: Float32[Array, "3 n"]
    weight: Float32[Array, "3 n"]
    position: Float32[Array, "3 n"]
    plane_normal: Float32[Array, "3 n"]
    normal: Float32[Array, "3 n"]
    tangent: Float32[Array, "3 n"]
    bitangent: Float32[Array, "3 n"]
    uv: Float32[Array, "2 n"]
    footprint_x: Float32[Array, "2 n"]
    footprint_y: Float32[Array, "2 n"]


def surface(
    scene: Scene,
    triangle: Int[Array, " n"],
    origin: Float[Array, " 3"],
    rays: tuple[Float[Array, "3 n"], Float[Array, "3 n"], Float[Array, "3 n"]],
) -> Surface:
    """Interpolate what the vertices hold to where rays meet their triangles.

    **Arguments:**

    - `triangle`: that each ray meets, or -1.
    - `origin`: of all rays. [m]
    - `rays`: directions through the point, and through the next to its right and the
        next below, at the distance of one shading sample. Unit.
    """
    direction, right, below = rays
    index = corners(scene, triangle)
    corner, uv = held(scene.vertex, index), held(scene.uv, index)
    here = crossing(corner, origin, direction)
    weight = _weights(here)
    edge_1, edge_2 = corner[1] - corner[0], corner[2] - corner[0]
    plane = _facing(unit(cross(edge_1, edge_2)), direction)
    smooth = unit(mix(weight, held(scene.normal, index)))
    # Vertex normals tell a surface's front; the viewer may be behind it.
    smooth = jnp.where(dot(smooth, plane)[None] < 0, -smooth, smooth)
    smooth = bent(smooth, direction)
    tangent, bitangent = _texture_axes(edge_1, edge_2, uv, smooth)
    plane_uv = _plane_uv(here, uv)
    return Surface(
        triangle=triangle,
        direction=direction,
        weight=weight,
        position=mix(weight, corner),
        plane_normal=plane,
        normal=smooth,
        tangent=tangent,
        bitangent=bitangent,
        uv=mix(weight, uv),
        footprint_x=_footprint(crossing(corner, origin, right), uv, plane_uv),
        footprint_y=_footprint(crossing(corner, origin, below), uv, plane_uv),
    )


def corners(scene: Scene, triangle: Int[Array, " n"]) -> Int32[Array, "3 n"]:
    """The vertices of triangles; of no triangle, any."""
    each = jnp.arange(3, dtype=jnp.int32)[:, None]
    index = scene.triangle[jnp.maximum(triangle, 0)[None], each]
    return once(index)


def held(
    values: Float[Array, "vertices axis"], index: Int[Array, "3 n"]
) -> Float[Array, "3 axis n"]:
    """What vertices hold, an axis at a time: rows of threes are read slowly."""
    axis = jnp.arange(values.shape[1], dtype=jnp.int32)[None, :, None]
    return once(values[index[:, None], axis])


def mix(
    weight: Float[Array, "3 n"], corner: Float[Array, "3 axis n"]
) -> Float[Array, "axis n"]:
    """The weighted mean of what three vertices hold."""
    first, second, third = weight[:, None]
    return first * corner[0] + second * corner[1] + third * corner[2]


def dot(a: Float[Array, "3 n"], b: Float[Array, "3 _"]) -> Float[Array, " n"]:
    """Of vectors on the first axis; the second may be one for all."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Float[Array, "3 n"], b: Float[Array, "3 n"]) -> Float[Array, "3 n"]:
    """Of vectors on the first axis."""
    x, y, z = (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )
    return once(jnp.stack([x, y, z]))


def once(values: Any) -> Any:
    """The same values, computed once: XLA else does it anew for each of their uses."""
    return jax.lax.optimization_barrier(values)


def unit(vector: Float[Array, "3 n"]) -> Float[Array, "3 n"]:
    """The vectors at length 1; one of length 0 stays."""
    square = dot(vector, vector)
    return once(vector / jnp.sqrt(jnp.where(square > 0, square, 1.0))[None])


def _weights(here: Crossing) -> Float[Array, "3 n"]:
    """Of the vertices; of a point that rounding put outside, those of the edge."""
    weight = jnp.stack([1 - here.second - here.third, here.second, here.third])
    weight = jnp.maximum(jnp.where(jnp.isfinite(weight), weight, 1 / 3), 0.0)
    return once(weight / (weight[0] + weight[1] + weight[2])[None])


def _facing(
    normal: Float[Array, "3 n"], direction: Float[Array, "3 n"]
) -> Float[Array, "3 n"]:
    return jnp.where(dot(normal, direction)[None] > 0, -normal, normal)


def bent(
    normal: Float[Array, "3 n"], direction: Float[Array, "3 n"]
) -> Float[Array, "3 n"]:
    """Normals turned until none looks away from the viewer.

    Those of coarse meshes do beside their outlines, which would be drawn dark.
    """
    away = jnp.maximum(dot(normal, direction) + _EDGE_ON, 0.0)
    return unit(normal - away[None] * direction)


def _texture_axes(
    edge_1: Float[Array, "3 n"],
    edge_2: Float[Array, "3 n"],
    uv: Float[Array, "3 2 n"],
    normal: Float[Array, "3 n"],
) -> tuple[Float[Array, "3 n"], Float[Array, "3 n"]]:
    """Directions in which u rises and v falls, made orthogonal to the normal."""
    (u_1, v_1), (u_2, v_2) = uv[1] - uv[0], uv[2] - uv[0]
    sign = jnp.sign(u_1 * v_2 - u_2 * v_1)[None]
    along_u = (edge_1 * v_2[None] - edge_2 * v_1[None]) * sign
    against_v = (edge_1 * u_2[None] - edge_2 * u_1[None]) * sign
    tangent = unit(along_u - normal * dot(along_u, normal)[None])
    bitangent = against_v - normal * dot(against_v, normal)[None]
    return tangent, unit(bitangent - tangent * dot(bitangent, tangent)[None])


def _plane_uv(at: Crossing, uv: Float[Array, "3 2 n"]) -> Float[Array, "2 n"]:
    """Of a point of the plane, in the triangle or not."""
    across = at.second[None] * (uv[1] - uv[0])
    return uv[0] + across + at.third[None] * (uv[2] - uv[0])


def _footprint(
    near: Crossing, uv: Float[Array, "3 2 n"], here: Float[Array, "2 n"]
) -> Float[Array, "2 n"]:
    step = _plane_uv(near, uv) - here
    met = (near.distance > 0)[None] & jnp.isfinite(step)
    return jnp.clip(jnp.where(met, step, _ENDLESS), -_ENDLESS, _ENDLESS)
