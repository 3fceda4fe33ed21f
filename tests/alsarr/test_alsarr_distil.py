"""Samples made into tables: which form, how good, and what is left out."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr import RATES
from alsarr.tables import (
    _domain,
    Conditions,
    distil,
    Domain,
    Eq31,
    Eq31LogTravel,
    Form,
    forms,
    Grid,
    QualityTables,
    sample,
    Samples,
    Scene,
    TensorPolynomial,
)
from alsarr.tables._certificate import percentiles
from alsarr.tables._domain import held_out
from camojab import Display, Exact, quality, Shading, Spectrum, Viewing


X64 = jax.config.read("jax_enable_x64")
PPD = 60.0
TENSOR = TensorPolynomial((3, 2, 3), 0.5 / PPD)
SMALL = TensorPolynomial((1, 1, 1), 0.5 / PPD)
DOMAIN = Domain()
GRID = Grid.over(DOMAIN, (7, 5, 5))
# Samples are in single precision; the powers of f in Eq. 31 lose three more digits.
ATOL = 1e-6 if X64 else 2e-4


def loss(texture, level, rate, direction, at):
    """Smooth qualities below 0 that no form can reproduce. [JND]."""
    v, f, light = (np.asarray(x, float) for x in at)
    width = int(rate.split("x")[direction if "x" in rate else 0])
    coarse = (width - 0.9) * (1.2 if direction else 1.0) * 2.0**-level
    seen = 1 / (1 + np.exp(-1.5 * (light - 0.3)))
    blur = np.exp(-(v / f) * (20 + 5 * texture))
    return -coarse * seen * (0.2 + blur) * (1 + 0.4 * texture) - 0.3 * v / f


def drawn(scene=None, rates=RATES.names, grid=GRID, size=None):
    """What `sample` makes, of a model that is known; `size` of each texture."""
    scene = scene or Scene.every(2, (0, 1))
    chosen, tried = grid.conditions(), held_out(scene.domain)
    every = Conditions(*(jnp.concatenate(x) for x in zip(chosen, tried, strict=True)))
    size = size or [1.0] * scene.num_textures
    found = [
        [[size[t] * loss(t, level, rate, d, every) for d in range(2)] for rate in rates]
        for t, level in scene.pairs
    ]
    names = ("brick", "grass", "sky", "wood")[: scene.num_textures]
    return Samples(
        np.float32(found), chosen, tried, scene, rates, names, PPD, "a drawn model"
    )


looked_up = eqx.filter_jit(QualityTables.quality)


def value(basis, c, at):
    """A polynomial from its description alone; `c` [..., 1, c], conditions [n]."""
    v, f, light = (np.asarray(x, float) for x in at)
    c = np.asarray(c, float)[..., None, :]
    if isinstance(basis, TensorPolynomial):
        travel = lambda v, f: np.log(np.maximum(v / f, basis.shortest_travel))
        to_one = lambda x, low, high: (2 * x - low - high) / (high - low)
        (v0, v1), (f0, f1), ends = ((x[0], x[1]) for x in jax.tree.leaves(DOMAIN))
        axes = (
            to_one(
                travel(v, f),
                travel(float(v0), float(f1)),
                travel(*map(float, (v1, f0))),
            ),
            to_one(np.log(f), np.log(float(f0)), np.log(float(f1))),
            to_one(light, *map(float, ends)),
        )
        chebyshev = np.polynomial.chebyshev.chebvander
        parts = [chebyshev(x, d) for x, d in zip(axes, basis.degrees, strict=True)]
        return np.sum(c * np.einsum("ni,nj,nk->nijk", *parts).reshape(v.size, -1), -1)
    w = [c[..., i] for i in range(10)]
    if isinstance(basis, Eq31LogTravel):
        v = np.log(1 + v / f / 0.05)
    motion = w[0] + w[1] * v + w[2] * f + w[3] * v**2 + w[4] * v * f + w[5] * f**2
    return motion * (w[6] * light**3 + w[7] * light**2 + w[8] * light + w[9])


def relative(samples, relative_to):
    """Qualities under the conditions of the fit and under those held out."""
    q = samples.quality
    if relative_to is not None:
        q = q - q[:, [samples.rates.index(relative_to)]]
    n = samples.grid.velocity.size
    return q[..., :n].astype(float), q[..., n:].astype(float)


def statistics(error):
    """Largest, 99th percentile and median, each the error of some condition."""
    error = np.sort(error, axis=-1)
    n = error.shape[-1]
    return error[..., -1], error[..., int(np.ceil(0.99 * n))], error[..., n // 2]


BASES = [Eq31(), Eq31("two-step"), Eq31LogTravel(), TENSOR]


@pytest.mark.parametrize("directions", ["separate", "shared"])
@pytest.mark.parametrize(
    "basis", BASES, ids=lambda b: "-".join(map(str, b.describe().values()))
)
def test_the_certificate_is_of_the_errors_that_are_made(basis, directions):
    samples = drawn()
    made = distil(samples, Form(basis, directions))
    ways = 1 if directions == "shared" else 2
    assert made.coefficients.shape == (4, 7, ways, basis.num_coefficients)
    _, tried = relative(samples, "4x4")
    error = np.abs(value(basis, made.coefficients, samples.held_out) - tried)
    per_polynomial = error if ways == 2 else error.reshape(4, 7, 1, -1)
    of = made.certificate
    got = (of.largest, of.percentile_99, of.median)
    for ours, theirs in zip(got, statistics(per_polynomial), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=ATOL)
    overall = np.stack(statistics(error[:, 1:].ravel()))
    np.testing.assert_allclose(of.overall, overall, rtol=0, atol=ATOL)
    assert made.largest_error == of.largest.max() and made.meets is None
    # Of a useful fit, of which there is something to tell.
    assert overall[0] > 0.01 and overall[2] < 0.1 * np.abs(tried).max()
    np.testing.assert_array_equal(of.sample.velocity, samples.held_out.velocity)


@pytest.mark.parametrize("basis", [SMALL, TENSOR], ids=["small", "tensor"])
def test_polynomials_are_least_squares_over_the_grid(basis):
    """Of both directions together where they share one."""
    samples = drawn()
    fitted, _ = relative(samples, "4x4")
    unit = jnp.eye(basis.num_coefficients)
    design = np.stack([value(basis, row, samples.grid) for row in unit], axis=1)
    design = design.reshape(fitted.shape[-1], -1)
    for directions in ("separate", "shared"):
        made = distil(samples, Form(basis, directions))
        got = value(basis, made.coefficients, samples.grid)
        target = (
            fitted.mean(axis=2, keepdims=True) if directions == "shared" else fitted
        )
        best = np.linalg.lstsq(design, target.reshape(-1, len(design)).T)[0]
        expected = (design @ best).T.reshape(got.shape)
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-6 if X64 else 1e-4)


def test_eq31_with_separate_directions_is_the_default():
    samples = drawn(Scene.every(1, (0,)))
    made = distil(samples)
    assert eqx.tree_equal(made.basis, Eq31()) and made.coefficients.shape[2] == 2
    assert made.tolerance_jnd is None and made.relative_to == "4x4"
    assert (made.rates, made.texture_names) == (RATES.names, ("brick",))
    assert made.model == "a drawn model"
    assert eqx.tree_equal(made.domain, samples.scene.domain)


@pytest.fixture(scope="module")
def plain():
    """Samples, and two forms with the largest error of each."""
    samples = drawn(Scene.every(2, (0,)))
    cheap, dear = Form(SMALL), Form(TENSOR)
    errors = [float(distil(samples, f).largest_error) for f in (cheap, dear)]
    assert errors[1] < 0.8 * errors[0]
    return samples, (cheap, dear), errors


def test_the_cheapest_form_that_is_good_enough_is_taken(plain):
    samples, given, (of_cheap, of_dear) = plain
    for tolerance, expected, tried in [
        (1.01 * of_cheap, SMALL, [(0, 2), (2, 2)]),
        (0.99 * of_cheap, TENSOR, [(0, 2), (1, 2), (2, 2)]),
        (1.01 * of_dear, TENSOR, [(0, 2), (1, 2), (2, 2)]),
    ]:
        seen = []
        progress = lambda *n, to=seen: to.append(n)
        made = distil(samples, given, tolerance_jnd=tolerance, progress=progress)
        assert eqx.tree_equal(made.basis, expected) and made.meets is True
        assert made.tolerance_jnd == tolerance and seen == tried


def test_where_none_is_good_enough_the_most_accurate_says_so(plain):
    samples, given, (_, of_dear) = plain
    for order in (given, given[::-1]):
        made = distil(samples, order, tolerance_jnd=0.5 * of_dear)
        assert eqx.tree_equal(made.basis, TENSOR) and made.meets is False
        np.testing.assert_allclose(made.largest_error, of_dear, rtol=1e-6)


def test_one_form_with_a_tolerance_is_tried_alone(plain):
    samples, given, (of_cheap, _) = plain
    made = distil(samples, given[0], tolerance_jnd=0.5 * of_cheap)
    assert eqx.tree_equal(made.basis, SMALL) and made.meets is False


def test_the_forms_to_choose_from_become_dearer_and_fit_the_display():
    cost = [form.cost for form in forms(PPD)]
    assert cost == sorted(cost) and cost[0] == 10
    assert Form(Eq31()).cost == 20 and Form(SMALL, "shared").cost == 8
    tensors = [f.basis for f in forms(PPD) if isinstance(f.basis, TensorPolynomial)]
    assert {b.shortest_travel for b in tensors} == {0.5 / PPD}
    made = distil(drawn(Scene.every(1, (0,))), tolerance_jnd=2.0)
    assert made.meets and made.coefficients.shape[2:] == (1, 10)
    assert eqx.tree_equal(made.basis, Eq31LogTravel())


def flat_and_not(tolerance, **changes):
    """The second of three textures hardly changes; the third does not occur."""
    scene = Scene(3, ((0, 0.0), (0, 1.0), (1, 0.0), (1, 2.0)), DOMAIN)
    samples = drawn(scene, size=[1.0, 0.01, 1.0])
    return samples, distil(samples, Form(TENSOR), tolerance_jnd=tolerance, **changes)


def test_a_flat_texture_becomes_one_constant():
    samples, made = flat_and_not(0.5)
    assert made.constant.tolist() == [False, False, True]
    assert made.count == 2 * 7 * 2 * 48 + 1
    np.testing.assert_array_equal(made.entry, [[0, 1, 1], [2, 2, 2], [-1, -1, -1]])
    np.testing.assert_array_equal(made.occurs, [[1, 1, 0], [1, 0, 1], [0, 0, 0]])
    _, tried = relative(samples, "4x4")
    apart = np.abs(tried[2:])
    # It is worse than a constant of 0 by what it really is.
    np.testing.assert_allclose(
        made.certificate.largest[2], apart.max(axis=(0, 3)), rtol=1e-6
    )
    assert 0 < made.certificate.largest[2].max() < 0.1
    both = np.concatenate(
        [
            np.abs(value(TENSOR, made.coefficients[:2], samples.held_out) - tried[:2])[
                :, 1:
            ].ravel(),
            apart[:, 1:].ravel(),
        ]
    )
    np.testing.assert_allclose(
        made.certificate.overall, statistics(both), rtol=0, atol=ATOL
    )
    assert made.meets is True
    # The same as the polynomials would be alone.
    alone = distil(samples, Form(TENSOR))
    assert alone.constant.tolist() == [False] * 4
    np.testing.assert_allclose(
        made.coefficients[:2],
        alone.coefficients[:2],
        rtol=0,
        atol=1e-9 if X64 else 1e-4,
    )


def test_of_the_models_own_quality_the_constant_is_the_middle():
    samples, made = flat_and_not(0.5, relative_to=None)
    own = samples.quality[2:]
    middle = (own.min() + own.max()) / 2
    assert made.constant.tolist() == [False, False, True]
    np.testing.assert_allclose(made.coefficients[2, :, :, 0], middle, rtol=1e-5)
    np.testing.assert_array_equal(made.coefficients[2, :, :, 1:], 0)
    at = lambda x: jnp.full(1, x)
    got = looked_up(
        made, jnp.array([1]), at(1.0), at(3.0), at(9.0), at(50.0), jnp.array(60.0)
    )
    np.testing.assert_allclose(got, middle * np.ones((1, 7)), rtol=1e-5)
    assert made.certificate.largest[2].max() <= 0.5


def test_all_textures_may_be_flat():
    scene = Scene.every(2, (0, 1))
    samples = drawn(scene, size=[0.01, 0.02])
    made = distil(samples, tolerance_jnd=0.5)
    assert made.constant.tolist() == [True, True] and made.count == 2
    np.testing.assert_array_equal(made.entry, [[0, 0], [1, 1]])
    assert made.meets is True
    _, tried = relative(samples, "4x4")
    np.testing.assert_allclose(made.largest_error, np.abs(tried).max(), rtol=1e-6)
    at = lambda x: jnp.full(2, x)
    got = looked_up(
        made, jnp.arange(2), at(0.0), at(9.0), at(9.0), at(50.0), jnp.array(60.0)
    )
    np.testing.assert_array_equal(got, 0)


def test_no_texture_is_flat_beyond_the_tolerance():
    samples = drawn(Scene.every(1, (0,)), size=[0.01])
    fitted, tried = relative(samples, "4x4")
    most = np.abs(np.concatenate([fitted, tried], -1)).max()
    of = lambda tolerance: distil(
        samples, Form(SMALL), tolerance_jnd=float(tolerance)
    ).constant.tolist()
    assert of(1.001 * most) == [True] and of(0.999 * most) == [False]


def test_qualities_are_relative_to_the_rate_that_is_named():
    samples = drawn(Scene.every(1, (0,)))
    for name in ("2x2", "1x1", None):
        made = distil(samples, Form(TENSOR), relative_to=name)
        assert made.relative_to == name
        fitted, tried = relative(samples, name)
        got = value(TENSOR, made.coefficients, samples.held_out)
        np.testing.assert_allclose(
            got - tried, 0, rtol=0, atol=float(made.largest_error) + ATOL
        )
        zero = [name == rate for rate in RATES.names]
        np.testing.assert_array_equal((got == 0).all(axis=(0, 2, 3)), zero)
        np.testing.assert_array_equal(
            (np.asarray(made.certificate.largest) == 0).all(axis=(0, 2)), zero
        )


def test_some_rates_alone_are_as_they_are_among_all():
    scene = Scene.every(1, (0,))
    some = ("4x4", "2x2", "1x1")
    whole = distil(drawn(scene), Form(TENSOR))
    few = distil(drawn(scene, rates=some), Form(TENSOR))
    assert few.rates == some and few.relative_to == "4x4"
    at = {
        "texture": jnp.zeros(3, int),
        "mip_level": jnp.zeros(3),
        "velocity_x": jnp.array([0.0, 7.0, 50.0]),
        "velocity_y": jnp.array([3.0, 9.0, 0.0]),
        "luminance": jnp.array([1.0, 50.0, 300.0]),
        "refresh_rate": jnp.array(60.0),
    }
    # 2x4 and 4x2 become 2x2; 1x2 and 2x1 become 1x1.
    stand_in = [0, 3, 3, 3, 6, 6, 6]
    np.testing.assert_allclose(
        looked_up(few, **at),
        looked_up(whole, **at)[:, np.array(stand_in)],
        rtol=0,
        atol=1e-9 if X64 else 1e-4,
    )


def test_separable_tables_have_three_sides_and_serve_seven_rates():
    scene = Scene.every(1, (0,))
    samples = drawn(scene, rates=("4", "2", "1"))
    made = distil(samples, Form(TENSOR))
    assert (made.rates, made.relative_to) == (("4", "2", "1"), "4")
    assert made.coefficients.shape == (1, 3, 2, 48)
    v = jnp.array([7.0])
    got = looked_up(
        made, jnp.array([0]), jnp.zeros(1), v, 2 * v, jnp.array([50.0]), jnp.array(60.0)
    )
    by_side = [
        [
            value(TENSOR, made.coefficients[0, k, d], ([u], [60.0], [np.log10(50)]))
            for k in range(3)
        ]
        for d, u in enumerate((7.0, 14.0))
    ]
    side = {"4": 0, "2": 1, "1": 2}
    for k, name in enumerate(RATES.names):
        x, y = name.split("x")
        expected = (by_side[0][side[x]] + by_side[1][side[y]]) / 2
        np.testing.assert_allclose(got[0, k], expected.item(), atol=ATOL)
    # The drawn model is itself separable, so the seven are as if sampled themselves.
    seven = looked_up(
        distil(drawn(scene), Form(TENSOR)),
        jnp.array([0]),
        jnp.zeros(1),
        v,
        2 * v,
        jnp.array([50.0]),
        jnp.array(60.0),
    )
    np.testing.assert_allclose(got, seven, rtol=0, atol=1e-5 if X64 else 1e-4)


def test_what_a_scene_leaves_out_is_nearest_and_outside():
    scene = Scene(2, ((1, 1.0), (1, 3.0)), DOMAIN)
    made = distil(drawn(scene), Form(SMALL))
    assert made.holds(jnp.array([0, 1])).tolist() == [False, True]
    at = lambda level: (
        jnp.array([1]),
        jnp.array([level]),
        *(jnp.array([x]) for x in (7.0, 3.0, 50.0)),
        jnp.array(60.0),
    )
    for level, nearest, outside in [
        (0.0, 1.0, True),
        (1.0, 1.0, False),
        (2.0, 1.0, False),
        (3.2, 3.0, False),
        (6.0, 3.0, True),
    ]:
        np.testing.assert_array_equal(
            looked_up(made, *at(level)), looked_up(made, *at(nearest))
        )
        assert made.outside(*at(level)).tolist() == [outside]


def test_percentiles_are_errors_that_were_made():
    error = np.random.default_rng(0).permutation(np.arange(1, 201.0))
    assert percentiles(error).tolist() == [200, 199, 101]
    assert percentiles(np.array([3.0])).tolist() == [3, 3, 3]
    assert percentiles(error.reshape(2, 100)).shape == (2, 3)


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"tolerance_jnd": 0.0}, "`tolerance_jnd` must be > 0 JND, got 0"),
        ({"tolerance_jnd": -1.0}, "`tolerance_jnd` must be > 0 JND, got -1"),
        ({"tolerance_jnd": float("nan")}, "`tolerance_jnd` must be > 0 JND, got nan"),
        ({"relative_to": "3x3"}, "`relative_to` must be one of 4x4, .* or None, .*3x3"),
        (
            {"form": (Form(Eq31()), Form(TENSOR))},
            "`form` must be one without a tolerance, got 2 forms",
        ),
        ({"form": (), "tolerance_jnd": 1.0}, "got 0 forms"),
        ({"constraint": "gain", "relative_to": None}, "must be monotone .* got gain"),
        (
            {"constraint": "monotone", "relative_to": "1x1"},
            "the coarsest rate or .*1x1",
        ),
    ],
)
def test_what_cannot_be_distilled(changes, message):
    from alsarr.tables import Constraint

    if "constraint" in changes:
        changes = changes | {"constraint": Constraint(changes["constraint"])}
    with pytest.raises(ValueError, match=message):
        distil(drawn(Scene.every(1, (0,))), **changes)


def test_samples_are_not_changed():
    samples = drawn(Scene.every(1, (0,)))
    before = samples.quality.copy()
    distil(samples, Form(TENSOR), tolerance_jnd=0.01)
    np.testing.assert_array_equal(samples.quality, before)
    assert [f.name for f in dataclasses.fields(samples)][0] == "quality"


def test_the_largest_errors_are_those_against_the_exact_model(monkeypatch):
    """Direction y is the transposed texture with the sides of the pixel swapped."""
    # Fewer conditions of the exact model, which takes its time.
    monkeypatch.setattr(_domain, "_HELD_OUT", 64)
    image = np.random.default_rng(4).random((512, 512))
    image *= np.linspace(0, 1, 512)[:, None]
    image[::2] *= 0.5
    spectrum = Spectrum.from_texture(image)
    rates = ("4x4", "2x1", "1x1")
    samples = sample(
        {"ramp": spectrum},
        Scene.every(1, (1,)),
        ppd=PPD,
        rates=rates,
        grid=Grid.over(DOMAIN, (5, 4, 4)),
        fidelity=Exact(),
    )
    made = distil(samples, Form(TENSOR))
    _, tried = relative(samples, "4x4")
    fitted = value(TENSOR, made.coefficients, samples.held_out)
    worst = np.abs(fitted - tried)[0].argmax(axis=-1)
    for k, name in [(1, "2x1"), (2, "1x1")]:
        for direction in range(2):
            at = [np.asarray(x)[worst[k, direction]] for x in samples.held_out]
            sides = [1 / int(side) for side in name.split("x")]
            of = Spectrum.from_texture(image.T) if direction else spectrum
            x, y = sides[::-1] if direction else sides
            exact = quality(
                of,
                Display(ppd=PPD, refresh_rate=at[1], luminance=10 ** at[2]),
                Viewing(at[0]),
                Shading(
                    rate_x=np.array([x, 0.25]),
                    rate_y=np.array([y, 0.25]),
                    mip_level=1.0,
                ),
            )
            gain = float(exact[0] - exact[1])
            error = abs(fitted[0, k, direction, worst[k, direction]] - gain)
            np.testing.assert_allclose(
                made.certificate.largest[0, k, direction],
                error,
                rtol=0,
                atol=2e-5 if X64 else 2e-3,
            )
            assert error > 0.01
