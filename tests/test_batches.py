"""Many conditions at once: shapes, transformations, compilations and memory."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import camojab._paper
import camojab._released
from camojab import (
    Components,
    Display,
    distortion,
    Formulation,
    Parameters,
    pool,
    pooled_quality,
    quality,
    Shading,
    Spectrum,
    Viewing,
)


X64 = jax.config.jax_enable_x64
RTOL = 1e-12 if X64 else 1e-5

FORMULATIONS = list(Formulation)
MODULES = {
    Formulation.RELEASED: camojab._released,
    Formulation.PAPER: camojab._paper,
}
DISPLAY = {"ppd": 60.0, "refresh_rate": 60.0, "luminance": 100.0}
PARAMETERS = Parameters(ws=-3.7, wt=-2.9, beta=0.36)


def spectrum(seed=0):
    texture = np.random.default_rng(seed).random((512, 512))
    return Spectrum.from_texture(texture)


# ---- shapes


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_shapes_broadcast_like_separate_calls(formulation):
    texture = spectrum()
    velocity = np.array([[5.0], [20.0], [60.0]])
    refresh_rate = np.array([30.0, 60.0, 120.0, 240.0])
    beta = np.array([0.3, 0.36, 0.4, 0.5])

    def parts(velocity, refresh_rate, beta):
        return distortion(
            texture,
            Display(**DISPLAY | {"refresh_rate": refresh_rate}),
            Viewing(velocity),
            Shading(rate_x=0.5),
            Parameters(ws=-3.7, wt=-2.9, beta=beta),
            formulation=formulation,
        )

    together = parts(velocity, refresh_rate, beta)
    assert together.spatial.shape == together.temporal.shape == (3, 4)
    for i in range(3):
        for j in range(4):
            alone = parts(velocity[i, 0], refresh_rate[j], beta[j])
            assert alone.spatial.shape == ()
            np.testing.assert_allclose(together.spatial[i, j], alone.spatial, RTOL)
            np.testing.assert_allclose(together.temporal[i, j], alone.temporal, RTOL)


@pytest.mark.parametrize("shape", [(), (4,), (3, 1)])
def test_weights_broadcast_too(shape):
    ws = -np.arange(1.0, 1.0 + np.prod(shape, dtype=int)).reshape(shape)
    args = (
        spectrum(),
        Display(**DISPLAY | {"refresh_rate": np.array([30.0, 60.0, 90.0, 120.0])}),
        Viewing(np.array([[5.0], [20.0], [60.0]])),
        None,
    )
    parts = distortion(*args, PARAMETERS)
    value = quality(*args, Parameters(ws=ws, wt=-2.0, beta=PARAMETERS.beta))
    expected = ws * np.asarray(parts.spatial) - 2 * np.asarray(parts.temporal)
    np.testing.assert_allclose(value, expected, rtol=1e-5)
    assert value.shape == expected.shape


def test_no_conditions_give_no_values():
    empty = Display(**DISPLAY | {"refresh_rate": np.zeros((0, 3))})
    value = quality(spectrum(), empty, Viewing(5.0), None, PARAMETERS)
    assert value.shape == (0, 3)


def test_numbers_of_any_type_are_taken():
    args = Viewing(5), Shading(rate_x=1, mip_level=2), PARAMETERS
    ours = quality(
        spectrum(),
        Display(ppd=60, refresh_rate=np.float32(50), luminance=np.int32(80)),
        *args,
    )
    exact = quality(
        spectrum(), Display(ppd=60.0, refresh_rate=50.0, luminance=80.0), *args
    )
    assert ours.dtype == exact.dtype and ours == exact


# ---- transformations


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_transformations_give_the_same_values(formulation):
    texture, velocity = spectrum(), jnp.array([3.0, 30.0])

    def of(texture, velocity):
        return quality(
            texture,
            Display(**DISPLAY),
            Viewing(velocity),
            Shading(rate_x=0.5, rate_y=0.25),
            PARAMETERS,
            formulation=formulation,
        )

    expected = of(texture, velocity)
    mapped = jax.jit(jax.vmap(of, (None, 0)))(texture, velocity)
    np.testing.assert_allclose(mapped, expected, RTOL)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_vmap_over_spectra_is_a_loop(formulation):
    textures = [spectrum(seed) for seed in range(3)]
    stacked = jax.tree.map(lambda *a: jnp.stack(a), *textures)
    of = lambda texture: quality(
        texture,
        Display(**DISPLAY),
        Viewing(20.0),
        Shading(rate_x=0.5),
        PARAMETERS,
        formulation=formulation,
    )
    mapped = jax.vmap(of)(stacked)
    np.testing.assert_allclose(mapped, [of(t) for t in textures], RTOL)
    assert len({float(q) for q in mapped}) == 3


# ---- pooled


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_pooled_is_exact(formulation):
    texture = spectrum()
    display = Display(
        ppd=np.array([26.0, 60.0]),
        refresh_rate=np.array([[50.0], [144.0], [1.0]]),
        luminance=np.array([2.5, 150.0]),
        persistence=0.4,
    )
    viewing = Viewing(np.array([[0.0], [20.0], [70.0]]))
    for shading in (
        None,
        Shading(rate_x=0.5, rate_y=0.25, mip_level=3.0),
        Shading(rate_x=0.37, rate_y=0.81),
    ):
        pooled = pool(texture, shading, PARAMETERS, formulation=formulation)
        exact = quality(
            texture, display, viewing, shading, PARAMETERS, formulation=formulation
        )
        assert exact.shape == (3, 2)
        np.testing.assert_allclose(
            pooled_quality(pooled, display, viewing), exact, RTOL
        )


def test_pooled_defaults_are_the_published_constants():
    texture, display, viewing = spectrum(), Display(**DISPLAY), Viewing(10.0)
    for formulation in FORMULATIONS:
        pooled = pool(texture, formulation=formulation)
        exact = quality(texture, display, viewing, formulation=formulation)
        np.testing.assert_allclose(
            pooled_quality(pooled, display, viewing), exact, RTOL
        )


def test_vmap_pools_several_rates():
    texture, display, viewing = spectrum(), Display(**DISPLAY), Viewing(20.0)
    rates = jnp.array([0.25, 0.5, 1.0])
    pooled = jax.vmap(lambda r: pool(texture, Shading(rate_x=r), PARAMETERS))(rates)
    mapped = jax.vmap(lambda p: pooled_quality(p, display, viewing))(pooled)
    exact = quality(texture, display, viewing, Shading(rate_x=rates), PARAMETERS)
    np.testing.assert_allclose(mapped, exact, RTOL)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_slopes_one_by_one_through_the_pool_are_those_of_the_batch(formulation):
    texture = spectrum()

    def total(rate, velocity):
        return quality(
            texture,
            Display(**DISPLAY),
            Viewing(velocity),
            Shading(rate_x=rate),
            PARAMETERS,
            formulation=formulation,
        ).sum()

    def pooled_one(rate, velocity):
        pooled = pool(
            texture, Shading(rate_x=rate), PARAMETERS, formulation=formulation
        )
        return pooled_quality(pooled, Display(**DISPLAY), Viewing(velocity))

    @jax.jit
    def slopes(*point):
        one_by_one = jax.vmap(jax.grad(pooled_one, (0, 1)))
        return one_by_one(*point), jax.grad(total, (0, 1))(*point)

    ours, exact = slopes(jnp.array([0.5, 0.31]), jnp.array([20.0, 60.0]))
    # In single precision the sums of a slope nearly cancel.
    rtol, atol = (1e-9, 0) if X64 else (1e-2, 1e-4)
    np.testing.assert_allclose(ours, exact, rtol=rtol, atol=atol)


# ---- compilations


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_one_compilation_serves_every_condition(formulation, monkeypatch):
    module = MODULES[formulation]
    evaluate, traced = module.evaluate, []

    def counted(*args):
        traced.append(1)
        return evaluate(*args)

    monkeypatch.setattr(module, "evaluate", counted)

    # Of a shape that no other test uses, or it would be compiled already.
    def run(texture, display, viewing, shading, parameters, **components):
        quality(
            texture,
            display,
            viewing,
            shading,
            parameters,
            formulation=formulation,
            components=Components(**components),
        )

    other = Parameters(ws=-1.0, wt=-2.0, beta=0.5, ca=0.0, cb=0.0)
    velocity = np.arange(7.0)
    run(spectrum(), Display(**DISPLAY), Viewing(velocity), None, PARAMETERS)
    first = len(traced)
    assert first > 0
    run(spectrum(1), Display(**DISPLAY), Viewing(velocity + 1), None, other)
    run(
        spectrum(),
        Display(ppd=26, refresh_rate=velocity + 50, luminance=1, persistence=0.5),
        Viewing(3),
        Shading(rate_x=0.5, rate_y=0.25, mip_level=2),
        other,
        vrs=False,
        eye_blur=np.float32(0),
    )
    assert len(traced) == first
    # Rates that differ from condition to condition are pooled one by one: once more.
    run(
        spectrum(),
        Display(**DISPLAY),
        Viewing(5.0),
        Shading(rate_x=np.linspace(0.2, 1.0, 7)),
        None,
        judder=0,
    )
    second = len(traced)
    assert second > first
    run(
        spectrum(1),
        Display(**DISPLAY),
        Viewing(velocity),
        Shading(rate_x=0.5, mip_level=velocity),
        PARAMETERS,
        vrs=velocity < 2,
    )
    assert len(traced) == second


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_one_compilation_serves_every_pooled_display(formulation, monkeypatch):
    module = MODULES[formulation]
    evaluate, traced = module.evaluate, []

    def counted(*args):
        traced.append(1)
        return evaluate(*args)

    monkeypatch.setattr(module, "evaluate", counted)
    velocity, counts = np.arange(9.0), []
    for i, rate in enumerate((0.25, 0.5, 1.0)):
        pooled = pool(
            spectrum(i), Shading(rate_x=rate), PARAMETERS, formulation=formulation
        )
        display = Display(**DISPLAY | {"ppd": 26.0 + i})
        pooled_quality(pooled, display, Viewing(velocity + i))
        counts.append(len(traced))
    assert counts[0] > 0 and counts[0] == counts[-1]


# ---- memory

LIMIT_BYTES = 100e6


def memory(function, *args):
    compiled = jax.jit(function).lower(*args).compile()
    return compiled.memory_analysis().temp_size_in_bytes


@pytest.mark.parametrize("slopes", [False, True])
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_memory_does_not_grow_with_the_conditions(formulation, slopes):
    texture, n = spectrum(), 4096

    def total(texture, velocity, luminance, rate):
        return quality(
            texture,
            Display(**DISPLAY | {"luminance": luminance}),
            Viewing(velocity),
            Shading(rate_x=rate),
            PARAMETERS,
            formulation=formulation,
        ).sum()

    function = jax.grad(total, (0, 1, 2, 3)) if slopes else total
    axis = jnp.linspace(0.1, 1.0, n)
    assert memory(function, texture, 50 * axis, 100 * axis, axis) < LIMIT_BYTES


@pytest.mark.parametrize("slopes", [False, True])
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_memory_does_not_grow_with_the_pooled_conditions(formulation, slopes):
    pooled, n = pool(spectrum(), None, PARAMETERS, formulation=formulation), 20_000

    def total(velocity, luminance, refresh_rate):
        return pooled_quality(
            pooled,
            Display(ppd=60.0, refresh_rate=refresh_rate, luminance=luminance),
            Viewing(velocity),
        ).sum()

    function = jax.grad(total, (0, 1, 2)) if slopes else total
    axis = jnp.linspace(0.1, 1.0, n)
    assert memory(function, 50 * axis, 100 * axis, 60 * axis) < LIMIT_BYTES
