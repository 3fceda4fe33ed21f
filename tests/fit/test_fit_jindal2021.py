"""The published calibration, from the authors' data."""

import functools
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares

from camojab import distortion, fit, Formulation, Parameters, Spectrum
from camojab._shipped import shipped
from camojab.fit import _least_squares as module


FILES = [
    "jindal2021/Experiment_Data/vrs_exp_data_jnd.mat",
    "jindal2021/Experiment_Data/vrs_exp_stimulus.mat",
    "jindal2021/Experiment_Data/external_data/marrr_exp1_jnds.mat",
    "jindal2021/Experiment_Data/external_data/marrr_exp1_confidence75.mat",
    "jindal2021/Experiment_Data/external_data/marrr_exp3_jnds.mat",
]
# Table 5 of Jindal et al. 2021 prints .74 .57 .53 .38 .03 and, in Section 4.4, 0.53;
# a third digit from their program's constants (CaMoJAB/camojab_fits.mat).
RMSE = {
    "Block-PC": 0.740,
    "Block-Mobile": 0.570,
    "Block-VR": 0.534,
    "MARRR Exp. 1": 0.384,
    "MARRR Exp. 3": 0.036,
}
# camojab_fits.mat has ws, wt, beta, a1, a2, a3; here ws a1, wt a1, beta, a2/a1, a3.
CONSTANTS = {"ws": -2.459092, "wt": -1.932688, "beta": 0.359664}
SCALES = {"denes2020_exp1": 2.193292, "denes2020_exp3": 1.191247}


pytestmark = pytest.mark.float64  # the fit is to be run in double precision


@functools.cache
def observations():
    return fit.jindal2021()


@functools.cache
def problem():
    """Spectra are pooled once; the fit itself takes milliseconds after that."""
    formulation = Formulation.RELEASED
    return module._problem(
        observations(), formulation, Parameters.published(), lambda done, total: None
    )


@functools.cache
def published_fit():
    return fit.fit(observations())


def coarser(found, factor):
    """The same moments with fewer cells, neighbours joined."""
    log = found.log.reshape(*found.log.shape[:2], -1, factor)
    weight = found.weight.reshape(log.shape)
    total = weight.sum(-1)
    mean = (weight * log).sum(-1) / jnp.where(total > 0, total, 1)
    return fit.Moments(mean, total)


@pytest.fixture
def pooled(real_data, monkeypatch):
    real_data(*FILES)
    found, names = problem()
    monkeypatch.setattr(module, "_problem", lambda *given: (found, names))
    return found, names


@pytest.fixture
def quick(pooled, monkeypatch):
    """An eighth of the cells: sixteenths of the time, and 1e-4 of a JND at most."""
    found, names = pooled
    fewer = module._Problem(
        coarser(found.moments, 8),
        found.measured,
        found.reference,
        found.data_set,
        found.temporal_only,
    )
    monkeypatch.setattr(module, "_problem", lambda *given: (fewer, names))
    return fewer


def test_the_published_fit(pooled):
    found = published_fit()
    assert found.verdict == ""
    assert {k: round(v, 3) for k, v in found.rmse.items()} == RMSE
    np.testing.assert_allclose(found.total_rmse, 0.533279, atol=5e-7)
    for name, value in CONSTANTS.items():
        np.testing.assert_allclose(getattr(found.parameters, name), value, rtol=1e-5)
    assert list(found.scales) == list(SCALES)
    for name, value in SCALES.items():
        np.testing.assert_allclose(found.scales[name], value, rtol=1e-5)
    published = Parameters.published()
    assert (found.parameters.ca, found.parameters.cb) == (published.ca, published.cb)
    # The products that can be known are the authors' own.
    ratio = float(found.parameters.ws / found.parameters.wt)
    np.testing.assert_allclose(ratio, published.ws / published.wt, rtol=1e-5)

    table = observations().table
    errors = found.predicted - table["quality_jnd"].to_numpy()
    np.testing.assert_allclose(np.sqrt(np.mean(errors**2)), found.total_rmse)
    anchors = table["reference"].to_numpy() == np.arange(len(table))
    assert anchors.sum() == 36 + 3 + 1
    np.testing.assert_array_equal(found.predicted[anchors], 0)


def test_the_prediction_is_the_models(pooled):
    """The moments are left out: spectra of two textures, at the fitted constants."""
    found = published_fit()
    table = observations().table
    for data_set, texture in (("jindal2021", "grass"), ("denes2020_exp1", None)):
        rows = table[table["data_set"] == data_set]
        rows = rows[rows["texture"] == (texture or "marrr_checkerboard")]
        c = module._condition(rows, found.parameters)
        spectrum = Spectrum.from_texture(
            observations().textures[rows["texture"].iloc[0]]
        )
        parts = distortion(spectrum, c.display, c.viewing, c.shading, found.parameters)
        quality = np.asarray(
            found.parameters.ws * parts.spatial + found.parameters.wt * parts.temporal
        )
        own = {index: i for i, index in enumerate(rows.index)}
        anchor = [own[r] for r in rows["reference"]]
        scale = found.scales.get(data_set, 1.0)
        np.testing.assert_allclose(
            found.predicted[rows.index], scale * (quality - quality[anchor]), atol=1e-5
        )


# ws, wt and beta of a start, within a factor of 30 of the solution.
STARTS = [
    (-1.4538, -2.6915, 0.348),  # that of the authors' program
    (-1.0, -1.0, 1.0),
    (-0.1, -10.0, 0.2),
    (-30.0, -0.1, 0.5),
    (-10.0, -10.0, 0.25),
    (-0.1, -0.1, 0.8),
    (-1.0, -30.0, 0.6),
    (-100.0, -60.0, 0.1),
]


@pytest.mark.parametrize("ws, wt, beta", STARTS)
def test_every_sensible_start_ends_there(quick, ws, wt, beta):
    found = fit.fit(observations(), start=Parameters(ws=ws, wt=wt, beta=beta))
    assert found.verdict == ""
    np.testing.assert_allclose(found.total_rmse, 0.533279, atol=2e-6)
    np.testing.assert_allclose(found.parameters.beta, 0.359664, rtol=1e-4)


def test_an_independent_solver_finds_nothing_better(quick):
    residuals = jax.jit(lambda theta: quick.predict(theta) - quick.measured)
    theta = jnp.log(jnp.array([2.459092, 1.932688, 0.359664, 2.193292, 1.191247]))
    found = least_squares(residuals, theta, jax.jit(jax.jacfwd(residuals)))
    start, end = (np.sqrt(np.mean(residuals(x) ** 2)) for x in (theta, found.x))
    np.testing.assert_allclose(end, 0.533279, atol=2e-6)
    assert start - end < 1e-8


def test_steps_that_run_out_are_said(quick):
    start = Parameters(ws=-0.1, wt=-10.0, beta=0.2)
    found = fit.fit(observations(), start=start, max_steps=2)
    assert found.steps == 2 and "maximum number of" in found.verdict
    assert np.isfinite(found.total_rmse)


# ---- the constants of the paper's formulation


def test_the_papers_constants_are_the_optimum(real_data):
    """At a minimum of the sum of squares no direction of the constants lowers it."""
    real_data(*FILES)
    shipped_file = shipped("parameters_paper.json")
    stored = json.loads(shipped_file.read_text())
    table = observations().table
    parts, slopes = paper_distortions(table)
    p, scales = stored["parameters"], stored["scales"]
    spatial_only = ~table["temporal_only"].to_numpy()
    scale = table["data_set"].map({"jindal2021": 1.0} | scales).to_numpy()
    reference = table["reference"].to_numpy()

    def relative(spatial, temporal):
        whole = np.where(
            spatial_only, p["ws"] * spatial + p["wt"] * temporal, -temporal
        )
        return scale * (whole - whole[reference])

    zero = np.zeros(len(table))
    predicted = relative(*parts)
    errors = predicted - table["quality_jnd"].to_numpy()
    for block, rmse in stored["rmse_jnd"].items():
        chosen = errors if block == "all" else errors[table["block"] == block]
        np.testing.assert_allclose(np.sqrt(np.mean(chosen**2)), rmse, rtol=1e-5)

    # Judder alone has no ws, wt: its scale takes their place.
    both = lambda column: np.where(spatial_only, column, 0.0)
    columns = [
        both(relative(parts[0], zero)),
        both(relative(zero, parts[1])),
        relative(*slopes),
        *(np.where(table["data_set"] == name, predicted, 0.0) for name in scales),
    ]
    for column in columns:
        cosine = errors @ column / np.linalg.norm(errors) / np.linalg.norm(column)
        assert abs(cosine) < 1e-5


def paper_distortions(table):
    """Spatial and temporal distortion of every row, and their slopes in beta."""
    formulation = Formulation.PAPER
    published = Parameters.published(formulation)
    parts, slopes = np.zeros((2, len(table))), np.zeros((2, len(table)))
    for name, rows in table.groupby("texture"):
        spectrum = Spectrum.from_texture(observations().textures[name])
        c = module._condition(rows, published)

        def at(beta, spectrum=spectrum, c=c):
            constants = Parameters(ws=-1.0, wt=-1.0, beta=beta)
            found = distortion(
                spectrum,
                c.display,
                c.viewing,
                c.shading,
                constants,
                formulation=formulation,
            )
            return jnp.stack([found.spatial, found.temporal])

        value, slope = jax.jvp(at, (published.beta,), (jnp.ones(()),))
        parts[:, rows.index], slopes[:, rows.index] = value, slope
    return parts, slopes
