"""Scales of what is counted, not measured."""

from typing import TYPE_CHECKING

import numpy as np


if TYPE_CHECKING:
    from matplotlib.colorbar import Colorbar


def count_on(bar: "Colorbar") -> None:
    """Have ticks at whole numbers alone, each in the middle of its colour."""
    from matplotlib.ticker import MaxNLocator

    indices = np.asarray(bar.mappable.get_array())
    bar.mappable.set_clim(indices.min() - 0.5, indices.max() + 0.5)
    bar.set_ticks(MaxNLocator(10, steps=[1, 2, 5, 10], integer=True, min_n_ticks=1))
