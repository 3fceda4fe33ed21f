"""`camojab fit`: votes or JND to constants, with what is known of them."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TYPE_CHECKING

import jax
import numpy as np

from . import datasets, fit
from ._command import print_table, Study, Unusable, usable
from ._page import Html, page, picture, table, text
from ._parameters import Formulation, load_parameters, Parameters
from ._results import (
    check_folder,
    EXPERIMENT,
    JINDAL2021,
    provenance,
    quote,
    read_study,
    records,
    save,
    SIMULATED,
    simulated_note,
    study_files,
    to_csv,
    to_json,
)
from ._shipped import shipped


if TYPE_CHECKING:
    import pandas


FILES = ("fit.json", "fit.csv", "report.html")

_READ = (
    *JINDAL2021,
    f"{EXPERIMENT}/vrs_exp_data.csv",
    "denes2020/data/pairwise_comparison_matrices.mat",
)
_FORMATS = {
    "value": ".6g",
    "standard_error": ".2g",
    "bootstrap_error": ".2g",
    "low": ".4g",
    "high": ".4g",
    "profile_low": ".4g",
    "profile_high": ".4g",
}
_ERRORS = (
    "standard_error is from the information in the data, which it takes as "
    "independent. bootstrap_error, low and high (95%) are from refits to observers "
    "drawn again and do not; where votes have no known observers the votes of each "
    "pair are drawn. profile_low and profile_high are the ends of the 95% likelihood "
    "interval. A constant without an error was held."
)


@dataclass(frozen=True)
class Choice:
    """What is fitted to what, as the command line has it.

    - `to`: `"jnd"`, `"votes"`, or `None` for JND of published data and one's own votes.
    - `resamples`: 0 for none, `None` for 1000 if refits are quick, else none.
    - `profiles`, `cross`: names of constants, and of columns.
    """

    to: str | None
    free: Sequence[str]
    formulation: str | None
    solver: str | None
    start: Path | None
    resamples: int | None
    seed: int
    profiles: Sequence[str]
    cross: Sequence[str]


@dataclass(frozen=True)
class _Source:
    """Votes and the JND that were made of them, or published with them.

    `by_group`: whether what was compared with each other is drawn together.
    """

    name: str
    votes: fit.Comparisons
    jnd: fit.Observations
    files: Mapping[str, Path]
    simulated: str
    by_group: bool = False


def fit_constants(
    *,
    own: Study | None,
    data: str,
    choice: Choice,
    output: Path,
    progress: Callable[[str, int, int], None],
) -> None:
    """Fit, write the files of `FILES` into the folder, and print the tables."""
    check_folder(output, FILES)
    key = jax.random.key(choice.seed)
    with usable():
        start, formulation, scales = _start(choice)
        source = _own(own, key) if own else _SOURCES[data](key)
    to = choice.to or ("votes" if own else "jnd")
    known = set(source.jnd.table["data_set"])
    with usable({"`free`": "`--free`", "`start.": "`--start "}):
        found = fit.fit(
            source.votes if to == "votes" else source.jnd,
            free=choice.free,
            formulation=formulation,
            start=start,
            scales={k: v for k, v in scales.items() if k in known},
            solver=fit.Solver(choice.solver) if choice.solver else None,
            progress=lambda *steps: progress("spectra", *steps),
        )
    resamples = _resamples(choice, found)
    refits = _refits(source, found, key, resamples, progress)
    profiles = _profiles(found, choice.profiles, progress)
    with usable({"`by`": "`--cross-validate`"}):
        crossed = {name: fit.cross_validate(found, name) for name in choice.cross}
    constants = _constants(found, refits, profiles)
    blocks = _blocks(found)
    rows = _rows(source, found)
    line = quote(source.name, f"fitted to {to}", found.report())
    details = {
        "blocks": records(blocks),
        "bootstrap": _bootstrap(refits, resamples),
        "profiles": {p.name: _profile(p) for p in profiles},
        "cross_validation": {name: records(t) for name, t in crossed.items()},
    }
    document = {
        **provenance("camojab-parameters/1", source.files, choice.seed),
        **fit.describe(found),
        "formulation": found.formulation.value,
        "parameters": {k: float(v) for k, v in vars(found.parameters).items()},
        "provenance": line,
        **details,
    }
    sections = _sections(source, found, constants, blocks, profiles, crossed, rows)
    title = f"CaMoJAB fitted to {source.name}"
    whole = page(title, sections, quote=line, simulated=source.simulated)
    save(
        output, dict(zip(FILES, (to_json(document), to_csv(rows), whole), strict=True))
    )
    print_table(f"What the fit leaves of {source.name}", blocks)
    print_table("Constants", constants, _FORMATS)
    for name, frame in crossed.items():
        print_table(f"Left out by {name}", frame)
    print(_summary(found))
    print(f"to quote: {line}")
    print(f"written: {', '.join(str(output / name) for name in FILES)}")


def _start(choice: Choice) -> tuple[Parameters, Formulation, dict[str, float]]:
    """Constants and scales of an earlier fit, or the published ones."""
    if choice.start is None:
        formulation = Formulation(choice.formulation or "released")
        return Parameters.published(formulation), formulation, {}
    constants, formulation = load_parameters(choice.start)
    if choice.formulation not in (None, formulation.value):
        raise Unusable(
            f"`--formulation` must be that of {choice.start}, {formulation.value}, got "
            f"{choice.formulation}."
        )
    scales = json.loads(choice.start.read_text()).get("scales", {})
    return constants, formulation, scales


def _own(own: Study, key: jax.Array) -> _Source:
    votes = read_study(own)
    files = study_files(own, votes.textures)
    jnd = fit.scaled(votes, key=key)
    note = simulated_note(own.votes)
    return _Source(str(own.votes), votes, jnd, files, note, by_group=True)


def _jindal2021(key: jax.Array) -> _Source:
    del key
    files = {name: datasets.fetch(name) for name in _READ}
    name = "Jindal et al. 2021 (Exp. 1) and Denes et al. 2020 (Exp. 1 and 3)"
    return _Source(name, fit.jindal2021_comparisons(), fit.jindal2021(), files, "")


def _simulated(key: jax.Array) -> _Source:
    votes = fit.simulated_comparisons()
    files = {n: shipped(n) for n in (SIMULATED, "simulated_conditions.csv")}
    note = simulated_note(shipped(SIMULATED))
    jnd = fit.scaled(votes, key=key)
    return _Source("the simulated votes", votes, jnd, files, note)


_SOURCES = {"jindal2021": _jindal2021, "simulated": _simulated}


def _resamples(choice: Choice, found: fit.Fit) -> int:
    if choice.resamples is not None:
        return choice.resamples
    return 1000 if isinstance(found.problem.energies, fit.Moments) else 0


def _refits(
    source: _Source,
    found: fit.Fit,
    key: jax.Array,
    resamples: int,
    progress: Callable[[str, int, int], None],
) -> fit.Refits | None:
    if not resamples:
        return None
    progress("bootstrap", 0, 1)
    votes = None if found.data is source.votes else source.votes
    with usable():
        refits = fit.bootstrap(found, key=key, resamples=resamples, votes=votes)
    progress("bootstrap", 1, 1)
    return refits


def _profiles(
    found: fit.Fit,
    names: Sequence[str],
    progress: Callable[[str, int, int], None],
) -> list[fit.Profile]:
    profiles = []
    for done, name in enumerate(names):
        progress("profiles", done, len(names))
        with usable({"`name`": "`--profile`"}):
            profiles.append(fit.profile(found, name))
    progress("profiles", len(names), max(len(names), 1))
    return profiles


def _constants(
    found: fit.Fit, refits: fit.Refits | None, profiles: Sequence[fit.Profile]
) -> "pandas.DataFrame":
    """A row for each constant that was fitted, then those that were held."""
    import pandas as pd

    units = found.problem.constants.units()
    rows: list[dict[str, Any]] = [
        {"constant": name, "unit": units[name], "value": value, "standard_error": error}
        for name, value, error in zip(
            found.free, found.values.tolist(), found.standard_error, strict=True
        )
    ]
    if refits:
        ends = (refits.standard_error, refits.low, refits.high)
        for row, *of in zip(rows, *ends, strict=True):
            row |= dict(zip(("bootstrap_error", "low", "high"), of, strict=True))
    for found_profile in profiles:
        row = rows[found.free.index(found_profile.name)]
        row |= {"profile_low": found_profile.low, "profile_high": found_profile.high}
    held = {k: float(v) for k, v in vars(found.parameters).items()}
    for name, value in held.items():
        if name not in found.free and not (value == 1 and name not in ("ws", "wt")):
            rows.append({"constant": name, "unit": "held", "value": value})
    return pd.DataFrame(rows)


def _blocks(found: fit.Fit) -> "pandas.DataFrame":
    import pandas as pd

    whole = {**found.rmse, "all": found.total_rmse} if found.rmse else {}
    blocks = found.data.table["block"].to_numpy()
    sizes = {name: int(np.sum(blocks == name)) for name in found.rmse}
    sizes["all"] = len(found.data.table)
    return pd.DataFrame(
        [
            {
                "block": name,
                "rows": sizes[name],
                "rmse_jnd": value,
            }
            for name, value in whole.items()
        ],
        columns=["block", "rows", "rmse_jnd"],
    )


def _rows(source: _Source, found: fit.Fit) -> "pandas.DataFrame":
    """Every condition, measured and predicted."""
    rows: Any = source.jnd.table.reset_index(drop=True)
    return rows.iloc[: len(found.predicted)].assign(predicted_jnd=found.predicted)


def _bootstrap(refits: fit.Refits | None, resamples: int) -> dict[str, Any]:
    if refits is None:
        return {"resamples": 0}
    named = lambda values: dict(zip(refits.free, values.tolist(), strict=True))
    return {
        "resamples": resamples,
        "level": refits.level,
        "converged": float(np.mean(refits.converged)),
        "standard_error": named(refits.standard_error),
        "low": named(refits.low),
        "high": named(refits.high),
    }


def _profile(found: fit.Profile) -> dict[str, Any]:
    return {
        "level": found.level,
        "low": found.low,
        "high": found.high,
        "values": found.values.tolist(),
        "deviance": found.deviance.tolist(),
    }


def _summary(found: fit.Fit) -> str:
    size = found.problem.target.size()
    kind = "votes" if isinstance(found.data, fit.Comparisons) else "JND"
    return (
        f"log-likelihood {found.log_likelihood:.3f} of {size} {kind}, "
        f"AIC {found.aic:.3f}, BIC {found.bic:.3f}; {found.solver.value}: "
        f"{found.verdict}"
    )


def _sections(
    source: _Source,
    found: fit.Fit,
    constants: "pandas.DataFrame",
    blocks: "pandas.DataFrame",
    profiles: Sequence[fit.Profile],
    crossed: Mapping[str, "pandas.DataFrame"],
    rows: "pandas.DataFrame",
) -> list[tuple[str, list[Html]]]:
    import pandas as pd

    from .plotting import profile_likelihood

    correlation = pd.DataFrame(found.correlation, columns=list(found.free))
    correlation.insert(0, "constant", list(found.free))
    sections = [
        ("What is left", [table(blocks), text(_summary(found) + ".")]),
        ("Constants", [table(constants, _FORMATS), text(_ERRORS)]),
        ("Correlation", [table(correlation)]),
        *_figures(rows, found, source.by_group),
    ]
    if profiles:
        errors = dict(zip(found.free, found.standard_error, strict=True))
        units = found.problem.constants.units()
        names = [p.name for p in profiles]
        drawn = profile_likelihood(
            profiles,
            np.array([errors[name] for name in names]),
            [units[name] for name in names],
        )
        shown = picture(drawn, "Profile likelihood of the constants")
        sections.append(("Profile likelihood", [shown]))
    for name, frame in crossed.items():
        sections.append((f"Left out by {name}", [table(frame)]))
    sections.append(("Every condition", [table(rows)]))
    return sections


def _figures(
    rows: "pandas.DataFrame", found: fit.Fit, by_group: bool
) -> list[tuple[str, list[Html]]]:
    """Figure 7 of Jindal et al. 2021 as far as the data have it, and all in one."""
    from .plotting import (
        measured_and_predicted,
        quality_by_refresh_rate,
        quality_by_shading_rate,
    )

    if by_group:
        rows = rows.assign(data_set=rows["group"], block=rows["group"])
    varied: Any = rows.groupby("data_set")[["rate_x", "refresh_rate_hz"]].nunique() > 1
    figures = []
    if varied["rate_x"].any():
        drawn = quality_by_shading_rate(rows, found.predicted)
        alt = "Quality against shading rate, measured and predicted"
        figures.append(("Quality against shading rate", [picture(drawn, alt)]))
    if (varied["refresh_rate_hz"] & ~varied["rate_x"]).any():
        drawn = quality_by_refresh_rate(rows, found.predicted)
        alt = "Quality against refresh rate, measured and predicted"
        figures.append(("Quality against refresh rate", [picture(drawn, alt)]))
    points = rows.assign(
        model="CaMoJAB", unit="JND", measured=rows["quality_jnd"]
    ).rename(
        columns={"predicted_jnd": "predicted", "low_jnd": "low", "high_jnd": "high"}
    )
    drawn = measured_and_predicted(points)
    alt = "Quality measured and predicted, a panel for each block"
    figures.append(("Measured and predicted", [picture(drawn, alt)]))
    return figures
