"""Figures of captured viewpoints, of what a network says of them, and of rate maps."""

from collections.abc import Mapping, Sequence
from typing import Any, TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from .._rates import RATES, TILE


if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..capture import View


def view_buffers(view: "View") -> "Figure":
    """What was captured of a viewpoint: pictures, and buffers with their units."""
    from matplotlib.figure import Figure

    from ._indices import count_on

    coarsest = RATES.names.index("4x4")
    speed = np.hypot(*np.moveaxis(view.motion, -1, 0))
    sky = ~np.isfinite(view.depth)
    pictures = {
        "shaded at 1x1": view.reference,
        "shaded at 4x4": view.images[coarsest],
        "reprojected (unseen black)": view.reprojected,
        "diffuse": view.diffuse,
        "specular": view.specular,
        "view normal (+1)/2": (view.normal.astype(np.float32) + 1) / 2,
    }
    buffers = {
        "roughness [1]": (view.roughness / 255, "viridis"),
        "depth [m]": (np.where(sky, np.nan, view.depth), "cividis"),
        "mip level [octaves]": (view.mip_level.astype(np.float32), "viridis"),
        "texture [index]": (view.texture, "turbo"),
        "sun [1]": (view.shadow / 255, "gray"),
        "motion [px]": (speed, "magma"),
    }
    figure = Figure(figsize=(13, 9.2))
    figure.set_layout_engine("constrained")
    axes: Any = figure.subplots(4, 3).ravel()
    for axis, (title, picture) in zip(axes, pictures.items(), strict=False):
        _bare(axis, title).imshow(picture)
    for axis, (title, (values, colours)) in zip(axes[6:], buffers.items(), strict=True):
        shown = _bare(axis, title).imshow(values, cmap=colours, interpolation="nearest")
        bar = figure.colorbar(shown, ax=axis, shrink=0.85)
        if title.endswith("[index]"):
            count_on(bar)
    return figure


def predicted_errors(
    pictures: Sequence[UInt8[np.ndarray, "height width 3"]],
    seen: Sequence[Bool[np.ndarray, "height width"]],
    measured: Sequence[Float[np.ndarray, "rows columns"]],
    predicted: Sequence[Float[np.ndarray, "rows columns"]],
    *,
    label: str,
) -> "Figure":
    """What a network predicts beside what was measured, a row for each viewpoint.

    **Arguments:**

    - `pictures`: shaded at full rate, sRGB bytes; what was not seen before is darkened.
    - `seen`: pixels that the previous picture shows.
    - `measured`, `predicted`: of each tile, on one scale.
    - `label`: what is measured, with its shading rate and its unit; without one it is
        a pure number. Differences have the same, and are shown to the largest.
    """
    from matplotlib.figure import Figure

    from camojab.plotting._style import with_unit

    highest = max(float(np.max(x)) for x in (*measured, *predicted)) or 1.0
    apart = [p - m for p, m in zip(predicted, measured, strict=True)]
    farthest = max(float(np.max(np.abs(x))) for x in apart) or 1.0
    height, width, _ = pictures[0].shape
    figure = Figure(figsize=(13.5, 0.5 + 3.0 * height / width * len(pictures)))
    figure.set_layout_engine("constrained")
    rows: Any = figure.subplots(len(pictures), 4, squeeze=False)
    scale = {"vmin": 0.0, "vmax": highest, "cmap": "magma"}
    off = {"vmin": -farthest, "vmax": farthest, "cmap": "RdBu_r"}
    for i, axes in enumerate(rows):
        dark = np.where(seen[i][..., None], pictures[i], pictures[i] // 4)
        _bare(axes[0], "picture, unseen dark" if i == 0 else "").imshow(dark)
        _bare(axes[1], "measured" if i == 0 else "").imshow(measured[i], **scale)
        _bare(axes[2], "predicted" if i == 0 else "").imshow(predicted[i], **scale)
        title = "predicted - measured" if i == 0 else ""
        _bare(axes[3], title).imshow(apart[i], **off)
    label = with_unit(label)
    unit = label[label.rindex("[") :]
    for images, text in ((rows[:, 1:3], label), (rows[:, 3:], f"difference {unit}")):
        shown = images[0, 0].images[0]
        figure.colorbar(shown, ax=list(images.ravel()), shrink=0.8, label=text)
    return figure


def rate_maps(
    maps: Mapping[str, Int[np.ndarray, "rows columns"]],
    pictures: Mapping[str, UInt8[np.ndarray, "height width 3"]],
    errors: Mapping[str, float],
    *,
    label: str,
) -> "Figure":
    """Rate maps of several methods, and the pictures that they make.

    **Arguments:**

    - `maps`: rate of each tile by method, as an index into `alsarr.RATES`.
    - `pictures`: shaded so, sRGB bytes, by the same names.
    - `errors`: of each picture, by the same names.
    - `label`: what the errors are, with their unit.
    """
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    count = len(maps)
    height, width, _ = next(iter(pictures.values())).shape
    figure = Figure(figsize=(4.3 * count, 1.2 + 2 * 4.3 * height / width))
    figure.set_layout_engine("constrained")
    axes: Any = figure.subplots(2, count, squeeze=False)
    for column, (name, rate) in enumerate(maps.items()):
        colours = RATES.colour[rate].repeat(TILE, axis=0).repeat(TILE, axis=1)
        cost = RATES.cost[rate].mean() / RATES.cost.max()
        title = f"{name}\n{label} {errors[name]:.4f}, cost {cost:.1%} of 1x1"
        _bare(axes[0, column], title).imshow(pictures[name])
        _bare(axes[1, column], "").imshow(colours[:height, :width])
    keys = [
        Patch(color=tuple(colour / 255), label=name)
        for name, colour in zip(RATES.names, RATES.colour, strict=True)
    ]
    figure.legend(handles=keys, ncols=len(keys), loc="outside lower center", fontsize=9)
    return figure


def _bare(axis: "Axes", title: str) -> "Axes":
    axis.set_title(title, fontsize=9)
    axis.set_xticks([])
    axis.set_yticks([])
    return axis
