"""Figures of oracles and solvers beside each other, and of what a network learned."""

from collections.abc import Mapping, Sequence
from typing import Any, TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int, UInt8

from .._rates import RATES, TILE
from ..network import Attribution


if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Of a column, for its title, and of a whole sheet, for the legend. [inches]
_COLUMN, _SHEET = 1.85, 6.0


def oracle_sheet(
    maps: Mapping[str, Int[np.ndarray, "rows columns"]],
    pictures: Mapping[str, UInt8[np.ndarray, "height width 3"]],
    errors: Mapping[str, Float[np.ndarray, "height width"]],
    *,
    label: str,
    detail: tuple[int, int, int, int] | None = None,
    columns: int = 5,
) -> "Figure":
    """Rate maps of several oracles, a detail of what each makes, and its error.

    Each oracle has its rate map in the paper's colours, below it a detail of the
    picture, and below that the error of every pixel on one scale. Titles have the mean
    error and the cost.

    **Arguments:**

    - `maps`: index of the rate of each tile, in the order of `alsarr.RATES`, by name.
    - `pictures`: shaded so, sRGB bytes, by the same names.
    - `errors`: of every pixel, >= 0, by the same names.
    - `label`: what the error is, with its unit; without one it is a pure number.
    - `detail`: left, top, width and height of what is shown of the pictures; a frame in
        the error marks it. All of them, if left out. [px]
    - `columns`: oracles beside each other. > 0
    """
    from matplotlib.figure import Figure

    from camojab.plotting._style import with_unit

    height, width = next(iter(errors.values())).shape
    left, top, wide, high = detail or (0, 0, width, height)
    columns = min(columns, len(maps))
    bands = -(-len(maps) // columns)
    shares = (height / width, high / wide, height / width)
    column = max(_COLUMN, (_SHEET - 0.7) / columns)
    size = columns * column + 0.7, bands * (column * sum(shares) + 0.5) + 0.4
    figure = Figure(figsize=size)
    figure.set_layout_engine("constrained", h_pad=0.02, w_pad=0.02, hspace=0)
    axes: Any = figure.subplots(
        3 * bands, columns, squeeze=False, height_ratios=shares * bands
    )
    for axis in axes.ravel():
        axis.set_axis_off()
    scale = {"vmin": 0.0, "vmax": max(float(np.max(e)) for e in errors.values()) or 1.0}
    for place, (name, rate) in enumerate(maps.items()):
        band, k = divmod(place, columns)
        above, middle, below = axes[3 * band : 3 * band + 3, k]
        cost = RATES.cost[rate].mean() / RATES.cost.max()
        mean = float(np.mean(errors[name]))
        above.set_title(f"{name}\n{label} {mean:.4f}, cost {cost:.1%}", fontsize=8)
        colours = RATES.colour[rate].repeat(TILE, axis=0).repeat(TILE, axis=1)
        above.imshow(colours[:height, :width], interpolation="nearest")
        shown = pictures[name][top : top + high, left : left + wide]
        middle.imshow(shown, interpolation="nearest")
        below.imshow(errors[name], cmap="magma", **scale)
        if detail is not None:
            _mark(below, detail)
    drawn, every = axes[2, 0].images[0], list(axes.ravel())
    figure.colorbar(drawn, ax=every, label=with_unit(label), pad=0.01, shrink=0.5)
    _rate_keys(figure)
    return figure


def _mark(axis: "Axes", place: tuple[int, int, int, int]) -> None:
    from matplotlib.patches import Rectangle

    left, top, wide, high = place
    axis.add_patch(Rectangle((left, top), wide, high, fill=False, edgecolor="white"))


def _rate_keys(figure: "Figure") -> None:
    from matplotlib.patches import Patch

    keys = [
        Patch(color=tuple(colour / 255), label=name)
        for name, colour in zip(RATES.names, RATES.colour, strict=True)
    ]
    figure.legend(handles=keys, ncols=len(keys), loc="outside lower center", fontsize=8)


def judged_twice(
    judged: Mapping[str, tuple[float, float]], *, labels: tuple[str, str]
) -> "Figure":
    """Oracles by two judgements of what they chose, a named point each.

    **Arguments:**

    - `judged`: both numbers of each oracle, by its name; less is better. Points that
        agree in three digits share a marker and a line of the legend.
    - `labels`: of the axes, with units.
    """
    from camojab.plotting._style import COLOURS, MARKERS, new_figure

    figure = new_figure(8.0, 4.6)
    axis = figure.subplots()
    together: dict[tuple[float, float], list[str]] = {}
    for name, (x, y) in judged.items():
        together.setdefault((float(f"{x:.3g}"), float(f"{y:.3g}")), []).append(name)
    for i, ((x, y), names) in enumerate(together.items()):
        again, k = divmod(i, len(COLOURS))
        marker = MARKERS[(k + again) % len(MARKERS)]
        colour = COLOURS[k]
        axis.plot(x, y, marker, color=colour, markersize=9, label=", ".join(names))
    axis.set_xlabel(labels[0])
    axis.set_ylabel(labels[1])
    axis.margins(0.12)
    axis.grid(color="0.92", zorder=0)
    axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=9, frameon=False)
    return figure


def solver_gaps(
    budgets: Sequence[float],
    gaps: Mapping[str, Sequence[float]],
    bounds: Mapping[str, Sequence[float]] | None = None,
) -> "Figure":
    """How far solvers stay below the best choice of rates, against the budget.

    **Arguments:**

    - `budgets`: shares of full rate everywhere, rising. [1]
    - `gaps`: of each solver at each budget, as a share of the best that there is. [1],
        >= 0. Below 0.001 % the axis is linear, so that 0 is on it.
    - `bounds`: for some of them what they say it could be at the most; dotted. [1]
    """
    from camojab.plotting._style import COLOURS, MARKERS, new_figure

    figure = new_figure(8.0, 4.2)
    axis = figure.subplots()
    percent = lambda values: 100 * np.asarray(values, float)
    for i, (name, found) in enumerate(gaps.items()):
        k = i % len(COLOURS)
        style: dict[str, Any] = {"color": COLOURS[k], "marker": MARKERS[k]}
        outer = 1 - i / max(len(gaps) - 1, 1)
        axis.plot(
            percent(budgets),
            percent(found),
            label=name,
            markersize=5 + 5 * outer,
            markerfacecolor="none",
            markeredgewidth=1.5,
            **style,
        )
        if bounds is not None and name in bounds:
            axis.plot(
                percent(budgets),
                percent(bounds[name]),
                linestyle=":",
                label=f"{name}: at the most",
                markersize=4,
                **style,
            )
    axis.set_yscale("symlog", linthresh=1e-3, linscale=0.5)
    axis.set_ylim(bottom=-2e-4)
    axis.set_xticks(percent(budgets), [f"{b:g}" for b in percent(budgets)])
    decades = (0, 0.001, 0.01, 0.1, 1, 10, 100)
    axis.set_yticks(decades, [f"{d:g}" for d in decades])
    axis.set_xlabel("budget [% of full rate everywhere]")
    axis.set_ylabel("below the best choice [%]")
    axis.grid(color="0.92", zorder=0)
    axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=9, frameon=False)
    return figure


def training_history(history: Float[np.ndarray, "evaluations 3"]) -> "Figure":
    """The loss of training, and the error on held-out views, against the steps done.

    **Arguments:**

    - `history`: of `alsarr.network.Training`. Without held-out views there is one line.
    """
    from camojab.plotting._style import COLOURS, new_figure

    figure = new_figure(7.0, 3.8)
    axis = figure.subplots()
    step, *losses = np.asarray(history, float).T
    names = "training views", "held-out views"
    for name, loss, colour in zip(names, losses, COLOURS, strict=False):
        if np.isfinite(loss).any():
            axis.plot(step, loss, marker="o", markersize=3, color=colour, label=name)
    axis.set_xlabel("steps [1]")
    axis.set_ylabel("mean absolute error,\ntransformed metric [1]")
    axis.set_ylim(bottom=0)
    axis.grid(color="0.92", zorder=0)
    axis.legend(frameon=False)
    return figure


def input_shares(attributions: Mapping[str, Attribution]) -> "Figure":
    """What each input contributes to predictions, where it was seen before and not.

    **Arguments:**

    - `attributions`: of networks with the same channels, by name; a panel each.
    """
    from camojab.plotting._style import new_figure

    figure = new_figure(4.6 * len(attributions), 3.2)
    panels: Any = figure.subplots(1, len(attributions), squeeze=False, sharey=True)[0]
    for axis, (name, found) in zip(panels, attributions.items(), strict=True):
        _shares(axis, found)
        axis.set_title(name, fontsize=10)
        axis.set_ylabel("input channel")
    panels[0].invert_yaxis()
    figure.legend(
        *panels[0].get_legend_handles_labels(),
        title="pixels that were",
        fontsize=8,
        title_fontsize=8,
        loc="outside right center",
        frameon=False,
    )
    return figure


def _shares(axis: "Axes", found: Attribution) -> None:
    from camojab.plotting._style import COLOURS

    place = np.arange(len(found.channels))
    for offset, name, colour in ((-0.2, "seen", 0), (0.2, "unseen", 5)):
        shares = getattr(found, name)
        axis.barh(place + offset, shares, 0.38, color=COLOURS[colour], label=name)
    axis.set_yticks(place, [name.replace("_", " ") for name in found.channels])
    axis.set_xlabel("share of the contributions [%]")
    axis.grid(axis="x", color="0.92", zorder=0)
    axis.set_axisbelow(True)
