"""Frames in NPZ files."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from camojab._files import DAMAGED, replacing

from ._buffers import Frame


_OPTIONAL = ("luminance", "previous_image")
# Before the name of a buffer that is one of `Frame.channels`.
_CHANNEL = "channels/"


def save_frame(path: str | Path, frame: Frame) -> None:
    """Write a frame as an NPZ file, one array a field. Written whole or not at all."""
    arrays: dict[str, Any] = {n: np.asarray(getattr(frame, n)) for n in Frame.UNITS}
    if frame.previous_image is not None:
        arrays["previous_image"] = np.asarray(frame.previous_image)
    for name, channel in (frame.channels or {}).items():
        arrays[_CHANNEL + name] = np.asarray(channel)
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)


def load_frame(path: str | Path) -> Frame:
    """Read a frame that `save_frame` wrote, or any NPZ file with the same arrays.

    `luminance` and `previous_image` may be missing, as they may for `Frame`, and what
    is called `channels/NAME` is the channel of that name.

    **Raises:** `ValueError` naming the file if it is no NPZ file or lacks an array;
    `FileNotFoundError`; and as `Frame`. Nothing in the file is executed.
    """
    with Path(path).open("rb") as file:
        if not zipfile.is_zipfile(file):
            raise ValueError(f"{path}: is no NPZ file.")
        try:
            stored = np.load(file, allow_pickle=False)
            names = (*Frame.UNITS, "previous_image")
            found = [name for name in names if name in stored.files]
            missing = [n for n in names if n not in found and n not in _OPTIONAL]
            arrays = {name: stored[name] for name in found if not missing}
            channels = {
                name.removeprefix(_CHANNEL): stored[name]
                for name in stored.files
                if name.startswith(_CHANNEL)
            }
        except DAMAGED as error:
            raise ValueError(
                f"{path}: holds something else than whole, plain arrays."
            ) from error
    if missing:
        raise ValueError(f"{path}: lacks the arrays {', '.join(missing)}.")
    return Frame(**arrays, channels=channels or None)
