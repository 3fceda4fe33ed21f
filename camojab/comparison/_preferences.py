"""Experiment 2: how often ALSaRR was preferred, and whether chance explains it."""

from collections.abc import Sequence
from typing import Any, TYPE_CHECKING

from .. import datasets


if TYPE_CHECKING:
    import pandas


def validation_preferences(
    votes: "pandas.DataFrame | None" = None,
    *,
    by: Sequence[str] = ("budget", "against", "uniform_setting"),
    confidence: float = 0.95,
) -> "pandas.DataFrame":
    """Preference for ALSaRR in groups of votes, with exact intervals and tests.

    The default groups are the six bars of Figure 12 (a): each budget against MARRR and
    against two settings of the uniform method; with `by=("scene", "budget", "against",
    "uniform_setting")` they are the 18 of its part (b).

    Every vote counts as independent of the others, as in the paper's test, although 12
    observers gave them all: a taste that observers share, or one that they do not,
    makes the true intervals wider.

    **Arguments:**

    - `votes`: as `camojab.datasets.jindal2021_validation_votes` returns them, which is
      what is taken if left out.
    - `by`: columns of `votes`; an empty list puts all votes in one group.
    - `confidence`: of the intervals, in (0, 1).

    **Returns:** a row for each group, in the order of the columns `by`, which come
    first, and then

    - `votes`: in the group; `preferred`: for ALSaRR; `preference`: their ratio.
    - `low`, `high`: Clopper-Pearson interval of the preference.
    - `p_value`: of the exact two-sided binomial test of even odds. Not corrected for
      the number of groups.

    **Raises:** `ValueError` for an unknown column, no votes, or a `confidence` out of
    range; as `fetch` if `votes` is left out.

    **Source:** Jindal et al. 2021, section 5.6 and Figure 12.
    """
    import pandas as pd

    table: Any = datasets.jindal2021_validation_votes() if votes is None else votes
    for name in (*by, "alsarr_preferred"):
        if name not in table.columns:
            known = ", ".join(table.columns)
            raise ValueError(f"`by` must name columns of {known}, got {name!r}.")
    if not 0 < confidence < 1:
        raise ValueError(f"`confidence` must be in (0, 1), got {confidence:g}.")
    if not len(table):
        raise ValueError("`votes` must have one row or more, got 0.")
    groups = table.groupby(list(by), sort=True) if by else [((), table)]
    rows = []
    for key, group in groups:
        found = _tested(group["alsarr_preferred"], confidence)
        rows.append({**dict(zip(by, key, strict=True)), **found})
    return pd.DataFrame(rows)


def _tested(preferred: Any, confidence: float) -> dict[str, float | int]:
    from scipy.stats import binomtest

    wins, votes = int(preferred.sum()), len(preferred)
    test = binomtest(wins, votes, 0.5)
    interval = test.proportion_ci(confidence, method="exact")
    return {
        "votes": votes,
        "preferred": wins,
        "preference": wins / votes,
        "low": float(interval.low),
        "high": float(interval.high),
        "p_value": float(test.pvalue),
    }
