"""Textures as pictures, and how much of each frequency they have."""

from collections.abc import Mapping
from typing import Any, TYPE_CHECKING

import numpy as np
from jaxtyping import ArrayLike, Float

from ._style import COLOURS, legend, logarithmic, new_figure


if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .._spectrum import Spectrum


_PICTURES_IN_A_LINE = 6
# What is below this share of the largest amplitude is rounding.
_FLOOR = 1e-9


def textures(images: Mapping[str, ArrayLike]) -> "Figure":
    """Grey pictures beside each other, encoded for the screen, each under its name.

    Six are in a line, all of one width.

    **Arguments:**

    - `images`: relative luminance, [height, width], by name. [1], in [0, 1].

    **Raises:** `ValueError` for no image, one that is not grey, and values that are
    not in [0, 1].
    """
    pictures = {name: _checked(name, image) for name, image in images.items()}
    if not pictures:
        raise ValueError("`images` must have at least one image, got none.")
    columns = min(_PICTURES_IN_A_LINE, len(pictures))
    lines = -(-len(pictures) // columns)
    side = min(2.6, 10.0 / columns)
    tall = max(len(picture) / len(picture.T) for picture in pictures.values())
    figure = new_figure(side * columns, (side * tall + 0.27) * lines)
    # Stored in notebooks, whose pictures have to stay small.
    figure.set_dpi(80)
    axes: Any = figure.subplots(lines, columns, squeeze=False).ravel()
    for axis in axes:
        axis.set_axis_off()
    for axis, (name, picture) in zip(axes, pictures.items(), strict=False):
        axis.imshow(picture ** (1 / 2.2), cmap="gray", vmin=0.0, vmax=1.0)
        axis.set_title(name, fontsize=10)
        # What room there is belongs to the names.
        axis.set_anchor("S")
    return figure


def _checked(name: str, image: ArrayLike) -> Float[np.ndarray, "rows columns"]:
    values = np.asarray(image, float)
    if values.ndim != 2 or not values.size:
        raise ValueError(
            f"`images` must have shape [height, width], got {list(values.shape)} for "
            f"{name!r}."
        )
    outside = values[~((values >= 0) & (values <= 1))]
    if outside.size:
        raise ValueError(
            f"`images` must be in [0, 1], got {outside[0]:g} for {name!r}."
        )
    return values


def amplitude_spectra(
    spectra: "Mapping[str, Spectrum]", *, ppd: float | None = None
) -> "Figure":
    """Amplitude against spatial frequency, a line for each texture.

    A point is the mean over the ring of bins at its distance from frequency 0, to the
    nearest bin. Both axes are logarithmic; frequency 0, and rings that hold nothing but
    rounding, are left out.

    **Arguments:**

    - `spectra`: by the names of their textures.
    - `ppd`: of a display on which a texel covers a pixel: frequency is in cycles per
        degree then, and in cycles per texel if left out. [px/deg], > 0.

    **Raises:** `ValueError` for no spectrum, and for a `ppd` that is out of range.
    """
    if not spectra:
        raise ValueError("`spectra` must have at least one spectrum, got none.")
    if ppd is not None and not 0 < ppd < np.inf:
        raise ValueError(f"`ppd` must be positive and finite, got {ppd:g} px/deg.")
    texels = 1.0 if ppd is None else ppd
    figure = new_figure(6.6, 4.1)
    figure.set_dpi(80)
    axis = figure.subplots()
    for i, (name, spectrum) in enumerate(spectra.items()):
        amplitude = np.asarray(spectrum.amplitude, float)
        mean = _rings(amplitude)
        frequency = np.arange(1, len(mean) + 1) / len(amplitude) * texels
        axis.set(xscale="log", yscale="log", xlim=(frequency[0], texels / 2))
        some = mean > _FLOOR * amplitude.max()
        colour = COLOURS[i % len(COLOURS)]
        axis.plot(frequency[some], mean[some], color=colour, linewidth=1.4, label=name)
    unit = "cycles/texel" if ppd is None else "cycles/deg"
    axis.set_xlabel(f"spatial frequency [{unit}]")
    axis.set_ylabel("mean amplitude [1]")
    axis.grid(color="0.92", zorder=0)
    if any(np.size(line.get_xdata()) for line in axis.lines):
        logarithmic(axis.xaxis)
        logarithmic(axis.yaxis)
    legend(figure, [axis])
    return figure


def _rings(amplitude: Float[np.ndarray, "n n"]) -> Float[np.ndarray, " rings"]:
    """Means at distances of 1, 2, ... bins, up to those that are whole circles."""
    half = len(amplitude) // 2
    y, x = np.indices(amplitude.shape) - half
    ring = np.rint(np.hypot(x, y)).astype(int).ravel()
    return (np.bincount(ring, amplitude.ravel()) / np.bincount(ring))[1:half]
