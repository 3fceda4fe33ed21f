"""Opinion scores that no model was fitted to, beside what the models say of them."""

from collections.abc import Callable
from typing import Any, TYPE_CHECKING

from .. import fit
from .._parameters import Formulation, Parameters
from ._measurements import measurements
from ._regression import affine, correlation, rank_correlation, rms
from ._table import AFFINE, all_models, ALONE, predictions, printed, SHOWN


if TYPE_CHECKING:
    import pandas


def predicted_scores(
    *,
    parameters: Parameters | None = None,
    formulation: Formulation = Formulation.RELEASED,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> "pandas.DataFrame":
    """Every opinion score of Mackin et al. 2016 and ITU-R BT.2246, and three models'.

    **Arguments, raises:** as `compare`.

    **Returns:** a row for each model, reduction and measurement, with the columns

    - `model`, `block`, `reduction`: as in `compare`.
    - `velocity_deg_s`, `refresh_rate_hz`, `rate_x`, `rate_y`: what the model is told.
    - `measured`: the score, in `unit`.
    - `quality`: the model's. [JND]
    - `predicted`: its slope and intercept, fitted to the block. In `unit`.
    - `slope`, `intercept`: that did so.

    **Source:** Jindal et al. 2021, section 4.6 and Figure 7c.
    """
    import pandas as pd

    observations = measurements()
    scored: Any = observations.table
    scored = scored[scored["unit"] != "JND"]
    opinions = fit.Observations(scored, observations.textures)
    told = ["velocity_deg_s", "refresh_rate_hz", "rate_x", "rate_y"]
    parts = []
    models = all_models(parameters, formulation)
    found = predictions(opinions, models, progress=progress)
    for model, setting, part, quality in found:
        factor, intercept = affine(quality, part["measured"].to_numpy(float))
        own = part[["block", *told, "measured", "unit"]].assign(
            quality=quality,
            predicted=factor * quality + intercept,
            slope=factor,
            intercept=intercept,
        )
        own.insert(0, "model", model)
        own.insert(2, "reduction", setting.reduction)
        parts.append(own)
    return pd.concat(parts, ignore_index=True)


def validate(
    *,
    parameters: Parameters | None = None,
    formulation: Formulation = Formulation.RELEASED,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> "pandas.DataFrame":
    """The models on opinion scores that none of their constants were fitted to.

    As `compare`, on the data of Mackin et al. 2016 and ITU-R BT.2246 alone, after a
    slope and an intercept. CaMoJAB gives the paper's 0.42, 0.28 and 0.69, the last with
    the resolution reduced along the motion only, as the authors' program has it; told
    of both axes, which were reduced, it leaves 4.24 of 100 points and MARRR 0.33.

    **Arguments, raises:** as `compare`.

    **Returns:** a row for each model, block and reduction, with the columns `model`,
    `block`, `reduction`, `rows` (measurements), `slope`, `intercept`, `rmse`, `unit`,
    `pearson` and `spearman` (correlation of scores and qualities; NaN for a model that
    does not see what varies) and `printed`, as in `compare`.

    **Source:** Jindal et al. 2021, section 4.6 and Figure 7c.
    """
    return agreement(
        predicted_scores(
            parameters=parameters, formulation=formulation, progress=progress
        )
    )


def agreement(scores: "pandas.DataFrame") -> "pandas.DataFrame":
    """The rows of `validate` from those of `predicted_scores`."""
    import pandas as pd

    rows = []
    groups: Any = scores.groupby(["model", "block", "reduction"], sort=False)
    for (model, block, reduction), part in groups:
        column = lambda name, part=part: part[name].to_numpy(float)
        quality, measured = column("quality"), column("measured")
        row = {
            "model": model,
            "block": block,
            "reduction": reduction,
            "rows": len(part),
            "slope": column("slope")[0],
            "intercept": column("intercept")[0],
            "rmse": rms(column("predicted") - measured),
            "unit": part["unit"].iloc[0],
            "pearson": correlation(quality, measured),
            "spearman": rank_correlation(quality, measured),
        }
        setting = {"sharing": ALONE, "constants": AFFINE, "velocity": SHOWN}
        rows.append({**row, "printed": printed(row | setting)})
    return pd.DataFrame(rows)
