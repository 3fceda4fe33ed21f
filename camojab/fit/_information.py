"""How well the data determine the constants, and which they cannot tell apart."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float


def check_identifiable(
    root: Float[np.ndarray, "data free"], names: Sequence[str], *, least: float = 0.0
) -> None:
    """Fail, naming the constants, if the information matrix has no full rank.

    `least` is the smallest effect of one standard error that counts as one, for a
    constant on its own.
    """
    size = np.linalg.norm(root, axis=0)
    idle = [n for n, s in zip(names, size, strict=True) if not s > least]
    if idle:
        raise ValueError(
            "`free` must be of constants that have an effect on these data, got "
            f"{', '.join(idle)}: hold {'it' if len(idle) == 1 else 'them'}."
        )
    _, values, vectors = np.linalg.svd(root / size, full_matrices=False)
    tolerance = 10 * float(np.finfo(root.dtype).eps) ** 0.5
    missing = vectors[len(root) :] if len(root) < len(names) else vectors[:0]
    blind = np.concatenate([vectors[values < tolerance * values[0]], missing])
    if len(blind):
        share = np.abs(blind).max(axis=0)
        mixed = [n for n, s in zip(names, share, strict=True) if s > 1e-3 * share.max()]
        raise ValueError(
            "`free` must be of constants that these data tell apart, got "
            f"{', '.join(mixed)}, of which only {len(mixed) - len(blind)} "
            f"combinations can be known: hold {len(blind)} of them."
        )


def covariance(root: Float[np.ndarray, "data free"]) -> Float[np.ndarray, "free free"]:
    """Inverse of the information, without forming the matrix itself.

    Not a number where there is none.
    """
    root = np.asarray(root, np.float64)
    if not np.isfinite(root).all():
        return np.full((root.shape[1],) * 2, np.nan)
    _, values, vectors = np.linalg.svd(root, full_matrices=False)
    if not values[-1] > 0:
        return np.full((root.shape[1],) * 2, np.nan)
    half = vectors.T / values
    return half @ half.T


def inverse(
    information: Float[np.ndarray, "free free"],
) -> Float[np.ndarray, "free free"]:
    """Of a positive definite matrix; not a number if it is none."""
    wide = np.asarray(information, np.float64)
    try:
        half = np.linalg.inv(np.linalg.cholesky(wide))
    except np.linalg.LinAlgError:
        return np.full(wide.shape, np.nan)
    return half.T @ half
