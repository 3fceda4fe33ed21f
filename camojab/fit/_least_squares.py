"""Least squares on JND, of the constants that JND can tell apart."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float, Int

from .._condition import Condition
from .._display import Components, Display, Shading, Viewing
from .._parameters import Formulation, Parameters
from .._spectrum import Spectrum
from ._moments import Moments, moments
from ._observations import Observations


class Fit(NamedTuple):
    """What a fit found, and how far it got.

    - `parameters`: in the scale of the first data set, whose own factor is 1: of one
      factor each for `ws`, `wt` and every data set, only products can be known.
    - `scales`: the factor of each further data set. [1], or, for one where only the
      judder differs, [JND] per unit of temporal distortion.
    - `rmse`: root mean square error of each block. [JND].
    - `total_rmse`: of all values together. [JND].
    - `predicted`: quality of each row. [JND].
    - `steps`, `verdict`: of the solver; the verdict is empty where it met its
      tolerance.
    """

    parameters: Parameters
    scales: dict[str, float]
    rmse: dict[str, float]
    total_rmse: float
    predicted: Float[np.ndarray, " rows"]
    steps: int
    verdict: str


class _Problem(eqx.Module):
    """The arrays that the residuals are made of; `theta` holds logarithms.

    `theta` is (-ws, -wt, beta, scales of the further data sets ...).
    """

    moments: Moments
    measured: Float[Array, " rows"]
    reference: Int[Array, " rows"]
    data_set: Int[Array, " rows"]
    temporal_only: Float[Array, " rows"]

    def predict(self, theta: Float[Array, " constants"]) -> Float[Array, " rows"]:
        ws, wt, beta = jnp.exp(theta[:3])
        scales = jnp.exp(jnp.concatenate([jnp.zeros_like(theta[:1]), theta[3:]]))
        spatial, temporal = self.moments.distortion(beta)
        both = -ws * spatial - wt * temporal
        energy = jnp.where(self.temporal_only > 0, -temporal, both)
        return scales[self.data_set] * (energy - energy[self.reference])


def fit(
    observations: Observations,
    *,
    formulation: Formulation = Formulation.RELEASED,
    start: Parameters | None = None,
    max_steps: int = 256,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Fit:
    """Fit `ws`, `wt`, `beta` and the data sets' scales to measured JND.

    Levenberg-Marquardt on logarithms, which keeps every constant on its side of zero;
    to be run in double precision.

    **Arguments:**

    - `start`: the published constants of the formulation if left out; every scale
      starts at 1.
    - `progress`: called with the textures done and their number while spectra are
      pooled; the fit itself takes milliseconds.

    **Raises:** `ValueError` if there are no more values than constants, or if `start`
    has the wrong signs.
    """
    start = start or Parameters.published(formulation)
    for name in ("ws", "wt"):
        value = float(getattr(start, name))
        if not value < 0:
            raise ValueError(f"`start.{name}` must be negative, got {value:g}.")
    problem, names = _problem(observations, formulation, start, progress)
    theta = jnp.log(jnp.stack([-start.ws, -start.wt, start.beta]))
    theta = jnp.concatenate([theta, jnp.zeros(len(names) - 1, theta.dtype)])
    if problem.measured.size <= theta.size:
        raise ValueError(
            f"`observations` must have more than {theta.size} values, got "
            f"{problem.measured.size}."
        )
    solution = _solve(problem, theta, max_steps)
    predicted = np.asarray(problem.predict(solution.value))
    ws, wt, beta = jnp.exp(solution.value[:3])
    scales = np.exp(np.asarray(solution.value[3:])).tolist()
    errors = predicted - np.asarray(problem.measured)
    blocks = observations.table["block"].to_numpy()
    return Fit(
        Parameters(ws=-ws, wt=-wt, beta=beta, ca=start.ca, cb=start.cb),
        dict(zip(names[1:], scales, strict=True)),
        {str(b): _rms(errors[blocks == b]) for b in dict.fromkeys(blocks)},
        _rms(errors),
        predicted,
        int(solution.stats["num_steps"]),
        optx.RESULTS[solution.result],
    )


@eqx.filter_jit
def _solve(
    problem: _Problem, theta: Float[Array, " constants"], max_steps: int
) -> optx.Solution:
    tolerance = float(jnp.finfo(theta.dtype).eps) ** 0.5
    return optx.least_squares(
        lambda theta, problem: problem.predict(theta) - problem.measured,
        optx.LevenbergMarquardt(rtol=tolerance, atol=tolerance),
        theta,
        problem,
        max_steps=max_steps,
        throw=False,
    )


def _problem(
    observations: Observations,
    formulation: Formulation,
    parameters: Parameters,
    progress: Callable[[int, int], None],
) -> tuple[_Problem, list[str]]:
    table = observations.table.reset_index(drop=True)
    textures = list(dict.fromkeys(table["texture"]))
    parts, rows = [], []
    for done, name in enumerate(textures):
        progress(done, len(textures))
        chosen = table[table["texture"] == name]
        spectrum = Spectrum.from_texture(observations.textures[name])
        condition = _condition(chosen, parameters)
        parts.append(moments(spectrum, condition, formulation=formulation))
        rows.append(chosen.index.to_numpy())
    progress(len(textures), len(textures))
    order = np.argsort(np.concatenate(rows))
    stacked = jax.tree.map(lambda *x: jnp.concatenate(x)[order], *parts)
    names = list(dict.fromkeys(table["data_set"]))
    column = lambda name, kind: jnp.asarray(table[name].to_numpy(kind))
    problem = _Problem(
        stacked,
        column("quality_jnd", stacked.log.dtype),
        column("reference", np.int32),
        jnp.asarray([names.index(x) for x in table["data_set"]]),
        column("temporal_only", stacked.log.dtype),
    )
    return problem, names


def _condition(table, parameters: Parameters) -> Condition:
    column = lambda name: table[name].to_numpy(float)
    return Condition(
        Display(
            ppd=column("ppd"),
            refresh_rate=column("refresh_rate_hz"),
            luminance=column("mean_luminance_cd_m2"),
            persistence=column("persistence"),
        ),
        Viewing(column("velocity_deg_s")),
        Shading(
            rate_x=column("rate_x"),
            rate_y=column("rate_y"),
            mip_level=column("mip_level"),
        ),
        Components(),
        parameters,
    )


def _rms(errors: Float[np.ndarray, " rows"]) -> float:
    return float(np.sqrt(np.mean(errors**2)))
