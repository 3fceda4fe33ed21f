"""Minima of small smooth functions, many side by side."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int


_STEPS = 100


class Minimum(eqx.Module):
    """Where the search ended.

    - `at`: the argument.
    - `converged`: whether the last step was negligible.
    - `definite`: whether the function bends upwards there in every direction, by more
      than `curvature`; if not, its minimum is at infinity.
    """

    at: Float[Array, " n"]
    converged: Bool[Array, ""]
    definite: Bool[Array, ""]


class _Place(eqx.Module):
    at: Float[Array, " n"]
    value: Float[Array, ""]
    gradient: Float[Array, " n"]
    hessian: Float[Array, "n n"]


class _Search(eqx.Module):
    place: _Place
    damping: Float[Array, ""]
    converged: Bool[Array, ""]
    step: Int[Array, ""]


def minimise(
    function: Callable[[Float[Array, " n"]], Float[Array, ""]],
    start: Float[Array, " n"],
    held: Float[Array, "n n"],
    *,
    curvature: float,
) -> Minimum:
    """Newton's method, damped as by Levenberg and Marquardt, for use under `vmap`.

    `held` is added to the Hessian, so that it is definite in the directions in which
    the function is constant, along which the search does not move. Most members of a
    batch take four to six steps; the batch takes as many as its slowest, 100 at most.
    """
    epsilon = float(jnp.finfo(start.dtype).eps)
    look = _look(function, held)

    def advance(search: _Search) -> _Search:
        here = search.place
        move = _move(here, search.damping)
        there = look(here.at + move)
        gain = here.value - there.value
        foreseen = -jnp.dot(move, here.gradient + 0.5 * (here.hessian @ move))
        # Below the noise of the value, the gradient knows better where to go.
        noise = 8.0 * epsilon * (1.0 + jnp.abs(here.value))
        # NaN, of a Hessian that is not definite, is no better place.
        better = gain >= -noise
        good = better & (gain >= 0.25 * foreseen - noise)
        calmer = jnp.where(search.damping < 1e-6, 0.0, 0.1 * search.damping)
        wilder = 6.0 * jnp.maximum(search.damping, 1e-3)
        negligible = (jnp.max(jnp.abs(move)) < epsilon**0.5) & (search.step > 0)
        return _Search(
            jax.tree.map(lambda new, old: jnp.where(better, new, old), there, here),
            jnp.where(good, calmer, wilder),
            better & negligible & (search.damping < 1.0),
            search.step + 1,
        )

    # The first step stays where it is, so that the function is compiled only once.
    nowhere = _Place(
        start,
        jnp.full((), jnp.inf, start.dtype),
        jnp.zeros_like(start),
        jnp.eye(len(start), dtype=start.dtype),
    )
    search = jax.lax.while_loop(
        lambda search: ~search.converged & (search.step < _STEPS),
        advance,
        _Search(
            nowhere,
            jnp.full((), 0.1, start.dtype),
            jnp.zeros((), bool),
            jnp.zeros((), jnp.int32),
        ),
    )
    hessian = search.place.hessian
    least = jnp.maximum(curvature, 16.0 * epsilon * jnp.max(jnp.diagonal(hessian)))
    factor = jnp.linalg.cholesky(
        hessian - least * jnp.eye(len(start), dtype=start.dtype)
    )
    # Infinite still where the function is not a number at the start.
    known = jnp.isfinite(search.place.value)
    definite = known & jnp.all(jnp.isfinite(factor))
    return Minimum(search.place.at, search.converged, definite)


def _look(
    function: Callable[[Float[Array, " n"]], Float[Array, ""]],
    held: Float[Array, "n n"],
) -> Callable[[Float[Array, " n"]], _Place]:
    def slope(x: Float[Array, " n"]) -> tuple[Array, tuple[Array, Array]]:
        value, gradient = jax.value_and_grad(function)(x)
        return gradient, (value, gradient)

    def look(x: Float[Array, " n"]) -> _Place:
        hessian, (value, gradient) = jax.jacfwd(slope, has_aux=True)(x)
        return _Place(x, value, gradient, hessian + held)

    return look


def _move(here: _Place, damping: Float[Array, ""]) -> Float[Array, " n"]:
    weight = jnp.diag(jnp.maximum(jnp.diagonal(here.hessian), 0.01))
    factor = jnp.linalg.cholesky(here.hessian + damping * weight)
    return -jax.scipy.linalg.cho_solve((factor, True), here.gradient)
