"""Figures of frames, rate maps and refresh rates: functions that return a `Figure`."""

from collections.abc import Mapping, Sequence
from typing import Any, TYPE_CHECKING

import numpy as np
from jaxtyping import ArrayLike

from .._comparison import Judged
from .._frame import Frame
from .._rates import RATES, TILE
from .._refresh import RefreshTable


if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def frame_buffers(frame: Frame) -> "Figure":
    """The buffers of a frame side by side, a square a tile, with their units."""
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    from ._indices import count_on

    texture = np.asarray(frame.texture)
    count = int(texture.max() - texture.min()) + 1
    speed = np.hypot(np.asarray(frame.velocity_x), np.asarray(frame.velocity_y))
    buffers = {
        "texture [index]": (texture, colormaps["turbo"].resampled(count)),
        "mip level [octaves]": (np.asarray(frame.mip_level), "viridis"),
        "slowest motion [deg/s]": (speed, "magma"),
        "luminance [cd/m$^2$]": (np.asarray(frame.luminance), "gray"),
    }
    figure = Figure(figsize=(11, 6.2))
    figure.set_layout_engine("constrained")
    for axis, (title, (values, colours)) in zip(
        figure.subplots(2, 2).ravel(), buffers.items(), strict=True
    ):
        image = axis.imshow(values, cmap=colours, interpolation="nearest")
        axis.set_title(title, fontsize=10)
        axis.set_xticks([])
        axis.set_yticks([])
        bar = figure.colorbar(image, ax=axis, shrink=0.85)
        if title.endswith("[index]"):
            count_on(bar)
    return figure


def refresh_rates(tables: Mapping[str, RefreshTable]) -> "Figure":
    """Quality against refresh rate, and what is best against velocity (Figure 8).

    **Arguments:**

    - `tables`: of budgets, by what they are to be called. Above there is a panel for
        each with a curve for some of its velocities and the best of each marked; below
        are the best refresh rate and the resolution it leaves.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(max(9.0, 4.5 * len(tables)), 7.4))
    figure.set_layout_engine("constrained")
    halves: Any = figure.subfigures(2, 1, height_ratios=(1.15, 1))
    above, below = halves
    panels = above.subplots(1, len(tables), squeeze=False, sharey=True)[0]
    for axis, (name, table) in zip(panels, tables.items(), strict=True):
        _quality_curves(axis, table)
        axis.set_title(f"budget {name}", fontsize=10)
    panels[0].set_ylabel("quality [JND]")
    panels[-1].legend(
        title="velocity [deg/s],\nbest marked",
        fontsize=8,
        title_fontsize=8,
        loc="center left",
        bbox_to_anchor=(1.0, 0.5),
        frameon=False,
    )
    _best_against_velocity(below.subplots(1, 2), tables)
    return figure


def _quality_curves(axis: "Axes", table: RefreshTable) -> None:
    from matplotlib import colormaps

    velocity = np.asarray(table.velocity)
    some = np.unique(np.linspace(0, velocity.size - 1, 7).round().astype(int))
    rates, quality = np.asarray(table.candidates), np.asarray(table.candidate_quality)
    # Few candidates are a list, and nothing is between them.
    marker = "." if rates.size <= 12 else ""
    for i, entry in enumerate(some):
        colour = colormaps["viridis"](0.92 * i / max(some.size - 1, 1))
        name = f"{velocity[entry]:g}"
        axis.plot(rates, quality[entry], marker=marker, color=colour, label=name)
        best = quality[entry].argmax()
        axis.plot(
            rates[best],
            quality[entry, best],
            "o",
            color=colour,
            markeredgecolor="black",
            markersize=7,
            zorder=3,
        )
    axis.set_xlabel("refresh rate [Hz]")
    axis.grid(color="0.92", zorder=0)


def _best_against_velocity(axes: Any, tables: Mapping[str, RefreshTable]) -> None:
    from camojab.plotting._style import COLOURS

    for i, (name, table) in enumerate(tables.items()):
        style: dict[str, Any] = {"color": COLOURS[i % len(COLOURS)], "where": "mid"}
        velocity = np.asarray(table.velocity)
        axes[0].step(velocity, np.asarray(table.refresh_rate), label=name, **style)
        axes[1].step(velocity, np.asarray(table.resolution), label=name, **style)
    axes[0].set_ylabel("best refresh rate [Hz]")
    axes[1].set_ylabel("shading resolution of each axis [1]")
    axes[1].set_ylim(0, 1.05)
    axes[1].set_yticks([0, 0.25, 0.5, 0.75, 1])
    for axis in axes:
        axis.set_xlabel("velocity [deg/s]")
        axis.grid(color="0.92", zorder=0)
    axes[0].legend(title="budget", fontsize=8, title_fontsize=8, loc="lower right")


def shading_preview(image: ArrayLike, rate: ArrayLike) -> "Figure":
    """A picture beside its rate map in the paper's colours, above a legend.

    Saved at the figure's own `dpi`, both have their pixels exactly.

    **Arguments:**

    - `image`: [height, width, 3], sRGB-encoded, in [0, 1], such as `coarse` makes it.
    - `rate`: index of the rate of each tile, [rows, columns].
    """
    from matplotlib.figure import Figure

    left = np.round(np.asarray(image) * 255).astype(np.uint8)
    rate = np.asarray(rate)
    height, width, _ = left.shape
    right = RATES.colour[rate].repeat(TILE, axis=0).repeat(TILE, axis=1)
    # Lettering grows with large pictures, which are shown smaller.
    unit = max(1.0, 2 * width / 1000)
    margin, legend = round(12 * unit), round(62 * unit)
    whole = max(2 * width + 3 * margin, 700), height + 2 * margin + legend
    figure = Figure(figsize=(whole[0] / 100, whole[1] / 100), dpi=100)
    start = (whole[0] - 2 * width - margin) // 2
    for x, pixels in ((start, left), (start + width + margin, right)):
        pixels = pixels[:height, :width]
        figure.figimage(pixels, x, margin + legend, origin="upper")
    _rate_legend(figure, rate, unit, margin)
    return figure


def _rate_legend(figure: "Figure", rate: np.ndarray, unit: float, margin: int) -> None:
    from matplotlib.patches import Rectangle
    from matplotlib.transforms import Affine2D

    width, height = figure.bbox.size
    pixels = Affine2D().scale(1 / width, 1 / height) + figure.transFigure
    shares = np.bincount(rate.ravel(), minlength=len(RATES)) / rate.size
    style: dict[str, Any] = {"transform": pixels, "size": 7.5 * unit, "va": "center"}
    entry = (width - 2 * margin) / len(RATES)
    for i, (name, share) in enumerate(zip(RATES.names, shares, strict=True)):
        x, y, side = margin + i * entry, margin + 30 * unit, 18 * unit
        colour = RATES.colour[i] / 255
        figure.add_artist(
            Rectangle((x, y), side, side, facecolor=colour, transform=pixels)
        )
        figure.text(x + 1.25 * side, y + side / 2, f"{name}  {share:.1%}", **style)
    cost = float(shares @ (RATES.cost / RATES.cost.max()))
    words = (
        "coarse pixel, width x height, and its share of the tiles; cost {:.1%} of 1x1"
    )
    figure.text(margin, margin + 10 * unit, words.format(cost), **style)


def methods_compared(rows: Sequence[Judged]) -> "Figure":
    """What methods make of budgets, and the shading rates they choose at one of them.

    **Arguments:**

    - `rows`: of every method at every budget. Above is quality against budget and,
        where refresh rates differ, those beside it, a line a method; lines that
        coincide are rings within each other. Below are shares of the rates at the
        middle budget.
    """
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(row.method for row in rows))
    budgets = sorted({row.budget for row in rows})
    several = len({row.refresh_rate for row in rows}) > 1
    figure = Figure(figsize=(12 if several else 9.5, 5.2 + 0.31 * len(names)))
    figure.set_layout_engine("constrained")
    ratios = (4.6, 0.7 + 0.31 * len(names))
    halves: Any = figure.subfigures(2, 1, height_ratios=ratios)
    above = halves[0].subplots(1, 1 + several, squeeze=False)[0]
    _against_budget(above[0], rows, names, "quality")
    above[0].set_ylabel("quality [JND]")
    if several:
        _against_budget(above[1], rows, names, "refresh_rate")
        above[1].set_ylabel("refresh rate [Hz]")
    above[-1].legend(
        loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8.5, frameon=False
    )
    middle = budgets[(len(budgets) - 1) // 2]
    _rate_shares(halves[1].subplots(), [r for r in rows if r.budget == middle])
    return figure


def _against_budget(
    axis: "Axes", rows: Sequence[Judged], names: Sequence[str], field: str
) -> None:
    from camojab.plotting._style import COLOURS, MARKERS

    for i, name in enumerate(names):
        again, k = divmod(i, len(COLOURS))
        own = sorted((r for r in rows if r.method == name), key=lambda r: r.budget)
        outer = 1 - i / max(len(names) - 1, 1)
        axis.plot(
            [100 * r.budget for r in own],
            [getattr(r, field) for r in own],
            color=COLOURS[k],
            marker=MARKERS[(k + again) % len(MARKERS)],
            linestyle=("-", "--", ":")[again % 3],
            markersize=4 + 8 * outer,
            markerfacecolor="none",
            markeredgewidth=1.4,
            linewidth=1 + 1.5 * outer,
            label=name,
        )
    ticks = sorted({100 * row.budget for row in rows})
    axis.set_xscale("log", base=2)
    axis.set_xticks(ticks, [f"{tick:.4g}" for tick in ticks])
    axis.minorticks_off()
    axis.set_xlabel("budget [% of full rate at the highest refresh rate]")
    axis.grid(color="0.92", zorder=0)


def _rate_shares(axis: "Axes", rows: Sequence[Judged]) -> None:
    """Bars of the methods from the top, and beside them what each has reached."""
    place = np.arange(len(rows))
    shares = 100 * np.array([row.shares for row in rows])
    start = np.cumsum(shares, axis=1) - shares
    for i, name in enumerate(RATES.names):
        colour = RATES.colour[i] / 255
        axis.barh(place, shares[:, i], left=start[:, i], color=colour, label=name)
    for y, row in enumerate(rows):
        found = f"{row.quality:.2f} JND, {row.refresh_rate:.4g} Hz"
        axis.text(101, y, found, va="center", fontsize=8.5)
    axis.set_yticks(place, [row.method for row in rows], fontsize=8.5)
    axis.invert_yaxis()
    axis.set_xlim(0, 100)
    axis.set_xlabel(
        f"share of the tiles [%] at a budget of {100 * rows[0].budget:.4g} %"
    )
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
    axis.legend(
        loc="lower left",
        bbox_to_anchor=(0, 1.0),
        ncols=len(RATES),
        fontsize=8.5,
        frameon=False,
    )
