"""Fits that keep an order against independent solvers, and what they keep."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import minimize, nnls

from alsarr.tables._constrained import (
    _Grids,
    _Order,
    _Problem,
    _raised_product,
    fit_constrained_linear,
    fit_constrained_product,
)


X64 = jax.config.jax_enable_x64

# The seven rates but the coarsest, to which all are relative, as indices.
MONOTONE = ((0, -1), (1, -1), (2, 0), (2, 1), (3, 2), (4, 2), (5, 3), (5, 4))
GAIN = tuple((k, -1) for k in range(6))
# The same of qualities relative to no rate.
ABSOLUTE = tuple((better + 1, worse + 1) for better, worse in MONOTONE)
MARGIN = 1e-4

# What the splitting may leave in the root of the mean square. [JND].
SPLIT = 3e-4


def axes(*sizes):
    """Chebyshev's points of three axes, as samples and grids of tables have them."""
    points = [-np.cos(np.arange(n) * np.pi / (n - 1)) for n in sizes]
    return [x.ravel() for x in np.meshgrid(*points, indexing="ij")]


def monomials(v, f, level):
    """The two factors of Eq. 31."""
    one = np.ones_like(v)
    motion = np.stack([one, v, f, v * v, v * f, f * f], axis=1)
    return motion, np.stack([level**3, level**2, level, one], axis=1)


def orthonormal(samples, grid):
    """The same functions in combinations that are orthonormal over the samples."""
    q, r = np.linalg.qr(samples)
    return q, grid @ np.linalg.inv(r)


def arrays(*of):
    return tuple(jnp.asarray(x, float) for x in of)


@pytest.fixture(scope="module")
def factors():
    at, everywhere = monomials(*axes(7, 5, 4)), monomials(*axes(9, 7, 5))
    (motion, gm), (light, gl) = map(orthonormal, at, everywhere)
    return arrays(motion, light, gm, gl)


@pytest.fixture(scope="module")
def polynomial():
    """Products of degrees (2, 1, 1): 12 coefficients, 140 samples, 315 places."""

    def design(v, f, level):
        every = [
            v**i * f**j * level**k for i in (0, 1, 2) for j in (0, 1) for k in (0, 1)
        ]
        return np.stack(every, axis=1)

    return arrays(design(*axes(7, 5, 4)), design(*axes(9, 7, 5)))


def noisy(seed, rates=6, size=1.0):
    """Qualities that rise with the rate on the whole, but not everywhere."""
    rng = np.random.default_rng(seed)
    v, f, level = axes(7, 5, 4)
    shape = rng.normal(size=(rates, 6)) @ np.stack(
        [v, f, level, v * f, v * level, v**2]
    ) + 0.2 * rng.normal(size=(rates, v.size))
    rise = np.linspace(0.5, 2.0, rates)[:, None]
    return jnp.asarray(size * (rise + shape), float)


def rows_of(order, rates):
    with_none = np.eye(rates + 1)[:, :rates]
    return np.stack([with_none[f] - with_none[c] for f, c in order])


def least(values, order):
    """Smallest difference of any pair, as a reader in single precision has it."""
    single = np.asarray(values, np.float32).astype(float)
    return (rows_of(order, single.shape[-2]) @ single).min()


def nearest_point(design, target, grid, order, margin):
    """The sum of squares of the exact solution: least distance by SciPy's `nnls`.

    Lawson and Hanson 1974, ch. 23.4, in coordinates where the distance is Euclidean.
    """
    rates, p = target.shape[0], design.shape[1]
    q, r = np.linalg.qr(design)
    free = (target @ q).ravel()
    places = grid @ np.linalg.inv(r)
    bounds = np.einsum("rk,mp->rmkp", rows_of(order, rates), places)
    bounds = bounds.reshape(-1, rates * p)
    lacks = margin - bounds @ free
    system = np.vstack([bounds.T, lacks[None, :]])
    unit = np.append(np.zeros(rates * p), 1.0)
    pull, _ = nnls(system, unit, maxiter=100_000)
    rest = system @ pull - unit
    moved = -rest[:-1] / rest[-1]
    outside = ((target - target @ q @ q.T) ** 2).sum()
    return outside + (moved**2).sum()


# ---- linear


@pytest.mark.parametrize("order, seed", [(MONOTONE, 0), (GAIN, 1), (MONOTONE, 2)])
def test_linear_is_the_nearest_that_keeps_the_order(polynomial, order, seed):
    design, grid = polynomial
    target = noisy(seed)
    found = fit_constrained_linear(design, target, grid, order, MARGIN)
    assert least(found @ grid.T, order) > 0
    squares = ((np.asarray(found @ design.T - target, float)) ** 2).sum()
    exact = nearest_point(
        *(np.asarray(x, float) for x in (design, target, grid)), order, MARGIN
    )
    free = np.linalg.lstsq(np.asarray(design), np.asarray(target).T)[0].T
    assert least(free @ np.asarray(grid).T, order) < -0.1
    root = lambda s: np.sqrt(s / target.size)
    assert -SPLIT < root(squares) - root(exact) < SPLIT
    np.testing.assert_allclose(squares, exact, rtol=1e-3)


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-3, 1.0, 30.0]))
def test_linear_keeps_any_order_of_anything(polynomial, seed, size):
    design, grid = polynomial
    target = noisy(seed, size=size)
    for order in (MONOTONE, GAIN):
        found = fit_constrained_linear(design, target, grid, order, MARGIN)
        assert np.isfinite(found).all()
        assert least(found @ grid.T, order) > 0


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_linear_returns_what_keeps_the_order(polynomial, seed):
    design, grid = polynomial
    c = np.random.default_rng(seed).normal(size=(6, design.shape[1]))
    # Each rises above all those before it by 0.01 JND where it comes closest.
    values = c @ np.asarray(grid, float).T
    for k in range(6):
        before = values[k - 1] if k else 0.0
        lift = 0.01 + max(0.0, (before - values[k]).max())
        c[k, 0] += lift
        values[k] += lift
    target = jnp.asarray(c, float) @ design.T
    found = fit_constrained_linear(design, target, grid, MONOTONE, MARGIN)
    np.testing.assert_allclose(found @ design.T, target, atol=1e-9 if X64 else 1e-4)


def test_linear_tables_are_those_one_by_one(polynomial):
    design, grid = polynomial
    targets = jnp.stack([noisy(0), noisy(1), jnp.zeros_like(noisy(0))])
    fit = lambda t: fit_constrained_linear(design, t, grid, MONOTONE, MARGIN)
    together = fit(targets)
    assert together.shape == (3, 6, 12)
    for one, target in zip(together, targets, strict=True):
        np.testing.assert_allclose(one, fit(target), atol=1e-9 if X64 else 1e-4)
    # 0 everywhere breaks a margin: each rate is raised by as many as it is above.
    largest = np.abs(np.asarray(together[2] @ grid.T)).max()
    assert largest < 4.5 * MARGIN + 4 * SPLIT


def test_linear_without_what_samples_determine(polynomial):
    design, grid = polynomial
    # One level only: half of the coefficients have no effect on the samples.
    level = np.asarray(design)[:, 1]
    chosen = np.flatnonzero(level == level.max())
    target = noisy(3)[:, chosen]
    there = np.asarray(grid)[:, 1] == np.asarray(grid)[:, 1].max()
    places = grid[np.flatnonzero(there)]
    found = fit_constrained_linear(design[chosen], target, places, MONOTONE, MARGIN)
    assert np.isfinite(found).all()
    assert least(found @ places.T, MONOTONE) > 0


# ---- products


def product(a, b, motion, light):
    return (a @ motion.T) * (b @ light.T)


def alike(seed, rates=6):
    """Qualities whose rates gain and lose alike, as a texture's do, and some noise."""
    rng = np.random.default_rng(seed)
    v, f, level = axes(7, 5, 4)
    share = np.cumsum(rng.uniform(0.1, 0.5, rates))[:, None]
    gain = (1 + 0.6 * v - 0.3 * f) * (1.5 + level) ** 2
    loss = np.exp(2 * (-v - 1 + f)) * (1 + 0.5 * level)
    q = share * gain - 0.5 * share**1.5 * loss + 0.05 * rng.normal(size=(rates, v.size))
    return jnp.asarray(q, float)


class Joint:
    """Both factors together for SciPy's `minimize`, in double precision."""

    def __init__(self, factors, target, order):
        self.m, self.l, self.gm, self.gl = (np.asarray(x, float) for x in factors)
        self.target = np.asarray(target, float)
        self.pairs = rows_of(order, len(target))

    def split(self, x):
        a = 6 * len(self.target)
        return x[:a].reshape(-1, 6), x[a:].reshape(-1, 4)

    def squares(self, x):
        a, b = self.split(x)
        rest = product(a, b, self.m, self.l) - self.target
        of_a = 2 * (rest * (b @ self.l.T)) @ self.m
        of_b = 2 * (rest * (a @ self.m.T)) @ self.l
        return (rest**2).sum(), np.concatenate([of_a.ravel(), of_b.ravel()])

    def keeps(self, x):
        values = product(*self.split(x), self.gm, self.gl)
        return (self.pairs @ values - MARGIN).ravel()

    def slopes(self, x):
        a, b = self.split(x)
        of_a = np.einsum("rk,km,md->rmkd", self.pairs, b @ self.gl.T, self.gm)
        of_b = np.einsum("rk,km,md->rmkd", self.pairs, a @ self.gm.T, self.gl)
        rows = self.pairs.shape[0] * len(self.gm)
        return np.hstack([of_a.reshape(rows, -1), of_b.reshape(rows, -1)])

    def improved(self, start):
        """A local optimum from there; places come in as they turn out to bind."""
        close = np.flatnonzero(self.keeps(start) < 0.02)
        x = start
        for _ in range(20):
            bounds = {
                "type": "ineq",
                "fun": lambda x, close=close: self.keeps(x)[close],
                "jac": lambda x, close=close: self.slopes(x)[close],
            }
            x = minimize(
                self.squares,
                x,
                jac=True,
                method="SLSQP",
                constraints=[bounds],
                options={"maxiter": 60, "ftol": 1e-9},
            ).x
            broken = np.flatnonzero(self.keeps(x) < -1e-6)
            if not broken.size:
                return x
            close = np.union1d(close, broken)
        raise AssertionError("the places that bind were not found")


@pytest.mark.parametrize(
    "order, target, stalled",
    # One factor after the other stalls where bounds would have both move at once: not
    # at all if each rate is bound by itself, and the more the less rates are alike.
    [
        (GAIN, noisy(1), 1e-4),
        (MONOTONE, alike(0), 5e-3),
        (MONOTONE, alike(1), 5e-3),
        (ABSOLUTE, alike(2, 7) - 3.0, 3e-2),
    ],
)
def test_no_better_product_is_near(factors, order, target, stalled):
    motion, light, gm, gl = factors
    a, b = fit_constrained_product(motion, light, target, gm, gl, order, MARGIN)
    assert least(product(a, b, gm, gl), order) > 0
    np.testing.assert_allclose(jnp.max(jnp.abs(b @ gl.T), axis=1), 1, rtol=1e-5)
    joint = Joint(factors, target, order)
    start = np.concatenate([np.asarray(x, float).ravel() for x in (a, b)])
    found, best = joint.squares(start)[0], joint.squares(joint.improved(start))[0]
    assert (1 - 1e-5) * best < found < (1 + stalled) * best


def test_free_products_break_the_order(factors):
    """Else the tests above would show nothing."""
    motion, light, gm, gl = (np.asarray(x, float) for x in factors)
    pairs = np.einsum("ni,nj->nij", motion, light)
    for seed in (0, 1):
        moments = np.einsum("nij,rn->rij", pairs, np.asarray(alike(seed), float))
        u, size, vt = np.linalg.svd(moments)
        free = product(u[:, :, 0] * size[:, :1], vt[:, 0], gm, gl)
        assert max(least(free, GAIN), least(free, MONOTONE)) < -100 * MARGIN


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-3, 1.0, 30.0]))
def test_products_keep_any_order_of_anything(factors, seed, size):
    motion, light, gm, gl = factors
    for order, rates in ((MONOTONE, 6), (GAIN, 6), (ABSOLUTE, 7)):
        target = noisy(seed, rates, size)
        a, b = fit_constrained_product(motion, light, target, gm, gl, order, MARGIN)
        assert np.isfinite(a).all() and np.isfinite(b).all()
        assert least(product(a, b, gm, gl), order) > 0


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_products_that_keep_the_order_come_back(factors, seed):
    motion, light, gm, gl = factors
    rng = np.random.default_rng(seed)
    v, f, level = axes(7, 5, 4)
    first = 2 + rng.uniform(-0.5, 0.5) * v + rng.uniform(-0.5, 0.5) * f * v
    second = 1.5 + rng.uniform(-1, 1) * level
    share = np.cumsum(rng.uniform(0.1, 1, 6))[:, None]
    target = jnp.asarray(share * first * second, float)
    a, b = fit_constrained_product(motion, light, target, gm, gl, MONOTONE, MARGIN)
    atol = 1e-8 if X64 else 1e-4
    np.testing.assert_allclose(product(a, b, motion, light), target, atol=atol)


@pytest.mark.parametrize("value", [0.0, 5.0, -5.0])
def test_flat_products(factors, value):
    motion, light, gm, gl = factors
    target = jnp.full((6, motion.shape[0]), value)
    a, b = fit_constrained_product(motion, light, target, gm, gl, MONOTONE, MARGIN)
    found = np.asarray(product(a, b, motion, light))
    assert least(product(a, b, gm, gl), MONOTONE) > 0
    # Four steps of a margin lie below the best rate, and solving adds a quarter each.
    atol = 8 * MARGIN + (0.0 if X64 else 1e-5 * abs(value))
    np.testing.assert_allclose(found, max(value, 0.0), atol=atol)


def test_a_flat_product_among_others(factors):
    """One rate that is on its bound everywhere, under others that are on none."""
    motion, light, gm, gl = factors
    target = alike(2).at[0].set(-5.0)
    a, b = fit_constrained_product(motion, light, target, gm, gl, MONOTONE, MARGIN)
    found = np.asarray(product(a, b, motion, light))
    assert least(product(a, b, gm, gl), MONOTONE) > 0
    np.testing.assert_allclose(found[0], 0.0, atol=8 * MARGIN)


def test_products_without_what_samples_determine():
    """One level and one refresh rate, as in a scene that has no others."""
    v, level = (x[:, 0] for x in (axes(7, 2, 2)[0][:, None], np.zeros((28, 1))))
    samples, places = monomials(v, 0 * v, level), monomials(v, 0 * v, level)
    one = lambda x: np.linalg.svd(x, full_matrices=False)

    def determined(sampled, there):
        u, size, vt = one(sampled)
        some = size > 1e-9 * size[0]
        inverse = np.where(some, 1 / np.where(some, size, 1), 0)[None] * vt.T
        return np.where(some[None], u, 0), there @ inverse

    (motion, gm), (light, gl) = map(determined, samples, places)
    target = jnp.asarray(np.linspace(-1, 2, 6)[:, None] * (1 + v)[None], float)
    args = arrays(motion, light), arrays(gm, gl)
    a, b = fit_constrained_product(*args[0], target, *args[1], MONOTONE, MARGIN)
    found = product(a, b, *args[1])
    assert np.isfinite(found).all()
    assert least(found, MONOTONE) > 0
    # What keeps the order comes back: rates above 0, which rise.
    np.testing.assert_allclose(found[2:], np.maximum(target[2:], 0), atol=3e-3)


def test_product_tables_are_those_one_by_one(factors):
    motion, light, gm, gl = factors
    targets = jnp.stack([alike(0), alike(1), noisy(0)]).reshape(3, 1, 6, -1)
    fit = lambda t: fit_constrained_product(motion, light, t, gm, gl, GAIN, MARGIN)
    together = product(*fit(targets), motion, light)
    assert together.shape == targets.shape
    for one, target in zip(together[:, 0], targets[:, 0], strict=True):
        alone = product(*fit(target), motion, light)
        np.testing.assert_allclose(one, alone, atol=1e-8 if X64 else 1e-3)


def test_a_rate_whose_light_vanishes_is_still_raised(factors):
    """The last resort, which no fit above has come to."""
    motion, light, gm, gl = factors
    ones = [np.linalg.lstsq(np.asarray(g), np.ones(len(g)))[0] for g in (gm, gl)]
    grids = _Grids(gm, gl, *arrays(*ones))
    both = motion[:, :, None] * light[:, None, :]
    gram = jnp.einsum("nij,nkl->ijkl", both, both)
    a = jnp.tile(grids.one_motion, (2, 1))
    slope = np.linalg.lstsq(np.asarray(gl), axes(9, 7, 5)[2])[0]
    b = jnp.stack([grids.one_light, jnp.asarray(slope, float)])
    order = ((0, -1), (1, 0))
    # The targets are the products themselves.
    moments = jnp.einsum("ijkl,rk,rl->rij", gram, a, b)
    problem = _Problem(gram, moments, jnp.zeros(()))
    found = _raised_product(a, b, problem, grids, _Order.of(order, 2), MARGIN)
    values = product(*found, gm, gl)
    assert least(values, order) > 0
    np.testing.assert_allclose(values[1], 1 + MARGIN, rtol=1e-5)


# ---- both


@pytest.mark.parametrize(
    "order, reason",
    [
        ((), "must have pairs"),
        (((6, 0),), "must have pairs of rates from 0 to 5"),
        (((0, -2),), "must have pairs"),
        (((0, 1), (1, 2), (2, 0)), "must not go round in a circle"),
        (((0, 0),), "must not go round in a circle"),
    ],
)
def test_orders_that_cannot_be(factors, polynomial, order, reason):
    motion, light, gm, gl = factors
    with pytest.raises(ValueError, match=f"`order` {reason}"):
        fit_constrained_linear(polynomial[0], noisy(0), polynomial[1], order, MARGIN)
    with pytest.raises(ValueError, match=f"`order` {reason}"):
        fit_constrained_product(motion, light, noisy(0), gm, gl, order, MARGIN)
