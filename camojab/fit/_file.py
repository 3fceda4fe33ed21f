"""A fit as a file that `camojab predict --parameters` reads back."""

import hashlib
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from .._parameters import save_parameters
from ._comparisons import Comparisons
from ._fit import Fit
from ._problem import Data


_PACKAGES = ("alsarr", "jax", "jaxlib", "numpy", "equinox", "optimistix")


def save_fit(
    path: str | Path,
    fit: Fit,
    *,
    provenance: str,
    seed: int | None = None,
    details: Mapping[str, object] | None = None,
) -> None:
    """Write a fit as JSON, whole or not at all.

    The entries are those of `camojab.save_parameters`, so that `load_parameters` and
    `camojab predict --parameters` read the file, and those of `describe`.

    **Arguments:** `provenance`: what it was fitted to, and when. `seed`: behind the
    random numbers of `details`, which adds further entries.
    """
    save_parameters(
        path,
        fit.parameters,
        fit.formulation,
        provenance=provenance,
        details={**(details or {}), **describe(fit), "seed": seed},
    )


def describe(fit: Fit) -> dict[str, Any]:
    """Everything known of a fit as plain numbers, lists and texts.

    `covariance` and `correlation` have their rows and columns in the order of `free`;
    what is not a number is `None`.
    """
    named = lambda values: dict(zip(fit.free, _plain(values), strict=True))
    units = fit.problem.constants.units()
    return {
        "free": list(fit.free),
        "values": named(fit.values),
        "value_units": units,
        "standard_error": named(fit.standard_error),
        "covariance": _plain(fit.covariance),
        "correlation": _plain(fit.correlation),
        "scales": fit.scales,
        "lapse": fit.lapse,
        "rmse_jnd": {**fit.rmse, "all": fit.total_rmse} if fit.rmse else {},
        "log_likelihood": fit.log_likelihood,
        "aic": fit.aic,
        "bic": fit.bic,
        "data": {
            "kind": "votes" if isinstance(fit.data, Comparisons) else "JND",
            "size": fit.problem.target.size(),
            "sha256": checksums(fit.data),
        },
        "solver": fit.solver.value,
        "steps": fit.steps,
        "converged": fit.converged,
        "result": fit.verdict,
        "versions": {name: version(name) for name in _PACKAGES},
    }


def checksums(data: Data) -> dict[str, str]:
    """SHA-256 of the tables, as CSV with all digits, and of each texture's numbers."""
    tables = {"table": data.table}
    if isinstance(data, Comparisons):
        tables["votes"] = data.votes
    found = {name: _digest(_csv(table).encode()) for name, table in tables.items()}
    for name, texels in data.textures.items():
        exact = np.ascontiguousarray(texels, "<f8")
        found[f"texture {name}"] = _digest(repr(exact.shape).encode() + exact.tobytes())
    return found


def _csv(table: Any) -> str:
    columns = [
        [repr(cell) for cell in table[name].tolist()] for name in sorted(table.columns)
    ]
    rows = [",".join(row) for row in zip(*columns, strict=True)]
    return "\n".join([",".join(sorted(table.columns)), *rows])


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _plain(values: np.ndarray) -> list[Any]:
    known = values.astype(object)
    known[~np.isfinite(values)] = None
    return known.tolist()
