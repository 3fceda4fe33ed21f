"""Qualities in an NPZ file to rates in an NPZ file."""

import zipfile
from pathlib import Path

import jax
import numpy as np

from camojab._files import DAMAGED, replacing

from ._rates import RATES
from .solve import (
    dynamic_programme,
    greedy_jindal2021,
    hull,
    lagrangian,
    Selection,
)


# By their names on the command line.
SOLVERS = {
    "lagrangian": lagrangian,
    "hull": hull,
    "greedy": greedy_jindal2021,
    "dynamic-programme": dynamic_programme,
}


def choose(path: Path, budget: float, solver: str) -> Selection:
    """A solver's choice for the qualities and costs of a file.

    **Arguments:**

    - `path`: NPZ file with `quality_jnd` [tiles, 7] (JND) and `cost` [7], any unit.
    - `budget`: share of the cost of the dearest rate everywhere. In (0, 1].
    - `solver`: a key of `SOLVERS`.

    **Raises:** `ValueError` naming the file, the array or the argument that is wrong.
    """
    if not 0 < budget <= 1:
        raise ValueError(f"`budget` must be in (0, 1], got {budget:g}.")
    quality, cost = _read(path)
    full = float(np.sum(np.broadcast_to(cost, quality.shape).max(axis=1)))
    cheapest = float(np.sum(np.broadcast_to(cost, quality.shape).min(axis=1)))
    if cheapest > budget * full:
        raise ValueError(
            f"`budget` must be at least {cheapest / full:g}, the share of the cost "
            f"that the cheapest rate of every tile takes, got {budget:g}."
        )
    with jax.enable_x64(True):
        return SOLVERS[solver](quality, cost, budget * full)


def save_choice(path: Path, chosen: Selection) -> None:
    """Write `rate` [tiles], the totals `quality_jnd` and `cost`, and `gap_jnd`."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(
            file,
            rate=np.asarray(chosen.rate),
            quality_jnd=np.asarray(chosen.quality),
            cost=np.asarray(chosen.cost),
            gap_jnd=np.asarray(chosen.gap),
        )


def _read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    with path.open("rb") as file:
        if not zipfile.is_zipfile(file):
            raise ValueError(f"{path}: must be an NPZ file.")
        try:
            stored = np.load(file, allow_pickle=False)
            arrays = {name: np.asarray(stored[name]) for name in stored.files}
        except DAMAGED as error:
            raise ValueError(f"{path}: must hold whole, plain arrays.") from error
    for name in ("quality_jnd", "cost"):
        if name not in arrays:
            raise ValueError(f"{path}: must hold {name}.")
    quality, cost = arrays["quality_jnd"], arrays["cost"]
    for name, array in (("quality_jnd", quality), ("cost", cost)):
        if array.dtype.kind not in "iuf":
            raise ValueError(f"{path}: {name} must hold numbers, got {array.dtype}.")
    rates = len(RATES)
    if quality.ndim != 2 or quality.shape[1] != rates or not len(quality):
        raise ValueError(
            f"{path}: quality_jnd must have shape [tiles, {rates}], got "
            f"{list(quality.shape)}."
        )
    if cost.shape not in ((rates,), quality.shape):
        raise ValueError(
            f"{path}: cost must have shape [{rates}], got {list(cost.shape)}."
        )
    return quality.astype(float), cost.astype(float)
