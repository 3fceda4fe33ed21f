"""How well a fit foretells data that it has not seen."""

from typing import Any, TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool

from ._comparisons import Comparisons
from ._constants import Constants
from ._fit import Fit, search
from ._problem import Problem
from ._targets import JndTarget, Target, vote_target


if TYPE_CHECKING:
    import pandas


def cross_validate(fit: Fit, by: str) -> "pandas.DataFrame":
    """Refit without each of the values of a column, and predict what was left out.

    The scale of a data set that was left out whole cannot be known from the others: the
    one that suits it best is taken.

    **Arguments:** `by`: a column of the data's table: `"texture"`, `"block"`,
    `"velocity_deg_s"` or `"data_set"`, for example. A vote is left out if either of its
    two conditions is.

    **Returns:** a row for each value of the column, with

    - the column itself, and `size`, the data left out;
    - for JND `rmse_jnd`, of these, and `rmse_seen_jnd`, of the others; references,
        which are 0 on both sides, do not count;
    - for votes `log_likelihood`, the mean of a vote left out, and
        `log_likelihood_seen`, of the others; guessing has -0.693;
    - the constants of each refit, by their names, and `converged`.

    **Raises:** `ValueError` for a column that is not there or has one value only, and
    if nothing would be left to fit.
    """
    import pandas as pd

    table: Any = fit.data.table
    if by not in table:
        raise ValueError(f"`by` must be of {', '.join(table)}, got {by!r}.")
    column = table[by].to_numpy()
    values = list(dict.fromkeys(column.tolist()))
    if len(values) < 2:
        raise ValueError(f"`by` must have two values or more, got {by!r} with one.")
    return pd.DataFrame([{by: v, **_fold(fit, column == v, by, v)} for v in values])


def _fold(
    fit: Fit, unseen: Bool[np.ndarray, " rows"], by: str, value: object
) -> dict[str, Any]:
    train, test = _split(fit, unseen)
    if train.size() <= len(fit.free) or not test.size():
        raise ValueError(
            f"`by` must leave data out, and more than {len(fit.free)} in, got {by!r}, "
            f"which leaves {test.size()} out and {train.size()} in for {value!r}."
        )
    own, held = _idle_scales(fit, train)
    kept = [name for name in fit.free if name not in (*own, *held)]
    at, good = fit.problem.constants, True
    if kept:
        posed = _posed(fit.problem, train, kept)
        found = search(posed, fit.solver)
        at, good = posed.constants.at(found.point), bool(found.converged)
    if own:
        best = _posed(_holding(fit.problem, at), test, own)
        at = best.constants.at(search(best, fit.solver).point)
    whole = at.freed(fit.free)
    return {
        "size": test.size(),
        **_scores(fit.problem, whole, train, test),
        **dict(zip(fit.free, np.asarray(whole.values(), float).tolist(), strict=True)),
        "converged": good,
    }


def _split(fit: Fit, unseen: Bool[np.ndarray, " rows"]) -> tuple[Target, Target]:
    target = fit.problem.target
    if isinstance(target, JndTarget):
        left = jnp.asarray(unseen, target.weight.dtype)
        weights = target.weight * (1 - left), target.weight * left
        train, test = (JndTarget(target.measured, weight) for weight in weights)
        return train, test
    assert isinstance(fit.data, Comparisons)
    votes: Any = fit.data.votes
    left = unseen[votes["a"].to_numpy(int)] | unseen[votes["b"].to_numpy(int)]
    return vote_target(votes, ~left), vote_target(votes, left)


def _idle_scales(fit: Fit, train: Target) -> tuple[list[str], list[str]]:
    """The scales of data sets of which nothing is left, and one to hold instead.

    The first data set has the unit that the others are in; without it another has.
    """
    if isinstance(train, JndTarget):
        rows = np.flatnonzero(np.asarray(train.weight) > 0)
    else:
        rows = np.asarray(train.a)[np.asarray(train.votes) > 0]
    there = set(fit.data.table["data_set"].to_numpy()[rows])
    first, *others = fit.problem.constants.data_sets
    scales = [f"scale:{name}" for name in others if f"scale:{name}" in fit.free]
    own = [name for name in scales if name.removeprefix("scale:") not in there]
    if first in there or not scales:
        return own, []
    return [f"scale:{first}", *own], [n for n in scales if n not in own][:1]


def _posed(problem: Problem, target: Target, free: list[str]) -> Problem:
    where = lambda p: (p.target, p.constants)
    return eqx.tree_at(where, problem, (target, problem.constants.freed(free)))


def _holding(problem: Problem, constants: Constants) -> Problem:
    return eqx.tree_at(lambda p: p.constants, problem, constants)


def _scores(
    problem: Problem, constants: Constants, train: Target, test: Target
) -> dict[str, float]:
    quality = problem.quality(constants)
    squares = [
        float(jnp.sum(target.residuals(quality, constants.lapse) ** 2))
        for target in (test, train)
    ]
    if isinstance(test, JndTarget):
        unseen, seen = (
            (square / target.size()) ** 0.5
            for square, target in zip(squares, (test, train), strict=True)
        )
        return {"rmse_jnd": unseen, "rmse_seen_jnd": seen}
    unseen, seen = (
        float(target.log_likelihood(target.residuals(quality, constants.lapse)))
        / target.size()
        for target in (test, train)
    )
    return {"log_likelihood": unseen, "log_likelihood_seen": seen}
