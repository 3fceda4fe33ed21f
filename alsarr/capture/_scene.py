"""What there is to see: triangles, what they are made of, and what lights them."""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float32, Int32

from camojab import Spectrum
from camojab._errors import check
from camojab._spectrum import SIZE

from ._animation import Animation
from ._numbers import Numbers
from ._texels import Texels


class Material(NamedTuple):
    """One material of the metallic-roughness model of glTF 2.0.

    - `base_colour`: linear light, times the colour texture. [1], in [0, 1]
    - `metallic`, `roughness`: times the surface texture's blue and green. Roughness is
        perceptual: GGX's alpha is its square. [1], in [0, 1]
    - `emissive`: light given off. [radiance], >= 0
    - `colour_texture`, `surface_texture`, `normal_texture`: indices into `Texels`.
    """

    base_colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    metallic: float = 0.0
    roughness: float = 1.0
    emissive: tuple[float, float, float] = (0.0, 0.0, 0.0)
    colour_texture: int = Texels.WHITE
    surface_texture: int = Texels.WHITE
    normal_texture: int = Texels.FLAT


class Materials(eqx.Module, strict=True):
    """All materials of a scene, one entry each; the fields are those of `Material`."""

    base_colour: Float32[Array, "materials 3"]
    metallic: Float32[Array, " materials"]
    roughness: Float32[Array, " materials"]
    emissive: Float32[Array, "materials 3"]
    colour_texture: Int32[Array, " materials"]
    surface_texture: Int32[Array, " materials"]
    normal_texture: Int32[Array, " materials"]

    @classmethod
    def of(cls, materials: Sequence[Material]) -> "Materials":
        """The materials in their order.

        **Raises:** `ValueError` for none, or for numbers out of range.
        """
        if not materials:
            raise ValueError("`materials` must hold at least one material, got none.")
        columns = dict(zip(Material._fields, zip(*materials, strict=True), strict=True))
        share = lambda name: check(
            name,
            jnp.asarray(columns[name], jnp.float32),
            lambda v: (v >= 0) & (v <= 1),
            "in [0, 1]",
        )
        index = lambda name: jnp.asarray(columns[name], jnp.int32)
        return cls(
            base_colour=share("base_colour"),
            metallic=share("metallic"),
            roughness=share("roughness"),
            emissive=_light("emissive", columns["emissive"]),
            colour_texture=index("colour_texture"),
            surface_texture=index("surface_texture"),
            normal_texture=index("normal_texture"),
        )


class Lights(eqx.Module, strict=True):
    """What lights a scene; linear light, red, green and blue, in one arbitrary unit.

    **Arguments:**

    - `sun_direction`: towards the sun, of any length but 0; kept as a unit vector.
    - `sun`: irradiance on a plane that faces the sun; 0 for none. >= 0
    - `point_position`: of lights without size. [m]
    - `point_intensity`: their radiant intensity, so that the irradiance at a distance
        d is intensity / d^2. >= 0
    - `sky`, `ground`: radiance of the zenith and the nadir, blended linearly by the y
        of a direction: the background, and what lights and is reflected by every
        surface. >= 0

    **Raises:** `ValueError` for a shape or a value out of range.
    """

    sun_direction: Float32[Array, "3"]
    sun: Float32[Array, "3"]
    point_position: Float32[Array, "points 3"]
    point_intensity: Float32[Array, "points 3"]
    sky: Float32[Array, "3"]
    ground: Float32[Array, "3"]

    def __init__(
        self,
        *,
        sun_direction: Numbers = (0.3, 0.8, 0.5),
        sun: Numbers = (0.0, 0.0, 0.0),
        point_position: Numbers = (),
        point_intensity: Numbers = (),
        sky: Numbers = (0.0, 0.0, 0.0),
        ground: Numbers = (0.0, 0.0, 0.0),
    ):
        direction = jnp.asarray(sun_direction, jnp.float32)
        length = jnp.sqrt(jnp.sum(direction**2))
        length = check("sun_direction", length, lambda v: v > 0, "a direction, not 0")
        self.sun_direction = direction / length
        self.sun = _light("sun", sun)
        place = jnp.asarray(point_position, jnp.float32).reshape(-1, 3)
        self.point_position = check("point_position", place, jnp.isfinite, "finite")
        self.point_intensity = _light("point_intensity", point_intensity).reshape(-1, 3)
        if self.point_position.shape != self.point_intensity.shape:
            raise ValueError(
                "`point_intensity` must be one for every `point_position`, got "
                f"{len(self.point_intensity)} for {len(self.point_position)}."
            )
        self.sky, self.ground = _light("sky", sky), _light("ground", ground)


class Mesh(NamedTuple):
    """Triangles of one material that move together, on the host.

    - `vertex`: positions. [m]
    - `normal`: unit normals of the vertices, on the outside.
    - `uv`: texture coordinates of the vertices, v down.
    - `triangle`: indices into `vertex`.
    - `material`: index into the scene's materials.
    - `part`: 0 for what stands still, else which of the animation's parts it is.
    """

    vertex: Float32[np.ndarray, "vertices 3"]
    normal: Float32[np.ndarray, "vertices 3"]
    uv: Float32[np.ndarray, "vertices 2"]
    triangle: Int32[np.ndarray, "triangles 3"]
    material: int
    part: int = 0


class Scene(eqx.Module, strict=True):
    """Everything that a picture is made of, as arrays in float32.

    - `name`: what the scene is called in records.
    - `vertex` [m], `normal` (unit), `uv` (v down) and `part` belong to vertices; part 0
        stands still.
    - `triangle`, `material`: three vertices and one material for each triangle.
    - `materials`, `texels`, `lights`: as described there.
    - `start`: a point in free space, from which viewpoints are looked for. [m]
    - `texture_name`: a name for each texture of `texels`.
    - `animation`: how the parts move; `None` for a still scene.
    - `bounds`: lowest and highest corner of the box that viewpoints stay in. [m]
    """

    name: str = eqx.field(static=True)
    vertex: Float32[Array, "vertices 3"]
    normal: Float32[Array, "vertices 3"]
    uv: Float32[Array, "vertices 2"]
    triangle: Int32[Array, "triangles 3"]
    material: Int32[Array, " triangles"]
    part: Int32[Array, " vertices"]
    materials: Materials
    texels: Texels
    lights: Lights
    start: Float32[Array, "3"]
    texture_name: tuple[str, ...] = eqx.field(static=True)
    animation: Animation | None
    bounds: Float32[Array, "2 3"]

    @classmethod
    def of(
        cls,
        name: str,
        meshes: Sequence[Mesh],
        materials: Sequence[Material],
        textures: dict[str, Float32[np.ndarray, "_ _ 3"]],
        *,
        lights: Lights,
        start: Numbers,
        animation: Animation | None = None,
        bounds: Numbers | None = None,
    ) -> "Scene":
        """Put a scene together.

        **Arguments:**

        - `meshes`: at least one, with a triangle in one of them.
        - `materials`: by the meshes' indices.
        - `textures`: by name, in the order that makes them textures 2, 3, ...
        - `bounds`: by default the box about all vertices.

        **Raises:** `ValueError` for an index out of range, or nothing to see.
        """
        if not sum(len(mesh.triangle) for mesh in meshes):
            raise ValueError("`meshes` must hold at least one triangle, got none.")
        _check_indices(meshes, materials, len(textures) + Texels.FIRST, animation)
        first = np.cumsum([0] + [len(mesh.vertex) for mesh in meshes])
        join = lambda arrays, dtype: jnp.asarray(np.concatenate(arrays), dtype)
        vertex = np.concatenate([mesh.vertex for mesh in meshes])
        if bounds is None:
            bounds = np.stack([vertex.min(axis=0), vertex.max(axis=0)])
        return cls(
            name=name,
            vertex=jnp.asarray(vertex, jnp.float32),
            normal=join([mesh.normal for mesh in meshes], jnp.float32),
            uv=join([mesh.uv for mesh in meshes], jnp.float32),
            triangle=join(
                [m.triangle + f for m, f in zip(meshes, first[:-1], strict=True)],
                jnp.int32,
            ),
            material=join(
                [np.full(len(m.triangle), m.material) for m in meshes], jnp.int32
            ),
            part=join([np.full(len(m.vertex), m.part) for m in meshes], jnp.int32),
            materials=Materials.of(materials),
            texels=Texels.from_pictures(list(textures.values())),
            lights=lights,
            start=jnp.asarray(start, jnp.float32),
            texture_name=("white", "flat normal", *textures),
            animation=animation,
            bounds=jnp.asarray(bounds, jnp.float32),
        )

    def at(self, time: ArrayLike) -> "Scene":
        """The scene as it stands at a time, without its animation.

        Parts and the lights that hang on them are moved. A still scene returns itself,
        and so does what this returns, whatever the time. Of two times the vertices are
        the same in number and order, so their difference is the motion between.

        **Arguments:**

        - `time`: [s], finite.
        """
        if self.animation is None:
            return self
        motion = self.animation.pose(time)
        vertex = motion.points(self.vertex, self.part)
        normal = motion.directions(self.normal, self.part)
        point = motion.points(self.lights.point_position, self.animation.light_part)
        where = lambda scene: (
            scene.vertex,
            scene.normal,
            scene.lights.point_position,
            scene.animation,
        )
        return eqx.tree_at(where, self, (vertex, normal, point, None))

    def spectrum(self, index: int) -> Spectrum:
        """Of a texture's luminance, repeated where it has less than 512 texels.

        **Arguments:**

        - `index`: of the texture, as in `texture_name` and `View.texture`.

        **Raises:** `ValueError` for an index out of range.
        """
        if not 0 <= index < len(self.texture_name):
            raise ValueError(
                f"`index` must be in [0, {len(self.texture_name)}), got {index}."
            )
        picture = self.texels.picture(index)[:SIZE, :SIZE]
        times = [-(-SIZE // side) for side in picture.shape[:2]]
        repeated = np.tile(picture, (*times, 1))[:SIZE, :SIZE]
        return Spectrum.from_texture(np.clip(repeated, 0, 1), encoding="linear")


def _light(name: str, value: Numbers) -> Float32[Array, "..."]:
    bright = lambda v: (v >= 0) & jnp.isfinite(v)
    return check(name, jnp.asarray(value, jnp.float32), bright, ">= 0 and finite")


def _check_indices(
    meshes: Sequence[Mesh],
    materials: Sequence[Material],
    textures: int,
    animation: Animation | None,
) -> None:
    parts = 1 if animation is None else 1 + len(animation.pivot)
    for index, mesh in enumerate(meshes):
        for name, value, count in (
            ("material", mesh.material, len(materials)),
            ("part", mesh.part, parts),
        ):
            if not 0 <= value < count:
                raise ValueError(
                    f"`{name}` of mesh {index} must be in [0, {count}), got {value}."
                )
        if len(mesh.triangle) and not (
            0 <= mesh.triangle.min() and mesh.triangle.max() < len(mesh.vertex)
        ):
            raise ValueError(
                f"`triangle` of mesh {index} must hold indices of its "
                f"{len(mesh.vertex)} vertices, got {mesh.triangle.min()} to "
                f"{mesh.triangle.max()}."
            )
    for index, material in enumerate(materials):
        used = material[4:]
        if min(used) < 0 or max(used) >= textures:
            raise ValueError(
                f"`materials` must use textures in [0, {textures}), number {index} "
                f"has {used}."
            )
