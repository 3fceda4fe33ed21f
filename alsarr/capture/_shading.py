"""Light that reaches the viewer: Lambert and GGX under the sun, lamps and the sky."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float32

from ._interpolate import dot, once, Surface, unit
from ._material import Reflectance
from ._scene import Lights
from ._tracer import Tracer


# How far shadow rays start from a surface: in metres, and per metre from the origin.
_LIFT, _LIFT_PER_METRE = 1e-4, 2e-5

# Nearer than this a lamp is no brighter. [m]
_NEAREST = 0.1

# Below it highlights are smaller than a pixel, and of no use to a picture.
_SMOOTHEST = 0.05


class ShadowRays(eqx.Module, strict=True):
    """Rays to the lights; the first light is the sun, then come the lamps.

    - `origin`: just off the surface. [m]
    - `direction`: unit.
    - `distance`: to the light. [m], infinite for the sun.
    - `needed`: whether the light is on the same side of the triangle as the viewer;
        where it is not, the point is in shadow.
    """

    origin: Float32[Array, "3 n"]
    direction: Float32[Array, "lights 3 n"]
    distance: Float32[Array, "lights n"]
    needed: Bool[Array, "lights n"]


def shadow_rays(lights: Lights, at: Surface) -> ShadowRays:
    """The rays that tell which lights reach points."""
    reach = jnp.max(jnp.abs(at.position), axis=0, keepdims=True)
    lift = _LIFT + _LIFT_PER_METRE * reach
    origin = once(at.position + lift * at.plane_normal)
    sun = jnp.broadcast_to(lights.sun_direction[:, None], origin.shape)
    lamps = [once(place[:, None] - origin) for place in lights.point_position]
    directions = [sun, *map(unit, lamps)]
    far = jnp.full(origin.shape[1:], jnp.inf, jnp.float32)
    distance = jnp.stack([far, *(jnp.sqrt(dot(x, x)) for x in lamps)])
    facing = jnp.stack([dot(x, at.plane_normal) > 0 for x in directions])
    needed = facing & (at.triangle >= 0)[None]
    return ShadowRays(origin, jnp.stack(directions), distance, needed)


def reached(tracer: Tracer, rays: ShadowRays) -> Float32[np.ndarray, "lights n"]:
    """1 where a light reaches a point and 0 where it does not.

    Only rays that are needed are traced.
    """
    origin, direction = np.asarray(rays.origin), np.asarray(rays.direction)
    distance, needed = np.asarray(rays.distance), np.asarray(rays.needed)
    visible = np.zeros(needed.shape, np.float32)
    for light, wanted in enumerate(needed):
        index = np.flatnonzero(wanted)
        stopped = tracer.occluded(
            origin[:, index].T, direction[light][:, index].T, distance[light, index]
        )
        visible[light, index] = ~stopped
    return visible


def radiance(
    lights: Lights,
    at: Surface,
    made_of: Reflectance,
    visible: Float[Array, "lights n"],
) -> Float[Array, "3 n"]:
    """Light towards the viewer, of the sky where no triangle was met.

    Lambert's law for the diffuse part and a microfacet model for the specular one:
    GGX's distribution, Smith's height-correlated masking and Schlick's Fresnel term.
    The sky lights without shadow: by its exact irradiance the diffuse part, and the
    specular one by its radiance in the mirror's direction, the less varied the rougher
    the surface is. Light bounces from nothing to another surface.

    **Arguments:**

    - `visible`: of each light, the sun first. [1], in [0, 1]

    **Source:** Walter et al. (2007), Microfacet Models for Refraction; Heitz (2014),
    Understanding the Masking-Shadowing Function, Eq. 99; glTF 2.0, Appendix B.
    """
    view = -at.direction
    from_sun = _reflected(made_of, view, lights.sun_direction[:, None])
    light = from_sun * lights.sun[:, None] * visible[0][None]
    lamps = (lights.point_position, lights.point_intensity, visible[1:])

    def with_lamp(
        light: Float[Array, "3 n"], lamp: tuple[Array, Array, Array]
    ) -> tuple[Float[Array, "3 n"], None]:
        place, intensity, reaches = lamp
        away = once(place[:, None] - at.position)
        square = jnp.maximum(dot(away, away), _NEAREST**2)
        share = _reflected(made_of, view, unit(away)) * (reaches / square)[None]
        return light + share * intensity[:, None], None

    # A loop is compiled once for all lamps.
    light, _ = jax.lax.scan(with_lamp, light, lamps)
    light += _ambient(lights, made_of, view) + made_of.emissive
    return jnp.where((at.triangle < 0)[None], _sky(lights, at.direction), light)


def _sky(lights: Lights, direction: Float[Array, "3 n"]) -> Float[Array, "3 n"]:
    mean, slope = _sky_blend(lights)
    return mean + slope * direction[1:2]


def _sky_blend(lights: Lights) -> tuple[Float[Array, "3 1"], Float[Array, "3 1"]]:
    """The sky's radiance is the first and, per unit of y, the second."""
    mean, slope = (lights.sky + lights.ground) / 2, (lights.sky - lights.ground) / 2
    return mean[:, None], slope[:, None]


def _reflected(
    made_of: Reflectance, view: Float[Array, "3 n"], towards: Float[Array, "3 _"]
) -> Float[Array, "3 n"]:
    """Share of a light's irradiance, on a plane facing it, that goes to the viewer."""
    towards = jnp.broadcast_to(towards, view.shape)
    half = unit(view + towards)
    facing_light = jnp.maximum(dot(made_of.normal, towards), 0.0)
    facing_view = jnp.maximum(dot(made_of.normal, view), 1e-3)
    facing_half = dot(made_of.normal, half)
    alpha_2 = jnp.maximum(made_of.roughness, _SMOOTHEST) ** 4
    spread = facing_half**2 * (alpha_2 - 1) + 1
    distribution = alpha_2 / (math.pi * spread**2)
    fresnel = _schlick(made_of.specular, jnp.maximum(dot(view, half), 0.0))
    mask = _masking(facing_light, facing_view, alpha_2)
    specular = fresnel * (distribution * mask)[None]
    diffuse = (1 - fresnel) * made_of.diffuse / math.pi
    return (diffuse + specular) * facing_light[None]


def _schlick(
    specular: Float[Array, "3 n"], cosine: Float[Array, " n"]
) -> Float[Array, "3 n"]:
    return specular + (1 - specular) * (1 - cosine[None]) ** 5


def _masking(
    light: Float[Array, " n"], view: Float[Array, " n"], alpha_2: Float[Array, " n"]
) -> Float[Array, " n"]:
    """Smith's term over four times both cosines. Heitz (2014), Eq. 99."""
    one = light * jnp.sqrt(view**2 * (1 - alpha_2) + alpha_2)
    other = view * jnp.sqrt(light**2 * (1 - alpha_2) + alpha_2)
    return 0.5 / (one + other)


def _ambient(
    lights: Lights, made_of: Reflectance, view: Float[Array, "3 n"]
) -> Float[Array, "3 n"]:
    mean, slope = _sky_blend(lights)
    normal, rough = made_of.normal, made_of.roughness[None]
    # The integral of a sky that is linear in y over the cosine's lobe.
    diffuse = made_of.diffuse * (mean + slope * (2 / 3) * normal[1:2])
    facing = jnp.maximum(dot(normal, view), 0.0)
    mirrored = 2 * facing[None] * normal - view
    seen = mirrored[1:2] * (1 - rough) + (2 / 3) * normal[1:2] * rough
    return diffuse + _sky_share(made_of, facing) * (mean + slope * seen)


def _sky_share(made_of: Reflectance, facing: Float[Array, " n"]) -> Float[Array, "3 n"]:
    """Share of light from everywhere that the specular part reflects.

    **Source:** Karis (2014), Physically Based Shading on Mobile (Unreal Engine), his
    fit to Lazarov's of the integral of GGX.
    """
    rough = made_of.roughness
    edge = jnp.minimum((1 - rough) ** 2, jnp.exp2(-9.28 * facing)) * (1 - rough)
    edge += 0.0425 - 0.0275 * rough
    scale = -1.04 * edge + 1.04 - 0.572 * rough
    offset = 1.04 * edge + 0.022 * rough - 0.04
    return made_of.specular * scale[None] + jnp.maximum(offset, 0.0)[None]
