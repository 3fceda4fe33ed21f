"""Refits to observers drawn again: error bars that know who cast which vote."""

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Key

from ..votes import Prior, resample
from ._comparisons import Comparisons, resampled
from ._fit import Fit, solve
from ._problem import Problem
from ._solvers import Solver
from ._targets import JndTarget, Target, vote_pairs, VoteTarget


@dataclass(frozen=True, eq=False)
class Refits:
    """Constants fitted to data drawn again.

    - `free`: names of the constants, in the order of `values`; units as in `Fit`.
    - `values`: of each refit. `converged`: whether it met its tolerance.
    - `low`, `high`: ends of the percentile interval of each constant.
    - `standard_error`: standard deviation of each constant over the refits.
    - `level`: the share of the refits between the ends.
    """

    free: tuple[str, ...]
    values: Float[np.ndarray, "resamples free"]
    converged: Bool[np.ndarray, " resamples"]
    low: Float[np.ndarray, " free"]
    high: Float[np.ndarray, " free"]
    standard_error: Float[np.ndarray, " free"]
    level: float


def bootstrap(
    fit: Fit,
    *,
    key: Key[Array, ""],
    resamples: int = 1000,
    votes: Comparisons | None = None,
    prior: Prior = Prior.BOUNDED,
    level: float = 0.95,
    batch_size: int = 8,
) -> Refits:
    """Refit to as many observers as there were, drawn with replacement.

    Of a data set whose observers are not known, all votes being of one, the votes on
    each pair are drawn again instead.

    **Arguments:**

    - `fit`: to votes, or to JND that were scaled from the votes `votes`.
    - `key`: a JAX random key; the same key, the same numbers.
    - `resamples`: how many; >= 2. Percentiles need several hundred.
    - `votes`: for a fit to JND: the votes behind its first rows, which are scaled again
        with `prior`; the other rows stay as they are. Data sets without known observers
        stay too.
    - `level`: share of the refits between the ends of an interval, in (0, 1).
    - `batch_size`: refits side by side; >= 1.

    **Raises:** `ValueError` for numbers out of range, JND without votes, and votes of
    other conditions than the fit's.

    **Source:** Efron 1979, doi:10.1214/aos/1176344552.
    """
    for name, value, least in (
        ("resamples", resamples, 2),
        ("batch_size", batch_size, 1),
    ):
        if value < least:
            raise ValueError(f"`{name}` must be >= {least}, got {value}.")
    if not 0 < level < 1:
        raise ValueError(f"`level` must be in (0, 1), got {level:g}.")
    targets = _targets(fit, votes, key, resamples, prior)
    start = jnp.asarray(fit.point)
    found, good = _refit(fit.problem, targets, start, fit.solver, batch_size)
    values = np.asarray(found, np.float64)
    low, high = np.quantile(values, [(1 - level) / 2, (1 + level) / 2], axis=0)
    return Refits(
        fit.free,
        values,
        np.asarray(good),
        low,
        high,
        np.std(values, axis=0, ddof=1),
        level,
    )


def _targets(
    fit: Fit,
    votes: Comparisons | None,
    key: Key[Array, ""],
    resamples: int,
    prior: Prior,
) -> Target:
    """The target of each resample, along a first axis."""
    target = fit.problem.target
    if isinstance(target, VoteTarget):
        assert isinstance(fit.data, Comparisons)
        wins, cast = _drawn(fit.data, key, resamples)
        a, b = (jnp.broadcast_to(x, wins.shape) for x in (target.a, target.b))
        return jax.vmap(VoteTarget)(a, b, wins, cast)
    if votes is None:
        raise ValueError(
            "`votes` must be given to draw observers behind JND, got None."
        )
    measured = _scaled_again(fit.data, votes, key, resamples, prior)
    weight = jnp.broadcast_to(target.weight, measured.shape)
    measured = jnp.asarray(measured, target.measured.dtype)
    return jax.vmap(JndTarget)(measured, weight)


@eqx.filter_jit
def _refit(
    problem: Problem,
    targets: Target,
    start: Float[Array, " free"],
    solver: Solver,
    batch_size: int,
) -> tuple[Float[Array, "resamples free"], Bool[Array, " resamples"]]:
    def one(target: Target):
        posed = eqx.tree_at(lambda p: p.target, problem, target)
        found = solve(posed, start, solver)
        return problem.constants.at(found.point).values(), found.converged

    return jax.lax.map(one, targets, batch_size=batch_size)


def _drawn(
    data: Comparisons, key: Key[Array, ""], resamples: int
) -> tuple[Float[Array, "resamples pairs"], Float[Array, "resamples pairs"]]:
    """Wins and votes of each pair, each data set drawn on its own."""
    votes: Any = data.votes
    pairs, code, won = vote_pairs(votes)
    data_set = data.table["data_set"].to_numpy()[votes["a"].to_numpy(int)]
    wins = np.zeros((resamples, len(pairs)))
    cast = np.zeros_like(wins)
    for number, name in enumerate(dict.fromkeys(data_set)):
        mine = data_set == name
        own = jax.random.fold_in(key, number)
        names, observer = np.unique(
            votes["observer"].to_numpy()[mine].astype(str), return_inverse=True
        )
        if len(names) > 1:
            counts = np.zeros((2, len(names), len(pairs)))
            np.add.at(counts[0], (observer, code[mine]), won[mine])
            np.add.at(counts[1], (observer, code[mine]), 1.0)
            drawn = resample(own, observers=len(names), resamples=resamples)
            weight = np.asarray(drawn, float)
            wins += weight @ counts[0]
            cast += weight @ counts[1]
        else:
            n = np.bincount(code[mine], minlength=len(pairs))
            w = np.bincount(code[mine], won[mine], len(pairs))
            share = jnp.asarray(w / np.maximum(n, 1), float)
            again = jax.random.binomial(own, n, share, (resamples, len(pairs)))
            wins += np.asarray(again, float)
            cast += n
    return jnp.asarray(wins, float), jnp.asarray(cast, float)


def _scaled_again(
    data: Any, votes: Comparisons, key: Key[Array, ""], resamples: int, prior: Prior
) -> Float[np.ndarray, "resamples rows"]:
    """Measured JND of all rows, those of known observers from each resample."""
    table: Any = votes.table
    rows: Any = data.table.reset_index(drop=True)
    same = ["texture", "velocity_deg_s", "refresh_rate_hz", "rate_x", "reference"]
    if len(table) > len(rows) or not table[same].equals(rows[same][: len(table)]):
        raise ValueError(
            "`votes` must be of the first conditions that were fitted, got others."
        )
    measured = np.tile(rows["quality_jnd"].to_numpy(float), (resamples, 1))
    for mine, samples in resampled(votes, key, resamples, prior):
        measured[:, mine] = samples
    return measured
