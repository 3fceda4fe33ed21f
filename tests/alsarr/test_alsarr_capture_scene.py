"""Textures and their pyramids, materials, lights, and the scene made of them."""

import jax.numpy as jnp
import numpy as np
import pytest

from alsarr.capture._scene import Lights, Material, Materials, Mesh, Scene
from alsarr.capture._texels import linear_light, Texels
from camojab import luminance, Spectrum


def level(texels, texture, index):
    offset, width, height = (
        int(a[texture, index]) for a in (texels.offset, texels.width, texels.height)
    )
    flat = np.asarray(texels.texel)[offset : offset + width * height]
    return flat.reshape(height, width, 3)


def square(material=0, part=0):
    vertex = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    return Mesh(
        vertex=vertex,
        normal=np.tile(np.array([[0, 0, 1]], np.float32), (4, 1)),
        uv=vertex[:, :2],
        triangle=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        material=material,
        part=part,
    )


def scene(meshes=None, materials=None, textures=None, **options):
    return Scene.of(
        "square",
        meshes or [square()],
        materials or [Material()],
        textures or {},
        lights=Lights(),
        start=(0, 0, 1),
        **options,
    )


def test_the_first_two_textures_are_white_and_flat():
    texels = Texels.from_pictures()
    np.testing.assert_array_equal(level(texels, Texels.WHITE, 0), [[[1, 1, 1]]])
    np.testing.assert_array_equal(level(texels, Texels.FLAT, 0), [[[0.5, 0.5, 1]]])
    np.testing.assert_array_equal(texels.levels, [1, 1])
    assert texels.texel.dtype == jnp.float32 and texels.offset.dtype == jnp.int32


def test_a_level_is_the_mean_of_four_texels_of_the_one_before():
    picture = np.random.default_rng(0).random((8, 16, 3), np.float32)
    texels = Texels.from_pictures([picture])
    assert int(texels.levels[2]) == 5
    np.testing.assert_array_equal(texels.width[2], [16, 8, 4, 2, 1])
    np.testing.assert_array_equal(texels.height[2], [8, 4, 2, 1, 1])
    np.testing.assert_array_equal(level(texels, 2, 0), picture)
    for index in range(3):
        finer = level(texels, 2, index)
        height, width = finer.shape[0] // 2, finer.shape[1] // 2
        blocks = finer.reshape(height, 2, width, 2, 3)
        np.testing.assert_allclose(
            level(texels, 2, index + 1), blocks.mean(axis=(1, 3)), rtol=1e-6
        )


@pytest.mark.parametrize("size", [(5, 5), (7, 12), (1, 9), (3, 2), (101, 37)])
def test_odd_sides_keep_the_mean_and_round_down(size):
    picture = np.random.default_rng(1).random((*size, 3), np.float32)
    texels = Texels.from_pictures([picture])
    for index in range(int(texels.levels[2])):
        here = level(texels, 2, index)
        assert here.shape[:2] == tuple(max(side >> index, 1) for side in size)
        np.testing.assert_allclose(
            here.mean(axis=(0, 1)), picture.mean(axis=(0, 1)), rtol=2e-5
        )
    assert here.shape == (1, 1, 3)


def test_a_ramp_stays_a_ramp_when_its_side_is_odd():
    ramp = np.tile(np.arange(7, dtype=np.float32)[None, :, None], (1, 1, 3))
    third = np.float32(7 / 3)
    expected = [(i + 0.5) * third - 0.5 for i in range(3)]
    got = level(Texels.from_pictures([ramp]), 2, 1)[0, :, 0]
    # Means of a ramp over thirds of it, where a texel cut in two counts on both sides.
    fine = np.repeat(np.arange(7), 3).reshape(3, 7).mean(axis=1)
    np.testing.assert_allclose(got, fine, rtol=1e-6)
    np.testing.assert_allclose(got, expected, atol=0.1)


def test_pictures_of_many_sizes_lie_side_by_side():
    rng = np.random.default_rng(2)
    pictures = [rng.random((*s, 3), np.float32) for s in ((4, 4), (1, 1), (2, 8))]
    texels = Texels.from_pictures(pictures)
    np.testing.assert_array_equal(texels.levels, [1, 1, 3, 1, 4])
    for index, picture in enumerate(pictures):
        np.testing.assert_array_equal(level(texels, index + 2, 0), picture)
    # A level that is not there repeats the last that is.
    np.testing.assert_array_equal(level(texels, 3, 3), pictures[1])
    with pytest.raises(ValueError, match="number 1 has none"):
        Texels.from_pictures([pictures[0], np.empty((0, 4, 3), np.float32)])


def test_bytes_become_light_by_the_curve_of_srgb():
    encoded = np.array([[[0, 10, 11], [128, 188, 255]]], np.uint8)
    # 0.5 of white's light is byte 187.5; the other values from IEC 61966-2-1 by hand.
    expected = [0, 10 / 255 / 12.92, 0.003346536, 0.21586050, 0.50288647, 1]
    np.testing.assert_allclose(linear_light(encoded).ravel(), expected, rtol=1e-5)


def test_materials_are_columns():
    materials = Materials.of(
        [Material(), Material((0.5, 0.25, 1.0), 1.0, 0.25, (2.0, 0.0, 0.0), 2, 3, 4)]
    )
    np.testing.assert_allclose(materials.base_colour, [[1, 1, 1], [0.5, 0.25, 1]])
    np.testing.assert_allclose(materials.roughness, [1, 0.25])
    np.testing.assert_array_equal(materials.colour_texture, [0, 2])
    np.testing.assert_array_equal(materials.normal_texture, [1, 4])
    with pytest.raises(ValueError, match=r"`roughness` must be in \[0, 1\], got 1.5"):
        Materials.of([Material(roughness=1.5)])
    with pytest.raises(ValueError, match="at least one material"):
        Materials.of([])


def test_lights_are_checked_and_the_sun_has_a_unit_direction():
    lights = Lights(
        sun_direction=(0, 3, 4),
        point_position=[(0, 1, 0), (1, 1, 1)],
        point_intensity=[(1, 1, 1), (2, 2, 2)],
    )
    np.testing.assert_allclose(lights.sun_direction, [0, 0.6, 0.8], rtol=1e-6)
    assert Lights().point_position.shape == (0, 3)
    with pytest.raises(ValueError, match="one for every `point_position`, got 1 for 2"):
        Lights(point_position=np.zeros((2, 3)), point_intensity=np.zeros((1, 3)))
    with pytest.raises(ValueError, match="`sky` must be >= 0 and finite, got -1"):
        Lights(sky=(1, -1, 0))
    with pytest.raises(ValueError, match="`sun_direction` must be a direction"):
        Lights(sun_direction=(0, 0, 0))


def test_meshes_are_joined():
    picture = np.ones((2, 2, 3), np.float32)
    joined = scene(
        [square(), square(material=1)],
        [Material(), Material(colour_texture=2)],
        {"paint": picture},
    )
    assert joined.vertex.shape == (8, 3) and joined.triangle.shape == (4, 3)
    np.testing.assert_array_equal(joined.triangle[2], [4, 5, 6])
    np.testing.assert_array_equal(joined.material, [0, 0, 1, 1])
    assert joined.texture_name == ("white", "flat normal", "paint")
    assert joined.at(3.0) is joined


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"meshes": [square(material=1)]}, r"`material` of mesh 0 .* got 1"),
        ({"meshes": [square(part=1)]}, r"`part` of mesh 0 must be in \[0, 1\), got 1"),
        (
            {"meshes": [square()._replace(triangle=np.array([[0, 1, 4]], np.int32))]},
            "indices of its 4 vertices, got 0 to 4",
        ),
        ({"materials": [Material(colour_texture=2)]}, "number 0 has"),
        (
            {"meshes": [square()._replace(triangle=np.empty((0, 3), np.int32))]},
            "at least one triangle",
        ),
    ],
)
def test_a_scene_that_cannot_be_is_refused(change, words):
    with pytest.raises(ValueError, match=words):
        scene(**change)


def test_a_spectrum_is_of_the_luminance_of_the_texture_repeated():
    random = np.random.default_rng(3)
    picture = random.uniform(0, 1, (100, 600, 3)).astype(np.float32)
    made = scene(textures={"wall": picture})
    np.testing.assert_array_equal(made.texels.picture(2), picture)
    # More than 512 texels are cut; of less, the last repetition is.
    rows = np.arange(512) % 100
    grey = luminance(picture[rows, :512], encoding="linear")
    expected = Spectrum.from_texture(grey).amplitude
    found = made.spectrum(2).amplitude
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=0.05)
    # White has nothing but its mean.
    white = np.asarray(made.spectrum(Texels.WHITE).amplitude)
    assert white[256, 256] > 0.999 * white.sum()


@pytest.mark.parametrize("index", [-1, 3])
def test_a_spectrum_of_no_such_texture(index):
    made = scene(textures={"wall": np.ones((1, 1, 3), np.float32)})
    with pytest.raises(ValueError, match=rf"`index` must be in \[0, 3\), got {index}"):
        made.spectrum(index)
