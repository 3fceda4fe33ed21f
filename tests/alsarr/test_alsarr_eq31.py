import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import least_squares

from alsarr.tables import evaluate_eq31, fit_eq31


def eq31(w, v, f, level):
    """Eq. 31 as it is printed."""
    motion = w[0] + w[1] * v + w[2] * f + w[3] * v**2 + w[4] * v * f + w[5] * f**2
    return motion * (w[6] * level**3 + w[7] * level**2 + w[8] * level + w[9])


def grid():
    """The conditions that the authors fitted: 6 velocities, 7 rates, 4 luminances."""
    axes = np.linspace(0, 50, 6), np.linspace(30, 120, 7), np.array([-1, 1, 2, 2.5])
    return [x.ravel() for x in np.meshgrid(*axes, indexing="ij")]


def scattered(count=60, seed=0):
    rng = np.random.default_rng(seed)
    ends = [(0, 50), (30, 120), (-1, 2.5)]
    return [rng.uniform(low, high, count) for low, high in ends]


def curved(v, f, level, seed=0):
    """Smooth qualities that no Eq. 31 can reproduce."""
    rng = np.random.default_rng(seed)
    blur = np.exp(-v * (60 / f) / rng.uniform(10, 40))
    light = 1 / (1 + np.exp(-rng.uniform(0.5, 2) * (level - rng.uniform(0, 1))))
    return 3 * blur * light + 0.3 * np.sin(v / 9 + f / 40 + level)


def jax_arrays(*arrays):
    return [jnp.asarray(x) for x in arrays]


# W of a material of the SciFi scene ("Bird (Instance)", mip level 7, full rate), as
# published in gfxdisp/ALSaRR at d06b3e0, to nine digits.
PUBLISHED = [
    1.33036972, -0.0522511970, 0.00788558028, 0.000511988928, 6.04559378e-05,
    -3.14956940e-05, -0.0136791587, 0.0414850005, 0.243010443, 0.346929493,
]  # fmt: skip


def test_value_is_the_printed_formula():
    conditions = scattered()
    got = evaluate_eq31(*jax_arrays([PUBLISHED], *conditions))
    expected = eq31(PUBLISHED, *conditions)
    rtol = 1e-13 if jax.config.read("jax_enable_x64") else 2e-6
    np.testing.assert_allclose(got, expected, rtol=rtol)


def test_tables_and_conditions_broadcast():
    w = np.random.default_rng(0).normal(size=(5, 7, 10))
    v, f, level = np.full((5, 1), 3.0), np.full((1, 7), 60.0), np.array([[1.5]])
    got = evaluate_eq31(*jax_arrays(w, v, f, level))
    expected = eq31(np.moveaxis(w, -1, 0), v, f, level)
    np.testing.assert_allclose(got, expected, rtol=1e-4)


@pytest.mark.parametrize("conditions", [grid(), scattered()], ids=["grid", "scattered"])
def test_fit_recovers_a_polynomial(conditions):
    quality = eq31(PUBLISHED, *conditions)
    fit = fit_eq31(*jax_arrays(*conditions, quality))
    exact = jax.config.read("jax_enable_x64")
    peak = np.abs(quality).max()
    # Single precision loses three digits to the powers of f, up to 120^2.
    assert fit.largest_error < peak * (1e-12 if exact else 1e-4)
    assert fit.converged
    scale = PUBLISHED[0] / fit.coefficients[0]
    np.testing.assert_allclose(
        fit.coefficients[:6] * scale, PUBLISHED[:6], rtol=1e-9 if exact else 2e-2
    )
    np.testing.assert_allclose(
        fit.coefficients[6:] / scale, PUBLISHED[6:], rtol=1e-9 if exact else 2e-2
    )


def test_luminance_factor_peaks_at_one_over_the_samples():
    v, f, level = scattered()
    for sign in (1, -1):
        fit = fit_eq31(*jax_arrays(v, f, level, sign * curved(v, f, level)))
        factor = np.polyval(np.asarray(fit.coefficients[6:], float), level)
        np.testing.assert_allclose(factor[np.argmax(np.abs(factor))], 1, rtol=1e-5)


def test_reported_errors_are_those_of_the_coefficients():
    conditions = scattered()
    quality = curved(*conditions)
    fit = fit_eq31(*jax_arrays(*conditions, quality))
    w = np.asarray(fit.coefficients, float)
    error = np.abs(eq31(w, *conditions) - quality)
    np.testing.assert_allclose(fit.largest_error, error.max(), rtol=1e-4)
    np.testing.assert_allclose(fit.median_error, np.median(error), rtol=2e-3)


def best_of_scipy(conditions, quality, starts):
    """Smallest sum of squares from several starts, in variables scaled to [-1, 1]."""
    v, f, level = ((x - x.mean()) / np.ptp(x) * 2 for x in conditions)
    rng = np.random.default_rng(1)
    residual = lambda w: eq31(w, v, f, level) - quality
    options = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "max_nfev": 2000}
    found = [
        least_squares(residual, rng.normal(size=10), **options) for _ in range(starts)
    ]
    return min(2 * solution.cost for solution in found)


@pytest.mark.float64  # it compares sums of squares to nine digits
@pytest.mark.parametrize("conditions", [grid(), scattered()], ids=["grid", "scattered"])
@pytest.mark.parametrize("seed", range(4))
def test_fit_is_the_best_that_scipy_finds(conditions, seed):
    quality = curved(*conditions, seed=seed)
    fit = fit_eq31(*jax_arrays(*conditions, quality))
    assert fit.converged
    w = np.asarray(fit.coefficients)
    ours = np.sum((eq31(w, *conditions) - quality) ** 2)
    theirs = best_of_scipy(conditions, quality, starts=6)
    assert ours > 0.01
    np.testing.assert_allclose(ours, theirs, rtol=1e-9)


def test_single_precision_is_nearly_as_good():
    conditions = scattered()
    quality = curved(*conditions)
    single = [jnp.asarray(x, jnp.float32) for x in (*conditions, quality)]
    fit = fit_eq31(*single)
    assert fit.coefficients.dtype == jnp.float32 and fit.converged
    w = np.asarray(fit.coefficients, np.float64)
    ours = np.sum((eq31(w, *conditions) - quality) ** 2)
    theirs = best_of_scipy(conditions, quality, starts=3)
    # A residual of 1e-4 of the largest quality is what single precision adds.
    assert ours < theirs + len(quality) * (1e-4 * np.abs(quality).max()) ** 2


def test_nothing_to_fit_gives_zeros_alone_and_in_a_batch():
    v, f, level = jax_arrays(*grid())
    some = jnp.asarray(curved(*grid()))
    batch = jnp.stack([some, jnp.zeros_like(some), some])
    fit = jax.vmap(fit_eq31, in_axes=(None, None, None, 0))
    found = eqx.filter_jit(fit)(v, f, level, batch)
    np.testing.assert_array_equal(found.coefficients[1], 0)
    np.testing.assert_array_equal(found.largest_error[1], 0)
    assert found.converged.all() and jnp.isfinite(found.coefficients).all()
    alone = fit_eq31(v, f, level, some)
    np.testing.assert_allclose(
        found.largest_error, [alone.largest_error, 0, alone.largest_error], rtol=1e-4
    )
    np.testing.assert_array_equal(fit_eq31(v, f, level, 0 * some).coefficients, 0)


@pytest.mark.parametrize("fixed", [0, 1, 2])
def test_a_condition_that_never_changes_is_no_obstacle(fixed):
    conditions = grid()
    conditions[fixed] = np.full_like(conditions[fixed], conditions[fixed][-1])
    quality = eq31(PUBLISHED, *conditions)
    fit = fit_eq31(*jax_arrays(*conditions, quality))
    assert np.all(np.isfinite(fit.coefficients))
    rtol = 1e-11 if jax.config.read("jax_enable_x64") else 1e-4
    assert fit.largest_error < rtol * np.abs(quality).max()


def test_fewer_samples_than_coefficients_are_reproduced():
    conditions = scattered(count=5)
    quality = curved(*conditions)
    fit = fit_eq31(*jax_arrays(*conditions, quality))
    assert fit.largest_error < 1e-3 * np.abs(quality).max()


@settings(deadline=None, max_examples=20)
@given(st.floats(1e-6, 1e6), st.sampled_from([1, -1]))
def test_errors_scale_with_the_quality(size, sign):
    conditions = scattered()
    quality = curved(*conditions)
    once = fit_eq31(*jax_arrays(*conditions, quality))
    scaled = fit_eq31(*jax_arrays(*conditions, size * sign * quality))
    np.testing.assert_allclose(
        scaled.largest_error, size * once.largest_error, rtol=1e-3
    )


def test_giving_up_early_is_reported():
    conditions = scattered()
    samples = jax_arrays(*conditions, curved(*conditions))
    early, whole = fit_eq31(*samples, max_rounds=2), fit_eq31(*samples)
    assert not early.converged and early.num_rounds == 2
    assert whole.converged and 2 < whole.num_rounds < 200


def test_what_is_wrong_is_named():
    v, f, level, quality = jax_arrays(*grid(), curved(*grid()))
    with pytest.raises(ValueError, match=r"must have one shape .*\(168,\), \(167,\)"):
        fit_eq31(v, f, level, quality[1:])
    with pytest.raises(ValueError, match=r"n > 0, got \(0,\)"):
        fit_eq31(v[:0], f[:0], level[:0], quality[:0])
    with pytest.raises(ValueError, match="`quality` must be finite, got nan"):
        fit_eq31(v, f, level, quality.at[3].set(jnp.nan))
    with pytest.raises(RuntimeError, match="`velocity` must be finite"):
        eqx.filter_jit(fit_eq31)(v * jnp.inf, f, level, quality)
