"""The forms of a polynomial: value, fit, slopes, description."""

import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from alsarr.tables import Conditions, Domain, Eq31, Eq31LogTravel, TensorPolynomial
from alsarr.tables._basis import basis_from


X64 = jax.config.read("jax_enable_x64")
DOMAIN = Domain(
    velocity=(0.0, 50.0), refresh_rate=(30.0, 120.0), log10_luminance=(-1.0, 2.5)
)
SHORTEST = 0.0078125
TENSOR = TensorPolynomial((3, 2, 3), SHORTEST)
BASES = [Eq31(), Eq31LogTravel(), TENSOR]
EVERY = [*BASES, Eq31("two-step")]
name = lambda basis: "-".join(map(str, basis.describe().values()))
each = pytest.mark.parametrize("basis", BASES, ids=name)
every = pytest.mark.parametrize("basis", EVERY, ids=name)

# Single precision loses three digits to the powers of f, up to 120^2.
RELATIVE = 1e-9 if X64 else 1e-4


def plain(ends):
    return [tuple(np.asarray(x, float)) for x in ends]


def design(basis, v, f, level, domain=DOMAIN):
    """What the coefficients of a tensor multiply, as its formula says."""
    ends = plain((domain.velocity, domain.refresh_rate, domain.log10_luminance))
    travel = lambda v, f: np.log(np.maximum(v / f, basis.shortest_travel))
    slow = travel(ends[0][0], ends[1][1])
    fast = travel(ends[0][1], ends[1][0])

    def chebyshev(x, low, high, degree):
        x = (2 * x - low - high) / (high - low) if high > low else 0 * x
        return np.polynomial.chebyshev.chebvander(x, degree)

    x = chebyshev(travel(v, f), slow, fast, basis.degrees[0])
    y = chebyshev(np.log(f), *np.log(ends[1]), basis.degrees[1])
    z = chebyshev(level, *ends[2], basis.degrees[2])
    return np.einsum("...i,...j,...k->...ijk", x, y, z).reshape(*v.shape, -1)


def by_hand(basis, c, v, f, level, domain=DOMAIN):
    """The value of each form from its description alone, in double precision."""
    c, v, f, level = (np.asarray(x, float) for x in (c, v, f, level))
    if isinstance(basis, TensorPolynomial):
        v, f, level = np.broadcast_arrays(v, f, level)
        return np.sum(c * design(basis, v, f, level, domain), axis=-1)
    w = np.moveaxis(c, -1, 0)
    if isinstance(basis, Eq31LogTravel):
        v = np.log(1 + v / f / 0.05)
    motion = w[0] + w[1] * v + w[2] * f + w[3] * v**2 + w[4] * v * f + w[5] * f**2
    return motion * (w[6] * level**3 + w[7] * level**2 + w[8] * level + w[9])


def conditions(v, f, level):
    return Conditions(*(jnp.asarray(x, float) for x in (v, f, level)))


def grid(v=(0.0, 0.5, 2.0, 8.0, 20.0, 50.0), f=(30, 55, 80, 105, 120), level=None):
    levels = (-1.0, 0.0, 1.0, 1.6, 2.1, 2.5) if level is None else level
    mesh = np.meshgrid(v, f, levels, indexing="ij")
    return conditions(*(x.ravel() for x in mesh))


def scattered(n=80, seed=3):
    rng = np.random.default_rng(seed)
    return conditions(
        rng.uniform(0, 50, n), rng.uniform(30, 120, n), rng.uniform(-1, 2.5, n)
    )


SIZES = np.array([1, 0.1, 0.01, 1e-3, 1e-3, 1e-4, 0.01, 0.1, 1, 1])


def drawn(basis, seed=0, shape=()):
    """Coefficients that make each term matter."""
    number = basis.num_coefficients
    c = np.random.default_rng(seed).normal(size=(*shape, number))
    return c if isinstance(basis, TensorPolynomial) else c * SIZES


def curved(at, seed=0):
    """Smooth qualities that no form can reproduce."""
    v, f, level = (np.asarray(x, float) for x in at)
    rng = np.random.default_rng(seed)
    blur = np.exp(-v * (60 / f) / rng.uniform(10, 40))
    light = 1 / (1 + np.exp(-rng.uniform(0.5, 2) * (level - rng.uniform(0, 1))))
    return 3 * blur * light + 0.3 * np.sin(v / 9 + f / 40 + level) + 1


@each
def test_value_is_the_formula_with_shapes_that_broadcast(basis):
    c = drawn(basis, shape=(5, 7))
    v = np.array([0, 0.2, 3.0, 20, 50])[:, None]
    f = np.array([30, 40, 60, 75, 90, 100, 120.0])[None]
    level = np.array([[1.5]])
    got = basis.evaluate(jnp.asarray(c), conditions(v, f, level), DOMAIN)
    assert got.shape == (5, 7) and got.dtype == jnp.result_type(float)
    expected = by_hand(basis, c, v, f, level)
    # Terms cancel: what counts is the size of the largest.
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12 if X64 else 3e-5)
    one = basis.evaluate(
        jnp.asarray(c[2, 3]), conditions(v[2, 0], f[0, 3], 1.5), DOMAIN
    )
    assert one.shape == ()
    np.testing.assert_allclose(one, expected[2, 3], rtol=0, atol=1e-12 if X64 else 3e-5)


@pytest.mark.parametrize("basis", [Eq31(), Eq31LogTravel()], ids=name)
def test_the_formula_of_eq31_can_be_typed_into_a_calculator(basis):
    formula, _, rest = basis.formula().partition(" with ")
    c = drawn(basis)
    known = {f"W{i}": w for i, w in enumerate(c)} | {"v": 7.0, "f": 60.0, "L": 1.25}
    calculator = lambda text: eval(
        text.partition("=")[2].replace("^", "**"), {"ln": np.log}, known
    )
    if rest:
        known["u"] = calculator(rest)
    expected = by_hand(basis, c, 7.0, 60.0, 1.25)
    np.testing.assert_allclose(calculator(formula), expected, rtol=1e-12)


def test_the_formula_of_a_tensor_names_its_setting():
    assert "shortest_travel_deg" in TENSOR.formula()
    assert "shortest_travel_deg" in TENSOR.describe()


@every
@settings(deadline=None, max_examples=15)
@given(st.integers(0, 2**32 - 1))
def test_a_member_of_the_family_is_recovered(basis, seed):
    at = grid()
    truth = drawn(basis, seed)
    quality = by_hand(basis, truth, *at)
    peak = np.abs(quality).max()
    if basis == Eq31("two-step"):
        # Its second factor divides by the first at rest, which must not nearly vanish.
        first = truth.copy()
        first[6:] = 0, 0, 0, np.polyval(truth[6:], 2.5)
        assume(abs(by_hand(basis, first, 0.0, 105.0, 0.0)) > 0.05 * peak)
    found = basis.fit(at, jnp.asarray(quality[None]), DOMAIN)
    assert found.shape == (1, basis.num_coefficients)
    # Between the samples too, so it is the same member.
    for where in (at, scattered()):
        got = by_hand(basis, found[0], *where)
        expected = by_hand(basis, truth, *where)
        np.testing.assert_allclose(got, expected, rtol=0, atol=10 * RELATIVE * peak)


@pytest.mark.parametrize("at", [grid(), scattered()], ids=["grid", "scattered"])
def test_a_tensor_is_fitted_by_least_squares(at):
    quality = np.stack([curved(at, seed) for seed in range(3)])
    found = TENSOR.fit(at, jnp.asarray(quality), DOMAIN)
    of = design(TENSOR, *(np.asarray(x, float) for x in at))
    best = np.linalg.lstsq(of, quality.T)[0]
    np.testing.assert_allclose(
        of @ np.asarray(found, float).T, of @ best, rtol=0, atol=1e-11 if X64 else 1e-4
    )
    assert np.abs(of @ best - quality.T).max() > 0.01


@pytest.mark.parametrize("basis", [Eq31(), Eq31LogTravel()], ids=name)
def test_eq31_on_a_grid_is_the_leading_singular_pair(basis):
    """A product of two linear factors on a grid is an approximation of rank one."""
    v = np.array([0.0, 0.5, 2, 8, 20, 50])
    f = np.array([30.0, 55, 80, 105, 120])
    level = np.array([-1.0, 0, 1, 1.6, 2.1, 2.5])
    quality = curved(grid())
    travel, rate = (x.ravel() for x in np.meshgrid(v, f, indexing="ij"))
    if isinstance(basis, Eq31LogTravel):
        travel = np.log(1 + travel / rate / 0.05)
    ones = np.ones_like(travel)
    motion = np.stack([ones, travel, rate, travel**2, travel * rate, rate**2], axis=1)
    left = np.linalg.qr(motion / np.abs(motion).max(axis=0))[0]
    right = np.linalg.qr(np.vander(level, 4))[0]
    within = left.T @ quality.reshape(len(travel), len(level)) @ right
    best = np.sum(quality**2) - np.linalg.svd(within)[1][0] ** 2
    found = basis.fit(grid(), jnp.asarray(quality[None]), DOMAIN)
    ours = np.sum((by_hand(basis, found[0], *grid()) - quality) ** 2)
    assert best > 0.1
    np.testing.assert_allclose(ours, best, rtol=1e-9 if X64 else 1e-3)


def test_two_steps_are_the_authors():
    """The surface at the highest luminance, then the share of it in the dark."""
    at = grid()
    v, f, level = (np.asarray(x, float) for x in at)
    quality = np.stack([curved(at, seed) for seed in range(3)])
    bright, still = level == 2.5, (v == 0) & (f == 105)
    ones = np.ones_like(v)
    motion = np.stack([ones, v, f, v**2, v * f, f**2], axis=1)
    found = Eq31("two-step").fit(at, jnp.asarray(quality), DOMAIN)
    for q, c in zip(quality, found, strict=True):
        surface = np.linalg.lstsq(motion[bright], q[bright])[0]
        at_rest = motion[still] @ surface
        light = np.polyfit(level[still], q[still] / at_rest, 3)
        expected = (motion @ surface) * np.polyval(light, level)
        got = by_hand(Eq31(), c, *at)
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-10 if X64 else 1e-3)
        joint = by_hand(Eq31(), Eq31().fit(at, jnp.asarray(q[None]), DOMAIN)[0], *at)
        # Which is what fitting both together is for.
        squares = lambda x, q=q: np.sum((x - q) ** 2)
        assert squares(joint) < 0.98 * squares(got)


def test_of_two_refresh_rates_as_near_to_105_hz_one_is_taken():
    at = grid(f=(30.0, 60.0, 100.0, 110.0))
    truth = drawn(Eq31())
    quality = by_hand(Eq31(), truth, *at)
    found = Eq31("two-step").fit(at, jnp.asarray(quality[None]), DOMAIN)
    np.testing.assert_allclose(
        by_hand(Eq31(), found[0], *at),
        quality,
        rtol=0,
        atol=10 * RELATIVE * np.abs(quality).max(),
    )


@each
def test_slopes_are_those_of_differences(basis):
    c = jnp.asarray(drawn(basis))
    names = ("velocity", "refresh_rate", "log10_luminance")
    at = {"velocity": 20.0, "refresh_rate": 70.0, "log10_luminance": 1.3}
    of = eqx.filter_jit(lambda x: basis.evaluate(x[3:], Conditions(*x[:3]), DOMAIN))
    x = jnp.concatenate([jnp.array([at[n] for n in names]), c])
    reverse, forward = jax.jit(jax.grad(of))(x), jax.jit(jax.jacfwd(of))(x)
    tolerance = 1e-10 if X64 else 1e-3
    np.testing.assert_allclose(reverse, forward, rtol=tolerance, atol=tolerance)
    value = lambda x: by_hand(basis, x[3:], *x[:3])
    x = np.asarray(x, float)
    steps = 1e-5 * np.maximum(np.abs(x), 1)
    differences = [
        (value(x + step) - value(x - step)) / (2 * size)
        for step, size in zip(np.diag(steps), steps, strict=True)
    ]
    np.testing.assert_allclose(
        reverse, differences, rtol=1e-6 if X64 else 2e-3, atol=1e-6 if X64 else 2e-3
    )
    assert (np.abs(reverse) > 1e-6).sum() > 10


@each
@pytest.mark.parametrize("v", [0.0, 50.0])
@pytest.mark.parametrize("f", [30.0, 120.0])
@pytest.mark.parametrize("level", [-1.0, 2.5])
def test_slopes_are_finite_at_rest_and_at_the_edges(basis, v, f, level):
    of = lambda c, at: basis.evaluate(c, Conditions(*at), DOMAIN)
    at = tuple(jnp.asarray(x) for x in (v, f, level))
    value, slope = jax.value_and_grad(of, argnums=(0, 1))(jnp.asarray(drawn(basis)), at)
    assert np.isfinite(value)
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(slope))


AXES = (
    (0.0, 0.5, 2.0, 8.0, 20.0, 50.0),
    (30.0, 55.0, 80.0, 105.0, 120.0),
    (-1.0, 0, 1, 1.6, 2.1, 2.5),
)


@every
@pytest.mark.parametrize("fixed", [0, 1, 2])
def test_an_axis_of_one_value_is_no_obstacle(basis, fixed):
    values = (5.0, 105.0, 1.6)
    axes, ends = list(AXES), [(0.0, 50.0), (30.0, 120.0), (-1.0, 2.5)]
    # As many samples as of the whole grid, so that the fit is not compiled anew.
    axes[fixed] = (values[fixed],) * len(axes[fixed])
    ends[fixed] = (values[fixed],) * 2
    domain = Domain(velocity=ends[0], refresh_rate=ends[1], log10_luminance=ends[2])
    at = grid(*axes)
    truth = np.abs(drawn(basis))
    quality = by_hand(basis, truth, *at, domain)
    found = basis.fit(at, jnp.asarray(quality[None]), domain)
    got = basis.evaluate(found, at, domain)
    peak = np.abs(quality).max()
    np.testing.assert_allclose(got, quality, rtol=0, atol=10 * RELATIVE * peak)


@every
def test_one_condition_alone_is_no_obstacle(basis):
    at = grid((0.0,), (60.0,), (2.0,))
    domain = Domain(velocity=(0, 0), refresh_rate=(60, 60), log10_luminance=(2, 2))
    found = basis.fit(at, jnp.array([[1.5], [0.0]]), domain)
    assert np.isfinite(found).all()
    got = basis.evaluate(found, at, domain)
    np.testing.assert_allclose(got, [1.5, 0], rtol=1e-6, atol=1e-6)


@every
@pytest.mark.parametrize("value", [0.0, -2.5])
def test_a_constant_is_the_same_everywhere(basis, value):
    c = basis.constant(value)
    assert c.shape == (basis.num_coefficients,)
    got = basis.evaluate(c[None], scattered(), DOMAIN)
    np.testing.assert_array_equal(got, np.full(80, value))


@every
def test_a_description_in_json_gives_the_basis_again(basis):
    described = json.loads(json.dumps(basis.describe()))
    again = basis_from(described)
    assert eqx.tree_equal(again, basis) is True
    assert described["name"] == basis.name


def test_descriptions_differ():
    assert len({json.dumps(basis.describe()) for basis in EVERY}) == len(EVERY)
    assert TensorPolynomial((2, 1, 0), 0.01).num_coefficients == 6


@pytest.mark.parametrize(
    "described, message",
    [
        ({"name": "spline"}, "`basis` must be one of eq31, .*, got 'spline'"),
        ({}, "`basis` must be one of eq31, .*, got None"),
        ({"name": "eq31", "degree": 2}, "must have the settings of eq31, got"),
        ({"name": "eq31-log-travel", "method": "joint"}, "settings of eq31-log"),
        ({"name": "tensor", "degrees": [1, 1, 1]}, "must have the settings of tensor"),
        ({"name": "tensor", "shortest_travel_deg": 0.1}, "the settings of tensor"),
        (
            TENSOR.describe() | {"method": "joint"},
            "must have the settings of tensor, got .*'method'",
        ),
        # Types are checked in tests alone, and then before the value.
        (
            {"name": "eq31", "method": "best"},
            "`method` must be joint or two-step|must have the settings of eq31",
        ),
        (
            TENSOR.describe() | {"degrees": [3, -1, 2]},
            r"`degrees` must be three whole numbers >= 0, got \(3, -1, 2\)",
        ),
        (
            TENSOR.describe() | {"shortest_travel_deg": 0.0},
            "`shortest_travel` must be > 0 deg and finite, got 0",
        ),
        (
            TENSOR.describe() | {"shortest_travel_deg": float("inf")},
            "`shortest_travel` must be > 0 deg and finite, got inf",
        ),
    ],
)
def test_what_is_no_basis(described, message):
    with pytest.raises(ValueError, match=message):
        basis_from(described)
