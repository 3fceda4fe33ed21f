"""The fit on data made up from known constants, and what it refuses."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

from camojab import (
    Components,
    Display,
    distortion,
    fit,
    Formulation,
    Parameters,
    Shading,
    Spectrum,
    Viewing,
)
from camojab.fit._constants import constants
from camojab.fit._problem import problem


FORMULATIONS = list(Formulation)
TRUTH = {
    Formulation.RELEASED: {"ws": -3.0, "wt": -2.0, "beta": 0.4},
    Formulation.PAPER: {"ws": -2e-3, "wt": -5e-3, "beta": 0.5},
}
SCALES = {"other": 2.5, "judder": 0.6}


@functools.cache
def textures():
    noise = np.random.default_rng(1).random((512, 512))
    ramp = np.linspace(0.1, 0.9, 512)[None, :] * np.ones((512, 1))
    return {"noise": noise, "smooth": 0.02 * noise + ramp}


def row(**columns):
    plain = {
        "texture": "noise",
        "mean_luminance_cd_m2": 100.0,
        "refresh_rate_hz": 60.0,
        "velocity_deg_s": 10.0,
        "persistence": 1.0,
        "ppd": 50.0,
        "rate_x": 1.0,
        "rate_y": 1.0,
        "mip_level": 1,
        "data_set": "rates",
        "block": "A",
        "temporal_only": False,
    }
    return plain | columns


def conditions():
    """Three data sets: shading rates, refresh rates, and judder alone.

    Textures alternate, so that rows do not lie in the order of their textures.
    """
    rows = []
    for velocity in (0.0, 40.0):
        for rate in (1.0, 0.5, 0.25):
            for texture in ("noise", "smooth"):
                rows.append(
                    row(
                        texture=texture,
                        velocity_deg_s=velocity,
                        rate_x=rate,
                        block="A" if velocity < 30 else "B",
                    )
                )
    first = {
        (r["velocity_deg_s"], r["texture"]): i for i, r in reversed([*enumerate(rows)])
    }
    reference = [first[r["velocity_deg_s"], r["texture"]] for r in rows]
    for data_set, alone in (("other", False), ("judder", True)):
        start = len(rows)
        for refresh_rate in (50.0, 70.0, 90.0):
            rows.append(
                row(
                    refresh_rate_hz=refresh_rate,
                    velocity_deg_s=25.0,
                    data_set=data_set,
                    block=data_set,
                    temporal_only=alone,
                )
            )
            reference.append(start)
    return pd.DataFrame(rows).assign(reference=reference)


@functools.cache
def parts(formulation):
    """Distortions of every row from the model itself, at the true exponent."""
    table = conditions()
    found = np.zeros((2, len(table)))
    for name, rows in table.groupby("texture"):
        column = lambda key, rows=rows: rows[key].to_numpy(float)
        both = distortion(
            Spectrum.from_texture(textures()[name]),
            Display(
                ppd=column("ppd"),
                refresh_rate=column("refresh_rate_hz"),
                luminance=column("mean_luminance_cd_m2"),
                persistence=column("persistence"),
            ),
            Viewing(column("velocity_deg_s")),
            Shading(
                rate_x=column("rate_x"),
                rate_y=column("rate_y"),
                mip_level=column("mip_level"),
            ),
            Parameters(**TRUTH[formulation]),
            formulation=formulation,
        )
        found[:, rows.index] = both.spatial, both.temporal
    return found


def observations(formulation=Formulation.RELEASED):
    table = conditions()
    truth = TRUTH[formulation]
    spatial, temporal = parts(formulation)
    whole = truth["ws"] * spatial + truth["wt"] * temporal
    whole = np.where(table["temporal_only"], -temporal, whole)
    whole = whole * table["data_set"].map({"rates": 1.0} | SCALES).to_numpy()
    table["quality_jnd"] = whole - whole[table["reference"]]
    return fit.Observations(table, textures())


@pytest.mark.float64  # the fit is to be run in double precision
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_known_constants_are_found_again(formulation):
    truth = TRUTH[formulation]
    start = Parameters(ws=3 * truth["ws"], wt=truth["wt"] / 3, beta=0.6)
    seen = []
    found = fit.fit(
        observations(formulation),
        formulation=formulation,
        start=start,
        progress=lambda done, total: seen.append((done, total)),
    )
    assert found.converged and found.steps > 2
    # Limited by the quadratures, 1e-8 of the texture's energy.
    for name, value in truth.items():
        np.testing.assert_allclose(getattr(found.parameters, name), value, rtol=1e-6)
    for name, value in SCALES.items():
        np.testing.assert_allclose(found.scales[name], value, rtol=1e-6)
    assert found.total_rmse < 1e-6
    assert list(found.rmse) == ["A", "B", "other", "judder"]
    assert seen == [(0, 2), (1, 2), (2, 2)]


@pytest.mark.float64  # the fit is to be run in double precision
def test_rmse_is_that_of_each_block():
    given = observations()
    noise = np.random.default_rng(0).normal(0, 0.3, len(given.table))
    given.table["quality_jnd"] += noise
    found = fit.fit(given)
    errors = found.predicted - given.table["quality_jnd"].to_numpy()
    for block, rmse in found.rmse.items():
        chosen = errors[given.table["block"] == block]
        np.testing.assert_allclose(rmse, np.sqrt(np.mean(chosen**2)), rtol=1e-12)
    np.testing.assert_allclose(found.total_rmse, np.sqrt(np.mean(errors**2)))
    # The noise is not smaller than what five constants can take away.
    assert found.total_rmse > 0.1


@pytest.mark.float64  # the fit is to be run in double precision
def test_labels_of_the_rows_do_not_matter():
    """`reference` is the number of a row, whatever the index of the table says."""
    given = observations()
    renamed = given.table.set_index(np.arange(len(given.table))[::-1] + 100)
    plain = fit.fit(given)
    other = fit.fit(fit.Observations(renamed, given.textures))
    np.testing.assert_array_equal(other.predicted, plain.predicted)


@pytest.mark.float64  # central differences
def test_derivatives_of_the_residuals():
    free = ("ws", "wt", "beta", "scales")
    chosen = constants(free, ["rates", "other", "judder"], Parameters.published())
    posed = problem(
        observations(), chosen, Formulation.RELEASED, Components(), lambda *n: None
    )
    point = jnp.log(jnp.array([3.0, 2.0, 0.4, 2.5, 0.6]))
    step = jnp.array([0.3, -0.2, 0.1, 0.4, -0.5])
    residuals = jax.jit(lambda point: posed.residuals(point))
    _, slope = jax.jvp(residuals, (point,), (step,))
    h = 1e-5
    differences = (residuals(point + h * step) - residuals(point - h * step)) / (2 * h)
    np.testing.assert_allclose(slope, differences, atol=1e-7)
    # And so are those of what the residuals are made of, whose size tells how well
    # the constants are known.
    judged, _, root = jax.jit(lambda point: posed.slope(point))(point)
    assert judged.shape == (18,) and root.shape == (18, 5)
    anchors = np.asarray(posed.target.weight) == 0
    np.testing.assert_allclose((root @ step)[~anchors], slope[~anchors], rtol=1e-9)


# ---- what cannot be fitted


@pytest.mark.parametrize("name", ["ws", "wt"])
@pytest.mark.parametrize("value", [1.5, 0.0])
def test_weights_must_start_negative(name, value):
    start = Parameters(**{"ws": -1.0, "wt": -1.0, "beta": 0.4, name: value})
    message = rf"`start.{name}` must be negative to be fitted, got {value:g}"
    with pytest.raises(ValueError, match=message):
        fit.fit(fit.Observations(conditions(), textures()), start=start)


def test_more_values_than_constants_are_needed():
    table = conditions()
    few = table[table["data_set"] == "rates"].iloc[[0, 2, 4]]
    few = few.assign(quality_jnd=[0.0, -1.0, -2.0], reference=0)
    message = r"more values than the 3 constants to fit, got 2\."
    with pytest.raises(ValueError, match=message):
        fit.fit(fit.Observations(few, textures()))
