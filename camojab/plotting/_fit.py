"""How well the constants of a fit are known."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ._style import COLOURS, legend, new_figure


if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..fit import Profile


def profile_likelihood(
    profiles: "Sequence[Profile]",
    standard_error: Float[np.ndarray, " profiles"],
    units: Sequence[str],
) -> "Figure":
    """A panel for each constant: the deviance, its interval, and a parabola.

    Between the points that were fitted the deviance is drawn by the interpolation that
    the ends of the interval come from.

    **Arguments:** profiles, and the standard error [in `units`] that the parabola has
    which the likelihood would be if it were one.
    """
    from scipy.stats import chi2

    columns = min(len(profiles), 3)
    lines = -(-len(profiles) // columns)
    figure = new_figure(3.3 * columns + 0.2, 2.7 * lines + 0.5)
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    for axis in panels[len(profiles) :]:
        axis.remove()
    for axis, found, error, unit in zip(
        panels, profiles, standard_error, units, strict=False
    ):
        best = found.values[int(np.argmin(found.deviance))]
        fine = np.linspace(found.values[0], found.values[-1], 200)
        parabola = ((fine - best) / error) ** 2
        axis.plot(fine, parabola, "--", color="0.6", label="standard error")
        axis.plot(fine, _deviance(found, fine), color=COLOURS[0], label="profile")
        axis.plot(found.values, found.deviance, ".", color=COLOURS[0], markersize=5)
        bound = float(chi2.ppf(found.level, 1))
        axis.axhline(bound, color="0.8", linewidth=0.8, zorder=0)
        for end in (found.low, found.high):
            axis.axvline(end, color=COLOURS[1], linewidth=1.0, label="interval")
        axis.set_ylim(0, 5 * bound)
        near = found.values[found.deviance < 5 * bound]
        axis.set_xlim(near[0], near[-1])
        axis.set_xlabel(f"{found.name} [{unit}]", fontsize=9)
        axis.set_ylabel("deviance [1]", fontsize=9)
        axis.tick_params(labelsize=8)
    legend(figure, list(panels[: len(profiles)]))
    return figure


def _deviance(
    found: "Profile", at: Float[np.ndarray, " fine"]
) -> Float[np.ndarray, " fine"]:
    """Its root, negative below the best value, is smooth; see `camojab.fit.profile`."""
    from scipy.interpolate import PchipInterpolator

    root = np.sqrt(found.deviance)
    root[: int(np.argmin(found.deviance))] *= -1
    return PchipInterpolator(found.values, root)(at) ** 2
