"""One predictor, one or two constants."""

import numpy as np
from jaxtyping import Float


def slope(
    quality: Float[np.ndarray, " rows"], measured: Float[np.ndarray, " rows"]
) -> tuple[float, float]:
    """Least-squares slope through the origin; 0 for a quality that is always 0."""
    square = float(quality @ quality)
    return (float(quality @ measured) / square if square else 0.0), 0.0


def affine(
    quality: Float[np.ndarray, " rows"], measured: Float[np.ndarray, " rows"]
) -> tuple[float, float]:
    """Least-squares slope and intercept; slope 0 for a quality that does not vary."""
    at, level = float(quality.mean()), float(measured.mean())
    if np.ptp(quality) == 0:
        return 0.0, level
    factor, _ = slope(quality - at, measured - level)
    return factor, level - factor * at


def rms(errors: Float[np.ndarray, " rows"]) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def correlation(
    quality: Float[np.ndarray, " rows"], measured: Float[np.ndarray, " rows"]
) -> float:
    """Pearson's; NaN for a quality that does not vary."""
    if np.ptp(quality) == 0:
        return float("nan")
    return float(np.corrcoef(quality, measured)[0, 1])


def rank_correlation(
    quality: Float[np.ndarray, " rows"], measured: Float[np.ndarray, " rows"]
) -> float:
    """Spearman's; NaN for a quality that does not vary."""
    from scipy.stats import rankdata

    return correlation(rankdata(quality), rankdata(measured))
