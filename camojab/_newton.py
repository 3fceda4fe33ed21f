"""Minima of smooth functions of a few numbers, alone or many side by side."""

import math
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int


class Place(eqx.Module):
    """What is known of a function at one argument.

    `curvature` is its Hessian, or a matrix that stands for it, such as the expected
    information of a likelihood; at least positive semi-definite there.
    """

    at: Float[Array, " n"]
    value: Float[Array, ""]
    gradient: Float[Array, " n"]
    curvature: Float[Array, "n n"]


class Minimum(eqx.Module):
    """Where a search ended; `converged` if its last step was negligible."""

    place: Place
    converged: Bool[Array, ""]
    steps: Int[Array, ""]


class _Search(eqx.Module):
    place: Place
    missing: Float[Array, "n n"]
    damping: Float[Array, ""]
    converged: Bool[Array, ""]
    step: Int[Array, ""]


def minimise(
    look: Callable[[Float[Array, " n"]], Place],
    start: Float[Array, " n"],
    *,
    secant: bool = False,
    reach: float = math.inf,
    max_steps: int = 100,
) -> Minimum:
    """Newton's method, damped as by Levenberg and Marquardt; may be vmapped.

    A step is negligible below the square root of the smallest difference that the
    numbers can tell.

    `secant` is for a curvature that stands for the Hessian: what it lacks is learnt
    from how the gradient changes, or steps that are always too long would zigzag. The
    search is given up where any number has moved by more than `reach`.

    **Source:** Dennis, Gay and Welsch 1981, doi:10.1145/355958.355965.
    """
    epsilon = float(jnp.finfo(start.dtype).eps)

    def advance(search: _Search) -> _Search:
        here = search.place
        hessian = here.curvature + search.missing
        move = _move(here, hessian, search.damping)
        there = look(here.at + move)
        gain = here.value - there.value
        foreseen = -jnp.dot(move, here.gradient + 0.5 * (hessian @ move))
        # Below the noise of the value, the gradient knows better where to go.
        noise = 8.0 * epsilon * (1.0 + jnp.abs(here.value))
        # NaN, of a matrix that is not definite, is no better place.
        better = gain >= -noise
        good = better & (gain >= 0.25 * foreseen - noise)
        calmer = jnp.where(search.damping < 1e-6, 0.0, 0.1 * search.damping)
        wilder = 6.0 * jnp.maximum(search.damping, 1e-3)
        negligible = (jnp.max(jnp.abs(move)) < epsilon**0.5) & (search.step > 0)
        missing = _learnt(search.missing, here, there) if secant else search.missing
        return _Search(
            jax.tree.map(lambda new, old: jnp.where(better, new, old), there, here),
            jnp.where(better, missing, search.missing),
            jnp.where(good, calmer, wilder),
            negligible & (search.damping < 1.0) & jnp.isfinite(here.value),
            search.step + 1,
        )

    # The first step stays where it is, so that the function is compiled only once.
    nowhere = Place(
        start,
        jnp.full((), jnp.inf, start.dtype),
        jnp.zeros_like(start),
        jnp.eye(len(start), dtype=start.dtype),
    )
    search = jax.lax.while_loop(
        lambda search: (
            ~search.converged
            & (search.step <= max_steps)
            & (jnp.max(jnp.abs(search.place.at - start)) <= reach)
        ),
        advance,
        _Search(
            nowhere,
            jnp.zeros_like(nowhere.curvature),
            jnp.full((), 0.1, start.dtype),
            jnp.zeros((), bool),
            jnp.zeros((), jnp.int32),
        ),
    )
    return Minimum(search.place, search.converged, search.step - 1)


def _move(
    here: Place, hessian: Float[Array, "n n"], damping: Float[Array, ""]
) -> Float[Array, " n"]:
    weight = jnp.diag(jnp.maximum(jnp.diagonal(here.curvature), 0.01))
    factor = jnp.linalg.cholesky(hessian + damping * weight)
    return -jax.scipy.linalg.cho_solve((factor, True), here.gradient)


def _learnt(missing: Float[Array, "n n"], here: Place, there: Place) -> Array:
    """What the curvature lacks of the Hessian, by the change of the gradient."""
    step, change = there.at - here.at, there.gradient - here.gradient
    along = jnp.dot(change, step)
    usable = jnp.isfinite(along) & (along > 0)
    along = jnp.where(usable, along, 1)
    wanted = change - there.curvature @ step
    # Forget what was learnt where it has become too large.
    before = jnp.abs(jnp.dot(step, missing @ step))
    size = jnp.abs(jnp.dot(step, wanted)) / jnp.where(before > 0, before, 1)
    sized = missing * jnp.where(before > 0, jnp.minimum(size, 1), 1)
    rest = wanted - sized @ step
    more = (jnp.outer(rest, change) + jnp.outer(change, rest)) / along
    less = jnp.dot(rest, step) * jnp.outer(change, change) / along**2
    return jnp.where(usable, sized + more - less, missing)
