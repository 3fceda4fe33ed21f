"""LPIPS against the package of its authors, on random weights."""

import importlib.util
import re
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr.metrics import (
    load_lpips_weights,
    lpips,
    lpips_distance,
    lpips_metric,
    LpipsWeights,
    pool_tiles,
    save_lpips_weights,
)


GOLDEN = Path(__file__).parents[1] / "golden"


def _maker():
    spec = importlib.util.spec_from_file_location("make", GOLDEN / "lpips_make.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def drawn():
    return _maker().drawn()


@pytest.fixture(scope="module")
def weights(drawn):
    return LpipsWeights.from_arrays(drawn[0])


@pytest.mark.parametrize("centred", [True, False])
def test_lpips_agrees_with_its_authors(drawn, weights, centred):
    _, reference, test = drawn
    kind = "centred" if centred else "not_centred"
    with np.load(GOLDEN / "lpips_alex.npz") as golden:
        expected, distance = golden[f"map_{kind}"], golden[f"distance_{kind}"]
    # The package holds its shift and scale in float32 in either precision.
    close = 1e-6 if jax.config.jax_enable_x64 else 1e-5
    found = lpips(reference, test, weights, centred=centred)
    np.testing.assert_allclose(found, expected, rtol=close)
    found = lpips_distance(reference, test, weights, centred=centred)
    np.testing.assert_allclose(found, distance, rtol=close)


def test_products_are_of_the_whole_numbers(weights):
    """Where float32 is multiplied at less precision unless more is asked for."""
    picture = jnp.zeros((31, 31, 3))
    traced = str(jax.make_jaxpr(lambda x: lpips(x, x, weights))(picture))
    found = re.findall("precision=(.*)", traced)
    assert len(found) >= 10
    assert set(found) == {"(Precision.HIGHEST, Precision.HIGHEST)"}


def test_equal_pictures_have_no_distance_and_a_finite_slope(drawn, weights):
    black = jnp.zeros((31, 31, 3))
    for picture in (black, jnp.asarray(drawn[1][:31, :31], float)):
        of = lambda x, y=picture: lpips_distance(y, x, weights)
        value, slope = jax.value_and_grad(of)(picture)
        # Both pictures go through one convolution, which may round them differently.
        np.testing.assert_allclose(value, 0, atol=1e-12)
        np.testing.assert_allclose(slope, 0, atol=1e-6)


def test_features_that_are_all_dark_have_a_finite_slope(weights):
    dead = eqx.tree_at(
        lambda w: w.biases, weights, tuple(b - 1e3 for b in weights.biases)
    )
    picture = jnp.full((31, 31, 3), 0.5)
    slope = jax.grad(lambda x: lpips_distance(picture, x, dead))(picture)
    np.testing.assert_array_equal(slope, 0)


# Single precision leaves too few digits for differences.
@pytest.mark.float64
def test_slopes_are_those_of_differences(drawn, weights):
    first, second = (jnp.asarray(0.1 + 0.8 * p[:31, 20:51], float) for p in drawn[1:])
    along = jnp.asarray(np.random.default_rng(0).normal(size=first.shape))
    of = lambda h: lpips_distance(first, second + h * along, weights)
    _, forward = jax.jvp(of, (0.0,), (1.0,))
    np.testing.assert_allclose(forward, jax.grad(of)(0.0), rtol=1e-9)
    # Rectifiers bend within a longer step.
    np.testing.assert_allclose(forward, (of(1e-8) - of(-1e-8)) / 2e-8, rtol=1e-4)


def test_weights_survive_a_file(weights, tmp_path):
    save_lpips_weights(weights, tmp_path / "weights.npz")
    read = load_lpips_weights(tmp_path / "weights.npz")
    for a, b in zip(jax.tree.leaves(weights), jax.tree.leaves(read), strict=True):
        np.testing.assert_array_equal(a, b)


def test_names_of_torchvision_are_known(drawn, weights):
    arrays = {}
    for name, value in drawn[0].items():
        head, *rest = name.rsplit(".", 2)
        arrays[".".join(("features", *rest)) if "slice" in head else name] = value
    read = LpipsWeights.from_arrays(arrays | {"classifier.1.bias": np.zeros(4096)})
    for a, b in zip(jax.tree.leaves(weights), jax.tree.leaves(read), strict=True):
        np.testing.assert_array_equal(a, b)


def test_wrong_weights_are_named(drawn, tmp_path):
    arrays = drawn[0]
    missing = {n: v for n, v in arrays.items() if n != "lin3.model.1.weight"}
    with pytest.raises(ValueError, match="`arrays` must have lin3.model.1.weight"):
        LpipsWeights.from_arrays(missing)
    with pytest.raises(ValueError, match=r"`net.slice1.0.bias` must have shape \[64\]"):
        LpipsWeights.from_arrays(arrays | {"net.slice1.0.bias": np.zeros(63)})
    path = tmp_path / "weights.pth"
    path.write_bytes(b"PK no archive")
    with pytest.raises(ValueError, match="`path` must be an archive of weights"):
        load_lpips_weights(path)
    np.savez(path.with_suffix(".npz"), **{"net.slice1.0.weight": np.array([None])})
    with pytest.raises(ValueError, match="`path` must be an archive of weights"):
        load_lpips_weights(path.with_suffix(".npz"))
    with pytest.raises(OSError):
        load_lpips_weights(tmp_path / "none.npz")


def test_the_metric_pools_the_map(drawn, weights):
    _, reference, test = drawn
    found = lpips_metric(weights)(reference, test, ppd=60)
    expected = pool_tiles(lpips(reference, test, weights))
    np.testing.assert_array_equal(found, expected)
    assert found.shape == (4, 5)
    with pytest.raises(ValueError, match="`ppd`"):
        lpips_metric(weights)(reference, test, ppd=0)


def test_pictures_must_be_large_enough(weights):
    picture = np.zeros((30, 40, 3))
    with pytest.raises(ValueError, match="`reference` must have 31 x 31 px or more"):
        lpips(picture, picture, weights)
