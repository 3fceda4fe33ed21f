"""Fit the model's constants to JND or to votes, and say how well they are known."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._display import Components
from .._newton import minimise
from .._parameters import Formulation, Parameters
from ._comparisons import Comparisons, scaled
from ._constants import Constants, constants
from ._information import check_identifiable, covariance, inverse
from ._problem import Data, Problem, problem, Progress
from ._solvers import least_squares, REACH, Solution, Solver


DEFAULT = ("ws", "wt", "beta", "scales")

# Near enough for a lapse rate to be sought; the rest of the way is common.
_STEPS_WITHOUT_LAPSE = 12

# A constant with less information than this about its logarithm is not known at all.
_LEAST = 1e-3


@dataclass(frozen=True, eq=False)
class Fit:
    """What a fit found, how well it is known, and how far it got.

    - `parameters`: in the scale of the first data set, unless that was given or freed.
    - `scales`: the factor of each data set, but of the first only if it is not 1. [1],
      or, for one where only the judder differs, [JND] per unit of temporal distortion.
    - `lapse`: probability that an observer guesses. [1].
    - `free`: names of the constants that were fitted, in the order of `values`,
      `covariance` and `standard_error`; units as in `camojab.Parameters`.
    - `covariance`: natural units, carried over from the logarithms that were searched.
      For votes the inverse of the observed information, for JND that of Gauss and
      Newton. It takes the data as independent, which JND that were scaled from the same
      votes, and votes of the same observer, are not: see `bootstrap`. Not a number
      where the search was given up without a minimum.
    - `predicted`: quality of each row relative to its reference. [JND].
    - `rmse`: root mean square error of each block, references included, which are 0 on
      both sides. [JND]. For votes, of the JND that `Prior.BOUNDED` scales them to;
      empty where they cannot be scaled.
    - `total_rmse`: of all rows together. [JND].
    - `log_likelihood`: of the data. For JND with normal errors of one unknown standard
      deviation; for votes without binomial constants.
    - `aic`, `bic`: information criteria; the standard deviation counts as a constant,
      references do not count as data.
    - `steps`, `converged`, `verdict`: of the solver; the verdict is a sentence.
    - `solver`, `formulation`: as they were chosen.
    - `problem`: what was solved, for everything that solves it again.
    """

    parameters: Parameters
    scales: dict[str, float]
    lapse: float
    free: tuple[str, ...]
    values: Float[np.ndarray, " free"]
    covariance: Float[np.ndarray, "free free"]
    predicted: Float[np.ndarray, " rows"]
    rmse: dict[str, float]
    total_rmse: float
    log_likelihood: float
    aic: float
    bic: float
    steps: int
    converged: bool
    verdict: str
    solver: Solver
    formulation: Formulation
    data: Data
    problem: Problem
    point: Float[np.ndarray, " free"]

    @property
    def standard_error(self) -> Float[np.ndarray, " free"]:
        """Of each free constant, in its own unit."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Float[np.ndarray, "free free"]:
        """Of the free constants. [1]."""
        error = self.standard_error
        return self.covariance / np.outer(error, error)

    def report(self) -> str:
        """One line to quote beside any number."""
        error = dict(zip(self.free, self.standard_error, strict=True))
        known = dict(zip(self.free, self.values, strict=True))
        shown = (f"{name}={known[name]:.6g}±{error[name]:.2g}" for name in self.free)
        return f"{self.formulation.value}, {', '.join(shown)}"


def fit(
    data: Data,
    *,
    free: Iterable[str] = DEFAULT,
    formulation: Formulation = Formulation.RELEASED,
    start: Parameters | None = None,
    scales: Mapping[str, float] | None = None,
    components: Components | None = None,
    solver: Solver | None = None,
    max_steps: int = 256,
    progress: Progress = lambda done, total: None,
) -> Fit:
    """Fit constants of the model to JND by least squares, or to votes by likelihood.

    For `Observations` the sum of squared errors [JND] is as small as possible, for
    `Comparisons` the votes are as likely as possible, without a scaling in between:
    a vote for A over B has probability lapse/2 + (1 - lapse) Phi((qA - qB)/1.4826).
    The search is over logarithms, which keep every constant on its side of zero. To be
    run in double precision.

    **Arguments:**

    - `free`: the constants to fit: fields of `camojab.Parameters`, `"scale:NAME"` for
        the factor of a data set, `"scales"` for those of all but the first, `"lapse"`
        for votes. The rest is held at `start` and `scales`, the lapse at 0. With
        `beta`, weights, scales and lapse alone the fit takes milliseconds once spectra
        are pooled; the others need the pooled spectra at every step.
    - `formulation`, `components`: of the model.
    - `start`: the published constants of the formulation if left out.
    - `scales`: by data set, where its factor starts or is held. > 0; 1 if left out.
    - `solver`: Levenberg-Marquardt for JND and scoring for votes if left out.
    - `max_steps`: of the search, after which it is given up; >= 1.
    - `progress`: called with the textures done and their number while spectra are
        pooled.

    **Returns:** see `Fit`. A search that did not meet its tolerance is returned too,
    and says so.

    **Raises:** `ValueError` for an unknown or repeated name, a start on the wrong side
    of zero, no more data than constants, constants without effect on the data, and
    constants of which only combinations have one; these are named.

    **Source:** Jindal et al. 2021, section 4.4; Levenberg 1944 and Marquardt 1963;
    votes as in Perez-Ortiz and Mantiuk 2017, arXiv:1712.03686.

    **Example:**

    >>> import jax
    >>> import numpy as np
    >>> import pandas as pd
    >>> from camojab.fit import fit, Observations
    >>> shown = dict(mean_luminance_cd_m2=100.0, refresh_rate_hz=60.0, persistence=1.0)
    >>> moving = dict(texture="noise", velocity_deg_s=5.0, ppd=60.0, mip_level=0)
    >>> jnd = [0.0, -0.5, -1.5]
    >>> measured = dict(rate_x=[1.0, 0.5, 0.25], rate_y=1.0, quality_jnd=jnd)
    >>> kind = dict(data_set="mine", block="mine", reference=0, temporal_only=False)
    >>> table = pd.DataFrame(shown | moving | measured | kind)
    >>> noise = np.random.default_rng(0).uniform(size=(512, 512))
    >>> with jax.enable_x64(True):
    ...     found = fit(Observations(table, {"noise": noise}), free=["ws"])
    >>> print(found.report())
    released, ws=-0.683726±0.03
    """
    start = start or Parameters.published(formulation)
    data_sets = list(dict.fromkeys(data.table["data_set"]))
    chosen = constants(free, data_sets, start, scales)
    names = chosen.free
    if solver is None:
        votes = isinstance(data, Comparisons)
        solver = Solver.SCORING if votes else Solver.LEVENBERG_MARQUARDT
    posed = problem(data, chosen, formulation, components or Components(), progress)
    if posed.target.size() <= len(names):
        raise ValueError(
            f"`data` must have more values than the {len(names)} constants to fit, got "
            f"{posed.target.size()}."
        )
    begin = chosen.point()
    check_identifiable(np.asarray(_evidence(posed, begin)), names)
    found = search(posed, solver, max_steps)
    _check_reached(begin, found.point, names)
    root = np.asarray(_evidence(posed, found.point))
    # Where a search was given up, what it has no information about means nothing.
    if bool(found.converged):
        check_identifiable(root, names, least=_LEAST)
    if isinstance(data, Comparisons):
        spread = inverse(np.asarray(_observed_information(posed, found.point)))
    else:
        spread = covariance(root)
    return _summary(data, posed, found, spread, solver, formulation)


@eqx.filter_jit
def solve(
    problem: Problem,
    start: Float[Array, " free"],
    solver: Solver = Solver.LEVENBERG_MARQUARDT,
    max_steps: int = 256,
) -> Solution:
    """Search for the smallest sum of squared residuals; may be vmapped."""
    if solver is Solver.SCORING:
        found = minimise(
            problem.look, start, secant=True, reach=REACH, max_steps=max_steps
        )
        return Solution(found.place.at, found.steps, found.converged)
    return least_squares(_residuals, start, problem, solver, max_steps)


def search(problem: Problem, solver: Solver, max_steps: int = 256) -> Solution:
    """Solve from the constants of the problem.

    The lapse rate is held until the others suit it: far from them a step may take it to
    0, from where there is no way back.
    """
    chosen = problem.constants
    others = tuple(name for name in chosen.free if name != "lapse")
    start = chosen.point()
    if others not in (chosen.free, ()):
        held = eqx.tree_at(lambda p: p.constants, problem, chosen.freed(others))
        enough = min(max_steps, _STEPS_WITHOUT_LAPSE)
        found = solve(held, held.constants.point(), solver, enough)
        start = held.constants.at(found.point).freed(chosen.free).point()
    return solve(problem, start, solver, max_steps)


@eqx.filter_jit
def _observed_information(
    problem: Problem, point: Float[Array, " free"]
) -> Float[Array, "free free"]:
    """Second derivatives of the negative log likelihood of votes.

    By differences of the exact gradient, which costs as much as a step for each
    constant; relative error about 1e-5 in double precision.
    """
    step = float(jnp.finfo(point.dtype).eps) ** (1 / 3)
    here = problem.look(point).gradient
    beside = point[None, :] + step * jnp.eye(point.size, dtype=point.dtype)
    rows = jax.lax.map(lambda x: (problem.look(x).gradient - here) / step, beside)
    return 0.5 * (rows + rows.T)


@eqx.filter_jit
def _evidence(problem: Problem, point: Float[Array, " free"]) -> Array:
    return problem.evidence(point)


def _residuals(point: Float[Array, " free"], problem: Problem) -> Array:
    return problem.residuals(point)


def _check_reached(
    begin: Float[Array, " free"], end: Float[Array, " free"], names: Sequence[str]
) -> None:
    gone = np.abs(np.asarray(end) - np.asarray(begin)) >= REACH
    lost = [name for name, far in zip(names, gone, strict=True) if far]
    if lost:
        raise ValueError(
            "`free` must be of constants that these data bound, got "
            f"{', '.join(lost)}, changed a million times over with ever better a fit: "
            f"hold {'it' if len(lost) == 1 else 'them'}."
        )


def _summary(
    data: Data,
    posed: Problem,
    found: Solution,
    spread: Float[np.ndarray, "free free"],
    solver: Solver,
    formulation: Formulation,
) -> Fit:
    at: Constants = posed.constants.at(found.point)
    slope = np.asarray(at.slope(), np.float64)
    predicted = np.asarray(posed.quality(at), np.float64)
    likelihood = float(posed.log_likelihood(found.point))
    count = len(at.free) + posed.target.NUISANCES
    rmse, total = _errors(data, predicted)
    scales = np.asarray(at.scale, np.float64).tolist()
    steps, good = int(found.steps), bool(found.converged)
    return Fit(
        parameters=at.parameters,
        scales={
            name: scale
            for i, (name, scale) in enumerate(zip(at.data_sets, scales, strict=True))
            if i or scale != 1
        },
        lapse=float(at.lapse),
        free=at.free,
        values=np.asarray(at.values(), np.float64),
        covariance=spread * np.outer(slope, slope),
        predicted=predicted,
        rmse=rmse,
        total_rmse=total,
        log_likelihood=likelihood,
        aic=2.0 * count - 2.0 * likelihood,
        bic=count * float(np.log(posed.target.size())) - 2.0 * likelihood,
        steps=steps,
        converged=good,
        verdict=(
            f"met its tolerance after {steps} steps"
            if good
            else f"stopped after {steps} steps without meeting its tolerance"
        ),
        solver=solver,
        formulation=formulation,
        data=data,
        problem=posed,
        point=np.asarray(found.point),
    )


def _errors(
    data: Data, predicted: Float[np.ndarray, " rows"]
) -> tuple[dict[str, float], float]:
    if isinstance(data, Comparisons):
        try:
            data = scaled(data)
        except ValueError:
            return {}, float("nan")
    table: Any = data.table
    errors = predicted - table["quality_jnd"].to_numpy()
    blocks = table["block"].to_numpy()
    each = {str(b): _rms(errors[blocks == b]) for b in dict.fromkeys(blocks)}
    return each, _rms(errors)


def _rms(errors: Float[np.ndarray, " rows"]) -> float:
    return float(np.sqrt(np.mean(errors**2)))
