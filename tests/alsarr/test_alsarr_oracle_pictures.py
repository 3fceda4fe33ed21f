"""The oracles that look at the previous picture: Yang 2019 and FidelityFX."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from alsarr import Frame, RATES, TILE
from alsarr.oracle import FidelityFxOracle, Yang2019Oracle
from camojab.baselines import (
    half_rate_error_yang2019,
    rates_yang2019,
    threshold_yang2019,
)


X64 = jax.config.read("jax_enable_x64")
RTOL = 1e-9 if X64 else 1e-4
PPD, RATE = 40.0, 80.0


def frame_of(image, velocity_x=0.0, velocity_y=0.0):
    """Of a colour picture, or of a grey one."""
    image = np.asarray(image, float)
    if image.ndim == 2:
        image = np.repeat(image[:, :, None], 3, axis=2)
    rows, columns = (-(-n // TILE) for n in image.shape[:2])
    return Frame(
        texture=np.zeros((rows, columns)),
        mip_level=0.0,
        velocity_x=velocity_x,
        velocity_y=velocity_y,
        luminance=50.0,
        previous_image=image,
    )


def tiles_of(luma):
    """Every tile's pixels that exist, row by row."""
    height, width = luma.shape
    return [
        luma[y : y + TILE, x : x + TILE]
        for y in range(0, height, TILE)
        for x in range(0, width, TILE)
    ]


def colours(height, width, seed=0):
    """Tiles from flat to rough, from dark to bright."""
    draw = np.random.default_rng(seed)
    shape = (-(-height // TILE), -(-width // TILE), 1)
    of_tile = lambda x: np.kron(x, np.ones((TILE, TILE, 1)))[:height, :width]
    level, contrast = of_tile(draw.random(shape)), of_tile(draw.random(shape) ** 4)
    noise = draw.uniform(-0.5, 0.5, (height, width, 3))
    return np.clip(level + contrast * noise, 0, 1)


def moving(height, width, seed=1):
    """Most tiles a few pixels a frame, some at rest. [deg/s]."""
    draw = np.random.default_rng(seed)
    shape = (-(-height // TILE), -(-width // TILE))
    px = draw.choice([0.0, 0.3, 1.5, 6.0], (2, *shape)) * draw.uniform(0.5, 2)
    return px * RATE / PPD


def expected_yang(image, velocity, sensitivity, environment):
    """Eq. 2, 14, 15, 20 and 21 in NumPy, tile by tile."""
    luma = image @ np.array([0.299, 0.587, 0.114])
    found = []
    for tile, v in zip(tiles_of(luma), velocity.reshape(2, -1).T, strict=True):
        threshold = sensitivity * (tile.mean() + environment)
        of_axis = []
        for axis, speed in zip((1, 0), v * PPD / RATE, strict=True):
            step = np.diff(tile, axis=axis) / 2
            error = np.sqrt(np.mean(step**2)) if step.size else 0.0
            half = (1 / (1 + (1.05 * speed) ** 3.10)) ** 0.35
            quarter = 2.13 * (1 / (1 + (0.55 * speed) ** 2.41)) ** 0.49
            of_side = {1: 0.0, 2: half * error, 4: quarter * error}
            of_axis.append({m: e / threshold for m, e in of_side.items()})
        across, down = of_axis
        found.append([-max(across[m], down[n]) for m, n in RATES.size.tolist()])
    return np.array(found)


def expected_fidelityfx(image, velocity, motion_factor):
    luma = image @ np.array([0.30, 0.59, 0.11])
    found = []
    for tile, v in zip(tiles_of(luma), velocity.reshape(2, -1).T, strict=True):
        hidden = np.hypot(*v) * PPD / RATE * motion_factor
        row = []
        for m, n in RATES.size.tolist():
            blocks = [
                tile[y : y + n, x : x + m]
                for y in range(0, tile.shape[0], n)
                for x in range(0, tile.shape[1], m)
            ]
            row.append(-max(0.0, max(np.ptp(block) for block in blocks) - hidden))
        found.append(row)
    return np.array(found)


# Whole tiles beside tiles cut by the edge, and beside slivers of one pixel.
SIZES = [(24, 40), (17, 33)]


@pytest.mark.parametrize("height, width", SIZES)
def test_qualities_are_those_of_the_equations(height, width):
    image, velocity = colours(height, width), moving(height, width)
    frame = frame_of(image, *velocity)
    nas = Yang2019Oracle(ppd=PPD, sensitivity=0.2, environment_luma=0.05)
    expected = expected_yang(image, velocity, 0.2, 0.05)
    np.testing.assert_allclose(nas.quality(frame, RATE), expected, RTOL, atol=1e-6)
    assert nas.unit == "just noticeable errors"

    fidelityfx = FidelityFxOracle(ppd=PPD, motion_factor=0.03)
    expected = expected_fidelityfx(image, velocity, 0.03)
    got = fidelityfx.quality(frame, RATE)
    np.testing.assert_allclose(got, expected, RTOL, atol=1e-6)
    assert fidelityfx.unit == "luma"


@pytest.mark.parametrize("kind", [Yang2019Oracle, FidelityFxOracle])
def test_full_rate_loses_nothing_and_coarser_never_less(kind):
    image = colours(64, 160)
    got = np.asarray(kind(ppd=PPD).quality(frame_of(image), RATE))
    assert not got[:, -1].any() and np.all(got <= 0)
    q = dict(zip(RATES.names, got.T, strict=True))
    for fine, coarse in (("1x2", "2x2"), ("2x2", "2x4"), ("4x2", "4x4")):
        assert np.all(q[coarse] <= q[fine]) and np.any(q[coarse] < q[fine])
    fast = np.asarray(kind(ppd=PPD).quality(frame_of(image, 5.0, 5.0), RATE))
    assert np.all(fast >= got) and np.any(fast > got)


def test_nas_chooses_what_the_baseline_chooses():
    """Every rate occurs, and what must be demoted because 4x1 and 1x4 are no rates."""
    height, width = 256, 800
    draw = np.random.default_rng(2)
    # Unlike detail along x and along y.
    grain = 10 ** draw.uniform(-3, 0, (2, height // TILE, width // TILE))
    of_pixel = np.kron(grain, np.ones((1, TILE, TILE)))
    image = 0.5 + 0.25 * (
        of_pixel[0] * draw.uniform(-1, 1, (1, width))
        + of_pixel[1] * draw.uniform(-1, 1, (height, 1))
    )
    velocity = moving(height, width)
    nas = Yang2019Oracle(ppd=PPD)
    got = RATES.size[np.asarray(nas.rate(frame_of(image, *velocity), RATE))]

    @jax.jit
    def baseline(tiles, px):
        error, mean = half_rate_error_yang2019(tiles), jnp.mean(tiles, axis=(1, 2))
        threshold = threshold_yang2019(mean, sensitivity=0.07, environment_luma=0.1)
        return rates_yang2019(error, threshold, px), error / threshold[:, None]

    px = velocity.reshape(2, -1).T * PPD / RATE
    expected, half = baseline(np.stack(tiles_of(image)), px)
    # In single precision the luma of grey is not quite grey.
    allowed = 0 if X64 else 1
    assert np.sum(np.any(got != expected, axis=1)) <= allowed
    assert len(np.unique(got, axis=0)) == 7
    # At rest one axis could be shaded at a quarter and the other at full rate only.
    still = np.asarray(half)[~px.any(axis=1)]
    assert np.any((2.13 * still[:, 0] < 1) & (still[:, 1] >= 1))
    assert np.any((2.13 * still[:, 1] < 1) & (still[:, 0] >= 1))


def blocks_of(wide, high, height=TILE, width=TILE):
    """Random blocks of one size: shading them so loses nothing."""
    draw = np.random.default_rng(3)
    small = draw.uniform(0, 1, (height // high, width // wide))
    return np.kron(small, np.ones((high, wide)))


def test_fidelityfx_finds_the_block_size():
    """1x2 and 2x1 the right way round, which the library confuses."""
    fidelityfx = FidelityFxOracle(ppd=PPD)
    for rate, (wide, high) in enumerate(RATES.size.tolist()):
        frame = frame_of(blocks_of(wide, high))
        assert int(fidelityfx.rate(frame, RATE)[0]) == rate
        assert fidelityfx.quality(frame, RATE)[0, rate] == 0
    rows = np.tile([[0.2], [0.8]], (8, 16))
    lost = fidelityfx.quality(frame_of(rows), RATE)[0]
    by_name = dict(zip(RATES.names, np.asarray(lost).tolist(), strict=True))
    assert by_name["2x1"] == 0 and by_name["1x2"] == pytest.approx(-0.6)


@pytest.mark.parametrize("level", [0.0, 0.02, 0.5, 1.0])
def test_fidelityfx_lets_flat_tiles_be_coarse_however_bright(level):
    flat = frame_of(np.full((TILE, TILE), level))
    assert int(FidelityFxOracle(ppd=PPD).rate(flat, RATE)[0]) == 0


def test_fidelityfx_cutoff_and_ties():
    image = np.full((TILE, TILE), 0.5)
    image[:, 1] = 0.56
    image[2, :] = 0.52
    frame = frame_of(image)
    of = lambda cutoff: int(
        FidelityFxOracle(ppd=PPD, variance_cutoff=cutoff).rate(frame, RATE)[0]
    )
    assert RATES.names[of(0.05)] == "1x2"
    assert RATES.names[of(0.07)] == "4x4"
    # 2x4 and 4x2 cost as much; a column of detail is worse for neither, a row is.
    ramp = np.full((TILE, TILE), 0.5) + 0.01 * np.arange(TILE)[:, None]
    steep = FidelityFxOracle(ppd=PPD, variance_cutoff=0.025)
    assert RATES.names[int(steep.rate(frame_of(ramp), RATE)[0])] == "4x2"
    both = FidelityFxOracle(ppd=PPD, variance_cutoff=0.03)
    assert RATES.names[int(both.rate(frame_of(ramp), RATE)[0])] == "4x2"
    # 10 px a frame at 0.01 a pixel hide all of it.
    fast = frame_of(image, 6 * RATE / PPD, 8 * RATE / PPD)
    assert not FidelityFxOracle(ppd=PPD).quality(fast, RATE).any()


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**31), st.sampled_from([Yang2019Oracle, FidelityFxOracle]))
def test_a_turned_picture_has_the_turned_rates(seed, kind):
    image, velocity = colours(32, 48, seed), moving(32, 48, seed)
    here = compiled(kind(ppd=PPD), frame_of(image, *velocity), RATE)
    turned = frame_of(image.swapaxes(0, 1), velocity[1].T, velocity[0].T)
    there = compiled(kind(ppd=PPD), turned, RATE)
    across = [RATES.names.index(name[::-1]) for name in RATES.names]
    there = np.asarray(there).reshape(3, 2, 7).transpose(1, 0, 2)[:, :, across]
    here = np.asarray(here).reshape(2, 3, 7)
    np.testing.assert_allclose(here, there, rtol=1e-5, atol=1e-6)


@eqx.filter_jit
def compiled(oracle, frame, rate):
    return oracle.quality(frame, rate)


@pytest.mark.parametrize("kind", [Yang2019Oracle, FidelityFxOracle])
def test_derivatives_are_finite(kind):
    """Also where nothing moves and where nothing is to be seen."""
    image = colours(32, 48)
    image[:16, :16] = 0.5
    frame = frame_of(image, *moving(32, 48))

    def total(vx, vy, picture):
        moved = eqx.tree_at(
            lambda f: (f.velocity_x, f.velocity_y, f.previous_image),
            frame,
            (vx, vy, picture),
        )
        return jnp.sum(kind(ppd=PPD).quality(moved, RATE))

    at = frame.velocity_x, frame.velocity_y, frame.previous_image
    for slope in jax.jit(jax.grad(total, argnums=(0, 1, 2)))(*at):
        assert np.isfinite(slope).all() and np.any(np.asarray(slope) != 0)


@pytest.mark.parametrize(
    "kind, who", [(Yang2019Oracle, "NAS"), (FidelityFxOracle, "FidelityFX")]
)
def test_what_is_missing_or_out_of_range_is_named(kind, who):
    frame = frame_of(colours(16, 16))
    blind = Frame(
        texture=np.zeros((1, 1)),
        mip_level=0.0,
        velocity_x=0.0,
        velocity_y=0.0,
        luminance=1.0,
    )
    rule = f"`frame.previous_image` must be given, since {who} looks .*, got None"
    for method in ("quality", "rate"):
        with pytest.raises(ValueError, match=rule):
            getattr(kind(ppd=PPD), method)(blind, RATE)
    with pytest.raises(ValueError, match="`refresh_rate` must be > 0 Hz and finite"):
        kind(ppd=PPD).quality(frame, -1.0)
    with pytest.raises(ValueError, match="`ppd` must be finite and > 0 px/deg, got 0"):
        kind(ppd=0)


@pytest.mark.parametrize(
    "kind, changes",
    [
        (Yang2019Oracle, {"sensitivity": 0}),
        (Yang2019Oracle, {"environment_luma": -1}),
        (FidelityFxOracle, {"motion_factor": -0.1}),
        (FidelityFxOracle, {"variance_cutoff": 0}),
    ],
)
def test_constants_are_checked(kind, changes):
    ((name, value),) = changes.items()
    with pytest.raises(ValueError, match=f"`{name}` must be finite and >.*{value}"):
        kind(ppd=PPD, **changes)
