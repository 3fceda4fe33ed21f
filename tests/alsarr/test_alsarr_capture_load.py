"""Scenes from glTF and OBJ files, small ones written here and the public ones."""

import base64
import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image


pytest.importorskip("embreex")
pytest.importorskip("trimesh")

from alsarr.capture._load import load_scene, scene_files
from alsarr.capture._scene import Lights
from alsarr.capture._texels import linear_light
from alsarr.capture._tracer import Tracer
from alsarr.capture._viewpoints import ViewpointSampler


# Scenes are in single precision whatever the lane.
pytestmark = pytest.mark.float64


POSITION = np.array([[0, 0, 0], [2, 0, 0], [0, 1, 0]], "<f4")
NORMAL = np.tile(np.array([[0, 0, 1]], "<f4"), (3, 1))
UV = np.array([[0, 0], [1, 0], [0.25, 0.75]], "<f4")
INDEX = np.array([0, 1, 2], "<u4")


def level(scene, texture):
    texels = scene.texels
    offset, width, height = (
        int(a[texture, 0]) for a in (texels.offset, texels.width, texels.height)
    )
    flat = np.asarray(texels.texel)[offset : offset + width * height]
    return flat.reshape(height, width, 3)


def write_gltf(folder, nodes, *, attributes=("NORMAL", "TEXCOORD_0"), materials=()):
    """One triangle, shown once for every node; images are files beside it."""
    blocks = {"POSITION": POSITION, "NORMAL": NORMAL, "TEXCOORD_0": UV, "index": INDEX}
    views, accessors, data = [], [], b""
    for name, block in blocks.items():
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": block.nbytes})
        accessor = {
            "bufferView": len(accessors),
            "componentType": 5125 if name == "index" else 5126,
            "count": len(block),
            "type": "SCALAR" if name == "index" else f"VEC{block.shape[1]}",
        }
        if name == "POSITION":
            accessor |= {"min": [0, 0, 0], "max": [2, 1, 0]}
        accessors.append(accessor)
        data += block.tobytes()
    used = {name: list(blocks).index(name) for name in ("POSITION", *attributes)}
    names = ["colour.png", "surface.png", "normal.png"]
    primitive = {"attributes": used, "indices": 3}
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": [{"mesh": 0, **node} for node in nodes],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [
            {
                "byteLength": len(data),
                "uri": "data:application/octet-stream;base64,"
                + base64.b64encode(data).decode(),
            }
        ],
    }
    if materials:
        primitive["material"] = 0
        document |= {
            "materials": list(materials),
            "images": [{"uri": name} for name in names],
            "textures": [{"source": i} for i in range(3)],
        }
    path = folder / "thing.gltf"
    path.write_text(json.dumps(document))
    return path


def save_picture(path, seed, size=(4, 8), channels=3):
    values = np.random.default_rng(seed).integers(0, 256, (*size, channels), np.uint8)
    Image.fromarray(values).save(path)
    return values


TEXTURED = {
    "name": "paint",
    "pbrMetallicRoughness": {
        "baseColorFactor": [1.0, 0.2, 0.0, 1.0],
        "metallicFactor": 0.25,
        "roughnessFactor": 0.5,
        "baseColorTexture": {"index": 0},
        "metallicRoughnessTexture": {"index": 1},
    },
    "normalTexture": {"index": 2},
    "emissiveFactor": [0.0, 0.5, 1.0],
}


@pytest.fixture
def textured(tmp_path):
    pictures = {
        name: save_picture(tmp_path / f"{name}.png", seed)
        for seed, name in enumerate(("colour", "surface", "normal"))
    }
    return write_gltf(tmp_path, [{}], materials=[TEXTURED]), pictures


def test_a_material_and_its_textures_are_read(textured):
    path, pictures = textured
    scene = load_scene(path)
    materials = scene.materials
    # trimesh keeps factors of colours in 8 bits.
    np.testing.assert_allclose(materials.base_colour, [[1, 0.2, 0]], atol=1 / 255)
    np.testing.assert_allclose(materials.metallic, [0.25])
    np.testing.assert_allclose(materials.roughness, [0.5])
    np.testing.assert_allclose(materials.emissive, [[0, 0.5, 1]], atol=1 / 255)
    colour, surface, normal = (
        int(field[0])
        for field in (
            materials.colour_texture,
            materials.surface_texture,
            materials.normal_texture,
        )
    )
    np.testing.assert_array_equal(
        level(scene, colour), linear_light(pictures["colour"])
    )
    for texture, name in ((surface, "surface"), (normal, "normal")):
        np.testing.assert_allclose(
            level(scene, texture), pictures[name] / np.float32(255)
        )
    assert scene.texture_name[colour] == "paint baseColor"
    np.testing.assert_allclose(scene.uv, UV, atol=1e-6)
    assert scene.name == "thing" and load_scene(path, name="other").name == "other"


def test_missing_textures_are_white_and_named(textured):
    path, _ = textured
    (path.parent / "colour.png").unlink()
    (path.parent / "normal.png").unlink()
    with pytest.warns(UserWarning, match=r"are white: colour\.png, normal\.png\.$"):
        scene = load_scene(path)
    assert int(scene.materials.colour_texture[0]) == 0
    assert int(scene.materials.normal_texture[0]) == 1
    assert int(scene.materials.surface_texture[0]) == 2


def test_missing_normals_are_computed_and_missing_uv_are_0(tmp_path):
    scene = load_scene(write_gltf(tmp_path, [{}], attributes=()))
    np.testing.assert_allclose(scene.normal, NORMAL, atol=1e-6)
    np.testing.assert_array_equal(scene.uv % 1, np.zeros((3, 2)))
    np.testing.assert_array_equal(scene.materials.base_colour, [[1, 1, 1]])


def test_transforms_are_applied_and_mirrors_keep_their_front(tmp_path):
    turned = {"translation": [0, 5, 0], "rotation": [0, 0.5**0.5, 0, 0.5**0.5]}
    mirrored = {"scale": [-1, 2, 1], "translation": [0, 0, 3]}
    scene = load_scene(write_gltf(tmp_path, [{}, turned, mirrored]))
    assert scene.triangle.shape == (3, 3)
    vertex, triangle = np.asarray(scene.vertex), np.asarray(scene.triangle)
    copies = [vertex[corner] for corner in triangle]
    key = lambda points: sorted(np.round(np.asarray(points, float), 4).tolist())
    expected = [
        POSITION,
        # A quarter turn about y takes x to -z.
        [[0, 5, 0], [0, 5, -2], [0, 6, 0]],
        [[0, 0, 3], [-2, 0, 3], [0, 2, 3]],
    ]
    assert sorted(map(key, copies)) == sorted(map(key, expected))
    normal = np.asarray(scene.normal)
    for corner in triangle:
        a, b, c = vertex[corner]
        front = np.cross(b - a, c - a)
        assert np.all(normal[corner] @ front > 0.99 * np.linalg.norm(front))


OBJ = """mtllib thing.mtl
v 0 0 0
v 2 0 0
v 0 1 0
v 0 1 -1
vt 0 0
vt 1 0
vt 0.25 0.75
usemtl leaf
f 1/1 2/2 3/3
usemtl plain
f 1/1 3/2 4/3
usemtl lost
f 1/1 2/2 4/3
"""
MTL = """newmtl leaf
Kd 0.1 0.1 0.1
map_Kd -s 1 1 1 leaf.png
newmtl plain
Ns 6
Kd 0.50196 1 0
newmtl lost
map_Kd gone.png
"""


def test_an_obj_file_and_its_materials_are_read(tmp_path):
    (tmp_path / "thing.obj").write_text(OBJ)
    (tmp_path / "thing.mtl").write_text(MTL)
    values = save_picture(tmp_path / "leaf.png", 3, size=(4, 4), channels=4)
    values[..., 3] = 255
    values[0, 0, 3] = values[2:, 2:, 3] = 0
    Image.fromarray(values).save(tmp_path / "leaf.png")
    with pytest.warns(UserWarning, match=r"thing\.obj.* are white: gone\.png\.$"):
        scene = load_scene(tmp_path / "thing.obj")
    assert scene.triangle.shape == (3, 3)
    textures = np.asarray(scene.materials.colour_texture)
    assert sorted(textures) == [0, 0, 2] and scene.texture_name[2] == "leaf.png"
    leaf = int(np.argmax(textures))
    np.testing.assert_array_equal(scene.materials.base_colour[leaf], [1, 1, 1])
    plain = int(np.argmin(np.asarray(scene.materials.base_colour)[:, 2]))
    np.testing.assert_allclose(
        scene.materials.base_colour[plain], [0.2159, 1, 0], atol=1e-4
    )
    # An exponent of 6 is (2 / (6 + 2))^(1/4).
    np.testing.assert_allclose(scene.materials.roughness[plain], 0.25**0.25, rtol=1e-6)
    corner = np.asarray(scene.triangle)[np.asarray(scene.material) == leaf][0]
    np.testing.assert_allclose(
        np.asarray(scene.uv)[corner] % 1, [[0, 0], [0, 0], [0.25, 0.25]], atol=1e-6
    )
    # Cut-out texels have the mean of what is not cut out about them.
    light, texels = linear_light(values[..., :3]), level(scene, 2)
    three = (light[0, 1] + light[1, 0] + light[1, 1]) / 3
    np.testing.assert_allclose(texels[0, 0], three, rtol=1e-5)
    blocks = np.stack([three, light[:2, 2:].mean((0, 1)), light[2:, :2].mean((0, 1))])
    np.testing.assert_allclose(texels[3, 3], blocks.mean(axis=0), rtol=1e-5)
    np.testing.assert_array_equal(texels[1, 1], light[1, 1])


def test_a_scene_names_its_files_whether_or_not_they_are_there(tmp_path):
    path = write_gltf(tmp_path, [{}], materials=[TEXTURED])
    document = json.loads(path.read_text())
    document["buffers"].append({"byteLength": 1, "uri": "more%20data.bin"})
    path.write_text(json.dumps(document))
    names = ["colour.png", "more data.bin", "normal.png", "surface.png"]
    assert scene_files(path) == [path, *(tmp_path / name for name in names)]

    path = tmp_path / "thing.obj"
    path.write_text(OBJ)
    assert scene_files(path) == [path, tmp_path / "thing.mtl"]
    (tmp_path / "thing.mtl").write_text(MTL)
    names = ["gone.png", "leaf.png", "thing.mtl"]
    assert scene_files(path) == [path, *(tmp_path / name for name in names)]


@pytest.mark.parametrize("content", ["not json", "[]", '{"images": 3}'])
def test_a_broken_scene_names_itself(tmp_path, content):
    path = tmp_path / "thing.gltf"
    path.write_text(content)
    assert scene_files(path) == [path]
    assert scene_files(tmp_path / "thing.glb") == [tmp_path / "thing.glb"]


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.ply", b"", "`path` must end in .glb, .gltf, .obj, got a.ply."),
        ("a.glb", None, "`path` must be a file"),
        ("a.glb", b"glTF" + bytes(30), "`path` cannot be read: a.glb"),
        ("a.glb", b"", "`path` cannot be read: a.glb"),
        ("a.gltf", b"not json", "`path` cannot be read: a.gltf"),
        ("a.gltf", b"{}", "`path` must hold triangles, a.gltf has none."),
        ("a.obj", b"hello", "`path` must hold triangles, a.obj has none."),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n", "finite positions"),
    ],
)
def test_bad_files_are_refused_in_a_sentence(tmp_path, name, content, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=re.escape(words)) as error:
        load_scene(tmp_path / name)
    assert "\n" not in str(error.value)


def test_without_trimesh_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "trimesh", None)
    path = write_gltf(tmp_path, [{}])
    with pytest.raises(ImportError, match=r"`alsarr\[capture\]` is not installed"):
        load_scene(path)


def test_what_is_given_is_taken(tmp_path):
    path = write_gltf(tmp_path, [{}])
    lights = Lights(sun=(1, 2, 3))
    bounds = [(-1, -1, -1), (3, 3, 3)]
    scene = load_scene(path, lights=lights, start=(1, 1, 2), bounds=bounds)
    np.testing.assert_array_equal(scene.lights.sun, [1, 2, 3])
    np.testing.assert_array_equal(scene.start, [1, 1, 2])
    np.testing.assert_array_equal(scene.bounds, bounds)
    # A single triangle leaves corners of its box open: there is room about it.
    around = np.asarray(load_scene(path).bounds)
    assert np.all(around[0] <= [-0.99, -0.99, -0.99])


PUBLIC = {
    # Triangles; materials, each counted once; textures.
    "bathroom.glb": (379_998, 27, 8),
    "flight_helmet/FlightHelmet.gltf": (94_722, 5, 15),
    "lost_empire/lost_empire.obj": (224_998, 2, 2),
}


@pytest.mark.parametrize("name", PUBLIC)
def test_public_scenes_load_and_have_viewpoints(name):
    path = Path(os.environ.get("CAMOJAB_DATA_DIR", "")) / "scenes" / name
    # Public files may not be shipped; where they cannot be had the reason is shown.
    if not path.is_file():
        pytest.skip(f"{name} is not in CAMOJAB_DATA_DIR/scenes")
    scene = load_scene(path)
    counts = len(scene.triangle), len(scene.materials.metallic)
    assert (*counts, len(scene.texture_name) - 2) == PUBLIC[name]
    low, high = np.asarray(scene.bounds)
    assert np.all((low <= scene.start) & (scene.start <= high))
    has_lamp = len(scene.lights.point_position) > 0
    assert has_lamp == (name == "bathroom.glb")
    (camera, previous), _ = ViewpointSampler(scene, seed=0, voxels=20_000).first(2)
    tracer = Tracer(np.asarray(scene.vertex), np.asarray(scene.triangle))
    forward = np.asarray(camera.forward)[None]
    _, distance = tracer.hit(np.asarray(camera.position)[None], forward)
    assert distance[0] > 0.02
    assert not np.array_equal(camera.position, previous.position)
