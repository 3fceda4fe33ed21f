"""Least squares, by the solvers of two libraries through one call."""

import enum
import functools
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int


class Solver(enum.Enum):
    """How the smallest sum of squared residuals is searched for.

    `SCORING` is Newton's method with the expected curvature, damped: Fisher scoring for
    votes, of which it takes a dozen steps where the others, which take the curvature
    from the residuals, take a hundred. The two of jaxopt are second opinions.
    """

    LEVENBERG_MARQUARDT = "levenberg-marquardt"
    SCORING = "scoring"
    DOGLEG = "dogleg"
    GAUSS_NEWTON = "gauss-newton"
    BFGS = "bfgs"
    JAXOPT_LEVENBERG_MARQUARDT = "jaxopt-levenberg-marquardt"
    JAXOPT_LBFGSB = "jaxopt-lbfgsb"


# How far the search goes for a logarithm: a factor of a million either way.
REACH = 14.0


class Solution(NamedTuple):
    """Where a search ended.

    - `converged`: whether it met its tolerance, the square root of the smallest
      difference that the numbers can tell.
    """

    point: Float[Array, " free"]
    steps: Int[Array, ""]
    converged: Bool[Array, ""]


Residuals = Callable[[Float[Array, " free"], Any], Float[Array, " data"]]


def least_squares(
    residuals: Residuals,
    start: Float[Array, " free"],
    args: Any,
    solver: Solver,
    max_steps: int,
) -> Solution:
    """Search from `start`; `residuals` is a function of the point and of `args`.

    May be transformed by `jit` and `vmap`. `residuals` must be the same object from
    call to call, or each call compiles anew.
    """
    tolerance = float(jnp.finfo(start.dtype).eps) ** 0.5
    search = _optimistix if solver in _OPTIMISTIX else _jaxopt
    return search(residuals, start, args, solver, max_steps, tolerance)


_OPTIMISTIX = {
    Solver.LEVENBERG_MARQUARDT: optx.LevenbergMarquardt,
    Solver.DOGLEG: optx.Dogleg,
    Solver.GAUSS_NEWTON: optx.GaussNewton,
    Solver.BFGS: optx.BFGS,
}


@functools.cache
def _mean(residuals: Residuals) -> Residuals:
    """Residuals whose squares have the mean of the others as their sum.

    Solvers that begin with a step along the slope go too far down a steep one.
    """

    def mean(point: Float[Array, " free"], args: Any) -> Float[Array, " data"]:
        values = residuals(point, args)
        return values / values.size**0.5

    return mean


def _optimistix(
    residuals: Residuals,
    start: Float[Array, " free"],
    args: Any,
    solver: Solver,
    max_steps: int,
    tolerance: float,
) -> Solution:
    least = _mean(residuals) if solver is Solver.BFGS else residuals
    found = optx.least_squares(
        least,
        _OPTIMISTIX[solver](rtol=tolerance, atol=tolerance),
        start,
        args,
        max_steps=max_steps,
        throw=False,
    )
    good = found.result == optx.RESULTS.successful
    return Solution(found.value, found.stats["num_steps"], good)


def _jaxopt(
    residuals: Residuals,
    start: Float[Array, " free"],
    args: Any,
    solver: Solver,
    max_steps: int,
    tolerance: float,
) -> Solution:
    residuals = _mean(residuals)
    with warnings.catch_warnings():
        # It says on import that it is no longer maintained, which is known here.
        warnings.simplefilter("ignore", DeprecationWarning)
        import jaxopt

    if solver is Solver.JAXOPT_LEVENBERG_MARQUARDT:
        search = jaxopt.LevenbergMarquardt(
            residuals, maxiter=max_steps, tol=tolerance, xtol=tolerance, gtol=tolerance
        )
        # It multiplies booleans by numbers.
        with jax.numpy_dtype_promotion("standard"):
            found, state = search.run(start, args)
    else:
        square = lambda point, args: 0.5 * jnp.sum(residuals(point, args) ** 2)
        search = jaxopt.LBFGSB(square, maxiter=max_steps, tol=tolerance)
        bounds = (start - REACH, start + REACH)
        found, state = search.run(start, bounds, args)
    return Solution(found, state.iter_num, state.error <= tolerance)
