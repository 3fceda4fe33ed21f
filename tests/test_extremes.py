"""Far outside the ordinary range, in single precision, and what never rises."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import reference
from camojab import (
    Display,
    Formulation,
    Parameters,
    pool,
    Pooled,
    pooled_quality,
    Shading,
    Spectrum,
    Viewing,
)


class Rung(NamedTuple):
    """A way to compute quality, and how many conditions a test can afford of it."""

    formulation: Formulation
    options: tuple[tuple[str, object], ...]
    conditions: int

    def pool(self, spectrum, shading, parameters=None):
        options = {"formulation": self.formulation, **dict(self.options)}
        return pool(spectrum, shading, parameters, **options)


EXACT = {
    "released": Rung(Formulation.RELEASED, (), 3000),
    "paper": Rung(Formulation.PAPER, (), 120),
}
POOLED = {
    f"{formulation.value}_pooled": Rung(
        formulation, (("fidelity", Pooled(2000)),), 100_000
    )
    for formulation in Formulation
}
RUNGS = EXACT | POOLED

RATES = [(1.0, 1.0), (0.5, 1.0), (1.0, 0.5), (0.5, 0.5), (0.25, 0.5), (0.5, 0.25)]
RATES.append((0.25, 0.25))


# ---- what is drawn


def textures():
    index = np.arange(512) // 16
    return {
        "flat": np.full((512, 512), 0.5),
        "white": np.ones((512, 512)),
        "impulse": np.ones((1, 1)),
        "zero": np.zeros((512, 512)),
        "checkerboard": (index[:, None] + index[None, :]) % 2.0,
        "noise": np.random.default_rng(0).random((512, 512)),
    }


@functools.cache
def amplitude(name):
    return reference.amplitude(textures()[name])


def spectrum(name):
    return Spectrum(jnp.asarray(amplitude(name), float))


def log_uniform(draw, low, high, n):
    return np.exp(draw.uniform(np.log(low), np.log(high), n))


def extreme_conditions(draw, n):
    """Far outside any display, a tenth of them at the ends of what is allowed."""
    conditions = {
        "ppd": log_uniform(draw, 1e-2, 1e4, n),
        "refresh_rate": log_uniform(draw, 1e-2, 1e5, n),
        "luminance": log_uniform(draw, 1e-6, 1e8, n),
        "persistence": log_uniform(draw, 1e-12, 1.0, n),
        "velocity": log_uniform(draw, 1e-6, 1e6, n),
    }
    conditions["persistence"][draw.random(n) < 0.1] = 1.0
    conditions["velocity"][draw.random(n) < 0.1] = 0.0
    return conditions


def extreme_shading(draw):
    """One of the usual rates, or any; mip levels far beyond the last."""
    usual = RATES[draw.integers(len(RATES))]
    rates = usual if draw.random() < 0.7 else log_uniform(draw, 1e-3, 1.0, 2)
    mip_level = draw.choice([0.0, draw.uniform(0, 10), draw.uniform(0, 200)])
    return Shading(rate_x=rates[0], rate_y=rates[1], mip_level=mip_level)


def ordinary_conditions(draw, n):
    """What is in use; one image in twenty stands still."""
    velocity = log_uniform(draw, 1e-2, 100.0, n)
    velocity = np.where(draw.random(n) < 0.5, draw.uniform(0.0, 100.0, n), velocity)
    return {
        "ppd": log_uniform(draw, 5.0, 200.0, n),
        "refresh_rate": log_uniform(draw, 20.0, 500.0, n),
        "luminance": log_uniform(draw, 1e-2, 1e4, n),
        "persistence": log_uniform(draw, 1e-2, 1.0, n),
        "velocity": np.where(draw.random(n) < 0.05, 0.0, velocity),
    }


def shown(conditions):
    display = Display(**{name: conditions[name] for name in Display.UNITS})
    return display, Viewing(conditions["velocity"])


# ---- finite


@functools.cache
def values_and_slopes(rung):
    """Each condition's value; slopes of their sum with everything that is real."""

    def total(amplitude, shading, parameters, display, viewing):
        pooled = rung.pool(Spectrum(amplitude), shading, parameters)
        value = pooled_quality(pooled, display, viewing)
        return value.sum(), value

    return jax.jit(jax.value_and_grad(total, (0, 1, 2, 3, 4), has_aux=True))


def not_finite(rung, name, shading, conditions):
    """Every value and slope that is not finite, with where it is."""
    run, parameters = values_and_slopes(rung), Parameters.published(rung.formulation)
    args = spectrum(name).amplitude, shading, parameters, *shown(conditions)
    (_, value), slopes = run(*args)
    found = {"quality": value, "slope with amplitude": slopes[0]}
    for module in slopes[1:]:
        found |= {f"slope with {field}": x for field, x in vars(module).items()}
    return [
        (what, name, shading.report(), at(conditions, i) if x.ndim == 1 else "pool")
        for what, x in found.items()
        for i in np.unique(np.argwhere(~np.isfinite(np.atleast_1d(x)))[:, 0])
    ]


def at(conditions, i):
    return ", ".join(f"{name}={x[i]:g}" for name, x in conditions.items())


@pytest.mark.parametrize("rung", RUNGS)
def test_nothing_breaks_at_the_extremes(rung):
    rung, draw, wrong = RUNGS[rung], np.random.default_rng(4), []
    each = -(-rung.conditions // (2 * len(textures())))
    coarsest = Shading(rate_x=1e-3, rate_y=1e-3, mip_level=200.0)
    for name in textures():
        for shading in (extreme_shading(draw), coarsest):
            wrong += not_finite(rung, name, shading, extreme_conditions(draw, each))
    assert wrong == []


# ---- single precision

# The largest of 51 000 conditions was 3e-5 JND in the released formulation and 7e-5 of
# 3600 in the paper's, both of noise of -60 and -100 JND; on nodes 2.1e-4 of 23 000, at
# -154 JND.
SINGLE_PRECISION_JND = 4e-4


def near_a_jump(conditions):
    """Where rounding a quantity may itself move the released replica by a bin."""
    across = np.maximum(conditions["velocity"], 0.1) * conditions["ppd"]
    bins = 256 * conditions["refresh_rate"] / across
    return (abs(bins - np.round(bins)) < 1e-5 * bins) & (bins < 513)


def quality_in(dtype, rung, name, shading, conditions):
    with jax.enable_x64(dtype == np.float64):
        texture = Spectrum(jnp.asarray(amplitude(name), dtype))
        pooled = rung.pool(texture, Shading(**shading))
        value = pooled_quality(pooled, *shown(conditions))
        assert value.dtype == dtype
        return np.asarray(value, np.float64)


@pytest.mark.float64  # it computes in both, whatever the lane
@pytest.mark.parametrize("rung", RUNGS)
def test_single_precision_is_like_double(rung):
    rung, draw = RUNGS[rung], np.random.default_rng(5)
    each = max(6, rung.conditions // 60)
    for name in ("noise", "checkerboard"):
        for rate_x, rate_y in RATES:
            mip_level = draw.choice([0.0, draw.uniform(0, 10)])
            shading = {"rate_x": rate_x, "rate_y": rate_y, "mip_level": mip_level}
            conditions = ordinary_conditions(draw, each)
            args = rung, name, shading, conditions
            single, double = (quality_in(d, *args) for d in (np.float32, np.float64))
            far = ~near_a_jump(conditions)
            assert far.sum() > 0.7 * each and (double < -1e-3).any()
            np.testing.assert_allclose(
                single[far], double[far], rtol=0, atol=SINGLE_PRECISION_JND
            )


# ---- what never falls


def spatial(rung, texture, shading, conditions):
    """The spatial distortion, and how far rounding can move it."""
    beta = Parameters.published(rung.formulation).beta
    parameters = Parameters(ws=1.0, wt=0.0, beta=beta)
    value = pooled_quality(rung.pool(texture, shading, parameters), *shown(conditions))
    # It is a sum over all bins, of either sign where aliases add to some of them.
    return np.asarray(value), 50 * jnp.finfo(value.dtype).eps * abs(np.asarray(value))


def assert_takes_no_less(more, less):
    (more, rounding), (less, other) = more, less
    fall = less - more - rounding - other
    assert fall.max() <= 0, f"falls by {fall.max():g}"
    assert (more - less > rounding + other).any()


def longer(conditions, factor):
    return np.minimum(conditions["persistence"] * factor, 1.0)


MORE_EYE_BLUR = {
    "persistence": longer,
    "velocity": lambda conditions, factor: conditions["velocity"] * factor,
    "refresh_rate": lambda conditions, factor: conditions["refresh_rate"] / factor,
}


@pytest.mark.parametrize("drawn", [ordinary_conditions, extreme_conditions])
@pytest.mark.parametrize("name", ["noise", "checkerboard"])
@pytest.mark.parametrize("rung", EXACT)
def test_more_eye_blur_takes_no_less(rung, name, drawn):
    rung, draw = RUNGS[rung], np.random.default_rng(6)
    for shading in (Shading(), Shading(rate_x=0.5, rate_y=0.25, mip_level=2.0)):
        conditions = drawn(draw, max(10, rung.conditions // 40))
        less = spatial(rung, spectrum(name), shading, conditions)
        factor = draw.uniform(1.0, 10.0, conditions["velocity"].shape)
        for quantity, raised in MORE_EYE_BLUR.items():
            blurred = conditions | {quantity: raised(conditions, factor)}
            more = spatial(rung, spectrum(name), shading, blurred)
            assert_takes_no_less(more, less)


@pytest.mark.parametrize("rung", EXACT)
def test_coarser_mip_level_takes_no_less(rung):
    rung, draw = RUNGS[rung], np.random.default_rng(7)
    conditions = ordinary_conditions(draw, max(6, rung.conditions // 100))
    for rate_x, rate_y in [(0.25, 0.5), (0.37, 0.81)]:
        at_level = lambda mip_level, x=rate_x, y=rate_y: spatial(
            rung,
            spectrum("noise"),
            Shading(rate_x=x, rate_y=y, mip_level=mip_level),
            conditions,
        )
        levels = [at_level(level) for level in (0.0, 0.4, 2.0, 7.0)]
        for less, more in zip(levels, levels[1:], strict=False):
            assert_takes_no_less(more, less)


def without_aliases():
    """No detail that the coarsest shading, of a quarter, cannot carry (bin 64)."""
    texels = np.random.default_rng(8).random((512, 512))
    bins = np.abs(np.arange(-256, 256))
    kept = (bins[:, None] <= 40) & (bins[None, :] <= 40)
    return Spectrum(jnp.asarray(reference.amplitude(texels) * kept, float))


def test_coarser_shading_without_aliases_takes_no_less():
    rung, draw = RUNGS["paper"], np.random.default_rng(9)
    conditions = ordinary_conditions(draw, max(6, rung.conditions // 100))
    for axis in ("rate_x", "rate_y"):
        other = {"rate_x": 0.5, "rate_y": 0.5, axis: None}
        at_rate = lambda rate, axis=axis, other=other: spatial(
            rung, without_aliases(), Shading(**other | {axis: rate}), conditions
        )
        rates = [at_rate(rate) for rate in (0.5, 0.4, 1 / 3, 0.25)]
        for less, more in zip(rates, rates[1:], strict=False):
            assert_takes_no_less(more, less)


@pytest.mark.parametrize("rung", RUNGS)
def test_coarser_shading_can_look_better(rung):
    # What it no longer shows, it no longer repeats: fast motion on a slow display.
    rung = RUNGS[rung]
    display = Display(ppd=36.0, refresh_rate=24.0, luminance=3000.0)
    fine, coarse = (
        pooled_quality(
            rung.pool(spectrum("noise"), Shading(rate_x=rate)), display, Viewing(73.0)
        )
        for rate in (1.0, 0.5)
    )
    assert coarse > fine + 0.1
