"""Pooling and evaluation of every fidelity, for pytest-benchmark.

    pytest tests/benchmarks/bench_model.py

runs the cases of `camojab bench` in the precision of the lane (`--float32` for single).
Compiling is not counted. The machine should have nothing else to do.
"""

import jax
import numpy as np
import pytest

from alsarr.tables import distil, Polynomial, sample, Scene
from camojab import (
    datasets,
    Display,
    Exact,
    Formulation,
    pool,
    Pooled,
    pooled_quality,
    quality,
    Shading,
    Spectrum,
    Viewing,
)
from camojab._bench import _scattered, CELLS


RUNGS = [Exact(), *map(Pooled, CELLS)]

each_formulation = pytest.mark.parametrize("formulation", list(Formulation))
each_rung = pytest.mark.parametrize("fidelity", RUNGS, ids=str)


@pytest.fixture(scope="module")
def spectrum():
    return Spectrum.from_texture(datasets.builtin_textures()["grass"])


def conditions(number):
    drawn = _scattered(np.random.default_rng(0), number)
    display = Display(
        ppd=drawn["ppd"],
        refresh_rate=drawn["refresh_rate_hz"],
        luminance=drawn["mean_luminance_cd_m2"],
        persistence=drawn["persistence"],
    )
    return display, Viewing(drawn["velocity_deg_s"])


def timed(benchmark, call):
    jax.block_until_ready(call())
    return benchmark(lambda: jax.block_until_ready(call()))


@each_formulation
@each_rung
def test_pooling(benchmark, spectrum, formulation, fidelity):
    timed(
        benchmark,
        lambda: (
            pool(
                spectrum,
                Shading(rate_x=0.5),
                formulation=formulation,
                fidelity=fidelity,
            ).energies
        ),
    )


@each_formulation
@each_rung
@pytest.mark.parametrize("batch", [1, 100, 10_000])
def test_evaluation(benchmark, spectrum, formulation, fidelity, batch):
    if isinstance(fidelity, Exact) and batch > 100:
        pytest.skip("ten thousand exact conditions take minutes")
    shading = Shading(rate_x=0.5)
    pooled = pool(spectrum, shading, formulation=formulation, fidelity=fidelity)
    arguments = conditions(batch)
    found = timed(benchmark, lambda: pooled_quality(pooled, *arguments))
    assert found.shape == (batch,) and np.isfinite(found).all()


@each_formulation
@each_rung
def test_both_at_once(benchmark, spectrum, formulation, fidelity):
    arguments = conditions(10)
    found = timed(
        benchmark,
        lambda: quality(
            spectrum,
            *arguments,
            Shading(rate_x=0.5),
            formulation=formulation,
            fidelity=fidelity,
        ),
    )
    assert found.shape == (10,)


def test_polynomial(benchmark, spectrum):
    textures = {"grass": spectrum}
    samples = sample(textures, Scene.every(1, (0,)), ppd=60.0)
    tables = distil(samples, relative_to=None)
    arguments, rung = conditions(10_000), Polynomial(tables, "grass")
    of = jax.jit(
        lambda *views: quality(spectrum, *views, Shading(rate_x=0.5), fidelity=rung)
    )
    assert timed(benchmark, lambda: of(*arguments)).shape == (10_000,)
