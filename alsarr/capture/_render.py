"""Shading samples to light, in batches of one size so that one compilation serves."""

import functools
from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Int32, UInt8

from ._camera import Camera
from ._coarse import every_pixel, Invocations
from ._interpolate import corners, crossing, held, once, Surface, surface
from ._material import Reflectance, reflectance
from ._scene import Scene
from ._shading import radiance, reached, shadow_rays, ShadowRays
from ._tone import automatic_exposure, tone_mapped
from ._tracer import Tracer
from ._visibility import visible_triangles


BATCH = 32768
"""Samples that are shaded at once."""


class Stage(NamedTuple):
    """A scene as it stands at one moment, and the same triangles for rays."""

    scene: Scene
    tracer: Tracer

    @classmethod
    def of(cls, scene: Scene) -> "Stage":
        """Build the tree of triangles, which for many of them takes a second."""
        vertex = np.asarray(scene.vertex, np.float32)
        return cls(scene, Tracer(vertex, np.asarray(scene.triangle, np.int32)))


class Samples(NamedTuple):
    """A batch of shading samples; those beyond `used` only fill it.

    `sun` is 1 where the sun reaches the point and 0 where it does not.
    """

    used: int
    at: Surface
    made_of: Reflectance
    sun: Float32[np.ndarray, " batch"]


class Shaded(NamedTuple):
    """Light of shading samples, and the batches it was found in."""

    light: Float32[np.ndarray, "samples 3"]
    batches: list[Samples]


def shade(
    stage: Stage,
    camera: Camera,
    wanted: Invocations,
    *,
    cell: tuple[int, int],
    size: tuple[int, int],
    batch: int = BATCH,
) -> Shaded:
    """Shade every sample at the centre of its coarse pixel.

    Where the ray through that centre passes by the sample's triangle, it is shaded at
    the nearest pixel that shows the triangle, as hardware does.

    **Arguments:**

    - `cell`: width and height of the coarse pixel; textures are read as coarsely. [px]
    - `size`: width and height of the picture. [px]
    - `batch`: samples that are shaded at once. Each number is compiled for.
    """
    light = np.empty((len(wanted), 3), np.float32)
    step = jnp.asarray(cell, jnp.float32)
    # All are under way before the first is waited for: tracing then overlaps.
    pending = [
        (start, count, _points(stage.scene, camera, triangle, places, step, size=size))
        for start, count, triangle, places in _batches(wanted, batch)
    ]
    done = []
    for start, count, (at, made_of, rays) in pending:
        visible = reached(stage.tracer, rays)
        found = _light(stage.scene, at, made_of, jnp.asarray(visible))
        light[start : start + count] = np.asarray(found)[:, :count].T
        done.append(Samples(count, at, made_of, visible[0]))
    return Shaded(light, done)


def render(
    scene: Scene,
    camera: Camera,
    *,
    size: tuple[int, int],
    tracer: Tracer | None = None,
    exposure: float | None = None,
    batch: int = BATCH,
) -> UInt8[Array, "height width 3"]:
    """A picture of a scene, every pixel shaded.

    **Arguments:**

    - `scene`: as it stands; of a moving one `scene.at(time)`.
    - `size`: width and height. [px], >= 1
    - `tracer`: of the same scene, if there is one already.
    - `exposure`: what light is multiplied by before the tone curve. Automatic, if not
        given.
    - `batch`: samples that are shaded at once.

    **Returns:** sRGB bytes.
    """
    stage = Stage.of(scene) if tracer is None else Stage(scene, tracer)
    wanted = every_pixel(visible_triangles(stage.tracer, camera, size=size))
    light = shade(stage, camera, wanted, cell=(1, 1), size=size, batch=batch).light
    if exposure is None:
        exposure = float(automatic_exposure(light))
    return picture(light, wanted, exposure)


def picture(
    light: Float32[np.ndarray, "samples 3"], wanted: Invocations, exposure: float
) -> UInt8[Array, "height width 3"]:
    """Each pixel in the colour of its sample."""
    chosen = jnp.asarray(light)[jnp.asarray(wanted.owner)]
    return tone_mapped(chosen, jnp.asarray(exposure, jnp.float32))


def _batches(
    wanted: Invocations, batch: int
) -> Iterator[tuple[int, int, Int32[Array, " batch"], Float32[Array, "batch 2 2"]]]:
    """Batches of triangles, and of the coarse centre and the nearest covered pixel."""
    places = np.stack([wanted.centre, wanted.covered], axis=1)
    for start in range(0, len(wanted), batch):
        count = min(batch, len(wanted) - start)
        chosen = slice(start, start + count)
        fill = ((0, batch - count),)
        triangle = np.pad(wanted.triangle[chosen], fill, constant_values=-1)
        place = np.pad(places[chosen], (*fill, (0, 0), (0, 0)))
        yield start, count, jnp.asarray(triangle), jnp.asarray(place)


@functools.partial(jax.jit, static_argnames="size")
def _points(
    scene: Scene,
    camera: Camera,
    triangle: Int32[Array, " n"],
    places: Float[Array, "n 2 2"],
    step: Float[Array, " 2"],
    *,
    size: tuple[int, int],
) -> tuple[Surface, Reflectance, ShadowRays]:
    """What is known of samples before the lights are asked."""
    rays = lambda x, y: once(camera.rays(x, y, *size).T)
    corner = held(scene.vertex, corners(scene, triangle))
    through = rays(places[:, 0, 0], places[:, 0, 1])
    inside = crossing(corner, camera.position, through).inside() | (triangle < 0)
    x, y = once(jnp.where(inside[:, None], places[:, 0], places[:, 1]).T)
    around = (rays(x, y), rays(x + step[0], y), rays(x, y + step[1]))
    at = once(surface(scene, triangle, camera.position, around))
    return at, reflectance(scene, at), shadow_rays(scene.lights, at)


@jax.jit
def _light(
    scene: Scene, at: Surface, made_of: Reflectance, visible: Float[Array, "lights n"]
) -> Float[Array, "3 n"]:
    return radiance(scene.lights, at, made_of, visible)
