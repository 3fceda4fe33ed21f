from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import reference
from camojab import sensitivity


# Computed with utils/stcsf_cam_daly.m of gfxdisp/ALSaRR at d06b3e0 in GNU Octave 7.3.
GOLDEN = Path(__file__).parent / "golden" / "csf.csv"

X64 = jax.config.jax_enable_x64

EXTREMES = np.meshgrid(
    [1e-6, 1e-3, 0.1, 1.0, 10.0, 100.0, 1e4],
    [0.0, 1e-3, 1.0, 60.0, 2e3, 1e5],
    [1e-6, 1e-3, 1.0, 1e4, 1e8],
    indexing="ij",
)


def test_golden():
    rows = np.genfromtxt(GOLDEN, delimiter=",", names=True)
    assert len(rows) == 290
    ours = sensitivity(
        rows["spatial_frequency_cpd"],
        rows["temporal_frequency_hz"],
        rows["luminance_cd_m2"],
    )
    rtol = 1e-10 if X64 else 1e-4
    np.testing.assert_allclose(ours, rows["sensitivity"], rtol=rtol, atol=0)


# The transcription multiplies factors that leave the range of a double long before the
# sensitivity itself does, so the ranges stop where a display and an eye do.
@settings(deadline=None, max_examples=50, database=None)
@given(
    rho=st.floats(0.01, 200),
    f=st.one_of(st.just(0.0), st.floats(0.01, 500)),
    level=st.floats(1e-3, 1e4),
)
def test_like_the_transcription(rho, f, level):
    expected = reference.sensitivity(np.array([rho]), f, level)[0]
    # Rounding the frequencies to float32 moves an exponent of e, about log S, by 1e-7
    # of itself; values below 1e-30 are far from any threshold.
    rtol = 1e-10 if X64 else 1e-4
    np.testing.assert_allclose(
        sensitivity(rho, f, level), expected, rtol=rtol, atol=1e-30
    )


def test_shapes_broadcast():
    rho, f, level = np.array([[1.0], [4.0]]), np.array([0.0, 5.0, 60.0]), 100.0
    together = sensitivity(rho, f, level)
    assert together.shape == (2, 3)
    for i in range(2):
        for j in range(3):
            alone = sensitivity(rho[i, 0], f[j], level)
            assert alone.shape == ()
            np.testing.assert_allclose(together[i, j], alone, rtol=1e-6)


def test_integers_and_mixed_precisions_are_taken():
    expected = sensitivity(4.0, 8.0, 100.0)
    # Strict promotion, which the tests run under, forbids what a user may well do.
    with jax.numpy_dtype_promotion("standard"):
        mixed = sensitivity(np.float32(4), 8, np.float64(100))
    assert mixed.dtype == expected.dtype
    np.testing.assert_allclose(mixed, expected, rtol=1e-6)


def test_spatial_frequency_zero_is_that_of_the_released_program():
    value = sensitivity(0.0, np.array([0.0, 1e-3, 60.0]), 100.0)
    np.testing.assert_array_equal(value, [0.0, 1.0, 1.0])


def test_extremes_are_finite():
    value = sensitivity(*EXTREMES)
    assert np.isfinite(value).all()
    assert (np.asarray(value) >= 0).all()


def test_gradient_is_finite_at_extremes_and_at_zero():
    zero = ([0.0, 0.0], [0.0, 60.0], [1.0, 1.0])
    points = [
        jnp.asarray(np.append(grid, more), float)
        for grid, more in zip(EXTREMES, zero, strict=True)
    ]
    slopes = jax.jit(jax.grad(lambda *a: sensitivity(*a).sum(), (0, 1, 2)))
    for slope in slopes(*points):
        assert np.isfinite(slope).all()


@pytest.mark.float64  # central differences in float32 have two digits at best
def test_gradient_is_the_slope():
    function = jax.jit(lambda x: sensitivity(x[0], x[1], x[2]))
    forward, backward = jax.jit(jax.jacfwd(function)), jax.jit(jax.grad(function))
    for f in (0.0, 5.0, 60.0):
        point = jnp.array([3.0, f, 50.0])
        slope = forward(point)
        np.testing.assert_allclose(backward(point), slope, rtol=1e-10)
        for i in (0, 1, 2) if f else (0, 2):
            step = 1e-5 * point[i]
            high, low = (function(point.at[i].add(by)) for by in (step, -step))
            np.testing.assert_allclose(slope[i], (high - low) / (2 * step), rtol=1e-6)


def test_transformations():
    rho = jnp.linspace(0.5, 30.0, 7)
    expected = sensitivity(rho, 10.0, 100.0)
    function = lambda r: sensitivity(r, 10.0, 100.0)
    # Rounding of one unit in the last place may differ between compilations.
    rtol = 1e-12 if X64 else 1e-5
    np.testing.assert_allclose(jax.jit(function)(rho), expected, rtol=rtol)
    np.testing.assert_allclose(jax.vmap(function)(rho), expected, rtol=rtol)


BAD = [
    ("spatial_frequency", -1.0, "finite and >= 0 cycles/deg", "-1"),
    ("spatial_frequency", np.nan, "finite and >= 0 cycles/deg", "nan"),
    ("spatial_frequency", np.inf, "finite and >= 0 cycles/deg", "inf"),
    ("temporal_frequency", -0.5, "finite and >= 0 Hz", "-0.5"),
    ("temporal_frequency", np.nan, "finite and >= 0 Hz", "nan"),
    ("luminance", 0.0, "finite and > 0 cd/m^2", "0"),
    ("luminance", -3.0, "finite and > 0 cd/m^2", "-3"),
    ("luminance", np.inf, "finite and > 0 cd/m^2", "inf"),
]


@pytest.mark.parametrize("name, value, rule, shown", BAD)
def test_errors(name, value, rule, shown):
    good = {"spatial_frequency": 1.0, "temporal_frequency": 1.0, "luminance": 1.0}
    with pytest.raises(ValueError) as error:
        sensitivity(**good | {name: value})
    assert str(error.value) == f"`{name}` must be {rule}, got {shown}."
    with pytest.raises(RuntimeError) as error:
        eqx.filter_jit(lambda v: sensitivity(**good | {name: v}))(jnp.asarray(value))
    assert f"`{name}` must be {rule}." in str(error.value)


def test_one_bad_value_of_many_is_shown():
    with pytest.raises(ValueError, match=r"^`luminance` must be .*, got -2\.$"):
        sensitivity(1.0, 1.0, np.array([1.0, -2.0, 3.0]))


def test_shapes_that_do_not_broadcast_are_named():
    with pytest.raises(ValueError) as error:
        sensitivity(np.ones(3), np.ones(4), 1.0)
    message = str(error.value)
    assert "must broadcast together" in message
    assert "(3,)" in message and "(4,)" in message
