"""One viewpoint, from the scene to its record."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Int32

from .._picture import encoded
from .._rates import RATES
from ._camera import Camera
from ._coarse import coarse_invocations, every_pixel, Invocations
from ._interpolate import dot, Surface
from ._material import Reflectance
from ._render import BATCH, picture, Samples, shade, Shaded, Stage
from ._reproject import Before, reproject
from ._scene import Scene
from ._tone import automatic_exposure, to_bytes
from ._tracer import Tracer
from ._view import View
from ._visibility import visible_triangles


_FULL = (1, 1)
_FULL_INDEX = RATES.names.index("1x1")


def capture_view(
    scene: Scene,
    camera: Camera,
    previous: Camera,
    *,
    size: tuple[int, int],
    time: float = 0.0,
    interval: float = 1 / 60,
    tracer: Tracer | None = None,
    batch: int = BATCH,
) -> View:
    """Render a viewpoint at every shading rate, with what was known before.

    Visibility is that of full resolution at every rate; samples are shaded as
    `coarse_invocations` says, with textures read the coarser the larger the coarse
    pixel is. The exposure is that of this viewpoint's full-rate picture; the previous
    viewpoint's picture is shaded at full rate and has its own.

    **Arguments:**

    - `previous`: the camera of the frame before, `interval` seconds earlier.
    - `size`: width and height. [px], >= 1
    - `time`: at which the scene is seen. [s]
    - `interval`: between the two frames. [s]; still scenes do not depend on it.
    - `tracer`: of `scene.vertex` and `scene.triangle`, so that many viewpoints of a
        still scene need not build it anew; a moving scene's is built for each time.
    - `batch`: samples that are shaded at once. Each number is compiled for; those of
        one picture are held together, some 300 bytes each.

    **Raises:** `ValueError` for a size below 1; `ImportError` without `embreex`.
    """
    if min(size) < 1:
        raise ValueError(f"`size` must be >= 1 px, got {size[0]} x {size[1]}.")
    now, then = _stages(scene, time, time - interval, tracer)
    past = _before(then, previous, size=size, batch=batch)
    triangle = visible_triangles(now.tracer, camera, size=size)
    plain = every_pixel(triangle)
    shaded = shade(now, camera, plain, cell=_FULL, size=size, batch=batch)
    exposure = automatic_exposure(shaded.light)
    images, count = [], []
    for cell in map(tuple, RATES.size.tolist()):
        wanted = coarse_invocations(triangle, cell)
        light = shaded.light
        if cell != _FULL:
            light = shade(now, camera, wanted, cell=cell, size=size, batch=batch).light
        images.append(np.asarray(picture(light, wanted, float(exposure))))
        count.append(len(wanted))
    return View(
        images=np.stack(images),
        **_buffers(now.scene, camera, shaded, plain, past, size=size),
        invocations=np.array(count, np.int32),
        exposure=np.asarray(exposure),
        time=np.asarray(time, np.float32),
        camera=camera,
        previous_camera=previous,
        scene=scene.name,
    )


def _stages(
    scene: Scene, now: float, then: float, tracer: Tracer | None
) -> tuple[Stage, Stage]:
    if scene.animation is None:
        stage = Stage.of(scene) if tracer is None else Stage(scene, tracer)
        return stage, stage
    return Stage.of(scene.at(now)), Stage.of(scene.at(then))


def _before(
    stage: Stage, camera: Camera, *, size: tuple[int, int], batch: int
) -> Before:
    """The frame before, of which only the picture and its depth are kept."""
    wanted = every_pixel(visible_triangles(stage.tracer, camera, size=size))
    shaded = shade(stage, camera, wanted, cell=_FULL, size=size, batch=batch)
    image = picture(shaded.light, wanted, float(automatic_exposure(shaded.light)))
    depth = [np.asarray(_depth(camera, s.at))[: s.used] for s in shaded.batches]
    return Before(
        camera=camera,
        scene=stage.scene,
        image=image.astype(jnp.float32) / 255,
        depth=jnp.asarray(np.concatenate(depth).reshape(wanted.owner.shape)),
    )


def _buffers(
    scene: Scene,
    camera: Camera,
    shaded: Shaded,
    wanted: Invocations,
    before: Before,
    *,
    size: tuple[int, int],
) -> dict[str, np.ndarray]:
    """The fields of a view that have one value a pixel, whatever the rate."""
    parts: list[dict[str, np.ndarray]] = []
    start = 0
    for samples in shaded.batches:
        pixel = wanted.centre[start : start + samples.used]
        start += samples.used
        parts.append(_part(scene, camera, samples, pixel, before, size=size))
    width, height = size
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return {
        name: values.reshape(height, width, *values.shape[1:])
        for name, values in joined.items()
    }


def _part(
    scene: Scene,
    camera: Camera,
    samples: Samples,
    pixel: Float32[np.ndarray, "count 2"],
    before: Before,
    *,
    size: tuple[int, int],
) -> dict[str, np.ndarray]:
    place = np.zeros((len(samples.sun), 2), np.float32)
    place[: samples.used] = pixel
    found = reproject(before, samples.at, jnp.asarray(place), size=size)
    fields = _fields(scene, camera, samples.at, samples.made_of)
    fields |= {
        "motion": found.motion,
        "reprojected": to_bytes(found.colour),
        "seen": found.seen,
    }
    host = {name: np.asarray(x)[: samples.used] for name, x in fields.items()}
    return host | {"shadow": (255 * samples.sun[: samples.used]).astype(np.uint8)}


@jax.jit
def _fields(
    scene: Scene, camera: Camera, at: Surface, made_of: Reflectance
) -> dict[str, Any]:
    sky = at.triangle < 0
    nothing = lambda x: jnp.where(sky if x.ndim == 1 else sky[:, None], 0, x)
    axes = jnp.stack([camera.right, camera.up, -camera.forward])
    normal = jnp.sum(axes[:, :, None] * made_of.normal[None], axis=1)
    material = scene.material[jnp.maximum(at.triangle, 0)]
    texture: Int32[Array, " n"] = scene.materials.colour_texture[material]
    return {
        "normal": nothing(normal.T).astype(jnp.float16),
        "diffuse": to_bytes(encoded(nothing(made_of.diffuse.T))),
        "specular": to_bytes(encoded(nothing(made_of.specular.T))),
        "roughness": to_bytes(nothing(made_of.roughness)),
        "depth": _depth(camera, at),
        "uv": nothing(at.uv.T),
        "texture": nothing(texture).astype(jnp.uint16),
        "mip_level": nothing(made_of.mip_level).astype(jnp.float16),
    }


@jax.jit
def _depth(camera: Camera, at: Surface) -> Float[Array, " n"]:
    depth = dot(at.position - camera.position[:, None], camera.forward[:, None])
    return jnp.where(at.triangle < 0, jnp.inf, depth)
