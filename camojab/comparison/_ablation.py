"""What each part of the model contributes: the fit repeated without it."""

from collections.abc import Callable, Mapping
from typing import Any, TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float, Int

from .. import fit
from .._display import Components, LowPass
from .._parameters import Formulation, Parameters
from ..fit._problem import all_moments


if TYPE_CHECKING:
    import pandas


# vrs, eye_blur, judder: everything, without one part, one part alone.
MASKS = (
    (True, True, True),
    (True, True, False),
    (True, False, True),
    (False, True, True),
    (True, False, False),
    (False, True, False),
    (False, False, True),
)
VARIANTS = (
    *((*mask, LowPass.LORENTZIAN) for mask in MASKS),
    *((*MASKS[0], low_pass) for low_pass in (LowPass.SINC, LowPass.GAUSSIAN)),
)


def ablation(
    observations: fit.Observations | None = None,
    *,
    formulation: Formulation = Formulation.RELEASED,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> "pandas.DataFrame":
    """Refit the model with each of the seven sets of its parts, and see what remains.

    And with all of them, but another low-pass filter in the place of the Lorentzian.

    The exponent, the weights and the data sets' scales are free, all of them >= 0 (a
    weight may become 0). For any exponent and ratio of the weights the best scales are
    known in closed form, so that the search is over these two alone, and a weight or
    scale without effect does no harm: without `vrs` nothing distinguishes the shading
    rates, without `judder` nothing is left of Experiment 3 of Denes et al. 2020, and
    these data then stand at their own root mean square.

    To be run in double precision.

    **Arguments:**

    - `observations`: `camojab.fit.jindal2021()` if left out.
    - `progress`: called with the textures done and their number, each counted six
      times, while spectra are pooled.

    **Returns:** a row for each set of parts and block, and for all blocks together
    (`"all"`), with the columns

    - `vrs`, `eye_blur`, `judder`: which parts are there, as in `camojab.Components`.
    - `low_pass`: the name of `camojab.LowPass` of every blur.
    - `block`, `rmse_jnd`: what remains. [JND]
    - `beta`: the fitted exponent; `temporal_share`: wt/(ws + wt), of no meaning where
      either distortion has no effect. The search starts at the published exponent.
    - `verdict`: of the solver, empty where it met its tolerance.

    **Raises:** `ValueError` if there are no more values than constants; `fetch`'s
    errors if the observations are left out.

    **Source:** the seven sets are those of `CaMoJAB/fits/ablation_camojab.m`
    (gfxdisp/ALSaRR at d06b3e0, MIT); the results of Jindal et al. 2021 are in a
    supplement that is not public.
    """
    import pandas as pd

    chosen = observations or fit.jindal2021()
    published = Parameters.published(formulation)
    problem = _problem(chosen, published)
    constants = 2 + problem.members.shape[0]
    if problem.measured.size <= constants:
        raise ValueError(
            f"`observations` must have more than {constants} values, got "
            f"{problem.measured.size}."
        )
    pooled = _all_moments(chosen, formulation, progress)
    log_beta = jnp.log(published.beta)
    start = jnp.stack([log_beta, jnp.zeros_like(log_beta)])
    rows = []
    for vrs, eye_blur, judder, low_pass in VARIANTS:
        parts: dict[str, Any] = {"vrs": vrs, "eye_blur": eye_blur, "judder": judder}
        parts["low_pass"] = low_pass.value
        moments = pooled[vrs, eye_blur, low_pass]
        weight = moments.weight.at[:, 2].multiply(float(judder))
        refit = _solve(problem, fit.Moments(moments.log, weight), start)
        rows += [parts | row for row in _rows(chosen.table, *refit)]
    return pd.DataFrame(rows)


def _rows(
    table: Any, theta: Float[Array, "2"], errors: Array, verdict: optx.RESULTS
) -> list[dict[str, Any]]:
    """What is left of each block and of all, and the constants that it took."""
    left, blocks = np.asarray(errors), table["block"].to_numpy()
    of = {str(name): left[blocks == name] for name in dict.fromkeys(blocks)}
    return [
        {
            "block": block,
            "rmse_jnd": float(np.sqrt(np.mean(own**2))),
            "beta": float(jnp.exp(theta[0])),
            "temporal_share": float(jax.nn.sigmoid(theta[1])),
            "verdict": optx.RESULTS[verdict],
        }
        for block, own in {**of, "all": left}.items()
    ]


class _Problem(eqx.Module):
    """Rows, which of them share a scale, and the constants but for the exponent."""

    measured: Float[Array, " rows"]
    reference: Int[Array, " rows"]
    temporal_only: Float[Array, " rows"]
    members: Float[Array, "sets rows"]
    parameters: Parameters

    def errors(self, theta: Float[Array, "2"], moments: fit.Moments) -> Array:
        """Residuals at an exponent (log) and a temporal share (log odds)."""
        at = eqx.tree_at(lambda p: p.beta, self.parameters, jnp.exp(theta[0]))
        spatial, temporal = moments.distortion(at)
        share = jax.nn.sigmoid(theta[1])
        both = (share - 1) * spatial - share * temporal
        energy = jnp.where(self.temporal_only > 0, -temporal, both)
        quality = energy - energy[self.reference]
        square = self.members @ (quality * quality)
        some = square > 0
        scale = (self.members @ (quality * self.measured)) / jnp.where(some, square, 1)
        scale = jnp.where(some, jnp.maximum(scale, 0), 0)
        return (scale @ self.members) * quality - self.measured


def _problem(observations: fit.Observations, parameters: Parameters) -> _Problem:
    table: Any = observations.table
    names = table["data_set"].to_numpy()
    members = [names == name for name in dict.fromkeys(names)]
    return _Problem(
        jnp.asarray(table["quality_jnd"].to_numpy(), float),
        jnp.asarray(table["reference"].to_numpy(np.int32)),
        jnp.asarray(table["temporal_only"].to_numpy(), float),
        jnp.asarray(np.stack(members), float),
        parameters,
    )


@eqx.filter_jit
def _solve(
    problem: _Problem, moments: fit.Moments, start: Float[Array, "2"]
) -> tuple[Float[Array, "2"], Float[Array, " rows"], optx.RESULTS]:
    tolerance = float(jnp.finfo(start.dtype).eps) ** 0.5
    solution = optx.least_squares(
        lambda theta, data: data[0].errors(theta, data[1]),
        optx.LevenbergMarquardt(rtol=tolerance, atol=tolerance),
        start,
        (problem, moments),
        max_steps=256,
        throw=False,
    )
    return solution.value, problem.errors(solution.value, moments), solution.result


def _all_moments(
    observations: fit.Observations,
    formulation: Formulation,
    progress: Callable[[int, int], None],
) -> Mapping[tuple[bool, bool, LowPass], fit.Moments]:
    """By `vrs`, `eye_blur` and `low_pass`; judder only has to be left out of a sum."""
    wanted = list(dict.fromkeys((v, e, shape) for v, e, _, shape in VARIANTS))
    parameters = Parameters.published(formulation)
    pooled = {}
    for turn, (vrs, eye_blur, low_pass) in enumerate(wanted):
        pooled[vrs, eye_blur, low_pass] = all_moments(
            observations,
            parameters,
            formulation,
            Components(vrs=vrs, eye_blur=eye_blur, low_pass=low_pass),
            lambda done, total, turn=turn: progress(
                turn * total + done, len(wanted) * total
            ),
        )
    return pooled
