"""The whole chain as a function of its constants: the model's values, exact slopes."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

from camojab import Components, distortion, fit, Formulation, Parameters, Spectrum
from camojab._parameters import UNITS
from camojab.fit._chain import Chain
from camojab.fit._constants import constants
from camojab.fit._problem import conditions, problem


X64 = jax.config.jax_enable_x64
FORMULATIONS = list(Formulation)
NAMES = tuple(name for name in UNITS if name not in ("ws", "wt"))
# None of them where it usually is.
POINT = {
    "beta": 0.42,
    "ca": 0.002,
    "cb": 0.06,
    "mipmap_width": 1.2,
    "hold_width": 0.8,
    "pursuit_width": 1.1,
    "achromatic_gain": 1.3,
    "red_green_gain": 0.7,
    "yellow_violet_gain": 1.6,
    "velocity_gain": 0.9,
}


def table():
    """Two pools of one texture, in turns, and no condition twice."""
    return pd.DataFrame(
        {
            "texture": "noise",
            "mean_luminance_cd_m2": [100.0, 5.0, 100.0, 700.0],
            "refresh_rate_hz": [60.0, 120.0, 30.0, 60.0],
            "velocity_deg_s": [10.0, 25.0, 25.0, 40.0],
            "persistence": [1.0, 0.5, 1.0, 0.8],
            "ppd": [50.0, 50.0, 26.0, 90.0],
            "rate_x": [0.5, 1.0, 0.5, 1.0],
            "rate_y": [0.5, 1.0, 0.5, 1.0],
            "mip_level": [1.0, 0.5, 1.0, 0.5],
            "data_set": "rates",
            "block": "A",
            "temporal_only": False,
            "reference": 0,
            "quality_jnd": [0.0, -1.0, -2.0, -3.0],
        }
    )


def texture():
    noise = np.random.default_rng(3).random((512, 512))
    return 0.5 * noise + np.linspace(0, 0.5, 512)[None, :] ** 2


@functools.cache
def chain(formulation):
    given = fit.Observations(table(), {"noise": texture()})
    chosen = constants(NAMES, ["rates"], Parameters(ws=-1.0, wt=-1.0, **POINT))
    steps = []
    posed = problem(
        given, chosen, formulation, Components(), lambda *step: steps.append(step)
    )
    assert steps == [(0, 1), (1, 1)]
    assert isinstance(posed.energies, Chain) and posed.energies.free == NAMES
    return posed.energies


@functools.cache
def compiled(formulation):
    made = chain(formulation)
    usual = Parameters(ws=-1.0, wt=-1.0, **POINT)
    where = lambda p: [getattr(p, name) for name in NAMES]

    def both(values):
        parameters = eqx.tree_at(where, usual, list(values))
        return jnp.stack(made.distortion(parameters))

    return jax.jit(both), jax.jit(jax.jacfwd(both)), jax.jit(jax.jacrev(both))


def values(**changes):
    return jnp.asarray([*(POINT | changes).values()], float)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_values_are_the_models(formulation):
    found = compiled(formulation)[0](values())
    exact = distortion(
        Spectrum.from_texture(texture()),
        *conditions(table()),
        Parameters(ws=-1.0, wt=-1.0, **POINT),
        formulation=formulation,
    )
    expected = np.stack([exact.spatial, exact.temporal])
    np.testing.assert_allclose(found, expected, rtol=1e-12 if X64 else 1e-4)
    # Four conditions of two pools.
    assert len(set(expected[0])) == 4
    assert len(chain(formulation).texture) == 2
    assert chain(formulation).pool.tolist() == [0, 1, 0, 1]


@pytest.mark.float64  # central differences
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_slopes_are_the_differences(formulation):
    value, forward, backward = compiled(formulation)
    found = np.asarray(forward(values()))
    np.testing.assert_allclose(backward(values()), found, rtol=1e-9, atol=1e-12)
    for i, name in enumerate(NAMES):
        # Small enough for the curvature, large enough for the rounding.
        h = 1e-5 * POINT[name]
        up, down = (value(values(**{name: POINT[name] + s})) for s in (h, -h))
        differences = np.asarray(up - down) / (2 * h)
        # Rounding of an energy, of which a distortion is a difference, over the step.
        rounding = 1e-14 * np.abs(value(values())).max() / h
        np.testing.assert_allclose(
            found[..., i], differences, rtol=1e-6, atol=rounding, err_msg=name
        )
    # Every constant has an effect on something.
    assert (np.abs(found).max(axis=(0, 1)) > 0).all()


@pytest.mark.float64  # a fit is to be run in double precision
def test_constants_of_the_eye_are_found_again():
    truth = dict(ws=-3.0, wt=-2.0, beta=0.4, cb=0.1)
    rows = pd.concat([table()] * 3, ignore_index=True)
    rows["velocity_deg_s"] = np.linspace(2.0, 60.0, 12)
    exact = distortion(
        Spectrum.from_texture(texture()), *conditions(rows), Parameters(**truth)
    )
    quality = truth["ws"] * exact.spatial + truth["wt"] * exact.temporal
    rows["quality_jnd"] = np.asarray(quality - quality[0])
    given = fit.Observations(rows, {"noise": texture()})
    start = Parameters(ws=-1.0, wt=-1.0, beta=0.36)
    found = fit.fit(given, free=tuple(truth), start=start)
    assert found.converged
    np.testing.assert_allclose(found.values, [*truth.values()], rtol=1e-5)

    with pytest.raises(ValueError, match="got ca, cb, pursuit_width, of which only 2"):
        fit.fit(given, free=("wt", "ca", "cb", "pursuit_width"), start=start)
