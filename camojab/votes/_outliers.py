"""Observers who vote unlike the others."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from ._groups import checked_tally, scale_weighted
from ._likelihood import Prior
from ._simulation import SIGMA
from ._tally import check_observers


if TYPE_CHECKING:
    import pandas


def outliers(
    votes: "pandas.DataFrame",
    *,
    by: Sequence[str] = (),
    prior: Prior = Prior.NONE,
) -> "pandas.DataFrame":
    """How well each observer's votes agree with the scale of all the others.

    **Arguments:** as in `scale_groups`.

    **Returns:** a row per observer, with the columns

    - `observer`; `pairs`, how many pairs the observer compared, those of each group
        counted; `votes`, how many the observer gave.
    - `log10_likelihood`: the mean over those pairs of the decimal logarithm of the
        binomial probability of the observer's votes, given the scaling of the votes
        of all others; at least -200 for each pair. Not a number where those alone
        cannot be scaled.
    - `distance`: how far that is below the first quartile of all observers, in
        interquartile ranges (infinite if these are 0); 0 above it. Above 1 is
        suspicious, no more: look at the votes before leaving anyone out.

    **Raises:** as `scale_groups`, and `ValueError` for fewer than two observers.

    **Source:** `pw_outlier_analysis` of pwcmp, and section 9 of Perez-Ortiz and Mantiuk
    2017, arXiv:1712.03686. Quartiles are MATLAB's: linear between (k - 1/2)/n.
    """
    import pandas as pd

    counted = checked_tally(votes, by, prior)
    check_observers(counted)
    others = 1.0 - np.eye(len(counted.observers))
    quality = np.asarray(scale_weighted(counted, others, prior).quality, np.float64)
    logs, compared = _log10_binomial(counted.wins, quality)
    pairs = compared.sum(axis=(1, 2, 3))
    likelihood = logs.sum(axis=(1, 2, 3)) / pairs
    return pd.DataFrame(
        {
            "observer": counted.observers,
            "pairs": pairs,
            "votes": counted.wins.sum(axis=(1, 2, 3)).astype(int),
            "log10_likelihood": likelihood,
            "distance": _distance(likelihood),
        }
    )


def _log10_binomial(
    wins: Float[np.ndarray, "observers groups n n"],
    quality: Float[np.ndarray, "observers groups n"],
) -> tuple[
    Float[np.ndarray, "observers groups n n"], Bool[np.ndarray, "observers groups n n"]
]:
    """Of each observer's votes on each pair i < j, 0 where there are none."""
    from scipy.stats import binom, norm

    votes = wins + np.swapaxes(wins, -1, -2)
    compared = np.triu(votes > 0, 1)
    difference = quality[..., :, None] - quality[..., None, :]
    log10 = binom.logpmf(wins, votes, norm.cdf(difference / SIGMA)) / np.log(10)
    # Not `fmax`, which would take a scaling that failed for a vote that cannot be.
    return np.where(compared, np.maximum(log10, -200.0), 0.0), compared


def _distance(likelihood: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    known = likelihood[~np.isnan(likelihood)]
    if not known.size:
        return likelihood
    low, high = np.quantile(known, [0.25, 0.75], method="hazen")
    below = np.where(likelihood < low, low - likelihood, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.where(below > 0, below / (high - low), 0.0)
    return np.where(np.isnan(likelihood), np.nan, distance)
