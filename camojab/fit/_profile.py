"""Profile likelihood: how much worse the best fit is with one constant held."""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._fit import Fit, solve
from ._problem import Problem
from ._solvers import Solver


@dataclass(frozen=True, eq=False)
class Profile:
    """The best that can be had with one constant held at each of several values.

    - `name`, `level`: as asked for.
    - `values`: where the constant was held, in its own unit; rising. Those are left out
      at which the search for the others failed.
    - `deviance`: twice what the log likelihood falls short of the best, >= 0.
    - `low`, `high`: ends of the interval in which the deviance is below the quantile of
      chi-square with one degree of freedom; not a number where it has no end within six
      standard errors.
    """

    name: str
    level: float
    values: Float[np.ndarray, " points"]
    deviance: Float[np.ndarray, " points"]
    low: float
    high: float


def profile(
    fit: Fit, name: str, *, level: float = 0.95, points: int = 25, batch_size: int = 1
) -> Profile:
    """Profile one of the constants that were fitted, and its likelihood interval.

    Unlike a standard error it does not take the likelihood for a parabola.

    **Arguments:** `name`: of `fit.free`. `level`: in (0, 1). `points`: >= 5, between
    six standard errors of the logarithm on either side. `batch_size`: fits side by
    side.

    **Raises:** `ValueError` for a name that was not fitted, numbers out of range, and a
    fit without a minimum.

    **Source:** Venzon and Moolgavkar 1988, doi:10.2307/2347496.
    """
    if name not in fit.free:
        raise ValueError(f"`name` must be of {', '.join(fit.free)}, got {name!r}.")
    if not 0 < level < 1:
        raise ValueError(f"`level` must be in (0, 1), got {level:g}.")
    if points < 5:
        raise ValueError(f"`points` must be >= 5, got {points}.")
    if not np.isfinite(fit.covariance).all():
        raise ValueError(
            f"`fit` must have found a minimum, got one that {fit.verdict}."
        )
    index = fit.free.index(name)
    slope = np.asarray(fit.problem.constants.at(jnp.asarray(fit.point)).slope())
    spread = fit.covariance / np.outer(slope, slope)
    steps = np.linspace(-6.0, 6.0, points)
    # The middle one is the fit itself, to the last digit.
    steps = np.unique(np.append(steps, 0.0))
    along = spread[:, index] / np.sqrt(spread[index, index])
    where = jnp.asarray(fit.point + steps[:, None] * along, fit.point.dtype)
    likelihood, values = _held(fit.problem, where, index, fit.solver, batch_size)
    likelihood, values = np.asarray(likelihood), np.asarray(values, np.float64)
    # Far from the optimum a search may fail; what it found is no profile.
    known = np.flatnonzero(np.isfinite(likelihood))
    order = known[np.argsort(values[known])]
    best = max(fit.log_likelihood, float(np.max(likelihood[known])))
    deviance = np.maximum(2.0 * (best - likelihood[order].astype(np.float64)), 0.0)
    ends = _ends(values[order], deviance, level)
    return Profile(name, level, values[order], deviance, *ends)


@eqx.filter_jit
def _held(
    problem: Problem,
    where: Float[Array, "points free"],
    index: int,
    solver: Solver,
    batch_size: int,
) -> tuple[Float[Array, " points"], Float[Array, " points"]]:
    """Log likelihood with the constant `index` held, and the value that it has."""
    others = np.delete(np.arange(where.shape[1]), index)

    def one(point: Float[Array, " free"]):
        at = problem.constants.at(point)
        fixed = at.freed([at.free[i] for i in others])
        posed = eqx.tree_at(lambda p: p.constants, problem, fixed)
        if not others.size:
            return posed.log_likelihood(point[others]), at.values()[index]
        found = solve(posed, point[others], solver)
        reached = jnp.where(found.converged, posed.log_likelihood(found.point), jnp.nan)
        return reached, at.values()[index]

    return jax.lax.map(one, where, batch_size=batch_size)


def _ends(
    values: Float[np.ndarray, " points"],
    deviance: Float[np.ndarray, " points"],
    level: float,
) -> tuple[float, float]:
    from scipy.interpolate import PchipInterpolator
    from scipy.stats import chi2

    bound = float(np.sqrt(chi2.ppf(level, 1)))
    best = int(np.argmin(deviance))
    # The root of the deviance is all but straight, so that it is interpolated well.
    root = np.sqrt(deviance)
    root[:best] *= -1
    rising = PchipInterpolator(values, root)
    low = rising.solve(-bound, extrapolate=False)
    high = rising.solve(bound, extrapolate=False)
    return (
        float(low[-1]) if len(low) else float("nan"),
        float(high[0]) if len(high) else float("nan"),
    )
