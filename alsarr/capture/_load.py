"""Scenes from glTF and OBJ files."""

import json
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, cast
from urllib.parse import unquote

import numpy as np
from jaxtyping import Float32

from camojab._extras import needed

from ._numbers import Numbers
from ._scene import Lights, Material, Mesh, Scene
from ._surroundings import surroundings
from ._texels import linear_light, Texels


Picture = Float32[np.ndarray, "height width 3"]
FORMATS = (".glb", ".gltf", ".obj")


def load_scene(
    path: str | Path,
    *,
    name: str | None = None,
    lights: Lights | None = None,
    start: Numbers | None = None,
    bounds: Numbers | None = None,
) -> Scene:
    """Read a scene from a glTF 2.0 (.glb, .gltf) or Wavefront OBJ (.obj) file.

    Of glTF: triangles, the scene graph's transforms, normals (computed where there are
    none), the first set of texture coordinates (0 where there is none), and the factors
    and textures of the materials' base colour, metallic-roughness, normal and emissive.
    Of OBJ: the same geometry, and of materials `map_Kd`, or `Kd` where there is none;
    `Ks` is ignored and roughness follows from `Ns`.

    Every surface is opaque and seen from both sides: rays are not asked about alpha, so
    cut-out leaves and panes of glass are solid, and texels whose alpha is 0 take the
    colour of those around them. Vertex colours, the factors of normal textures,
    cameras, lights and animations in the file are ignored. Lengths are metres and y is
    up.

    **Arguments:**

    - `path`: other files that it names are looked for beside it.
    - `name`: of the scene; by default the file's name without its ending.
    - `lights`: by default a sun and a sky, and in a room that has a ceiling a lamp
        below it that lights the room about as much as the sun lights a field.
    - `start`: a point in free space, from which viewpoints are looked for [m]; by
        default, of 512 points in `bounds`, the one farthest from everything that does
        not look at the back of surfaces.
    - `bounds`: lowest and highest corner of where viewpoints may be [m]; by default the
        box about all vertices, and for an object that stands free half its size more on
        every side.

    **Warns:** naming them, of textures that cannot be read; they are white (flat, for
    normals).

    **Raises:** `ValueError` for a file that cannot be read or holds no triangle;
    `ImportError` without the extra `capture` (trimesh).
    """
    path = Path(path)
    graph = _graph(path)
    images = _Images()
    is_obj = path.suffix.lower() == ".obj"
    maps = _mtl_maps(path) if is_obj else {}
    missing = _missing(set(maps.values()) if is_obj else _gltf_files(path, "images"))
    if missing:
        warnings.warn(
            f"{path.name}: these textures cannot be read and are white: "
            f"{', '.join(sorted(file.name for file in missing))}.",
            stacklevel=2,
        )
    there = {name: file for name, file in maps.items() if file not in missing}
    material_of = _obj_materials(there) if is_obj else _gltf_material
    numbers: dict[Material, int] = {}
    meshes = []
    for node in sorted(graph.graph.nodes_geometry):
        transform, geometry = graph.graph[node]
        part = graph.geometry[geometry]
        # Points and lines are no surfaces.
        if not hasattr(part, "faces") or not len(part.faces):
            continue
        material = material_of(part.visual, images)
        number = numbers.setdefault(material, len(numbers))
        meshes.append(_mesh(part, np.asarray(transform, float), number))
    if not meshes:
        raise ValueError(f"`path` must hold triangles, {path.name} has none.")
    vertex = np.concatenate([mesh.vertex for mesh in meshes])
    if not np.all(np.isfinite(vertex)):
        raise ValueError(f"`path` must hold finite positions, {path.name} does not.")
    found = surroundings(meshes, start=start, bounds=bounds)
    return Scene.of(
        name or path.stem,
        meshes,
        list(numbers),
        images.pictures,
        lights=lights or found.lights,
        start=found.start,
        bounds=found.bounds,
    )


def scene_files(path: Path) -> list[Path]:
    """A scene's file and those that it names, whether or not they are there."""
    named: set[Path] = set()
    if path.suffix.lower() == ".obj":
        named = {path.parent / library for _, library in _statements(path, "mtllib")}
        named |= set(_mtl_maps(path).values())
    # What is wrong with a file is for `load_scene` to say.
    with suppress(ValueError, TypeError, AttributeError):
        if path.suffix.lower() == ".gltf":
            named = _gltf_files(path, "buffers", "images")
    return [path, *sorted(named)]


class _Images:
    """The textures that are in use, each once and by name."""

    def __init__(self):
        self.pictures: dict[str, Picture] = {}
        self._number: dict[tuple[Any, bool], int] = {}

    def number(
        self, key: Any, read: Callable[[], Any], *, name: str, colour: bool
    ) -> int:
        """Index of the texture that `key` stands for, read when first asked for."""
        if (key, colour) not in self._number:
            image = read()
            picture = _light(image) if colour else _plain(image)
            while name in self.pictures:
                name += "'"
            self.pictures[name] = picture
            self._number[key, colour] = len(self.pictures) - 1 + Texels.FIRST
        return self._number[key, colour]


def _plain(image: Any) -> Picture:
    return np.asarray(image.convert("RGB")).astype(np.float32) / np.float32(255)


def _light(image: Any) -> Picture:
    light = linear_light(np.asarray(image.convert("RGB")))
    if image.mode != "RGBA" and "transparency" not in image.info:
        return light
    cover = np.asarray(image.convert("RGBA"))[:, :, 3:] > 0
    return _filled(light, cover.astype(np.float32))


def _filled(light: Picture, cover: np.ndarray) -> Picture:
    """Texels without cover take the mean of the smallest 2^n block that has some."""
    height, width = light.shape[:2]
    if np.all(cover > 0) or max(height, width) == 1:
        return light
    even = ((0, height % 2), (0, width % 2), (0, 0))
    blocks = lambda x: sum(np.pad(x, even)[i::2, j::2] for i in (0, 1) for j in (0, 1))
    weight = blocks(cover)
    mean = blocks(light * cover) / np.maximum(weight, 1e-9)
    coarse = _filled(mean, np.minimum(weight, 1))
    around = coarse.repeat(2, axis=0).repeat(2, axis=1)[:height, :width]
    return np.where(cover > 0, light, around)


def _graph(path: Path) -> Any:
    if path.suffix.lower() not in FORMATS:
        raise ValueError(f"`path` must end in {', '.join(FORMATS)}, got {path.name}.")
    if not path.is_file():
        raise ValueError(f"`path` must be a file, there is no {path}.")
    trimesh = needed("capture", "trimesh", "reading scenes")
    try:
        return cast(Any, trimesh.load_scene(path, process=False))
    # Its readers raise whatever their parsers do on a broken file.
    except Exception as error:
        reason = str(error) or type(error).__name__
        raise ValueError(f"`path` cannot be read: {path.name}: {reason}.") from error


def _mesh(part: Any, transform: np.ndarray, material: int) -> Mesh:
    linear = transform[:3, :3]
    vertex = np.asarray(part.vertices) @ linear.T + transform[:3, 3]
    triangle = np.asarray(part.faces, np.int32)
    # A mirrored copy is seen from inside unless its corners change order.
    if np.linalg.det(linear) < 0:
        triangle = triangle[:, ::-1]
    normal = np.asarray(part.vertex_normals) @ np.linalg.pinv(linear)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    up = np.array([[0.0, 1.0, 0.0]])
    uv = getattr(part.visual, "uv", None)
    flipped = np.zeros((len(vertex), 2)) if uv is None else np.asarray(uv) * [1, -1]
    return Mesh(
        vertex.astype(np.float32),
        np.where(length > 0, normal / np.where(length > 0, length, 1), up).astype(
            np.float32
        ),
        # trimesh has v upwards for every format; a whole number more is the same.
        (flipped + [0, 1]).astype(np.float32),
        np.ascontiguousarray(triangle),
        material,
    )


def _gltf_material(visual: Any, images: _Images) -> Material:
    found = getattr(visual, "material", None)
    if found is None or not hasattr(found, "baseColorFactor"):
        return Material()
    label = found.name or "material"

    def texture(field: str, missing: int, *, colour: bool) -> int:
        image = getattr(found, field, None)
        if image is None:
            return missing
        name = f"{label} {field.removesuffix('Texture')}"
        return images.number(id(image), lambda: image, name=name, colour=colour)

    # Without a factor glTF's is 1, also where there is a texture.
    metallic, roughness = (
        1.0 if value is None else float(np.clip(value, 0, 1))
        for value in (found.metallicFactor, found.roughnessFactor)
    )
    return Material(
        base_colour=_colour(found.baseColorFactor, 1.0),
        metallic=metallic,
        roughness=roughness,
        emissive=_emissive(found),
        colour_texture=texture("baseColorTexture", Texels.WHITE, colour=True),
        surface_texture=texture("metallicRoughnessTexture", Texels.WHITE, colour=False),
        normal_texture=texture("normalTexture", Texels.FLAT, colour=False),
    )


def _emissive(found: Any) -> tuple[float, float, float]:
    """The factor; an emissive texture counts as its mean light."""
    light = np.array(_colour(found.emissiveFactor, 0.0))
    if found.emissiveTexture is not None and np.any(light > 0):
        texels = np.asarray(found.emissiveTexture.convert("RGB"))
        light = light * linear_light(texels).mean(axis=(0, 1))
    red, green, blue = (float(v) for v in light)
    return red, green, blue


def _colour(factor: Any, otherwise: float) -> tuple[float, float, float]:
    if factor is None:
        return otherwise, otherwise, otherwise
    values = np.asarray(factor)
    if np.issubdtype(values.dtype, np.integer):
        values = values / 255
    red, green, blue = (float(v) for v in np.clip(values[:3], 0, 1))
    return red, green, blue


def _obj_materials(maps: dict[str, Path]) -> Callable[[Any, _Images], Material]:
    def material_of(visual: Any, images: _Images) -> Material:
        found = getattr(visual, "material", None)
        if found is None or not hasattr(found, "diffuse"):
            return Material()
        # trimesh's own reading of Ns as the exponent of a Phong lobe.
        roughness = float(np.clip(found.to_pbr().roughnessFactor, 0, 1))
        file = maps.get(found.name)
        if file is None:
            return Material(_encoded_colour(found.diffuse), roughness=roughness)
        number = images.number(file, lambda: _opened(file), name=file.name, colour=True)
        # Kd is what shows where there is no texture, as exporters write it.
        return Material(roughness=roughness, colour_texture=number)

    return material_of


def _encoded_colour(diffuse: Any) -> tuple[float, float, float]:
    """Kd is taken as an sRGB colour, as most exporters write it."""
    values = np.asarray(diffuse)
    if not np.issubdtype(values.dtype, np.integer):
        values = np.rint(255 * np.clip(values, 0, 1))
    red, green, blue = linear_light(values[None, None, :3].astype(np.uint8))[0, 0]
    return float(red), float(green), float(blue)


def _mtl_maps(path: Path) -> dict[str, Path]:
    """The file of each material's `map_Kd`, by the material's name."""
    maps, name = {}, ""
    for library in _statements(path, "mtllib"):
        file = path.parent / library[1]
        if not file.is_file():
            continue
        for key, value in _statements(file, "newmtl", "map_Kd"):
            if key == "newmtl":
                name = value
            else:
                # Options stand before the name and have no spaces in their values.
                value = value.split()[-1] if value.startswith("-") else value
                maps[name] = path.parent / value.replace("\\", "/")
    return maps


def _statements(path: Path, *keys: str) -> list[tuple[str, str]]:
    found = []
    with path.open(encoding="utf-8", errors="replace") as lines:
        for line in lines:
            key, _, value = line.strip().partition(" ")
            if key in keys and value.strip():
                found.append((key, value.strip()))
    return found


def _opened(file: Path) -> Any:
    from PIL import Image

    return Image.open(file)


def _readable(file: Path) -> bool:
    try:
        with _opened(file) as image:
            image.load()
    except OSError:
        return False
    return True


def _gltf_files(path: Path, *keys: str) -> set[Path]:
    """The files of a glTF document's images or buffers; a .glb file holds its own."""
    if path.suffix.lower() == ".glb":
        return set()
    document = json.loads(path.read_text(encoding="utf-8"))
    parts = [part for key in keys for part in document.get(key, [])]
    uris = [part.get("uri", "data:") for part in parts]
    return {path.parent / unquote(uri) for uri in uris if not uri.startswith("data:")}


def _missing(files: set[Path]) -> set[Path]:
    return {file for file in files if not _readable(file)}
