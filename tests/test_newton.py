"""The damped Newton search, on functions whose minima are known."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from camojab._newton import minimise, Place


X64 = jax.config.jax_enable_x64
ATOL = 1e-7 if X64 else 2e-3


def place(value, curvature=None):
    """Look at a function; its Hessian, unless something stands for it."""

    def look(x):
        hessian = jax.hessian(value)(x) if curvature is None else curvature(x)
        return Place(x, value(x), jax.grad(value)(x), hessian)

    return look


def residuals(x):
    """Rosenbrock's valley, half the squares of which have their minimum 0 at (1, 1)."""
    return jnp.stack([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])


def squares(x):
    return 0.5 * jnp.sum(residuals(x) ** 2)


def gauss_newton(x):
    slope = jax.jacfwd(residuals)(x)
    return slope.T @ slope


DRAW = np.random.default_rng(0)
DESIGN = np.column_stack([np.ones(40), DRAW.normal(size=(40, 2))])
LABEL = (DRAW.random(40) < 1 / (1 + np.exp(-DESIGN @ [0.5, 1.0, -2.0]))).astype(float)


def logistic(x):
    odds = jnp.asarray(DESIGN, float) @ x
    # A small ridge: with labels that a plane can part there is no minimum otherwise.
    loss = jnp.sum(jnp.logaddexp(odds, 0.0) - jnp.asarray(LABEL, float) * odds)
    return loss + 0.01 * jnp.sum(x**2)


@pytest.mark.parametrize("secant", [False, True])
def test_the_valley(secant):
    look = place(squares, gauss_newton)
    found = jax.jit(functools.partial(minimise, look, secant=secant))(
        jnp.array([-1.2, 1.0])
    )
    assert found.converged
    np.testing.assert_allclose(found.place.at, 1.0, atol=ATOL)
    assert 5 < found.steps < 60


@pytest.mark.parametrize("secant", [False, True])
def test_logistic_regression(secant):
    from scipy.optimize import minimize

    expected = minimize(
        lambda x: float(logistic(jnp.asarray(x, float))),
        np.zeros(3),
        jac=lambda x: np.asarray(jax.grad(logistic)(jnp.asarray(x, float)), float),
        options={"gtol": 1e-10 if X64 else 1e-4},
    )
    found = minimise(place(logistic), jnp.zeros(3), secant=secant)
    assert found.converged and found.steps < 25
    np.testing.assert_allclose(found.place.at, expected.x, atol=ATOL)
    np.testing.assert_allclose(found.place.value, expected.fun, rtol=1e-6)
    np.testing.assert_allclose(found.place.gradient, 0.0, atol=ATOL)


def test_secant_learns_what_the_curvature_lacks():
    """A curvature of a tenth makes every step ten times too long."""
    look = place(logistic, lambda x: 0.1 * jax.hessian(logistic)(x))
    plain = minimise(look, jnp.zeros(3), max_steps=400)
    taught = minimise(look, jnp.zeros(3), secant=True, max_steps=400)
    assert taught.converged and taught.steps < plain.steps
    exact = minimise(place(logistic), jnp.zeros(3)).place.at
    np.testing.assert_allclose(taught.place.at, exact, atol=ATOL)


def test_many_side_by_side_are_as_each_alone():
    look = place(squares, gauss_newton)
    starts = jnp.array([[-1.2, 1.0], [0.5, 0.5], [3.0, -2.0], [1.0, 1.0]])
    one = functools.partial(minimise, look, secant=True)
    many = jax.jit(jax.vmap(one))(starts)
    assert many.converged.all()
    np.testing.assert_allclose(many.place.at, 1.0, atol=ATOL)
    for i, start in enumerate(starts):
        assert abs(int(one(start).steps) - int(many.steps[i])) <= 2
    # From the minimum itself, only to see that it is one.
    assert many.steps[3] <= 2 < many.steps[0]


@pytest.mark.parametrize("most", [0, 1, 3])
def test_steps_may_run_out(most):
    found = minimise(
        place(squares, gauss_newton), jnp.array([-1.2, 1.0]), max_steps=most
    )
    assert not found.converged and found.steps == most
    assert np.isfinite(found.place.at).all()
    if not most:
        np.testing.assert_array_equal(found.place.at, jnp.array([-1.2, 1.0]))


def test_the_value_never_rises():
    values = [
        float(minimise(place(logistic), jnp.full(3, 4.0), max_steps=n).place.value)
        for n in range(6)
    ]
    assert values[-1] < values[0]
    assert (np.diff(values) <= 1e-6 * values[0]).all()


def test_a_place_without_value_is_not_taken():
    """Beyond 2 the function is not a number, and a full step would end there."""

    def value(x):
        return jnp.sum(
            jnp.where(x < 2.0, -jnp.log(2.0 - x) + 0.5 * (x - 3.0) ** 2, jnp.nan)
        )

    found = minimise(place(value), jnp.array([-30.0]))
    assert found.converged and found.place.at < 2
    # 1/(2 - x) = 3 - x.
    np.testing.assert_allclose(found.place.at, (5 - 5**0.5) / 2, atol=ATOL)
