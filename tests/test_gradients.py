"""Slopes of the quality: forward = reverse = differences, finite where it is hard."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from camojab import (
    Display,
    Exact,
    Formulation,
    Parameters,
    Pooled,
    quality,
    Shading,
    Spectrum,
    Viewing,
)


X64 = jax.config.jax_enable_x64

NAMES = (
    "velocity",
    "refresh_rate",
    "persistence",
    "ppd",
    "luminance",
    "rate_x",
    "rate_y",
    "mip_level",
    "beta",
    "ws",
    "wt",
    "ca",
    "cb",
)
USUAL = {
    "velocity": 20.0,
    "refresh_rate": 60.0,
    "persistence": 0.9,
    "ppd": 60.0,
    "luminance": 100.0,
    "rate_x": 0.5,
    "rate_y": 0.5,
    "mip_level": 1.0,
    "beta": 0.36,
    "ws": -3.7,
    "wt": -2.9,
    "ca": 0.0016,
    "cb": 0.08,
}


def vector(**changes):
    return jnp.array([(USUAL | changes)[name] for name in NAMES], float)


# Formulations on both of their rungs. So few cells make errors of a tenth of a JND, and
# the slopes must still be those of the rung itself.
RELEASED = (Formulation.RELEASED, Exact())
PAPER = (Formulation.PAPER, Exact())
RELEASED_POOLED = (Formulation.RELEASED, Pooled(600))
PAPER_POOLED = (Formulation.PAPER, Pooled(600))
EVERY = {
    "released": RELEASED,
    "paper": PAPER,
    "released_pooled": RELEASED_POOLED,
    "paper_pooled": PAPER_POOLED,
}


def on_every(test):
    ways = [pytest.param(way, id=name) for name, way in EVERY.items()]
    return pytest.mark.parametrize("way", ways)(test)


def qualities(way, x, amplitude):
    """One quality for each row of `x`."""
    formulation, fidelity = way
    c = dict(zip(NAMES, x.T, strict=True))
    return quality(
        Spectrum(amplitude),
        Display(**{n: c[n] for n in Display.UNITS}),
        Viewing(c["velocity"]),
        Shading(**{n: c[n] for n in Shading.UNITS}),
        Parameters(**{n: c[n] for n in ("ws", "wt", "beta", "ca", "cb")}),
        formulation=formulation,
        fidelity=fidelity,
    )


# Compiled once for all tests of the file, not once a test.
@functools.cache
def compiled(way):
    values = functools.partial(qualities, way)
    one = lambda x, amplitude: values(x[None], amplitude)[0]
    return jax.jit(values), jax.jit(jax.grad(one, (0, 1))), jax.jit(jax.jacfwd(one))


def central_differences(way, x, amplitude):
    """The differences, and how far rounding alone can move them."""
    steps = 1e-5 * jnp.maximum(jnp.abs(x), 1e-3)
    points = jnp.concatenate([x[None] + jnp.diag(steps), x[None] - jnp.diag(steps)])
    high, low = jnp.split(compiled(way)[0](points, amplitude), 2)
    rounding = 1e-15 * jnp.abs(high).max() / steps
    return np.asarray((high - low) / (2 * steps)), np.asarray(rounding)


def assert_are_the_differences(slope, differences, rounding):
    assert (np.abs(slope - differences) <= 1e-4 * np.abs(differences) + rounding).all()


@functools.cache
def amplitude_of(texture):
    index = np.arange(512) // 16
    drawn = {
        "dense": np.random.default_rng(5).random((512, 512)),
        "checkerboard": 0.15 + 0.7 * ((index[:, None] + index[None, :]) % 2),
        "ramp": np.tile(np.linspace(0.05, 0.95, 512), (512, 1)),
        "zero": np.zeros((8, 8)),
    }
    amplitude = Spectrum.from_texture(drawn[texture]).amplitude
    # What rounding left in the empty bins is cleared: the zeros are exact.
    return jnp.where(amplitude > 1e-8 * amplitude.max(), amplitude, 0.0)


TEXTURES = ["dense", "checkerboard", "ramp", "zero"]

# Rates of a half and a quarter, alike and unlike, and rates between the usual ones.
POINTS = [
    vector(),
    vector(velocity=10.0, persistence=0.5, rate_y=0.25, mip_level=2.0),
    vector(velocity=30.0, ppd=64.0, luminance=10.0, rate_x=0.25, rate_y=0.97),
    vector(
        velocity=45.0,
        refresh_rate=120.0,
        persistence=0.05,
        ppd=26.0,
        luminance=2.5,
        rate_x=0.7,
        rate_y=0.31,
        mip_level=3.0,
        beta=0.5,
    ),
    vector(velocity=0.1, refresh_rate=50.0, ppd=90.0),
]

# Where a slope may be infinite or undefined: no motion, no blur, full rate.
CORNERS = [
    vector(velocity=0.0),
    vector(ca=0.0, cb=0.0),
    vector(velocity=0.0, ca=0.0, cb=0.0),
    vector(rate_x=1.0, rate_y=1.0, mip_level=0.0, persistence=1.0),
    vector(velocity=0.0, ca=0.0, cb=0.0, rate_x=1.0, rate_y=1.0, mip_level=0.0),
]


def test_the_textures_have_exact_zeros():
    empty = {name: float((amplitude_of(name) == 0).mean()) for name in TEXTURES}
    assert empty["dense"] == 0 and empty["zero"] == 1
    assert empty["checkerboard"] > 0.99 and empty["ramp"] > 0.99


@pytest.mark.float64  # central differences in float32 have two digits at best
@pytest.mark.parametrize("way", [PAPER, PAPER_POOLED], ids=["exact", "pooled"])
@pytest.mark.parametrize("texture", ["dense", "checkerboard", "ramp"])
def test_paper_slopes_agree(texture, way):
    _, backward, forward = compiled(way)
    amplitude = amplitude_of(texture)
    for x in POINTS if texture == "dense" else POINTS[1:3]:
        slope = np.asarray(backward(x, amplitude)[0])
        np.testing.assert_allclose(slope, forward(x, amplitude), rtol=1e-10, atol=1e-12)
        differences, rounding = central_differences(way, x, amplitude)
        assert_are_the_differences(slope, differences, rounding)


# Smooth in the released formulation too; velocity, refresh rate, ppd and rates move its
# replicas by whole bins.
SMOOTH = ["luminance", "persistence", "mip_level", "beta", "ws", "wt", "ca", "cb"]


@pytest.mark.float64  # central differences in float32 have two digits at best
@pytest.mark.parametrize("way", [RELEASED, RELEASED_POOLED], ids=["exact", "pooled"])
@pytest.mark.parametrize("texture", ["dense", "checkerboard", "ramp"])
def test_released_slopes_agree(texture, way):
    _, backward, forward = compiled(way)
    amplitude = amplitude_of(texture)
    smooth = [NAMES.index(name) for name in SMOOTH]
    for x in POINTS if texture == "dense" else POINTS[1:3]:
        slope = np.asarray(backward(x, amplitude)[0])
        np.testing.assert_allclose(slope, forward(x, amplitude), rtol=1e-10, atol=1e-12)
        differences, rounding = central_differences(way, x, amplitude)
        assert_are_the_differences(slope[smooth], differences[smooth], rounding[smooth])


@on_every
@pytest.mark.parametrize("texture", TEXTURES)
def test_slopes_are_finite_and_alike_at_corners(way, texture):
    _, backward, forward = compiled(way)
    amplitude = amplitude_of(texture)
    rtol, atol = (1e-10, 1e-12) if X64 else (1e-3, 1e-3)
    # In double precision the points have tests of their own.
    for x in CORNERS if X64 else (*CORNERS, *POINTS):
        slope, by_amplitude = backward(x, amplitude)
        assert np.isfinite(slope).all() and np.isfinite(by_amplitude).all()
        np.testing.assert_allclose(slope, forward(x, amplitude), rtol=rtol, atol=atol)


EXTREMES = [
    {"velocity": 1e-6},
    {"velocity": 1000.0},
    {"velocity": 1e9},
    {"refresh_rate": 1e-3},
    {"refresh_rate": 1.0},
    {"refresh_rate": 2000.0},
    {"refresh_rate": 1e6},
    {"luminance": 1e-6},
    {"luminance": 1e4},
    {"luminance": 1e8},
    {"persistence": 1e-6},
    {"ppd": 0.1},
    {"ppd": 1e4},
    {"rate_x": 1e-3, "rate_y": 1e-3},
    {"mip_level": 12.0},
    {"mip_level": 60.0},
    {"mip_level": 140.0},
    {"beta": 0.05},
    {"beta": 2.0},
]


@on_every
def test_extremes_are_finite(way):
    values, backward, _ = compiled(way)
    amplitude = amplitude_of("checkerboard")
    points = [vector(**extreme) for extreme in EXTREMES]
    padding = [vector()] * (2 * len(NAMES) - len(points))  # as many as are compiled
    value = np.asarray(values(jnp.stack(points + padding), amplitude))
    wrong = [EXTREMES[i] for i in np.flatnonzero(~np.isfinite(value[: len(points)]))]
    for x, extreme in zip(points, EXTREMES, strict=True):
        slope, by_amplitude = backward(x, amplitude)
        wrong += [(extreme, NAMES[i]) for i in np.flatnonzero(~np.isfinite(slope))]
        if not np.isfinite(by_amplitude).all():
            wrong.append((extreme, "amplitude"))
    assert wrong == []


@on_every
def test_zero_texture_has_no_slope(way):
    _, backward, _ = compiled(way)
    for slope in backward(vector(), amplitude_of("zero")):
        np.testing.assert_array_equal(slope, 0)


@pytest.mark.float64  # central differences in float32 have two digits at best
@on_every
def test_slope_with_the_amplitude(way):
    values, backward, _ = compiled(way)
    one = lambda amplitude: values(jnp.tile(vector(), (2 * len(NAMES), 1)), amplitude)[
        0
    ]
    amplitude = amplitude_of("dense")
    along = amplitude * jnp.asarray(np.random.default_rng(1).random((512, 512)))
    differences = (one(amplitude + 1e-6 * along) - one(amplitude - 1e-6 * along)) / 2e-6
    slope = (backward(vector(), amplitude)[1] * along).sum()
    np.testing.assert_allclose(slope, differences, rtol=1e-6)


@pytest.mark.float64  # central differences in float32 have two digits at best
def test_slope_with_the_texels():
    texture = jnp.asarray(np.random.default_rng(2).random((32, 48)))
    along = jnp.asarray(np.random.default_rng(3).random((32, 48)) - 0.5)

    @jax.jit
    def one(texture):
        amplitude = Spectrum.from_texture(texture).amplitude
        return qualities(PAPER, vector()[None], amplitude)[0]

    differences = (one(texture + 1e-6 * along) - one(texture - 1e-6 * along)) / 2e-6
    slope = (jax.jit(jax.grad(one))(texture) * along).sum()
    np.testing.assert_allclose(slope, differences, rtol=1e-6)


@pytest.mark.float64  # central differences in float32 have two digits at best
@on_every
def test_second_derivatives_of_what_is_fitted(way):
    _, backward, _ = compiled(way)
    amplitude, x = amplitude_of("dense"), vector()
    fitted = jnp.array([NAMES.index(name) for name in ("beta", "ws", "wt", "ca")])
    slope = lambda at: backward(x.at[fitted].set(at), amplitude)[0][fitted]
    curvature = np.asarray(jax.jacfwd(slope)(x[fitted]))
    np.testing.assert_allclose(curvature, curvature.T, rtol=1e-9, atol=1e-9)
    for i, value in enumerate(x[fitted]):
        step = jnp.zeros(len(fitted)).at[i].set(1e-5 * abs(value))
        rise = slope(x[fitted] + step) - slope(x[fitted] - step)
        differences = np.asarray(rise / (2 * step[i]))
        np.testing.assert_allclose(curvature[i], differences, rtol=1e-5, atol=1e-6)
