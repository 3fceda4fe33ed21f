"""Tidy vote tables."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int


if TYPE_CHECKING:
    import pandas


def count(votes: "pandas.DataFrame", conditions: list[str]) -> Int[np.ndarray, "n n"]:
    """Wins between conditions: entry (i, j) is how often i was preferred to j.

    **Arguments:**

    - `votes`: columns `condition_a`, `condition_b` and `a_preferred` (boolean).
    - `conditions`: the names, in the order of the result.

    **Raises:** `ValueError` naming a condition of `votes` that is not in the list.
    """
    index = {name: i for i, name in enumerate(conditions)}
    wins = np.zeros((len(conditions),) * 2, int)
    for a, b, preferred in zip(
        votes["condition_a"], votes["condition_b"], votes["a_preferred"], strict=True
    ):
        for name in (a, b):
            if name not in index:
                raise ValueError(
                    f"`votes` must name known conditions only, got {name!r}."
                )
        i, j = index[a], index[b]
        wins[(i, j) if preferred else (j, i)] += 1
    return wins
