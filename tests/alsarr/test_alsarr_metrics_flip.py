"""FLIP against flip-evaluator, an implementation of its authors, and its slopes."""

import functools

import flip_evaluator
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage
from skimage import data

from alsarr import coarse
from alsarr.metrics import automatic_exposures, flip, hdr_flip
from alsarr.metrics._flip import _wide


SIZE = (96, 128)
PPD = 33.5
MAPPERS = ("aces", "reinhard", "hable")


def natural(name):
    picture = getattr(data, name)()[60 : 60 + SIZE[0], 100 : 100 + SIZE[1]]
    return (picture / np.float32(255)).astype(np.float32)


def rendered():
    """A lit ball before a checkered wall."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]] + 0.5
    u, v = (x - 64) / 42, (y - 48) / 42
    square = u**2 + v**2
    normal_z = np.sqrt(np.maximum(1 - square, 0))
    shade = np.maximum(0.6 * normal_z - 0.5 * u - 0.4 * v, 0.02)
    wall = np.where((x // 12 + y // 9) % 2 == 0, 0.9, 0.15)
    ball = shade[..., None] * np.array([1.0, 0.35, 0.1]) + 0.9 * shade[..., None] ** 40
    shown = np.where((square < 1)[..., None], ball, wall[..., None] * [0.4, 0.7, 1])
    return np.clip(shown, 0, 1).astype(np.float32)


def coarsened(picture):
    tiles = -(-picture.shape[0] // 16), -(-picture.shape[1] // 16)
    rate = np.random.default_rng(3).integers(0, 7, tiles)
    return np.array(coarse(picture, rate), np.float32)


def blurred(picture):
    return ndimage.gaussian_filter(picture, (1.5, 1.5, 0))


@functools.cache
def pair(name):
    if name == "rendered":
        return rendered(), coarsened(rendered())
    picture = natural(name.split()[0])
    change = blurred if name.endswith("blurred") else coarsened
    return picture, np.ascontiguousarray(change(picture))


PAIRS = ("astronaut blurred", "chelsea coarse", "coffee coarse", "rendered")


def theirs(reference, test, kind, **parameters):
    error, _, used = flip_evaluator.evaluate(
        reference, test, kind, applyMagma=False, parameters=parameters
    )
    return error[..., 0], used


def lit(picture):
    """Linear light of a picture under a light that changes by ten stops."""
    stops = np.linspace(-4, 6, picture.shape[1])[None, :, None]
    return (picture**2.2 * 2**stops).astype(np.float32)


@pytest.mark.parametrize(
    "name, ppd", [*((name, PPD) for name in PAIRS), (PAIRS[0], 12.0), (PAIRS[1], 67.02)]
)
def test_flip_agrees_with_its_authors(name, ppd):
    expected, _ = theirs(*pair(name), "LDR", ppd=ppd)
    found = flip(*pair(name), ppd=ppd)
    assert found.dtype == jnp.result_type(float) and expected.max() > 0.2
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4)


@pytest.mark.parametrize(
    "name, tone_mapper",
    [("astronaut blurred", "aces"), *(("rendered", mapper) for mapper in MAPPERS)],
)
def test_hdr_flip_and_its_exposures_agree_with_its_authors(name, tone_mapper):
    light = [lit(picture) for picture in pair(name)]
    expected, used = theirs(*light, "HDR", ppd=PPD, tonemapper=tone_mapper)
    exposures = automatic_exposures(light[0], tone_mapper=tone_mapper)
    assert len(exposures) == used["numExposures"] > 3
    ends = used["startExposure"], used["stopExposure"]
    # The other side computes in float32.
    np.testing.assert_allclose(exposures[jnp.array([0, -1])], ends, atol=1e-5)
    found = hdr_flip(*light, ppd=PPD, tone_mapper=tone_mapper)
    assert expected.max() > 0.2
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4)


def test_exposures_may_be_given():
    light = [lit(picture) for picture in pair("rendered")]
    chosen = {"startExposure": -1.0, "stopExposure": 1.5, "numExposures": 2}
    expected, _ = theirs(*light, "HDR", ppd=PPD, tonemapper="hable", **chosen)
    given = np.array([-1.0, 1.5])
    found = hdr_flip(*light, ppd=PPD, tone_mapper="hable", exposures=given)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4)


def rounding():
    """In single precision L* is known to 1e-5, of which FLIP takes the power 0.7."""
    return 1e-6 if jax.config.jax_enable_x64 else 1e-4


def test_more_light_on_all_changes_nothing():
    light = [lit(picture) for picture in pair("rendered")]
    exposures = automatic_exposures(light[0])
    brighter = [8 * picture for picture in light]
    np.testing.assert_allclose(
        automatic_exposures(brighter[0]), exposures - 3, atol=1e-5
    )
    np.testing.assert_allclose(
        hdr_flip(*brighter, ppd=PPD, exposures=exposures - 3),
        hdr_flip(*light, ppd=PPD, exposures=exposures),
        atol=rounding(),
    )


def test_flip_is_symmetric_and_zero_for_equal_pictures():
    first, second = pair("rendered")
    found = flip(first, second, ppd=PPD)
    np.testing.assert_array_equal(flip(second, first, ppd=PPD), found)
    np.testing.assert_array_equal(flip(first, first, ppd=PPD), 0)
    black, white = np.zeros_like(first), np.ones_like(first)
    # HyAB of white and black is less than of green and blue, the largest there is.
    assert 0.9 < float(flip(black, white, ppd=PPD).mean()) < 1


def test_bytes_are_shares_of_white():
    first, second = (
        np.round(255 * picture).astype(np.uint8) for picture in pair("rendered")
    )
    found = flip(first, second, ppd=PPD)
    expected = flip(first / 255, second / 255, ppd=PPD)
    np.testing.assert_allclose(found, expected, atol=rounding())


SMALL_PPD = 8
SHAPE = (14, 18, 3)


def small(seed):
    return np.random.default_rng(seed).uniform(0.1, 0.9, SHAPE)


def test_jit_and_vmap_change_nothing():
    first, second = (jnp.asarray([small(i), small(i + 1)], float) for i in (0, 2))
    of = functools.partial(flip, ppd=SMALL_PPD)
    expected = [of(a, b) for a, b in zip(first, second, strict=True)]
    found = jax.jit(jax.vmap(of))(first, second)
    np.testing.assert_allclose(found, jnp.stack(expected), atol=1e-5)


def test_a_second_picture_compiles_nothing():
    flip(small(0), small(1), ppd=SMALL_PPD)
    before = _wide._cached._cache_size()
    flip(small(2), small(3), ppd=np.float32(SMALL_PPD))
    assert _wide._cached._cache_size() == before


def hdr(reference, test):
    return hdr_flip(reference, test, ppd=SMALL_PPD, exposures=jnp.array([-0.5, 0.5]))


def ldr(reference, test):
    return flip(reference, test, ppd=SMALL_PPD)


# Single precision leaves too few digits for differences.
@pytest.mark.float64
@pytest.mark.parametrize("of", [ldr, hdr])
def test_slopes_are_those_of_differences(of):
    random = np.random.default_rng(4)
    weight = random.uniform(size=SHAPE[:2])
    loss = lambda a, b: jnp.sum(weight * of(a, b))
    at = jnp.asarray(small(0)), jnp.asarray(small(1))
    along = tuple(jnp.asarray(random.normal(size=SHAPE)) for _ in at)
    _, forward = jax.jvp(loss, at, along)
    reverse = sum(
        jnp.vdot(g, d) for g, d in zip(jax.grad(loss, (0, 1))(*at), along, strict=True)
    )
    h = 1e-6
    ahead, back = (
        loss(*(a + s * d for a, d in zip(at, along, strict=True))) for s in (h, -h)
    )
    np.testing.assert_allclose(forward, reverse, rtol=1e-9)
    np.testing.assert_allclose(forward, (ahead - back) / (2 * h), rtol=1e-5)


@pytest.mark.parametrize("of", [ldr, hdr])
@pytest.mark.parametrize(
    "levels", [(0, 0), (1, 1), (0, 1), (0.5, 0.5), (0.04045, 0.04045)]
)
def test_slopes_are_finite_where_pictures_are_equal_or_at_the_ends(of, levels):
    first, second = (jnp.full(SHAPE, level, float) for level in levels)
    loss = lambda a, b: jnp.sum(of(a, b))
    for slope in jax.grad(loss, (0, 1))(first, second):
        assert np.isfinite(slope).all()


def test_a_flat_difference_has_no_edges():
    grey = [np.full((*SIZE, 3), level) for level in (0.5, 0.6)]
    found = np.asarray(flip(*grey, ppd=PPD))
    np.testing.assert_allclose(found, found[0, 0], rtol=1e-3)
    expected, _ = theirs(*(g.astype(np.float32) for g in grey), "LDR", ppd=PPD)
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_light_of_any_strength_is_finite():
    picture = np.broadcast_to(np.logspace(-30, 25, SHAPE[1])[:, None], SHAPE)
    for tone_mapper in MAPPERS:
        found = hdr_flip(
            picture,
            2 * picture,
            ppd=SMALL_PPD,
            tone_mapper=tone_mapper,
            exposures=np.array([-80.0, 0.0, 80.0]),
        )
        assert np.isfinite(found).all() and float(found.max()) > 0.05


@pytest.mark.parametrize("ppd", [0, -1, 0.5, 1e4, np.nan, np.array([60.0, 60.0])])
def test_ppd_must_be_a_sensible_number(ppd):
    with pytest.raises(ValueError, match=r"`ppd` must be a plain number in \[1, 1000"):
        flip(small(0), small(1), ppd=ppd)


def test_ppd_has_no_default_and_no_tracer():
    with pytest.raises(TypeError, match="ppd"):
        flip(small(0), small(1))
    with pytest.raises(ValueError, match="`ppd` must be a plain number.*traced"):
        jax.jit(lambda ppd: flip(small(0), small(1), ppd=ppd))(60.0)


def test_pictures_must_fit():
    with pytest.raises(ValueError, match=r"`test` must have the shape of `reference`"):
        flip(small(0), small(1)[:-1], ppd=PPD)
    with pytest.raises(ValueError, match=r"`reference` must have shape"):
        flip(small(0)[..., 0], small(1), ppd=PPD)
    with pytest.raises(ValueError, match=r"`test` must be in \[0, 1\], got 1.2"):
        flip(small(0), np.full_like(small(1), 1.2), ppd=PPD)


def test_light_must_fit():
    with pytest.raises(ValueError, match="`test` must be finite and >= 0"):
        hdr_flip(small(0), -small(1), ppd=PPD)
    with pytest.raises(ValueError, match="`reference` must have shape"):
        hdr_flip(small(0)[0], small(1), ppd=PPD)
    with pytest.raises(ValueError, match="`test` must have the shape"):
        hdr_flip(small(0), small(1)[1:], ppd=PPD)
    with pytest.raises(ValueError, match="`tone_mapper` must be one of aces"):
        hdr_flip(small(0), small(1), ppd=PPD, tone_mapper="filmic")
    with pytest.raises(ValueError, match="`exposures` must be a list"):
        hdr_flip(small(0), small(1), ppd=PPD, exposures=1.0)
    with pytest.raises(ValueError, match="`exposures` must be finite"):
        hdr_flip(small(0), small(1), ppd=PPD, exposures=np.array([np.inf]))
    with pytest.raises(ValueError, match="`reference` must have light in half"):
        hdr_flip(np.zeros((8, 8, 3)), small(1)[:8, :8], ppd=PPD)
    with pytest.raises(ValueError, match="give `exposures`"):
        jax.jit(lambda a: hdr_flip(a, a, ppd=PPD))(small(0))
