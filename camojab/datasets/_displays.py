"""Displays by name, with the source of their numbers."""

import json
from typing import TYPE_CHECKING

from .._shipped import shipped


if TYPE_CHECKING:
    import pandas


def displays() -> "pandas.DataFrame":
    """Display presets, one a row.

    **Returns:** a table with the columns

    - `name`: such as `"jindal2021_pc"`.
    - `ppd`: pixels of the panel per visual degree. [px/deg]
    - `refresh_rate_hz`: frames a second. [Hz]
    - `mean_luminance_cd_m2`: luminance that the observer is adapted to. [cd/m2]
    - `persistence`: lit fraction of a frame, in (0, 1].
    - `source`: where each of these numbers is published.

    **Raises:** nothing.

    **Source:** `data/displays.json`, which says it for each display.

    **Example:**

    >>> from camojab import datasets
    >>> datasets.displays().set_index("name").loc["jindal2021_pc", "ppd"].item()
    50.0
    """
    import pandas as pd

    document = json.loads(shipped("displays.json").read_text(encoding="utf-8"))
    table = pd.DataFrame(document["displays"])
    return table.astype(dict.fromkeys(document["units"], float))
