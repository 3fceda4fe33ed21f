"""Tables as a rung of the model: values, its own error estimate, and the choice."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr import RATES
from alsarr.tables import (
    Conditions,
    distil,
    Form,
    Grid,
    load_tables,
    Polynomial,
    sample,
    save_tables,
    Scene,
    TensorPolynomial,
)
from camojab import (
    Auto,
    Display,
    distortion,
    error_estimate,
    Pooled,
    quality,
    Shading,
    Spectrum,
    Viewing,
)


PPD = 45.0
GRID = Grid(
    velocity=(5.0, 15.0, 25.0, 35.0),
    refresh_rate=(60.0, 80.0, 100.0, 120.0),
    log10_luminance=(1.0, 1.5, 2.0, 2.5),
)


@pytest.fixture(scope="module")
def spectrum():
    return Spectrum.from_texture(np.random.default_rng(0).random((512, 512)))


@pytest.fixture(scope="module")
def samples(spectrum):
    """Of two textures, of which the second does not occur."""
    return sample(
        {"noise": spectrum, "absent": spectrum},
        Scene(2, ((0, 0.0), (0, 2.0)), GRID.domain),
        ppd=PPD,
        grid=GRID,
    )


@pytest.fixture(scope="module")
def tables(samples):
    return distil(samples, relative_to=None)


def conditions(n=30, seed=0, **fixed):
    random = np.random.default_rng(seed)
    drawn = {
        "refresh_rate": random.uniform(60, 120, n),
        "luminance": 10 ** random.uniform(1, 2.5, n),
        "ppd": PPD,
    }
    shading = Shading(
        rate_x=RATES.resolution[:, :1], rate_y=RATES.resolution[:, 1:], mip_level=2.0
    )
    return Display(**drawn | fixed), Viewing(random.uniform(5, 35, n)), shading


def test_it_is_what_the_table_holds(spectrum, tables):
    args = conditions()
    ours = quality(spectrum, *args, fidelity=Polynomial(tables, "noise"))
    assert ours.shape == (7, 30)
    # The table knows its largest error, beside what the pooled samples are off.
    sampled = Display(ppd=PPD, refresh_rate=80.0, luminance=100.0), Viewing(15.0)
    at = Shading(rate_x=0.5, rate_y=0.25)
    error = quality(spectrum, *sampled, at, fidelity=Polynomial(tables, "noise"))
    error -= quality(spectrum, *sampled, at)
    assert 0 < abs(float(error)) <= float(tables.largest_error) + 0.01


@pytest.mark.parametrize("directions", ["separate", "shared"])
def test_it_is_any_form_of_a_table(spectrum, samples, directions):
    form = Form(TensorPolynomial((2, 2, 1), 0.5 / PPD), directions)
    of = distil(samples, form, relative_to=None)
    display, viewing, shading = conditions()
    got = quality(spectrum, display, viewing, shading, fidelity=Polynomial(of, "noise"))
    rate = RATES.names.index("2x4")
    at = [x.astype(of.dtype) for x in (viewing.velocity, jnp.log10(display.luminance))]
    expected = form.basis.evaluate(
        of.coefficients[1, rate, 0][None],
        Conditions(at[0], display.refresh_rate.astype(of.dtype), at[1]),
        of.domain,
    )
    np.testing.assert_allclose(got[rate], expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(
    "fixed", [{}, {"ppd": 90.0}, {"persistence": 0.1}, {"luminance": 0.1}]
)
def test_the_estimate_is_that_of_the_conditions_asked_for(spectrum, tables, fixed):
    args = conditions(**fixed)
    rung = Polynomial(tables, "noise")
    exact = quality(spectrum, *args)
    error = float(jnp.abs(quality(spectrum, *args, fidelity=rung) - exact).max())
    estimate = error_estimate(spectrum, *args, fidelity=rung)
    assert 0.5 * error <= estimate <= 2 * error + 0.01
    if fixed:
        # What the table does not know of makes it wrong, and it says so.
        assert estimate > 2 * error_estimate(spectrum, *conditions(), fidelity=rung)


def test_auto_takes_the_table_where_it_is_accurate_enough(spectrum, tables):
    args = conditions(60)
    rung = Polynomial(tables, "noise")
    estimate = error_estimate(spectrum, *args, fidelity=rung)
    rungs = (rung, Pooled(2000))
    taken = quality(spectrum, *args, fidelity=Auto(1.01 * estimate, rungs))
    np.testing.assert_array_equal(taken, quality(spectrum, *args, fidelity=rung))
    tighter = Auto(0.5 * estimate, rungs)
    taken = quality(spectrum, *args, fidelity=tighter)
    np.testing.assert_array_equal(
        taken, quality(spectrum, *args, fidelity=Pooled(2000))
    )


def test_slopes_are_those_of_the_polynomial(spectrum, tables):
    def of(x):
        display = Display(ppd=PPD, refresh_rate=x[1], luminance=x[2])
        rung = Polynomial(tables, "noise")
        return quality(spectrum, display, Viewing(x[0]), fidelity=rung)

    x = jnp.array([20.0, 90.0, 100.0])
    slope = jax.grad(of)(x)
    np.testing.assert_allclose(slope, jax.jacfwd(of)(x), rtol=1e-5)
    step = 1e-2 * x
    differences = [
        (of(x.at[i].add(step[i])) - of(x.at[i].add(-step[i]))) / (2 * step[i])
        for i in range(3)
    ]
    np.testing.assert_allclose(slope, jnp.stack(differences), rtol=2e-3)


def test_what_they_are_relative_to_is_kept(tables, tmp_path):
    save_tables(tmp_path / "tables.json", tables)
    assert load_tables(tmp_path / "tables.json").relative_to is None


def test_errors(spectrum, samples, tables):
    with pytest.raises(ValueError, match="must be one of noise, absent, got 'grass'"):
        Polynomial(tables, "grass")
    with pytest.raises(ValueError, match="tables have polynomials of, got 'absent'"):
        Polynomial(tables, "absent")
    relative = distil(samples)
    with pytest.raises(ValueError, match="relative to no rate, got .* 4x4"):
        Polynomial(relative, "noise")
    few = dataclasses.replace(
        samples, rates=("4x4", "1x1"), quality=samples.quality[:, [0, 6]]
    )
    with pytest.raises(ValueError, match="`tables` must have the rates 4x4.*4x4, 1x1"):
        Polynomial(distil(few, relative_to=None), "noise")
    display, viewing, _ = conditions()
    rung = Polynomial(tables, "noise")
    with pytest.raises(ValueError, match="`shading` must be at one of the rates 4x4"):
        quality(spectrum, display, viewing, Shading(rate_x=0.3), fidelity=rung)
    with pytest.raises(ValueError, match="tables hold quality alone, got Polynomial"):
        distortion(spectrum, display, viewing, fidelity=rung)
