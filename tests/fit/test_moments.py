"""Quadratures of log amplitude stand in for the spectrum, whatever the exponent."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import reference
from camojab import (
    Components,
    Display,
    distortion,
    Formulation,
    Parameters,
    Shading,
    Spectrum,
    Viewing,
)
from camojab._condition import Condition, flattened
from camojab.fit import _moments, moments


X64 = jax.config.read("jax_enable_x64")
FORMULATIONS = list(Formulation)
BETAS = [0.25, 0.3596635, 0.574776695867621, 1.0, 1.7]

# One row a condition, from a still to a fast texture and from 13 to 90 px/deg.
DISPLAY = {
    "ppd": np.array([50.0, 90.0, 26.0, 60.0, 13.0]),
    "refresh_rate": np.array([144.0, 60.0, 144.0, 50.0, 30.0]),
    "luminance": np.array([150.0, 75.0, 2.5, 1e3, 1e-2]),
    "persistence": np.array([1.0, 1.0, 0.05, 0.5, 0.2]),
}
VELOCITY = np.array([0.0, 10.0, 75.0, 40.0, 200.0])
SHADING = {
    "rate_x": np.array([1.0, 0.5, 0.25, 0.5, 0.25]),
    "rate_y": np.array([1.0, 1.0, 0.5, 0.25, 1.0]),
    "mip_level": np.array([3.0, 1.0, 5.0, 0.0, 2.0]),
}


def texture():
    """Detail at every scale over a ramp, and not the same in x as in y."""
    noise = np.random.default_rng(5).random((512, 512))
    return 0.5 * noise + np.linspace(0, 0.5, 512)[None, :] ** 2


@functools.cache
def spectrum():
    return Spectrum.from_texture(texture())


def condition(formulation, **parameters):
    constants = Parameters(ws=-1.0, wt=-1.0, **{"beta": 0.36, **parameters})
    return Condition(
        Display(**DISPLAY),
        Viewing(VELOCITY),
        Shading(**SHADING),
        Components(),
        constants,
    )


@functools.cache
def made(formulation, nodes=32):
    return moments(
        spectrum(), condition(formulation), formulation=formulation, nodes=nodes
    )


def at(beta):
    """Constants of which only the exponent has an effect."""
    return Parameters(ws=-1.0, wt=-1.0, beta=beta)


def reference_energy(found, beta):
    return np.sum(
        np.asarray(found.weight, float)[:, 0]
        * np.exp(beta * np.asarray(found.log, float)[:, 0]),
        axis=-1,
    )


def largest_error(formulation, beta, nodes=32):
    """Of both distortions of all conditions, in units of the reference's energy."""
    found = made(formulation, nodes)
    spatial, temporal = found.distortion(at(beta))
    c = condition(formulation, beta=beta)
    exact = distortion(
        spectrum(),
        c.display,
        c.viewing,
        c.shading,
        c.parameters,
        formulation=formulation,
    )
    energy = reference_energy(found, beta)
    errors = np.stack([spatial - exact.spatial, temporal - exact.temporal])
    return np.abs(errors / energy).max()


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("beta", BETAS)
def test_moments_reproduce_the_distortion(formulation, beta):
    # In single precision the model itself is good to 1e-4.
    bound = 1e-8 if X64 else 1e-4
    assert largest_error(formulation, beta) < bound


@pytest.mark.float64  # rounding covers the error of 16 nodes
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_error_falls_with_the_nodes(formulation):
    few, some, many = (largest_error(formulation, 1.0, n) for n in (3, 6, 32))
    assert few > 50 * some > 5000 * many


@functools.cache
def drawn(name):
    index = np.arange(512)
    return {
        "noise": np.random.default_rng(2).random((512, 512)),
        "small": np.random.default_rng(3).random((24, 31)),
        "checkerboard": 0.15 + 0.7 * ((index[:, None] // 16 + index // 16) % 2),
        "ramp": np.tile(np.linspace(0.05, 0.95, 512), (512, 1)),
    }[name]


# All five conditions, at exponents within and beyond those that fits come to.
WITHIN, BEYOND = np.array([0.1, 0.15, 0.25, 0.4, 0.7, 1.0, 1.5]), np.array([0.05, 2.0])


@functools.cache
def quadrature_errors(name, formulation):
    """Relative errors of each energy at `WITHIN`, and at `BEYOND`."""
    spectrum = Spectrum.from_texture(drawn(name))
    _, every = flattened(condition(formulation), spectrum.amplitude.dtype)
    found = moments(spectrum, condition(formulation), formulation=formulation)
    errors = []
    for k in range(5):
        one = jax.tree.map(lambda x, k=k: x[k], every)
        for n, field in enumerate(_moments._fields(spectrum, one, formulation)):
            log, weight = (np.asarray(x, float) for x in (field.log, field.weight))
            exact = [np.sum(weight * np.exp(beta * log)) for beta in (*WITHIN, *BEYOND)]
            nodes, weights = found.log[k, n], found.weight[k, n]
            ours = [
                jnp.sum(weights * jnp.exp(beta * nodes)) for beta in (*WITHIN, *BEYOND)
            ]
            difference = np.abs(np.array(ours) - exact)
            errors.append(difference / np.where(np.array(exact) > 0, exact, 1))
    return np.split(np.max(errors, axis=0), [len(WITHIN)])


@pytest.mark.float64  # the error is far below what single precision can tell
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("name", ["noise", "small", "checkerboard", "ramp"])
def test_energies_of_other_textures(name, formulation):
    within, beyond = quadrature_errors(name, formulation)
    # Between few lines the paper's replica leaves energies of a few bins, from which
    # their many empty neighbours take nodes.
    regular = name in ("checkerboard", "ramp") and formulation is Formulation.PAPER
    assert within.max() < (1e-7 if regular else 1e-8)
    assert beyond.max() < (1e-5 if regular else 1e-8)


@pytest.mark.parametrize("beta", BETAS)
def test_reference_energy_is_that_of_the_transcription(beta):
    k = np.abs(np.arange(-256, 256))
    amplitude = reference.amplitude(texture())
    energy = reference_energy(made(Formulation.RELEASED), beta)
    for i, ppd in enumerate(DISPLAY["ppd"]):
        rho = np.maximum(k[:, None], k[None, :]) * ppd / 512
        still = reference.sensitivity(rho, 0.0, DISPLAY["luminance"][i])
        expected = np.mean((amplitude * still) ** beta)
        np.testing.assert_allclose(energy[i], expected, rtol=1e-8 if X64 else 1e-4)


@pytest.mark.float64  # differences of single-precision sums are noise
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("beta", [0.3, 0.6, 1.2])
def test_derivative_in_beta(formulation, beta):
    found = made(formulation)
    f = lambda b: jnp.stack(found.distortion(at(b)))
    one, beta = jnp.ones(()), jnp.asarray(beta)
    value, forward = jax.jvp(f, (beta,), (one,))
    h = 1e-5
    differences = (f(beta + h) - f(beta - h)) / (2 * h)
    scale = np.abs(differences).max()
    np.testing.assert_allclose(forward, differences, rtol=1e-6, atol=1e-8 * scale)
    weights = np.random.default_rng(0).normal(size=value.shape)
    backward = jax.grad(lambda b: jnp.sum(weights * f(b)))(beta)
    np.testing.assert_allclose(backward, np.sum(weights * forward), rtol=1e-9)


@pytest.mark.float64  # the two sums round differently in single precision
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_derivative_in_beta_is_the_models_own(formulation):
    beta, one = jnp.asarray(0.36), jnp.ones(())
    c = condition(formulation)

    def exact(b):
        constants = Parameters(ws=-1.0, wt=-1.0, beta=b)
        parts = distortion(
            spectrum(),
            c.display,
            c.viewing,
            c.shading,
            constants,
            formulation=formulation,
        )
        return jnp.stack([parts.spatial, parts.temporal])

    found = made(formulation)
    _, ours = jax.jvp(lambda b: jnp.stack(found.distortion(at(b))), (beta,), (one,))
    _, theirs = jax.jvp(exact, (beta,), (one,))
    slope = np.sum(
        np.asarray(found.weight * jnp.abs(found.log))[:, 0]
        * np.exp(0.36 * np.asarray(found.log)[:, 0]),
        axis=-1,
    )
    assert np.abs(np.asarray(ours - theirs) / slope).max() < 1e-8


def test_shapes_broadcast_and_are_flattened():
    c = Condition(
        Display(ppd=50.0, refresh_rate=np.array([[60.0], [120.0]]), luminance=100.0),
        Viewing(np.array([0.0, 10.0, 20.0])),
        Shading(),
        Components(),
        Parameters(ws=-1.0, wt=-1.0, beta=0.36),
    )
    found = moments(spectrum(), c, nodes=8)
    assert found.log.shape == found.weight.shape == (6, 3, 8)
    exact = distortion(spectrum(), c.display, c.viewing, c.shading, c.parameters)
    spatial, _ = found.distortion(at(0.36))
    # 8 nodes only: order matters here, not digits.
    np.testing.assert_allclose(spatial.reshape(2, 3), exact.spatial, rtol=0.01)
    assert len({round(float(x), 6) for x in spatial}) == 5
    assert (found.weight >= 0).all()


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("vrs", [True, False])
@pytest.mark.parametrize("level", [0.0, 0.5])
def test_flat_textures(formulation, vrs, level):
    """One bin, or none, is left: nothing to spread a quadrature over."""
    flat = Spectrum.from_texture(np.full((512, 512), level))
    c = Condition(
        Display(ppd=50.0, refresh_rate=144.0, luminance=150.0),
        Viewing(10.0),
        Shading(rate_x=0.5),
        Components(vrs=vrs),
        Parameters(ws=-1.0, wt=-1.0, beta=0.36),
    )
    found = moments(flat, c, formulation=formulation)
    got = np.concatenate(found.distortion(at(0.36)))
    exact = distortion(
        flat,
        c.display,
        c.viewing,
        c.shading,
        c.parameters,
        formulation=formulation,
        components=c.components,
    )
    expected = np.array([exact.spatial, exact.temporal])
    assert np.isfinite(got).all()
    # Beside 1e5 times the energy in a texture with detail.
    np.testing.assert_allclose(got, expected, rtol=1e-4, atol=1e-6)
