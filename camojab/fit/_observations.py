"""Scaled measurements, with the conditions that the model is evaluated at."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from .. import datasets


if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Observations:
    """What a fit needs: measured differences of quality and their conditions.

    - `table`: a row per measurement. Columns: those of the model's conditions (as
      `camojab predict` names them, `velocity_deg_s` being what enters the model);
      `data_set`, which shares one scale; `block`, which is reported on its own;
      `reference`, the row that quality is measured against; `temporal_only`, where
      only the judder differs; `quality_jnd`, measured, relative to `reference`;
      `low_jnd` and `high_jnd`, the ends of its interval where it has one.
    - `textures`: the texels of each name in the column `texture`.
    """

    table: "pandas.DataFrame"
    textures: Mapping[str, Float[np.ndarray, "rows columns"]]


def jindal2021() -> Observations:
    """The 184 values that the published constants were fitted to.

    Experiment 1 of Jindal et al. 2021 (three blocks) and Experiments 1 and 3 of Denes
    et al. 2020, with the set-up of the authors' fit: quality relative to full rate, to
    50 Hz and to 82.5 Hz, shading reduced along the motion only.
    """
    import pandas

    rates: Any = datasets.jindal2021_jnd()
    # The eye's own rotation in the experiment, as the authors' fit takes it.
    rates["velocity_deg_s"] = rates.pop("tracked_velocity_deg_s")
    rates = _described(rates, "jindal2021", "Block-" + rates["block"])
    rates["reference"] = _references(
        rates, ["block", "texture", "velocity_deg_s"], rates["rate_x"] == 1
    )

    refresh = _described(
        datasets.denes2020_exp1_jnd(), "denes2020_exp1", "MARRR Exp. 1"
    )
    refresh["reference"] = _references(
        refresh, ["velocity_deg_s"], refresh["refresh_rate_hz"] == 50
    )

    judder: Any = datasets.denes2020_exp3_jnd()
    judder = _described(judder, "denes2020_exp3", "MARRR Exp. 3")
    judder["temporal_only"] = True
    judder["quality_jnd"] = -judder["loss_jnd"]
    judder["low_jnd"] = judder["high_jnd"] = np.nan
    judder["reference"] = _references(
        judder, ["velocity_deg_s"], judder["refresh_rate_hz"] == 82.5
    )
    return Observations(
        _stacked([rates, refresh, judder], pandas), datasets.jindal2021_textures()
    )


def _described(table: Any, data_set: str, block: Any) -> Any:
    return table.assign(data_set=data_set, block=block, temporal_only=False)


def _references(table: Any, group: list[str], reference: Any) -> Any:
    """The row, among those alike in `group`, that is the reference of each row."""
    rows = table.index.to_series().where(reference)
    return rows.groupby([table[name] for name in group]).transform("max").astype(int)


def _stacked(parts: list[Any], pandas: Any) -> Any:
    """Tables below one another, `reference` moved with its rows."""
    start = 0
    shifted = []
    for part in parts:
        shifted.append(part.assign(reference=part["reference"] + start))
        start += len(part)
    return pandas.concat(shifted, ignore_index=True, join="inner")
