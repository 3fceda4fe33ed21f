"""Figures of frames and rate maps; each returns a matplotlib `Figure`."""

from typing import TYPE_CHECKING

import numpy as np

from ._frame import Frame


if TYPE_CHECKING:
    from matplotlib.figure import Figure


def frame_buffers(frame: Frame) -> "Figure":
    """The buffers of a frame side by side, a square a tile, with their units."""
    from matplotlib import colormaps
    from matplotlib.figure import Figure

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
        figure.colorbar(image, ax=axis, shrink=0.85)
    return figure
