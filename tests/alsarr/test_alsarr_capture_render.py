"""From rays to light: interpolation, textures, reflection, shadows and tone."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr import RATES
from alsarr.capture import (
    Camera,
    capture_view,
    coarse_invocations,
    Lights,
    Material,
    Mesh,
    render,
    Scene,
    Texels,
)
from alsarr.capture._coarse import every_pixel
from alsarr.capture._interpolate import crossing, held
from alsarr.capture._material import lookup, mip_level, Reflectance
from alsarr.capture._render import shade, Stage
from alsarr.capture._shading import _ambient, _reflected
from alsarr.capture._tone import automatic_exposure, MIDDLE_GREY, tone_mapped
from alsarr.capture._visibility import visible_triangles


SIZE = 48, 32
BATCH = 512
FLOOR, BOX, SIDES = 0, 1, np.array([[-0.6, 0.0, -0.5], [0.5, 0.8, 0.7]])
SUN = np.array([-0.6, 1.0, -0.7]) / np.linalg.norm([-0.6, 1.0, -0.7])
LAMP = np.array([-1.5, 2.0, 1.0])
# What the floor's normal texture holds everywhere: to its right, up, and off it.
TILT = np.array([0.2, -0.3, np.sqrt(1 - 0.2**2 - 0.3**2)])

# Compiled as a whole they are ready sooner than an operation at a time.
looked_up, level_of, crossed = map(jax.jit, (lookup, mip_level, crossing))
reflected, ambient = map(jax.jit, (_reflected, _ambient))


def mesh(corners, material, repeats=1.0):
    """A rectangle, its corners anticlockwise as seen from outside."""
    vertex = np.array(corners, np.float32)
    normal = np.cross(vertex[1] - vertex[0], vertex[2] - vertex[0])
    normal = np.tile(normal / np.linalg.norm(normal), (4, 1)).astype(np.float32)
    uv = repeats * np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
    triangle = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Mesh(vertex, normal, uv.astype(np.float32), triangle, material)


def box(low, high, material):
    (a, b, c), (d, e, f) = low, high
    return [
        mesh([(a, e, f), (d, e, f), (d, e, c), (a, e, c)], material),
        mesh([(a, b, f), (d, b, f), (d, e, f), (a, e, f)], material),
        mesh([(d, b, c), (a, b, c), (a, e, c), (d, e, c)], material),
        mesh([(d, b, f), (d, b, c), (d, e, c), (d, e, f)], material),
        mesh([(a, b, c), (a, b, f), (a, e, f), (a, e, c)], material),
    ]


@pytest.fixture(scope="module")
def scene():
    """A box on a textured floor, with sun, a lamp and sky."""
    ground = [(-4, 0, 4), (4, 0, 4), (4, 0, -4), (-4, 0, -4)]
    picture = np.random.default_rng(0).random((32, 32, 3), np.float32)
    tilt = np.tile(np.float32((1 + TILT) / 2), (2, 2, 1))
    return Scene.of(
        "box",
        [mesh(ground, FLOOR, 4.0), *box(*SIDES, BOX)],
        [
            Material(colour_texture=2, normal_texture=3),
            Material((0.8, 0.3, 0.2), metallic=0.25, roughness=0.4),
        ],
        {"noise": picture, "tilt": tilt},
        lights=Lights(
            sun_direction=SUN,
            sun=(3.0, 2.8, 2.5),
            point_position=[LAMP],
            point_intensity=[(2.0, 2.0, 2.0)],
            sky=(0.4, 0.5, 0.7),
            ground=(0.2, 0.2, 0.2),
        ),
        start=(0, 1.5, 3),
    )


@pytest.fixture(scope="module")
def stage(scene):
    return Stage.of(scene)


@pytest.fixture(scope="module")
def camera():
    return Camera.look_at((1.0, 2.2, 3.0), (0.0, 0.2, 0.0))


@pytest.fixture(scope="module")
def view(scene, stage, camera):
    before = Camera.look_at((1.1, 2.2, 3.0), (0.0, 0.2, 0.0))
    return capture_view(
        scene, camera, before, size=SIZE, tracer=stage.tracer, batch=BATCH
    )


def pixels(camera):
    """Rays through the pixels' centres, in double precision."""
    width, height = SIZE
    y, x = np.mgrid[:height, :width] + 0.5
    rays = camera.rays(jnp.asarray(x), jnp.asarray(y), width, height)
    return np.asarray(camera.position, float), np.asarray(rays, float)


def box_distance(origin, direction, grow=0.0):
    """Where rays enter the box, by its slabs; infinite where they pass by."""
    low, high = SIDES[0] - grow, SIDES[1] + grow
    with np.errstate(divide="ignore"):
        ends = np.stack([(low - origin) / direction, (high - origin) / direction])
    enter, leave = ends.min(axis=0).max(axis=-1), ends.max(axis=0).min(axis=-1)
    return np.where((enter <= leave) & (leave > 0), enter, np.inf)


def floor_distance(origin, direction):
    with np.errstate(divide="ignore"):
        distance = -origin[1] / direction[..., 1]
        place = origin + distance[..., None] * direction
    within = (distance > 0) & (np.abs(place[..., [0, 2]]) <= 4).all(axis=-1)
    return np.where(within, distance, np.inf)


def test_depth_is_that_of_the_box_and_the_floor(view, camera):
    origin, rays = pixels(camera)
    near, far = (box_distance(origin, rays, g) for g in (0.004, -0.004))
    ground = floor_distance(origin, rays)
    clear = (np.isfinite(near) == np.isfinite(far)) & np.isfinite(ground)
    distance = np.minimum(box_distance(origin, rays), ground)
    depth = distance * (rays @ np.asarray(camera.forward, float))
    assert clear.mean() > 0.6
    np.testing.assert_allclose(view.depth[clear], depth[clear], rtol=2e-5)


def test_shadows_are_where_the_box_is_in_the_way_of_the_sun(view, camera):
    origin, rays = pixels(camera)
    on_floor = floor_distance(origin, rays)
    on_floor = np.where(np.isinf(box_distance(origin, rays, 0.01)), on_floor, np.inf)
    floor = np.isfinite(on_floor)
    place = (origin + np.where(floor, on_floor, 0)[..., None] * rays)[floor]
    # What lies within 5 mm of the shadow's edge is left out.
    larger, smaller = (
        np.isfinite(box_distance(place, SUN, g)) for g in (0.005, -0.005)
    )
    clear = larger == smaller
    assert clear.mean() > 0.95 and 30 < larger.sum() < larger.size - 30
    expected = np.where(larger, 0, 255)
    np.testing.assert_array_equal(view.shadow[floor][clear], expected[clear])


def shows(camera):
    """Pixels that show the inside of the box's sides, and of the floor."""
    origin, rays = pixels(camera)
    block = np.isfinite(box_distance(origin, rays, -0.01))
    ground = np.isfinite(floor_distance(origin, rays))
    return block, ground & np.isinf(box_distance(origin, rays, 0.01))


def test_normals_are_in_view_space_and_follow_the_normal_texture(view, camera):
    block, ground = shows(camera)
    axes = np.stack([camera.right, camera.up, -camera.forward]).astype(float)
    # On the floor the texture's right is x, its top is -z, and off it is y.
    expected = axes @ np.array([TILT[0], TILT[2], -TILT[1]])
    found = view.normal[ground].astype(float)
    np.testing.assert_allclose(found, np.tile(expected, (len(found), 1)), atol=2e-3)
    # Three of the box's sides are seen, each with its own axis.
    world = view.normal[block].astype(float) @ axes
    sides = {tuple(side) for side in np.round(world).astype(int).tolist()}
    assert sides == {(1, 0, 0), (0, 1, 0), (0, 0, 1)}
    np.testing.assert_allclose(world, np.round(world), atol=2e-3)


def test_colours_and_roughness_are_those_of_the_material(view, camera):
    block, ground = shows(camera)
    base = np.array([0.8, 0.3, 0.2])
    encode = lambda light: 255 * (1.055 * light ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(
        view.diffuse[block] - encode(0.75 * base), 0, atol=0.5 + 1e-3
    )
    specular = encode(0.75 * 0.04 + 0.25 * base)
    np.testing.assert_allclose(view.specular[block] - specular, 0, atol=0.5 + 1e-3)
    np.testing.assert_array_equal(view.roughness[block], 102)
    np.testing.assert_array_equal(view.roughness[ground], 255)
    np.testing.assert_array_equal(view.texture[block], 0)
    np.testing.assert_array_equal(view.texture[ground], 2)
    sky = np.isinf(view.depth)
    assert sky.any() and block.sum() > 50 and ground.sum() > 300
    for name in ("normal", "diffuse", "specular", "roughness", "shadow", "texture"):
        np.testing.assert_array_equal(getattr(view, name)[sky], 0)


def test_texture_coordinates_are_those_of_the_place(view, camera):
    _, ground = shows(camera)
    origin, rays = pixels(camera)
    distance = np.where(ground, floor_distance(origin, rays), 0)
    place = (origin + distance[..., None] * rays)[ground]
    # Four repeats over 8 m, the first corner at x = -4 and z = -4.
    expected = (place[:, [0, 2]] + 4) / 2
    np.testing.assert_allclose(view.uv[ground], expected, atol=1e-4)


def test_a_lamp_casts_a_shadow_of_its_own(scene, stage, camera):
    """Of two renderings, with the lamp and without, floor in its shadow is the same."""
    wanted = every_pixel(visible_triangles(stage.tracer, camera, size=SIZE))
    lit = shade(stage, camera, wanted, cell=(1, 1), size=SIZE, batch=BATCH)
    where = lambda scene: scene.lights.point_intensity
    dark = eqx.tree_at(where, scene, jnp.zeros((1, 3), jnp.float32))
    without = shade(
        Stage(dark, stage.tracer), camera, wanted, cell=(1, 1), size=SIZE, batch=BATCH
    )
    lamp = (lit.light > without.light).any(axis=1)
    place = [np.asarray(s.at.position).T[: s.used] for s in lit.batches]
    place = np.concatenate(place).astype(float)
    floor = (wanted.triangle < 2) & (wanted.triangle >= 0)
    to_lamp = LAMP - place[floor]
    larger, smaller = (
        box_distance(place[floor], to_lamp, g) < 1 for g in (0.01, -0.01)
    )
    clear = larger == smaller
    assert 10 < larger.sum() < larger.size - 10
    np.testing.assert_array_equal(lamp[floor][clear], ~larger[clear])


def test_full_rate_is_a_plain_rendering_bit_for_bit(view, scene, stage, camera):
    plain = render(scene, camera, size=SIZE, tracer=stage.tracer, batch=BATCH)
    np.testing.assert_array_equal(view.images[RATES.names.index("1x1")], plain)
    triangle = visible_triangles(stage.tracer, camera, size=SIZE)
    light = [
        shade(stage, camera, w, cell=(1, 1), size=SIZE, batch=BATCH).light
        for w in (every_pixel(triangle), coarse_invocations(triangle, (1, 1)))
    ]
    np.testing.assert_array_equal(light[0], light[1])


def test_samples_do_not_depend_on_what_is_shaded_with_them(stage, camera):
    triangle = visible_triangles(stage.tracer, camera, size=SIZE)
    every = every_pixel(triangle)
    some = np.random.default_rng(0).permutation(len(every))[:100]
    chosen = replace(
        every,
        triangle=every.triangle[some],
        centre=every.centre[some],
        covered=every.covered[some],
    )
    of = lambda wanted: (
        shade(stage, camera, wanted, cell=(1, 1), size=SIZE, batch=BATCH).light
    )
    np.testing.assert_array_equal(of(chosen), of(every)[some])


@pytest.mark.parametrize("cell", [(4, 4), (2, 1)])
def test_samples_are_at_the_coarse_centre_or_a_covered_pixel(cell, stage, camera):
    triangle = visible_triangles(stage.tracer, camera, size=SIZE)
    wanted = coarse_invocations(triangle, cell)
    shaded = shade(stage, camera, wanted, cell=cell, size=SIZE, batch=BATCH)
    place = np.concatenate(
        [np.asarray(s.at.position).T[: s.used] for s in shaded.batches]
    )
    x, y, _ = camera.project(jnp.asarray(place), *SIZE)
    found = np.stack([x, y], axis=1)
    off = lambda where: np.abs(found - where).max(axis=1)
    hit = wanted.triangle >= 0
    at_centre = off(wanted.centre) < 1e-2
    assert (at_centre | (off(wanted.covered) < 1e-2))[hit].all()
    # The centre is taken exactly where its ray is within the triangle.
    x, y = wanted.centre.T
    rays = camera.rays(jnp.asarray(x), jnp.asarray(y), *SIZE).T
    vertex = stage.scene.triangle[np.maximum(wanted.triangle, 0)].T
    cross = crossed(held(stage.scene.vertex, vertex), camera.position, rays)
    third = np.asarray(1 - cross.second - cross.third)
    weight = np.stack([third, np.asarray(cross.second), np.asarray(cross.third)])
    clear = hit & (np.abs(weight.min(axis=0)) > 1e-4)
    np.testing.assert_array_equal(at_centre[clear], (weight.min(axis=0) > 0)[clear])
    assert (~at_centre[hit]).sum() > 3


def test_mip_level_follows_the_size_of_a_pixel_and_of_the_coarse_pixel(stage):
    # The floor, 16 texels a metre, seen from straight above.
    distance = 2.0
    camera = Camera((-2.5, distance, 2.5), (0.0, -1.0, 0.0), (0, 0, -1), fov_y=40.0)
    triangle = visible_triangles(stage.tracer, camera, size=SIZE)
    assert set(triangle.ravel()) <= {0, 1}
    pixel_m = 2 * distance * np.tan(np.radians(20)) / SIZE[1]
    for cell in [(1, 1), (2, 1), (1, 2), (4, 4), (2, 4)]:
        wanted = coarse_invocations(triangle, cell)
        shaded = shade(stage, camera, wanted, cell=cell, size=SIZE, batch=BATCH)
        used = shaded.batches[0].used
        level = np.asarray(shaded.batches[0].made_of.mip_level)[:used]
        expected = np.maximum(np.log2(pixel_m * 16 * max(cell)), 0)
        np.testing.assert_allclose(level, expected, atol=1e-3)
    assert expected > 1


@pytest.fixture(scope="module")
def texels():
    rng = np.random.default_rng(0)
    return Texels.from_pictures([rng.random((4, 8, 3), np.float32)])


def read(texels, u, v, level):
    uv = jnp.asarray([[u], [v]], jnp.float32)
    texture, level = jnp.asarray([2], jnp.int32), jnp.asarray([level], jnp.float32)
    return np.asarray(looked_up(texels, texture, uv, level))[:, 0]


def test_texture_at_texel_centres_between_them_and_around_the_edge(texels):
    picture = np.asarray(texels.texel)[2 : 2 + 32].reshape(4, 8, 3)
    for x, y in ((0, 0), (7, 3), (3, 1)):
        u, v = (x + 0.5) / 8, (y + 0.5) / 4
        for turn in (0, 1, -2):
            np.testing.assert_allclose(
                read(texels, u + turn, v - turn, 0.0), picture[y, x], atol=1e-6
            )
    between = read(texels, 4 / 8, 0.5 / 4, 0.0)
    np.testing.assert_allclose(between, picture[0, 3:5].mean(axis=0), atol=1e-6)
    corner = picture[np.ix_([0, 3], [0, 7])].mean(axis=(0, 1))
    np.testing.assert_allclose(read(texels, 0.0, 0.0, 0.0), corner, atol=1e-6)


def test_texture_between_levels_and_at_the_last(texels):
    picture = np.asarray(texels.texel)[2 : 2 + 32].reshape(4, 8, 3)
    coarser = picture[:2, :2].mean(axis=(0, 1))
    np.testing.assert_allclose(read(texels, 1 / 8, 1 / 4, 1.0), coarser, atol=1e-6)
    fine = read(texels, 1 / 8, 1 / 4, 0.0)
    mixed = 0.75 * fine + 0.25 * coarser
    np.testing.assert_allclose(read(texels, 1 / 8, 1 / 4, 0.25), mixed, atol=1e-6)
    mean = picture.mean(axis=(0, 1))
    np.testing.assert_allclose(read(texels, 0.3, 0.9, 3.0), mean, atol=1e-6)


@pytest.mark.parametrize(
    "footprint, level",
    [
        (((1 / 8, 0), (0, 1 / 4)), 0.0),
        (((0.25 / 8, 0), (0, 0.1 / 4)), 0.0),
        (((4 / 8, 0), (0, 1 / 4)), 2.0),
        (((1 / 8, 0), (0, 2 / 4)), 1.0),
        (((3 / 8, 4 / 4), (0, 0)), np.log2(5)),
        (((1e6, 0), (0, 0)), 3.0),
    ],
)
def test_level_is_the_longer_side_of_the_footprint(texels, footprint, level):
    x, y = (jnp.asarray(side, jnp.float32)[:, None] for side in footprint)
    got = level_of(texels, jnp.asarray([2], jnp.int32), x, y)
    np.testing.assert_allclose(got, [level], atol=1e-5)


def made_of(normal, roughness=0.5, specular=0.04, diffuse=0.5):
    count = normal.shape[1]
    three = lambda value: jnp.full((3, count), value, jnp.float32)
    return Reflectance(
        diffuse=three(diffuse),
        specular=three(specular),
        roughness=jnp.full(count, roughness, jnp.float32),
        emissive=three(0.0),
        normal=jnp.asarray(normal, jnp.float32),
        mip_level=jnp.zeros(count, jnp.float32),
    )


def directions(count, seed):
    rng = np.random.default_rng(seed)
    found = rng.normal(size=(3, count))
    found[2] = np.abs(found[2]) + 0.05
    return found / np.linalg.norm(found, axis=0)


@pytest.mark.parametrize("roughness", [0.2, 0.5, 1.0])
def test_reflection_is_the_textbooks(roughness):
    """Written with Smith's Lambda of Walter et al. 2007, in double precision."""
    view, light = directions(50, 1), directions(50, 2)
    normal = np.tile([[0.0], [0.0], [1.0]], (1, 50))
    got = reflected(
        made_of(normal, roughness, 0.3),
        jnp.asarray(view, jnp.float32),
        jnp.asarray(light, jnp.float32),
    )
    alpha = roughness**2
    half = (view + light) / np.linalg.norm(view + light, axis=0)
    tangent = lambda w: np.sqrt(1 - w[2] ** 2) / w[2]
    smith = lambda w: (np.sqrt(1 + (alpha * tangent(w)) ** 2) - 1) / 2
    chi = half[2] ** 4 * (1 + (tangent(half) / alpha) ** 2) ** 2
    density = 1 / (np.pi * alpha**2 * chi)
    fresnel = 0.3 + 0.7 * (1 - np.sum(view * half, axis=0)) ** 5
    masking = 1 / (1 + smith(view) + smith(light))
    specular = fresnel * density * masking / (4 * view[2] * light[2])
    expected = ((1 - fresnel) * 0.5 / np.pi + specular) * light[2]
    np.testing.assert_allclose(got, np.tile(expected, (3, 1)), rtol=2e-4)


def test_no_surface_reflects_more_than_it_is_given():
    polar, around = np.meshgrid(
        (np.arange(300) + 0.5) / 300 * np.pi / 2, (np.arange(200) + 0.5) / 200 * np.pi
    )
    ways = [
        np.sin(polar) * np.cos(around),
        np.sin(polar) * np.sin(around),
        np.cos(polar),
    ]
    light = np.stack(ways).reshape(3, -1)
    area = (np.sin(polar) * np.pi / 2 / 300 * 2 * np.pi / 200).ravel()
    normal = np.tile([[0.0], [0.0], [1.0]], (1, area.size))
    for roughness, cosine in ((0.3, 0.9), (0.6, 0.3), (1.0, 0.6)):
        view = np.tile([[np.sqrt(1 - cosine**2)], [0.0], [cosine]], (1, area.size))
        share = reflected(
            made_of(normal, roughness, 1.0, 1.0),
            jnp.asarray(view, jnp.float32),
            jnp.asarray(light, jnp.float32),
        )
        total = np.asarray(share, float) @ area
        assert (0.4 < total).all() and (total < 1.0001).all()


def test_ambient_light_is_the_integral_of_the_sky():
    lights = Lights(sky=(0.9, 0.6, 0.3), ground=(0.1, 0.2, 0.05))
    rng = np.random.default_rng(5)
    ways = rng.normal(size=(400_000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    blend = (ways[:, 1:2] + 1) / 2
    sky = np.array([0.1, 0.2, 0.05]) + blend * np.array([0.8, 0.4, 0.25])
    for normal in ([0, 1, 0], [0.6, 0, 0.8], [0, -0.8, 0.6]):
        facing = np.maximum(ways @ np.array(normal, float), 0)
        expected = 4 * np.mean(sky * facing[:, None], axis=0)
        at = np.array(normal, np.float32)[:, None]
        # Black in every mirror: of the specular part only its small offset is left.
        got = ambient(lights, made_of(at, 1.0, 0.0, 1.0), jnp.asarray(at))[:, 0]
        np.testing.assert_allclose(got, expected, rtol=0.01)


def test_exposure_makes_the_average_middle_grey():
    light = np.exp(np.random.default_rng(0).normal(size=(20, 30, 3))).astype(np.float32)
    exposure = automatic_exposure(light)
    luminance = light @ np.array([0.2126, 0.7152, 0.0722])
    average = np.exp(np.log(luminance).mean())
    np.testing.assert_allclose(exposure * average, MIDDLE_GREY, rtol=1e-3)
    # Twice the light is the same picture.
    np.testing.assert_allclose(automatic_exposure(2 * light) * 2, exposure, rtol=1e-3)
    assert np.isfinite(automatic_exposure(np.zeros((4, 4, 3), np.float32)))


def test_tone_curve_rises_from_black_to_white():
    light = jnp.asarray(np.geomspace(1e-4, 1e3, 300), jnp.float32)[:, None]
    got = np.asarray(tone_mapped(jnp.tile(light, (1, 3)), jnp.float32(1.0))).astype(int)
    assert (np.diff(got[:, 0]) >= 0).all() and got[-1, 0] == 255
    black = tone_mapped(jnp.zeros((1, 3), jnp.float32), jnp.float32(1.0))
    np.testing.assert_array_equal(black, 0)
    # Narkowicz's curve at 0.6 x 0.18, encoded by hand: 0.14005 and 0.41126.
    grey = tone_mapped(jnp.full((1, 3), 0.18, jnp.float32), jnp.float32(1.0))
    np.testing.assert_array_equal(grey, 105)


def test_what_is_beyond_the_scene_is_the_sky(scene, stage):
    camera = Camera((0.0, 2.0, 0.0), (0.0, 1.0, 0.05), fov_y=40.0)
    got = render(
        scene, camera, size=SIZE, tracer=stage.tracer, exposure=1.0, batch=BATCH
    )
    _, rays = pixels(camera)
    up = (rays[..., 1:2] + 1) / 2
    sky = np.array([0.2] * 3) + up * (np.array([0.4, 0.5, 0.7]) - 0.2)
    expected = tone_mapped(jnp.asarray(sky, jnp.float32), jnp.float32(1.0))
    np.testing.assert_allclose(
        np.asarray(got).astype(int), np.asarray(expected).astype(int), atol=1
    )


def test_a_size_below_one_pixel_is_refused(scene, camera):
    with pytest.raises(ValueError, match=r"`size` must be >= 1 px, got 0 x 8"):
        capture_view(scene, camera, camera, size=(0, 8))
