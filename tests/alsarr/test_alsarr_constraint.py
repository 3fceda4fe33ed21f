"""Tables that keep the order of the rates, from samples to a file and back."""

import jax
import numpy as np
import pytest

from alsarr.tables import (
    Conditions,
    Constraint,
    distil,
    Domain,
    Eq31,
    Eq31LogTravel,
    Form,
    Grid,
    load_tables,
    sample,
    save_tables,
    Scene,
    TensorPolynomial,
)
from alsarr.tables._distil import _DENSE
from alsarr.tables._rate_order import rate_order, SIDES
from camojab import Pooled, Spectrum


DOMAIN = Domain(velocity=(0.0, 40.0))
TENSOR = TensorPolynomial((3, 1, 2), 0.01)
FORMS = {
    "eq31": Form(Eq31()),
    "travel": Form(Eq31LogTravel(), "shared"),
    "tensor": Form(TENSOR),
}


def sampled(**more):
    random = np.random.default_rng(0)
    noise = Spectrum.from_texture(random.random((512, 512)))
    scene = Scene.every(1, (0, 2), DOMAIN)
    grid = Grid.over(DOMAIN, (9, 5, 5))
    return sample(
        {"noise": noise}, scene, ppd=50.0, grid=grid, fidelity=Pooled(1000), **more
    )


@pytest.fixture(scope="module")
def samples():
    return sampled()


def falls(tables, order):
    """By how much the better of two rates is worse, where the order is to be kept."""
    dense = Grid.over(tables.domain, _DENSE).conditions()
    at = Conditions(*(x[None, None] for x in dense))
    found = np.stack(
        [
            np.asarray(tables.basis.evaluate(c[:, :, None], at, tables.domain))
            for c in tables.coefficients
        ]
    )
    free = [i for i, r in enumerate(tables.rates) if r != tables.relative_to]
    found = np.concatenate([found[:, free], np.zeros_like(found[:, :1])], axis=1)
    return np.stack([found[:, worse] - found[:, better] for better, worse in order])


@pytest.mark.parametrize(
    "name, constraint",
    [("eq31", Constraint.GAIN), *((name, Constraint.MONOTONE) for name in FORMS)],
)
def test_the_order_is_kept_in_what_a_file_holds(samples, tmp_path, name, constraint):
    order = rate_order(constraint, samples.rates, "4x4").pairs
    free = distil(samples, FORMS[name])
    assert falls(free, order).max() > 0.05
    made = distil(samples, FORMS[name], constraint=constraint)
    save_tables(tmp_path / "tables.json", made)
    with jax.enable_x64(False):
        assert falls(load_tables(tmp_path / "tables.json"), order).max() <= 0
    # The model itself does not keep it, so it costs accuracy; but not all of it.
    quality = samples.quality - samples.quality[:, :1]
    most = 0.5 * float(np.abs(quality).max())
    assert float(free.largest_error) < float(made.largest_error) < most


def test_the_model_itself_falls(samples):
    """What the published shading rates gain is negative where judder is removed."""
    quality = samples.quality - samples.quality[:, :1]
    assert quality.min() < -0.5


def test_monotone_orders_more_than_gain(samples):
    monotone = rate_order(Constraint.MONOTONE, samples.rates, "4x4").pairs
    gain = distil(samples, FORMS["eq31"], constraint=Constraint.GAIN)
    assert falls(gain, monotone).max() > 0.01


def test_order_of_the_rates():
    names = ("2x4", "4x2", "2x2", "1x2", "2x1", "1x1")
    rates = ("4x4", *names)
    pairs = rate_order(Constraint.MONOTONE, rates, "4x4").pairs
    named = {(names[a], names[b] if b >= 0 else "4x4") for a, b in pairs}
    assert named == {
        *(("2x4", "4x4"), ("4x2", "4x4"), ("2x2", "2x4"), ("2x2", "4x2")),
        *(("1x2", "2x2"), ("2x1", "2x2"), ("1x1", "1x2"), ("1x1", "2x1")),
    }
    gain = rate_order(Constraint.GAIN, rates, "4x4").pairs
    assert gain == tuple((i, -1) for i in range(6))
    assert rate_order(Constraint.MONOTONE, SIDES, "4").pairs == ((0, -1), (1, 0))


def test_absolute_and_separable_tables_can_be_monotone(samples):
    made = distil(
        samples, FORMS["tensor"], relative_to=None, constraint=Constraint.MONOTONE
    )
    order = rate_order(Constraint.MONOTONE, samples.rates, None).pairs
    assert falls(made, order).max() <= 1e-5
    separable = distil(
        sampled(rates=SIDES), FORMS["eq31"], constraint=Constraint.MONOTONE
    )
    order = rate_order(Constraint.MONOTONE, SIDES, "4").pairs
    assert falls(separable, order).max() <= 0


def test_what_cannot_be_ordered(samples):
    with pytest.raises(ValueError, match="`constraint` must go with .* got 2x2"):
        distil(samples, relative_to="2x2", constraint=Constraint.MONOTONE)
    with pytest.raises(ValueError, match="`constraint` must be monotone .* got gain"):
        distil(samples, relative_to=None, constraint=Constraint.GAIN)
