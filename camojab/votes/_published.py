"""Votes of published experiments in the tidy form."""

from typing import TYPE_CHECKING

import numpy as np

from .. import datasets


if TYPE_CHECKING:
    import pandas


def votes_jindal2021() -> "pandas.DataFrame":
    """Experiment 1 of Jindal et al. 2021: 4764 votes of 13 observers in nine groups.

    **Returns:** a table as `read_votes` returns it, in the order of the file. Groups:
    `block` (`"PC"`, `"Mobile"`, `"VR"`) and `velocity_deg_s`. Nine conditions in each:
    `"full"`, full rate, which is one condition for all textures, and the texture with
    the coarse pixel, width x height relative to it, as `"grass 2x1"` or `"noise 4x1"`.
    (The stimuli had half the vertical resolution throughout; only the width differs.)

    **Raises:** as `datasets.fetch`.

    **Source:** see `datasets.jindal2021_votes`. The published JND come from these votes
    with `Prior.BOUNDED`, relative to `"full"`.
    """
    votes = datasets.jindal2021_votes()

    def condition(side: str) -> list[str]:
        sides = zip(votes[f"texture_{side}"], votes[f"rate_x_{side}"], strict=True)
        return [
            "full" if rate == 1 else f"{texture} {round(1 / rate)}x1"
            for texture, rate in sides
        ]

    return votes[["observer", "block", "velocity_deg_s"]].assign(
        condition_a=condition("a"),
        condition_b=condition("b"),
        a_preferred=votes["a_preferred"],
    )


def votes_denes2020() -> "pandas.DataFrame":
    """Experiment 1 of Denes et al. 2020: 3961 votes in six groups.

    Only counts were published, for each pair of refresh rates. Here they are one vote a
    row, all of the observer `"unknown"`, in an order that means nothing: they can be
    scaled, but nothing that compares observers can be said of them (`bootstrap` and
    `outliers` refuse them). The votes across stimuli were not published.

    **Returns:** a table as `read_votes` returns it. Groups: `stimulus`, as in
    `datasets.denes2020_exp1_comparisons`. Conditions: `"50 Hz"` to `"165 Hz"`;
    `condition_a` is the lower rate.

    **Raises:** as `datasets.fetch`.
    """
    import pandas as pd

    pairs = datasets.denes2020_exp1_comparisons()
    parts = []
    for won, votes in ((True, pairs["a_wins"]), (False, pairs["b_wins"])):
        each = pairs.loc[np.repeat(pairs.index, votes)]
        parts.append(
            pd.DataFrame(
                {
                    "observer": "unknown",
                    "stimulus": each["stimulus"],
                    "condition_a": [f"{f:g} Hz" for f in each["refresh_rate_a_hz"]],
                    "condition_b": [f"{f:g} Hz" for f in each["refresh_rate_b_hz"]],
                    "a_preferred": won,
                }
            )
        )
    return pd.concat(parts).sort_index(kind="stable").reset_index(drop=True)
