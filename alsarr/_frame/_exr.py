"""Frames from the buffers that engines write as OpenEXR images."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import ArrayLike

from ._buffers import Frame
from ._published import hundredths


MotionUnit = Literal["deg/s", "px/frame", "uv/frame", "percent/frame"]

_NEEDED = ("texture", "mip_level", "motion_x", "motion_y")

# What each unit of motion cannot be understood without.
_DISPLAY = {
    "deg/s": (),
    "px/frame": ("ppd", "refresh_rate"),
    "uv/frame": ("ppd", "refresh_rate", "resolution_px"),
    "percent/frame": ("ppd", "refresh_rate", "resolution_px"),
}


def frame_from_exr(
    channels: Mapping[str, tuple[str | Path, str]],
    *,
    motion_unit: MotionUnit,
    ppd: float | None = None,
    refresh_rate: float | None = None,
    resolution_px: tuple[int, int] | None = None,
    luminance: ArrayLike | None = None,
    previous_image: ArrayLike | None = None,
) -> Frame:
    """A frame from channels of OpenEXR images that have a pixel for each tile.

    **Arguments:**

    - `channels`: where each buffer is: `texture`, `mip_level`, `motion_x`, `motion_y`
        and, if it was written, `luminance` [cd/m^2]; for each the file and the name of
        the channel, such as `("motion.exr", "R")`. Of several parts the first is read.
        Half-precision channels hold whole numbers to 2048 only.
    - `motion_unit`: what motion was written in; there is no default because no number
        tells. `"deg/s"`; `"px/frame"`; `"uv/frame"`, shares of the picture's width and
        height; or `"percent/frame"`, hundredths of them, as in the frame of Jindal et
        al. (2021).
    - `ppd` [px/deg], `refresh_rate` [Hz], `resolution_px` (width and height): of the
        picture, where the unit needs them: all for shares, the first two for pixels.
    - `luminance`, `previous_image`: as for `Frame`, unless `channels` has the former.

    **Raises:** `ValueError` for a buffer or display that is missing, a file that cannot
    be read whole (named), has no such channel, or has a window smaller than its
    display's; `OSError` for one that cannot be opened; and as `Frame`.
    """
    _check_request(channels, motion_unit, ppd, refresh_rate, resolution_px, luminance)
    images = {path: _read(Path(path)) for path in {p for p, _ in channels.values()}}
    buffers: dict[str, Any] = {
        name: _channel(images[path], path, channel)
        for name, (path, channel) in channels.items()
    }
    if luminance is not None:
        buffers["luminance"] = luminance
    display: dict[str, Any] = {"ppd": ppd, "refresh_rate": refresh_rate}
    display["resolution_px"] = resolution_px
    if motion_unit == "percent/frame" and resolution_px is not None:
        width, height = resolution_px
        buffers["motion_x"] = hundredths(buffers["motion_x"], width)
        buffers["motion_y"] = hundredths(buffers["motion_y"], height)
    make: Callable[..., Frame] = Frame.from_pixels_per_frame
    if motion_unit == "uv/frame":
        make = Frame.from_uv_per_frame
    if motion_unit == "deg/s":
        make, display = Frame.from_degrees, {}
    return make(**buffers, **display, previous_image=previous_image)


def _check_request(
    channels: Mapping[str, tuple[str | Path, str]],
    motion_unit: str,
    ppd: float | None,
    refresh_rate: float | None,
    resolution_px: tuple[int, int] | None,
    luminance: ArrayLike | None,
) -> None:
    missing = [name for name in _NEEDED if name not in channels]
    unknown = [name for name in channels if name not in (*_NEEDED, "luminance")]
    if missing or unknown:
        raise ValueError(
            f"`channels` must be {', '.join(_NEEDED)} and perhaps luminance, got "
            f"{', '.join(channels) or 'none'}."
        )
    if "luminance" in channels and luminance is not None:
        raise ValueError(
            "`luminance` must be left out where `channels` has it, got both."
        )
    if motion_unit not in _DISPLAY:
        raise ValueError(
            f"`motion_unit` must be one of {', '.join(_DISPLAY)}, got {motion_unit!r}."
        )
    given = {"ppd": ppd, "refresh_rate": refresh_rate, "resolution_px": resolution_px}
    for name in _DISPLAY[motion_unit]:
        if given[name] is None:
            raise ValueError(f"`{name}` must be given for motion in {motion_unit}.")


def _read(path: Path) -> dict[str, np.ndarray]:
    """Every channel of a file's first part."""
    # The library reports a file that is not there and one that is none alike.
    with path.open("rb"):
        pass
    import OpenEXR

    try:
        with OpenEXR.File(str(path), separate_channels=True) as image:
            header = image.header()
            # Pixels are the library's own until the file is closed.
            found = {k: np.array(v.pixels) for k, v in image.channels().items()}
            pixels, display = header["dataWindow"], header["displayWindow"]
    except (RuntimeError, ValueError, TypeError, KeyError, MemoryError) as error:
        raise ValueError(f"{path}: must be a whole OpenEXR image.") from error
    if not np.array_equal(pixels, display):
        raise ValueError(f"{path}: must have pixels in all of its display window.")
    return found


def _channel(
    image: Mapping[str, np.ndarray], path: str | Path, channel: str
) -> np.ndarray:
    if channel not in image:
        raise ValueError(
            f"{path}: must have the channel {channel}, got {', '.join(image)}."
        )
    return image[channel]
