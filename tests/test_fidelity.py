"""Rungs between exact and fast: their errors, their own estimates, their slopes."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from camojab import (
    Auto,
    choose_fidelity,
    Components,
    datasets,
    Display,
    distortion,
    error_estimate,
    Exact,
    Formulation,
    Parameters,
    pool,
    Pooled,
    pooled_quality,
    quality,
    Shading,
    Spectrum,
    Viewing,
)
from camojab._chains import CHAIN
from camojab._node_pool import cells, replica_places
from camojab._pooled import _size


GOLDEN = Path(__file__).parent / "golden" / "model_dst.csv"
STIMULI = "jindal2021/Experiment_Data/vrs_exp_stimulus.mat"
TEXTURES = ["checkerboard", "gradient_linear", "grass", "marrr_checkerboard", "noise"]

X64 = jax.config.jax_enable_x64
FORMULATIONS = list(Formulation)
DISPLAY = {"ppd": 60.0, "refresh_rate": 60.0, "luminance": 100.0}
RATES = np.array([[1, 1], [0.5, 1], [1, 0.5], [0.5, 0.5], [0.25, 0.5], [0.25, 0.25]])


def texture(kind="noise", seed=0):
    random = np.random.default_rng(seed).random((512, 512))
    if kind == "smooth":
        random = (np.cumsum(random - 0.5, axis=1) / 60).clip(-0.5, 0.5) + 0.5
    elif kind == "stripes":
        random = np.broadcast_to(np.arange(512) // 8 % 2 * 0.7 + 0.15, (512, 512))
    elif kind == "flat":
        random = np.full((512, 512), 0.5)
    return Spectrum.from_texture(random)


def scattered(n, seed=0, **fixed):
    random = np.random.default_rng(seed)
    between = lambda low, high: np.exp(random.uniform(np.log(low), np.log(high), n))
    drawn = {
        "ppd": between(10, 120),
        "refresh_rate": between(20, 300),
        "luminance": between(0.1, 1000),
        "persistence": between(0.02, 1),
    }
    return Display(**drawn | fixed), Viewing(between(0.3, 100))


# ---- against exact


@pytest.mark.parametrize("name", TEXTURES)
def test_golden_conditions(real_data, name):
    real_data(STIMULI)
    rows = np.genfromtxt(
        GOLDEN, delimiter=",", names=True, dtype=None, encoding="utf-8"
    )
    rows = rows[rows["texture"] == name]
    p = Parameters.published()
    parts = distortion(
        Spectrum.from_texture(datasets.jindal2021_textures()[name]),
        Display(
            ppd=rows["ppd"],
            refresh_rate=rows["refresh_rate_hz"],
            luminance=rows["mean_luminance_cd_m2"],
            persistence=rows["persistence"],
        ),
        Viewing(rows["velocity_deg_s"]),
        Shading(
            rate_x=rows["rate_x"], rate_y=rows["rate_y"], mip_level=rows["mip_level"]
        ),
        Parameters(ws=p.ws, wt=p.wt, beta=rows["beta"]),
        components=Components(
            vrs=rows["vrs"], eye_blur=rows["eye_blur"], judder=rows["judder"]
        ),
        fidelity=Pooled(5000),
    )
    ws, wt = float(p.ws), float(p.wt)
    golden = ws * rows["E_s"] + wt * rows["E_t"]
    error = ws * np.asarray(parts.spatial) + wt * np.asarray(parts.temporal) - golden
    # At an exponent of 2, six rows of 210, the constants give millions of JND.
    usual = rows["beta"] <= 1
    assert np.abs(error[usual]).max() < 0.001
    assert (np.abs(error) <= 0.01 * np.abs(golden)).all()
    # Differences between any two conditions, and so between any two rates.
    assert np.ptp(error[usual]) < 0.001


KINDS = ["noise", "smooth", "stripes", "flat"]


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("kind", KINDS)
def test_errors_are_small_and_not_underestimated(kind, formulation):
    shading = Shading(
        rate_x=RATES[[0, 1, 5], :1],
        rate_y=RATES[[0, 1, 5], 1:],
        mip_level=np.array([[0.0], [1.5], [4.0]]),
    )
    n = 200 if formulation is Formulation.RELEASED else 40
    args = (texture(kind), *scattered(n), shading)
    exact = quality(*args, formulation=formulation)
    # The integrals of PAPER over a fine display are up to a hundred JND of dense noise.
    worst = {Formulation.RELEASED: (0.5, 0.02), Formulation.PAPER: (2.5, 0.05)}
    for most, largest in zip((1000, 5000), worst[formulation], strict=True):
        rung = Pooled(most)
        ours = quality(*args, formulation=formulation, fidelity=rung)
        error = float(jnp.abs(ours - exact).max())
        estimate = error_estimate(*args, formulation=formulation, fidelity=rung)
        # Rounding in single precision is no error of the rung.
        assert error <= 2 * estimate + (1e-9 if X64 else 1e-4)
        assert estimate <= 10 * error + (1e-9 if X64 else 1e-4)
        assert error < largest


@pytest.mark.parametrize(
    "fixed",
    [{"ppd": 5.0}, {"ppd": 200.0}, {"luminance": 0.01}, {"refresh_rate": 20.0}],
    ids=lambda fixed: next(iter(fixed)),
)
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_estimates_hold_at_the_ends_of_the_ordinary_range(fixed, formulation):
    n = 100 if formulation is Formulation.RELEASED else 30
    args = (texture(), *scattered(n, seed=1, **fixed), Shading(rate_x=0.5))
    exact = quality(*args, formulation=formulation)
    for most in (500, 2000):
        ours = quality(*args, formulation=formulation, fidelity=Pooled(most))
        error = float(jnp.abs(ours - exact).max())
        estimate = error_estimate(*args, formulation=formulation, fidelity=Pooled(most))
        assert error <= 2 * estimate + (1e-9 if X64 else 1e-3)


def test_a_sample_stands_for_many_conditions():
    spectrum, shading = texture(), Shading(rate_x=0.5)
    display, viewing = scattered(20_000)
    whole = quality(spectrum, display, viewing, shading, fidelity=Pooled(500))
    fine = quality(spectrum, display, viewing, shading, fidelity=Pooled(20_000))
    error = float(jnp.abs(whole - fine).max())
    estimate = error_estimate(spectrum, display, viewing, shading, fidelity=Pooled(500))
    assert 0.5 * error <= estimate <= 3 * error


def test_more_cells_are_more_accurate():
    args = (texture(), *scattered(200), Shading(rate_x=0.5, mip_level=1.0))
    exact = quality(*args)
    errors = [
        float(jnp.abs(quality(*args, fidelity=Pooled(n)) - exact).max())
        for n in (400, 1000, 2000, 5000)
    ]
    assert (np.diff(errors) < 0).all() and errors[0] > 100 * errors[-1]


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("most", [400, 1000, 2000, 5000, 20_000, 50_000])
def test_no_more_cells_than_asked_for(most, formulation):
    nodes, single = _size(most, formulation)
    chain = CHAIN[formulation]
    places = replica_places(single, chain.FARTHEST)
    assert 0.3 * most < cells(nodes, len(places)) <= most
    assert (np.diff(places) > 0).all() and places[-1] == chain.FARTHEST
    pooled = pool(texture(), formulation=formulation, fidelity=Pooled(most)).energies
    kept = [pooled.lost, pooled.kept, pooled.moved]
    assert sum(x.size for x in kept) == cells(nodes, len(places))


# ---- one signature


@pytest.mark.parametrize("fidelity", [Exact(), Pooled(1000)])
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_settings_of_any_shape_give_what_they_give_alone(formulation, fidelity):
    spectrum = texture()
    rate_x, velocity = np.array([1.0, 0.5, 0.5]), np.array([[5.0], [30.0]])

    def of(rate_x, velocity, beta):
        return distortion(
            spectrum,
            Display(**DISPLAY),
            Viewing(velocity),
            Shading(rate_x=rate_x),
            Parameters(ws=-3.7, wt=-2.9, beta=beta),
            formulation=formulation,
            fidelity=fidelity,
        )

    together = of(rate_x, velocity, np.array([[0.36], [0.5]]))
    assert together.spatial.shape == together.evaluated.judder.shape == (2, 3)
    for i in range(2):
        for j in range(3):
            alone = of(rate_x[j], velocity[i, 0], (0.36, 0.5)[i])
            assert alone.spatial.shape == ()
            rtol = 1e-11 if X64 else 2e-5
            for one, all_ in (
                (alone.spatial, together.spatial),
                (alone.temporal, together.temporal),
            ):
                np.testing.assert_allclose(all_[i, j], one, rtol)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_traced_settings_are_those_of_their_values(formulation):
    spectrum = texture()
    display, viewing = scattered(5)
    rates = jnp.array([1.0, 0.5, 0.5, 0.25, 1.0])
    of = lambda rates: quality(
        spectrum,
        display,
        viewing,
        Shading(rate_x=rates),
        formulation=formulation,
        fidelity=Pooled(1000),
    )
    np.testing.assert_allclose(jax.jit(of)(rates), of(rates), 1e-11 if X64 else 2e-5)


def test_no_conditions_give_no_values():
    empty = Display(**DISPLAY | {"refresh_rate": np.zeros((0, 3))})
    for fidelity in (Pooled(1000), Auto(0.1), Exact()):
        value = quality(texture(), empty, Viewing(5.0), fidelity=fidelity)
        assert value.shape == (0, 3)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_pool_of_cells_is_the_rung(formulation):
    spectrum, shading = texture(), Shading(rate_x=0.5, rate_y=0.25, mip_level=2.0)
    display, viewing = scattered(9)
    rung = Pooled(1000)
    # A pool does not know its rate, and so leaves out fewer replicas that are nothing.
    pooled = pool(spectrum, shading, formulation=formulation, fidelity=rung)
    np.testing.assert_allclose(
        pooled_quality(pooled, display, viewing),
        quality(
            spectrum,
            display,
            viewing,
            shading,
            formulation=formulation,
            fidelity=rung,
        ),
        rtol=1e-7 if X64 else 2e-5,
    )


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_chunks_do_not_show(formulation):
    spectrum = texture()
    display, viewing = scattered(5000)
    pooled = pool(spectrum, formulation=formulation, fidelity=Pooled(600))
    whole = np.asarray(pooled_quality(pooled, display, viewing))
    for i in (0, 4095, 4096, 4999):
        one = jax.tree.map(lambda x, i=i: x[i] if x.ndim else x, (display, viewing))
        np.testing.assert_allclose(
            whole[i], pooled_quality(pooled, *one), 1e-11 if X64 else 2e-5
        )


@pytest.mark.parametrize("slopes", [False, True])
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_memory_does_not_grow_with_the_conditions(formulation, slopes):
    spectrum = texture()

    def total(velocity, luminance, refresh_rate):
        return quality(
            spectrum,
            Display(ppd=60.0, refresh_rate=refresh_rate, luminance=luminance),
            Viewing(velocity),
            formulation=formulation,
            fidelity=Pooled(5000),
        ).sum()

    function = jax.grad(total, (0, 1, 2)) if slopes else total

    def scratch(n):
        axis = jnp.linspace(0.1, 1.0, n)
        compiled = jax.jit(function).lower(axis, axis, axis).compile()
        return compiled.memory_analysis().temp_size_in_bytes

    # Beside a few numbers a condition; each node of each would take 80 times as much.
    assert scratch(200_000) - scratch(50_000) < 150_000 * 16 * 8


# ---- terms that were left out


@pytest.mark.parametrize("fidelity", [Exact(), Pooled(1000)])
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_terms_are_left_out_only_where_they_cannot_matter(formulation, fidelity):
    spectrum = texture()
    velocity = np.array([0.0, 0.3, 0.6, 3.0, 50.0])
    rate_x = np.array([[1.0], [0.25]])

    def of(persistence, **off):
        return distortion(
            spectrum,
            Display(**DISPLAY, persistence=persistence),
            Viewing(velocity),
            Shading(rate_x=rate_x),
            formulation=formulation,
            components=Components(**off),
            fidelity=fidelity,
        )

    parts = of(1.0)
    assert parts.fidelity == str(fidelity)
    judder = np.asarray(parts.evaluated.judder)
    # A still image has no replica in the band; the finer one reaches farther.
    assert not judder[:, 0].any() and judder[:, -1].all()
    assert (judder[0] >= judder[1]).all() and (judder[0] != judder[1]).any()
    assert (np.asarray(parts.evaluated.band)[0] == 256).all()
    np.testing.assert_array_equal(np.asarray(parts.temporal)[~judder], 0)
    assert (np.asarray(parts.temporal)[judder] > 0).all()
    assert np.asarray(parts.evaluated.eye_blur).all()
    assert np.asarray(parts.evaluated.vrs).all()

    # What eye blur is left out would have changed nothing.
    without = of(1.0, eye_blur=False)
    assert not np.asarray(without.evaluated.eye_blur).any()
    vanishing = of(1e-20)
    assert not np.asarray(vanishing.evaluated.eye_blur).any()
    np.testing.assert_array_equal(vanishing.spatial, without.spatial)
    some = of(1e-6)
    assert np.asarray(some.evaluated.eye_blur).all()

    none = of(1.0, vrs=False, judder=False)
    assert not np.asarray(none.evaluated.judder).any()
    assert not np.asarray(none.evaluated.vrs).any()


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_what_was_left_out_would_not_have_counted(formulation, monkeypatch):
    chain, spectrum = CHAIN[formulation], texture()
    velocity = np.geomspace(0.3, 30.0, 40)
    # Of a shape that no other test uses, or it would be compiled already.
    coarse = Shading(rate_x=0.25, rate_y=0.25)
    args = (spectrum, Display(**DISPLAY), Viewing(velocity), coarse)
    skipped = distortion(*args, formulation=formulation)
    assert 5 < np.asarray(skipped.evaluated.judder).sum() < 35
    assert (np.asarray(skipped.evaluated.band) < 75).all()

    whole_band = jnp.asarray(2)

    def everything(c):
        far = jnp.full_like(c.display.ppd, 1e9)
        return chain.terms_within(c, far, c.display.ppd, jnp.asarray(256))

    jax.clear_caches()
    monkeypatch.setattr(chain, "terms", everything)
    monkeypatch.setattr(chain, "band", lambda highest: whole_band)
    whole = distortion(*args, formulation=formulation)
    assert np.asarray(whole.evaluated.judder).all()
    rtol = 1e-14 if X64 else 1e-6
    np.testing.assert_allclose(skipped.temporal, whole.temporal, rtol, atol=1e-16)
    np.testing.assert_allclose(skipped.spatial, whole.spatial, rtol)
    jax.clear_caches()


# ---- the choice of a rung


def test_auto_takes_the_cheapest_rung_that_is_accurate_enough():
    args = (texture(), *scattered(100), Shading(rate_x=0.5))
    exact, taken = quality(*args), []
    for tolerance in (0.1, 0.03, 0.01):
        rung = Auto(tolerance)
        parts = distortion(*args, fidelity=rung)
        taken.append(parts.fidelity)
        ours = quality(*args, fidelity=rung)
        p = Parameters.published()
        np.testing.assert_array_equal(
            ours, p.ws * parts.spatial + p.wt * parts.temporal
        )
        assert float(jnp.abs(ours - exact).max()) <= tolerance
        assert error_estimate(*args, fidelity=rung) <= tolerance
    sizes = [int(name.split("=")[1].rstrip(")")) for name in taken]
    assert sizes == sorted(sizes) and sizes[0] < sizes[-1]
    # The next cheaper rung would not have done.
    rungs = Auto(0.01).rungs
    before = rungs[[str(r) for r in rungs].index(taken[-1]) - 1]
    assert error_estimate(*args, fidelity=before) > 0.01


def test_the_chosen_rung_can_be_used_under_transformations():
    spectrum, (display, viewing) = texture(), scattered(100)
    rung = choose_fidelity(spectrum, display, viewing, fidelity=Auto(0.1))
    assert isinstance(rung, Pooled)
    of = lambda v: quality(spectrum, display, Viewing(v), fidelity=rung)
    expected = quality(spectrum, display, viewing, fidelity=Auto(0.1))
    ours = jax.jit(of)(viewing.velocity)
    np.testing.assert_allclose(ours, expected, 1e-11 if X64 else 2e-5)


def test_auto_is_exact_where_nothing_else_will_do():
    args = (texture(), *scattered(100))
    assert distortion(*args, fidelity=Auto(0.0)).fidelity == "Exact()"
    assert error_estimate(*args, fidelity=Auto(0.0)) == 0
    few = (texture(), *scattered(5))
    assert distortion(*few, fidelity=Auto(0.5)).fidelity == "Exact()"


# ---- errors


@pytest.mark.parametrize("cells", [0, 399, 50_001, -5])
def test_cells_out_of_range(cells):
    with pytest.raises(ValueError, match=rf"`cells` must be .* got {cells}\."):
        Pooled(cells)


@pytest.mark.parametrize("tolerance", [-0.1, float("nan"), float("inf")])
def test_tolerance_out_of_range(tolerance):
    with pytest.raises(ValueError, match="`tolerance_jnd` must be finite and >= 0 JND"):
        Auto(tolerance)


def test_errors_are_estimated_outside_transformations():
    def of(velocity):
        return quality(
            texture(),
            Display(**DISPLAY | {"refresh_rate": np.linspace(30, 120, 50)}),
            Viewing(velocity),
            fidelity=Auto(0.1),
        )

    with pytest.raises(ValueError, match="outside JAX transformations"):
        jax.jit(of)(5.0)


@pytest.mark.parametrize("dtype", [jnp.bfloat16, jnp.float16])
def test_half_precision_is_refused(dtype):
    low = Spectrum(texture().amplitude.astype(dtype))
    args = (low, Display(**DISPLAY), Viewing(5.0))
    match = f"`spectrum` must be in float32 or float64, .* got {jnp.dtype(dtype)}"
    for call in (
        lambda: quality(*args),
        lambda: distortion(*args, fidelity=Pooled(1000)),
        lambda: pool(low),
        lambda: error_estimate(*args, fidelity=Pooled(1000)),
    ):
        with pytest.raises(ValueError, match=match):
            call()


def test_shapes_that_do_not_broadcast_are_named():
    with pytest.raises(ValueError, match=r"must broadcast together.*\(2,\).*\(3,\)"):
        quality(
            texture(),
            Display(**DISPLAY | {"ppd": np.arange(1, 3)}),
            Viewing(np.arange(3)),
            fidelity=Pooled(1000),
        )
