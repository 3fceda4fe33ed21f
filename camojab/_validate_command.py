"""`camojab validate`: constants on data that they were not fitted to."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from . import comparison, datasets, fit, votes
from ._command import print_table, Study, usable
from ._page import Html, page, picture, table, text
from ._parameters import Formulation, load_parameters, Parameters
from ._results import (
    check_folder,
    EXPERIMENT,
    JINDAL2021,
    OPINIONS,
    provenance,
    quote,
    read_study,
    records,
    save,
    simulated_note,
    study_files,
    to_csv,
    to_json,
)
from ._shipped import shipped
from .comparison._models import camojab
from .comparison._regression import correlation, rank_correlation, rms, slope
from .comparison._validation import agreement
from .votes._simulation import SIGMA


if TYPE_CHECKING:
    import pandas


FILES = ("validate.json", "validate.csv", "report.html")

# What `comparison.predicted_scores` and `validation_preferences` read.
FETCHED = (*JINDAL2021, f"{EXPERIMENT}/alsarr_validation_experiment.csv")

_PUBLISHED = "Mackin et al. 2016, ITU-R BT.2246 and Experiment 2 of Jindal et al. 2021"
_FORMATS = {
    "p_value": ".2g",
    "printed": ".2f",
    "budget": "g",
    "velocity_deg_s": "g",
    "refresh_rate_hz": "g",
    "rate_x": "g",
    "rate_y": "g",
}
_SCORES = (
    "A slope and an intercept are fitted to each data set, no constant of a model. "
    "printed is the number of Table 5 where the row is the one behind it: the paper "
    "tells CaMoJAB that the resolution of ITU-R PPD was reduced along the motion only; "
    "it was reduced along both axes."
)
_ODDS = (
    "Exact binomial test of even odds, two-sided, and Clopper-Pearson intervals of "
    "95%. Votes count as independent, although 12 observers gave them all; no "
    "correction is made for the number of rows."
)
_OWN = (
    "RMSE is over all rows, the correlations are over those that are not their own "
    "reference. slope is the best factor (least squares) of the predicted JND, and "
    "best_scale the most likely one given the votes. Log-likelihoods are means over "
    "votes, natural logarithm: chance is even odds, scale is that of the JND that the "
    "votes themselves were scaled to, the most that any prediction could be expected "
    "to reach."
)


@dataclass(frozen=True)
class _Found:
    """What goes into the files and onto the terminal, by title."""

    main: "pandas.DataFrame"
    tables: Mapping[str, "pandas.DataFrame"]
    details: Mapping[str, "pandas.DataFrame"]
    sections: list[tuple[str, list[Html]]]
    notes: list[str]


def validate(
    *,
    own: Study | None,
    parameters: Path | None,
    output: Path,
    progress: Callable[[str, int, int], None],
) -> None:
    """Validate, write the files of `FILES` into the folder, and print the tables."""
    check_folder(output, FILES)
    with usable():
        constants, formulation = load_parameters(
            parameters or shipped("parameters_released.json")
        )
        if own:
            comparisons = read_study(own)
            name, files = str(own.votes), study_files(own, comparisons.textures)
        else:
            comparisons, name = None, _PUBLISHED
            files = {
                **{each: datasets.fetch(each) for each in FETCHED},
                **{each: shipped(each) for each in OPINIONS},
            }
    if parameters:
        files[str(parameters)] = parameters
    if comparisons is None:
        found = _on_published(constants, formulation, progress)
    else:
        with usable():
            found = _on_own(comparisons, constants, formulation, progress)
    line = quote(name, f"parameters: {formulation.value}, {constants.report()}")
    document = {
        **provenance("camojab-validate/1", files),
        "data": name,
        "formulation": formulation.value,
        "parameters": {key: float(value) for key, value in vars(constants).items()},
        "agreement": records(found.main),
        **{key: records(frame) for key, frame in found.details.items()},
        "notes": found.notes,
    }
    made_up = simulated_note(own.votes) if own else ""
    title = f"CaMoJAB on {name}"
    whole = page(title, found.sections, quote=line, simulated=made_up)
    contents = (to_json(document), to_csv(found.main), whole)
    save(output, dict(zip(FILES, contents, strict=True)))
    for title, frame in found.tables.items():
        print_table(title, frame, _FORMATS)
    for note in found.notes:
        print(note)
    print(f"to quote: {line}")
    print(f"written: {', '.join(str(output / each) for each in FILES)}")


def _on_published(
    constants: Parameters,
    formulation: Formulation,
    progress: Callable[[str, int, int], None],
) -> _Found:
    from .plotting import measured_and_predicted, preferences

    scores: Any = comparison.predicted_scores(
        parameters=constants,
        formulation=formulation,
        progress=lambda *steps: progress("models", *steps),
    )
    agreed = agreement(scores)
    bars = comparison.validation_preferences()
    scenes = comparison.validation_preferences(
        by=("scene", "budget", "against", "uniform_setting")
    )
    drawn = scores.assign(
        block=[
            block if reduction == "none" else f"{block}, told {reduction}"
            for block, reduction in zip(
                scores["block"], scores["reduction"], strict=True
            )
        ]
    )
    points = picture(measured_and_predicted(drawn), "Scores measured and predicted")
    sections = [
        ("Opinion scores", [points, table(agreed, _FORMATS), text(_SCORES)]),
        (
            "Preference for ALSaRR, Figure 12 (a)",
            [
                picture(preferences(bars), "Preference in six conditions"),
                table(bars, _FORMATS),
                text(_ODDS),
            ],
        ),
        (
            "Preference by scene, Figure 12 (b)",
            [
                picture(preferences(scenes), "Preference by scene"),
                table(scenes, _FORMATS),
            ],
        ),
        ("Every score", [table(scores, _FORMATS)]),
    ]
    return _Found(
        agreed,
        {
            "Opinion scores: RMSE, Pearson, Spearman": agreed,
            "Experiment 2, Figure 12 (a): preference for ALSaRR": bars,
            "Experiment 2, Figure 12 (b): by scene": scenes,
        },
        {"scores": scores, "preferences": bars, "preferences_by_scene": scenes},
        sections,
        [_SCORES, _ODDS],
    )


def _on_own(
    comparisons: fit.Comparisons,
    constants: Parameters,
    formulation: Formulation,
    progress: Callable[[str, int, int], None],
) -> _Found:
    from .plotting import measured_and_predicted

    progress("scale", 0, 1)
    observations: Any = fit.scaled(comparisons)
    progress("scale", 1, 1)
    progress("model", 0, 1)
    rows: Any = observations.table.reset_index(drop=True).assign(unit="JND")
    quality = camojab(rows, observations.textures, constants, formulation)
    progress("model", 1, 1)
    scored = rows.assign(predicted=quality)
    cast = _votes(comparisons, quality)
    blocks = dict.fromkeys(scored["block"])
    import pandas as pd

    lines = [
        {"block": block, **_agreement(own), **_likelihood(heard)}
        for block, own, heard in [
            *(
                (b, scored[scored["block"] == b], cast[cast["block"] == b])
                for b in blocks
            ),
            ("all", scored, cast),
        ]
    ]
    agreed = pd.DataFrame(lines)
    points = scored.assign(
        model="CaMoJAB", unit="JND", measured=scored["quality_jnd"]
    ).rename(columns={"low_jnd": "low", "high_jnd": "high"})
    figure = picture(measured_and_predicted(points), "JND measured and predicted")
    shown = scored[
        ["block", "condition", "quality_jnd", "low_jnd", "high_jnd", "predicted"]
    ].rename(columns={"predicted": "predicted_jnd"})
    sections = [
        ("Agreement", [figure, table(agreed), text(_OWN)]),
        ("Every condition", [table(shown)]),
    ]
    return _Found(
        agreed,
        {"Agreement with the votes": agreed},
        {"conditions": shown},
        sections,
        [_OWN],
    )


def _agreement(rows: Any) -> dict[str, float | int]:
    predicted = rows["predicted"].to_numpy(float)
    measured = rows["quality_jnd"].to_numpy(float)
    factor, _ = slope(predicted, measured)
    free = rows["reference"].to_numpy(int) != rows.index.to_numpy()
    return {
        "rows": len(rows),
        "rmse_jnd": rms(predicted - measured),
        "slope": factor,
        "rmse_after_slope_jnd": rms(factor * predicted - measured),
        "pearson": correlation(predicted[free], measured[free]),
        "spearman": rank_correlation(predicted[free], measured[free]),
    }


def _votes(
    comparisons: fit.Comparisons, quality: Float[np.ndarray, " rows"]
) -> "pandas.DataFrame":
    """Each vote's lead of the winner, predicted and on the votes' own scale. [JND]"""
    cast: Any = comparisons.votes
    found: Any = votes.scale_groups(cast, by=["group"], prior=votes.Prior.BOUNDED)
    jnd = found.table.set_index(["group", "condition"])["quality_jnd"]
    on_scale = lambda side: jnd.loc[
        list(zip(cast["group"], cast[f"condition_{side}"], strict=True))
    ].to_numpy()
    a, b = cast["a"].to_numpy(int), cast["b"].to_numpy(int)
    sign = np.where(cast["a_preferred"].to_numpy(bool), 1.0, -1.0)
    return cast.assign(
        block=comparisons.table["block"].to_numpy()[a],
        predicted=sign * (quality[a] - quality[b]),
        scaled=sign * (on_scale("a") - on_scale("b")),
    )


def _likelihood(cast: Any) -> dict[str, float | int]:
    from scipy.optimize import minimize_scalar

    predicted = cast["predicted"].to_numpy(float)
    if not len(cast):
        return {"votes": 0}
    found: Any = minimize_scalar(
        lambda factor: -_per_vote(factor * predicted), bounds=(0, 100), method="bounded"
    )
    return {
        "votes": len(cast),
        "log_likelihood": _per_vote(predicted),
        "best_scale": float(found.x),
        "log_likelihood_at_best_scale": -float(found.fun),
        "log_likelihood_of_chance": float(np.log(0.5)),
        "log_likelihood_of_scale": _per_vote(cast["scaled"].to_numpy(float)),
    }


def _per_vote(difference: Float[np.ndarray, " votes"]) -> float:
    """Mean log probability of votes for conditions better by so many JND."""
    from scipy.stats import norm

    return float(np.mean(norm.logcdf(difference / SIGMA)))
