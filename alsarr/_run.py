"""The main job: votes to constants, constants to tables, tables to a rate map."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from camojab import fit, Parameters, Spectrum

from ._inputs import Inputs
from ._rate_choice import SOLVERS
from ._rates import RATES
from ._report import write_report
from ._stages import Result, Stages
from .export import write_rates_bin, write_rates_png
from .oracle import TableOracle
from .tables import (
    AbstractTables,
    distil,
    Eq31LogTravel,
    Form,
    load_tables,
    sample,
    save_tables,
)
from .tables._file import SCHEMA


Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Outcome:
    """What each stage found, and the names of those that had to be computed.

    - `fit`: `rmse_jnd` per block and `all`, `parameters`, `scales`, `predicted_jnd`,
      `steps`, `verdict`.
    - `tables`: `largest_error_jnd`, `median_error_jnd`, `textures`, `mip_levels`.
    - `rate_map`: `solver`, `quality_jnd`, `gap_jnd`, `cost` and `full_cost` [px],
      `budget`, `shares`, `outside`, `tiles`.
    - `quote`: the line to quote beside any of these numbers.
    """

    fit: Result
    tables: Result
    rate_map: Result
    quote: str
    computed: tuple[str, ...]


def run(
    inputs: Inputs,
    out: Path,
    *,
    budget: float,
    solver: str = "greedy",
    progress: Progress = lambda stage, done, total: None,
) -> Outcome:
    """Fit, distil, solve and report into the folder `out`.

    Writes `parameters.json`, `tables.json`, `rates.png`, `rates.bin` and `report.html`,
    each whole or not at all, and `run.json`, the record that lets a second run leave
    out what did not change.

    **Arguments:**

    - `budget`: share of the cost of shading every tile at full rate. In (0, 1].
    - `solver`: a key of `SOLVERS`; the paper's own if left out.
    - `progress`: called with a stage's name, the steps done and their number.

    **Raises:** `ValueError` for a budget out of range or below the coarsest map.
    """
    check_budget(budget)
    stages, release = Stages(out), version("alsarr")
    data = (release, inputs.observations.table, dict(inputs.observations.textures))

    found, fitted = stages.run(
        "fit",
        data,
        ["parameters.json"],
        lambda: _fit(inputs, out, lambda *n: progress("fit", *n)),
    )
    parameters = Parameters(**found["parameters"])
    made, distilled = stages.run(
        "tables",
        (
            release,
            SCHEMA,
            dict(inputs.textures),
            inputs.scene.pairs,
            inputs.scene.domain,
            inputs.ppd,
            parameters,
        ),
        ["tables.json"],
        lambda: _tables(inputs, parameters, out, lambda *n: progress("tables", *n)),
    )
    own = inputs.tables or load_tables(out / "tables.json")
    solved, mapped = stages.run(
        "rate map",
        (release, inputs.frame, own, inputs.refresh_rate, budget, solver),
        ["rates.png", "rates.bin"],
        lambda: _rate_map(inputs, own, budget, solver, out),
    )
    quote = _quote(release, inputs, parameters)
    _, reported = stages.run(
        "report",
        (
            *data,
            inputs.frame,
            dict(inputs.published),
            found,
            made,
            solved,
            quote,
        ),
        ["report.html"],
        lambda: write_report(out, inputs, found, made, solved, quote),
    )
    names = ("fit", "tables", "rate map", "report")
    new = (fitted, distilled, mapped, reported)
    computed = tuple(n for n, is_new in zip(names, new, strict=True) if is_new)
    return Outcome(found, made, solved, quote, computed)


def check_budget(budget: float) -> None:
    """Fail for a budget out of range or below the coarsest map, before any work."""
    if not 0 < budget <= 1:
        raise ValueError(f"`budget` must be in (0, 1], got {budget:g}.")
    least = RATES.cost.min() / RATES.cost.max()
    if budget < least:
        raise ValueError(
            f"`budget` must be at least {least:g}, the cost of 4x4 everywhere, got "
            f"{budget:g}."
        )


def _fit(inputs: Inputs, out: Path, progress: Callable[[int, int], None]) -> Result:
    with jax.enable_x64(True):
        found = fit.fit(inputs.observations, progress=progress)
        rmse = {**found.rmse, "all": found.total_rmse}
        fit.save_fit(
            out / "parameters.json",
            found,
            provenance=f"least squares on the JND of {inputs.name}",
        )
        constants = {k: float(v) for k, v in vars(found.parameters).items()}
    return {
        "parameters": constants,
        "scales": found.scales,
        "rmse_jnd": rmse,
        "predicted_jnd": found.predicted.tolist(),
        "steps": found.steps,
        "verdict": found.verdict,
    }


def _tables(
    inputs: Inputs,
    parameters: Parameters,
    out: Path,
    progress: Callable[[int, int], None],
) -> Result:
    # Single precision is exact to 1e-5 JND here and takes a third of the time.
    with jax.enable_x64(False):
        wide = lambda x: jnp.asarray(x, float)
        samples = sample(
            {k: Spectrum.from_texture(v) for k, v in inputs.textures.items()},
            inputs.scene,
            ppd=inputs.ppd,
            parameters=jax.tree.map(wide, parameters),
            progress=progress,
        )
        # As cheap as the published form, and a third of its error.
        tables = distil(samples, Form(Eq31LogTravel()))
        save_tables(out / "tables.json", tables)
    return {
        "textures": list(tables.texture_names),
        "mip_levels": list(inputs.scene.mip_levels),
        "pairs": len(inputs.scene.pairs),
        "basis": tables.basis.name,
        "largest_error_jnd": float(tables.largest_error),
        "median_error_jnd": float(tables.median_error),
    }


def _rate_map(
    inputs: Inputs, tables: AbstractTables, budget: float, solver: str, out: Path
) -> Result:
    with jax.enable_x64(True):
        wide = lambda x: x.astype(float) if jnp.issubdtype(x.dtype, jnp.floating) else x
        frame, oracle = jax.tree.map(wide, (inputs.frame, TableOracle(tables)))
        quality = oracle.quality(frame, inputs.refresh_rate)
        full = int(RATES.cost.max()) * quality.shape[0]
        chosen = SOLVERS[solver](quality, RATES.cost, budget * full)
        outside = int(oracle.count_outside(frame, inputs.refresh_rate))
        rate = np.asarray(chosen.rate).reshape(frame.shape)
        total, cost, gap = (float(x) for x in (chosen.quality, chosen.cost, chosen.gap))
    write_rates_png(out / "rates.png", rate)
    write_rates_bin(out / "rates.bin", rate)
    counts = np.bincount(rate.ravel(), minlength=len(RATES))
    return {
        "solver": solver,
        "quality_jnd": total,
        "gap_jnd": gap,
        "cost": cost,
        "budget": budget,
        "full_cost": full,
        "shares": dict(zip(RATES.names, (counts / rate.size).tolist(), strict=True)),
        "outside": outside,
        "tiles": int(rate.size),
    }


def _quote(release: str, inputs: Inputs, parameters: Parameters) -> str:
    return (
        f"alsarr {release}; data: {inputs.name}; display: {inputs.ppd:g} px/deg, "
        f"{inputs.refresh_rate:g} Hz; parameters: {parameters.report()}"
    )
