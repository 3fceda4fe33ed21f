"""Rate maps as lossless pictures that engines import."""

from pathlib import Path

import numpy as np
from jaxtyping import ArrayLike, Int, UInt8

from camojab._files import replacing

from .._rates import RATES
from ._rate_map import checked_map, decoded


# Godot 4's byte for a coarse pixel 1, 2 and 4 wide (red) or high (green).
_GODOT = np.array([0, 85, 170], np.uint8)


def write_rates_grey(path: str | Path, rate: ArrayLike) -> None:
    """Write the bytes of `write_rates_bin` as an 8-bit grey PNG, one pixel a tile.

    Import it without colour management or compression. Written whole or not at all.

    **Raises:** as `write_rates_bin`.
    """
    _write(path, RATES.code[checked_map(rate)])


def read_rates_grey(path: str | Path) -> Int[np.ndarray, "rows columns"]:
    """Read a rate map that `write_rates_grey` wrote, as indices of rates.

    **Raises:** `ValueError` naming the file if it is no 8-bit grey PNG or has a pixel
    that is no code of the seven rates. `FileNotFoundError` if there is none.
    """
    codes = _read(path)
    if codes.ndim != 2:
        raise ValueError(f"{path}: must be an 8-bit grey PNG, got shape {codes.shape}.")
    return decoded(codes, path)


def write_rates_godot(path: str | Path, rate: ArrayLike) -> None:
    """Write a rate map as the VRS texture of Godot 4, a lossless RGB PNG.

    One pixel a tile, the top row first: red tells the width of the coarse pixel, green
    its height, 0, 85 and 170 for 1, 2 and 4 pixels; blue is 0. Set it as
    `Viewport.vrs_texture`, imported as lossless. Written whole or not at all.

    **Raises:** as `write_rates_bin`.

    **Source:** Godot documentation, Variable rate shading.
    """
    octaves = np.log2(RATES.size).astype(int)[checked_map(rate)]
    _write(path, np.pad(_GODOT[octaves], ((0, 0), (0, 0), (0, 1))))


def read_rates_godot(path: str | Path) -> Int[np.ndarray, "rows columns"]:
    """Read a rate map that `write_rates_godot` wrote, as indices of rates.

    **Raises:** `ValueError` naming the file if it is no RGB PNG or has a colour that
    stands for none of the seven rates. `FileNotFoundError` if there is none.
    """
    pixels = _read(path)
    if pixels.ndim != 3 or pixels.shape[2] != 3:
        raise ValueError(f"{path}: must be an 8-bit RGB PNG, got shape {pixels.shape}.")
    colours = np.pad(_GODOT[np.log2(RATES.size).astype(int)], ((0, 0), (0, 1)))
    same = np.all(pixels[:, :, None] == colours, axis=-1)
    none = ~np.any(same, axis=-1)
    if np.any(none):
        row, column = np.argwhere(none)[0]
        colour = bytes(pixels[row, column]).hex().upper()
        raise ValueError(
            f"{path}: the pixel in row {row}, column {column} must stand for a "
            f"shading rate, got #{colour}."
        )
    return np.argmax(same, axis=-1)


def _write(path: str | Path, pixels: UInt8[np.ndarray, "rows columns *rgb"]) -> None:
    import imageio.v3

    with replacing(path) as temporary:
        imageio.v3.imwrite(temporary, pixels, extension=".png")


def _read(path: str | Path) -> UInt8[np.ndarray, "rows columns *rgb"]:
    import imageio.v3

    data = Path(path).read_bytes()
    try:
        pixels = np.asarray(imageio.v3.imread(data, plugin="pillow"))
    except (OSError, SyntaxError, ValueError) as error:
        raise ValueError(f"{path}: must be a whole PNG file.") from error
    if pixels.dtype != np.uint8:
        raise ValueError(f"{path}: must have 8 bits a channel, got {pixels.dtype}.")
    return pixels
