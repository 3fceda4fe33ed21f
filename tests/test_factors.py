"""The factors on widths and sensitivities do what their names say; 1 is the paper."""

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
from camojab._csf import log_sensitivity
from camojab._display import LowPass
from camojab._parameters import FACTORS


X64 = jax.config.jax_enable_x64
RTOL = 1e-11 if X64 else 2e-4
EPSILON = float(jnp.finfo(float).eps)
FORMULATIONS = list(Formulation)
BETA = 0.36
CONDITION = {
    "ppd": 50.0,
    "luminance": 80.0,
    "refresh_rate": 60.0,
    "persistence": 0.9,
    "velocity": 20.0,
    "rate_x": 0.5,
    "rate_y": 0.25,
    "mip_level": 1.0,
}


@functools.cache
def texture():
    noise = np.random.default_rng(3).random((512, 512))
    return 0.5 * noise + np.linspace(0, 0.5, 512)[None, :] ** 2


@functools.cache
def spectrum():
    return Spectrum.from_texture(texture())


def parts(formulation, condition=CONDITION, components=None, **constants):
    c = dict(condition)
    found = distortion(
        spectrum(),
        Display(**{name: c.pop(name) for name in Display.UNITS}),
        Viewing(c.pop("velocity")),
        Shading(**c),
        Parameters(**{"ws": -1.0, "wt": -1.0, "beta": BETA} | constants),
        formulation=formulation,
        components=components,
    )
    return np.array([found.spatial, found.temporal], np.float64)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_one_is_the_paper(formulation):
    ones = dict.fromkeys(FACTORS, 1.0)
    np.testing.assert_array_equal(parts(formulation, **ones), parts(formulation))


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_twice_the_mipmap_is_one_level_more(formulation):
    found = parts(formulation, mipmap_width=2.0)
    expected = parts(formulation, CONDITION | {"mip_level": 2.0})
    np.testing.assert_allclose(found, expected, rtol=RTOL)
    assert not np.allclose(found, parts(formulation), rtol=0.01)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_twice_the_hold_is_half_the_refresh_rate(formulation):
    """As far as the blur goes: the judder depends on the refresh rate by itself."""
    found, usual = parts(formulation, hold_width=2.0), parts(formulation)
    expected = parts(formulation, CONDITION | {"refresh_rate": 30.0})
    np.testing.assert_allclose(found[0], expected[0], rtol=RTOL)
    np.testing.assert_allclose(found[1], usual[1], rtol=RTOL)
    assert abs(found[0] / usual[0] - 1) > 0.001


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_twice_the_pursuit_is_twice_both_its_constants(formulation):
    found = parts(formulation, ca=0.002, cb=0.07, pursuit_width=2.0)
    expected = parts(formulation, ca=0.004, cb=0.14)
    np.testing.assert_allclose(found, expected, rtol=RTOL)
    assert abs(found[0] / parts(formulation, ca=0.002, cb=0.07)[0] - 1) > 0.001


@pytest.mark.parametrize("gain", [0.3, 2.5])
@pytest.mark.parametrize("f", [0.0, 60.0])
def test_the_three_gains_are_one_factor_on_the_sensitivity(f, gain):
    rho = jnp.asarray(np.geomspace(0.05, 50, 9), float)
    f, level = jnp.full_like(rho, f), jnp.full_like(rho, 80.0)
    log = float(np.log(gain))
    found = log_sensitivity(rho, f, level, (log, log, log, 0.0))
    plain = log_sensitivity(rho, f, level)
    np.testing.assert_allclose(found, plain + log, rtol=RTOL, atol=RTOL)
    # Each one alone lies between none and all of it, and together they are more.
    zero = jnp.zeros(())
    for i in range(3):
        gains = tuple(log if k == i else zero for k in range(4))
        change = np.asarray(log_sensitivity(rho, f, level, gains) - plain) / log
        assert (change > -RTOL).all() and (change < 1 + RTOL).all()
        assert change.max() > 0.01


@pytest.mark.parametrize("f, expected", [(0.0, 0.0), (60.0, 0.7)])
def test_the_gain_of_velocity_is_of_what_flickers(f, expected):
    rho = jnp.asarray(np.geomspace(0.05, 50, 9), float)
    f, level = jnp.full_like(rho, f), jnp.full_like(rho, 80.0)
    found = log_sensitivity(rho, f, level, (0.0, 0.0, 0.0, 0.7))
    np.testing.assert_allclose(
        found - log_sensitivity(rho, f, level), expected, rtol=RTOL, atol=RTOL
    )


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_gains_are_powers_of_the_energies(formulation):
    gains = dict.fromkeys([n for n in FACTORS if n.endswith("_gain")][:3], 1.7)
    usual = parts(formulation)
    np.testing.assert_allclose(
        parts(formulation, **gains)[0], 1.7**BETA * usual[0], rtol=RTOL
    )
    found = parts(formulation, velocity_gain=1.7)
    np.testing.assert_allclose(found[0], usual[0], rtol=RTOL)
    # In the released program the bin at frequency 0 has a sensitivity of its own.
    rtol = RTOL if formulation is Formulation.PAPER else 1e-3
    np.testing.assert_allclose(found[1], 1.7**BETA * usual[1], rtol=rtol)


# ---- other low-passes

TRANSFER = {
    LowPass.LORENTZIAN: lambda x: 1.0 / (1.0 + (4.0 / np.pi * x) ** 2),
    # Its zeros are raised, or their logarithms would be infinite.
    LowPass.SINC: lambda x: np.maximum(np.abs(np.sinc(x)), EPSILON),
    LowPass.GAUSSIAN: lambda x: np.exp(-((np.pi * x) ** 2) / 6.0),
}


@pytest.mark.parametrize("low_pass", list(LowPass))
def test_low_passes_are_those_of_the_transcription(low_pass, monkeypatch):
    transfer = TRANSFER[low_pass]
    monkeypatch.setattr(reference, "lorentzian", lambda rho, b: transfer(rho * b))
    expected = reference.distortion(
        reference.amplitude(texture()), beta=BETA, **CONDITION
    )
    found = parts(Formulation.RELEASED, components=Components(low_pass=low_pass))
    # Near the zeros of the sinc there is only what rounding leaves.
    np.testing.assert_allclose(found, expected, rtol=1e-9 if X64 else 2e-3)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_low_passes_differ_and_have_slopes(formulation):
    def spatial(width, low_pass):
        found = distortion(
            spectrum(),
            Display(ppd=50.0, refresh_rate=60.0, luminance=80.0),
            Viewing(20.0),
            Shading(rate_x=0.5, mip_level=1.0),
            Parameters(ws=-1.0, wt=-1.0, beta=BETA, mipmap_width=width),
            formulation=formulation,
            components=Components(low_pass=low_pass),
        )
        return found.spatial

    value = jax.value_and_grad(spatial)
    found = [value(jnp.asarray(1.0, float), low_pass) for low_pass in LowPass]
    assert np.isfinite(found).all()
    assert len({round(float(v), 6) for v, _ in found}) == 3
    # A wider blur takes more away, whatever its shape.
    assert all(slope > 0 for _, slope in found)
