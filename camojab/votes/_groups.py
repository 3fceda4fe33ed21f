"""Scaling of a whole table of votes, group by group."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ._goodness import goodness_of_fit
from ._likelihood import Prior
from ._scaling import check_determined, check_linked, Solution, solve
from ._tally import Tally, tally


if TYPE_CHECKING:
    import pandas


# Scalings side by side: on a CPU, more would wait for their slowest.
_BATCH = 4
# Scalings a call: always as many, or every other number of draws would compile anew.
_CHUNK = 64


@dataclass(frozen=True, eq=False)
class GroupScaling:
    """JND of every condition of every group.

    - `table`: a row per group and condition. Columns: the grouping ones; `condition`;
      `votes`, in how many it took part; `quality_jnd`, with mean 0 in its group or
      relative to the reference.
    - `groups`: a row per group. Columns: the grouping ones; `conditions`, `observers`
      and `votes`, how many; `log_likelihood` of the votes, without binomial constants;
      `deviance`, `degrees_of_freedom` and `p_value` as in `GoodnessOfFit`;
      `converged`, whether the search met its tolerance.
    """

    table: "pandas.DataFrame"
    groups: "pandas.DataFrame"


def scale_groups(
    votes: "pandas.DataFrame",
    *,
    by: Sequence[str] = (),
    prior: Prior = Prior.NONE,
    reference: Hashable | None = None,
) -> GroupScaling:
    """Scale the votes of each group on its own, all groups at once.

    **Arguments:**

    - `votes`: a table as `read_votes` returns it.
    - `by`: the columns that tell the groups apart; none for one group.
    - `prior`: see `Prior`.
    - `reference`: the condition that is 0 JND in each group (`Gauge.FIX0` of `scale`);
        without it the mean of each group is.

    **Returns:** tables whose rows are sorted by group and by condition, numbers in
    names by size, with the reference first; the order of the votes does not matter.

    **Raises:** `TableError`, a `ValueError`, naming the rows of `votes` that are not
    votes; `ValueError` for a group that lacks the reference, and, naming the group, in
    the cases in which `scale` does.
    """
    import pandas as pd

    counted = checked_tally(votes, by, prior, reference)
    everyone = np.ones((1, len(counted.observers)))
    found = jax.tree.map(lambda x: x[0], scale_weighted(counted, everyone, prior))
    table = condition_table(counted, found, reference)
    wins = counted.wins.sum(axis=0)
    fits = [
        goodness_of_fit(won[here][:, here], quality[here])
        for won, quality, here in zip(wins, found.quality, counted.present, strict=True)
    ]
    groups = pd.DataFrame(
        {
            **counted.group_rows(),
            "conditions": counted.present.sum(axis=1),
            "observers": (counted.wins.sum(axis=(2, 3)) > 0).sum(axis=0),
            "votes": wins.sum(axis=(1, 2)).astype(int),
            "log_likelihood": found.log_likelihood,
            "deviance": [fit.deviance for fit in fits],
            "degrees_of_freedom": [fit.degrees_of_freedom for fit in fits],
            "p_value": [fit.p_value for fit in fits],
            "converged": found.converged,
        }
    )
    return GroupScaling(table, groups)


def checked_tally(
    votes: "pandas.DataFrame",
    by: Sequence[str],
    prior: Prior,
    reference: Hashable | None = None,
) -> Tally:
    """Count the votes, or fail, naming the group, where one has no finite scaling."""
    counted = tally(votes, by, reference=reference)
    wins = counted.wins.sum(axis=0)
    for g, names in enumerate(counted.conditions):
        if reference is not None and reference not in names:
            raise ValueError(
                f"`reference` must be a condition in {counted.label(g)}, which are of "
                f"{', '.join(map(str, names))}, got {reference!r}."
            )
        n = len(names)
        check_linked(wins[g, :n, :n], names, prior, counted.label(g))
    return counted


def scale_weighted(
    counted: Tally, weights: Float[np.ndarray, "draws observers"], prior: Prior
) -> Solution:
    """Every group scaled with every weighting of the observers: `draws groups ...`."""
    draws, groups = len(weights), len(counted.groups)

    def chunk(start: int) -> Solution:
        # Draws of one group side by side: these take about as many steps as each other.
        place = np.arange(start, start + _CHUNK) % (groups * draws)
        group, draw = place // draws, place % draws
        wins = np.einsum("po,opij->pij", weights[draw], counted.wins[:, group])
        present = jnp.asarray(counted.present[group])
        return _solve_chunk(jnp.asarray(wins, float), present, prior)

    def by_draw(*parts: Array) -> np.ndarray:
        whole = np.concatenate(parts)[: groups * draws]
        return whole.reshape(groups, draws, *whole.shape[1:]).swapaxes(0, 1)

    return jax.tree.map(by_draw, *map(chunk, range(0, groups * draws, _CHUNK)))


@eqx.filter_jit
def _solve_chunk(
    wins: Float[Array, "chunk n n"], present: Bool[Array, "chunk n"], prior: Prior
) -> Solution:
    alone = lambda given: solve(*given, prior=prior)
    return jax.lax.map(alone, (wins, present), batch_size=_BATCH)


def condition_table(
    counted: Tally, found: Solution, reference: Hashable | None
) -> "pandas.DataFrame":
    """The table of `GroupScaling`, or an error where votes leave a JND infinite."""
    import pandas as pd

    for g, determined in enumerate(found.determined):
        check_determined(bool(determined), counted.label(g))
    wins = counted.wins.sum(axis=0)
    return pd.DataFrame(counted.rows()).assign(
        votes=(wins.sum(axis=1) + wins.sum(axis=2))[counted.present].astype(int),
        quality_jnd=quality_rows(counted, found, reference),
    )


def quality_rows(
    counted: Tally, found: Solution, reference: Hashable | None
) -> Float[np.ndarray, "*draws rows"]:
    """Quality [JND] in the rows of `Tally.rows`, relative to the reference if any."""
    values = np.asarray(found.quality, float)
    if reference is not None:
        values = values - values[..., :1]
    return values[..., counted.present]
