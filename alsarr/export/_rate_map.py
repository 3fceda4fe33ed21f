import json
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import ArrayLike, Int, UInt8

from camojab._files import replacing, write_text

from .._rates import RATES
from ._json import read_object, whole


TILES = (8, 16, 32)
_SCHEMA = "alsarr-rate-image/1"


def write_rates_bin(
    path: str | Path, rate: ArrayLike, *, tile: int | None = None
) -> None:
    """Write a rate map as the bytes of a shading-rate image, one a tile.

    Row by row from the top left, without header or padding. The byte is
    `(log2 m << 2) | log2 n` for a coarse pixel m wide and n high: both the value of
    Direct3D 12's `D3D12_SHADING_RATE` and the texel of Vulkan's fragment-shading-rate
    attachment (format R8_UINT). Written whole or not at all.

    **Arguments:**

    - `rate`: index of the rate of each tile, in the order of `alsarr.RATES`, shape
        `[rows, columns]`.
    - `tile`: width and height of a tile. [px], 8, 16 or 32. If given, what the bytes
        do not tell (rows, columns, tile, the codes that occur) is written beside them,
        as JSON in the file `path` + `.json`.

    **Raises:** `ValueError` if `rate` has another shape or another index, or for
    another tile.

    **Source:** Microsoft DirectX-Specs, Variable Rate Shading; Vulkan specification,
    Primitive Fragment Shading Rate.
    """
    rate = checked_map(rate)
    codes = RATES.code[rate]
    about = None if tile is None else _about(rate, check_tile(tile))
    with replacing(path) as temporary:
        temporary.write_bytes(codes.tobytes())
    if about is not None:
        write_text(_beside(path), json.dumps(about, indent=1) + "\n")


def read_rates_bin(
    path: str | Path, *, rows: int | None = None, columns: int | None = None
) -> Int[np.ndarray, "rows columns"]:
    """Read a rate map that `write_rates_bin` wrote, as indices of rates.

    **Arguments:**

    - `rows`, `columns`: of the map; both, or neither if the JSON beside it tells.

    **Raises:** `ValueError` naming the file if it has not `rows * columns` bytes, or a
    byte that is no code of the seven rates; likewise for the JSON beside it.
    `FileNotFoundError` if there is none.
    """
    if rows is None or columns is None:
        if rows is not columns:
            raise ValueError("`rows` and `columns` must be given both, or neither.")
        rows, columns = _size_beside(path)
    codes = np.frombuffer(Path(path).read_bytes(), np.uint8)
    if codes.size != rows * columns:
        raise ValueError(
            f"{path}: must have {rows} x {columns} = {rows * columns} bytes, "
            f"got {codes.size}."
        )
    return decoded(codes.reshape(rows, columns), path)


def decoded(
    codes: UInt8[np.ndarray, "rows columns"], path: str | Path
) -> Int[np.ndarray, "rows columns"]:
    """Indices of the rates with these codes; `path` is named if one is no code."""
    index = np.full(256, -1)
    index[RATES.code] = np.arange(len(RATES))
    rate = index[codes]
    if np.any(rate < 0):
        where = int(np.argmax(rate < 0))
        raise ValueError(
            f"{path}: byte {where} must be the code of a shading rate, "
            f"got 0x{codes.flat[where]:02X}."
        )
    return rate


def check_tile(tile: int) -> int:
    if tile not in TILES:
        raise ValueError(f"`tile` must be 8, 16 or 32 px, got {tile}.")
    return tile


def _beside(path: str | Path) -> Path:
    return Path(f"{path}.json")


def _about(rate: np.ndarray, tile: int) -> dict[str, Any]:
    present = np.unique(rate)
    return {
        "schema": _SCHEMA,
        "format": "R8_UINT",
        "rows": rate.shape[0],
        "columns": rate.shape[1],
        "tile_px": tile,
        "origin": "top-left, row by row",
        "byte": "(log2 width << 2) | log2 height of the coarse pixel",
        "rates": {RATES.names[i]: int(RATES.code[i]) for i in present},
    }


def _size_beside(path: str | Path) -> tuple[int, int]:
    beside = _beside(path)
    about = read_object(beside)
    if about.get("schema") != _SCHEMA:
        raise ValueError(
            f"{beside}: `schema` must be {_SCHEMA!r}, got {about.get('schema')!r}."
        )
    return whole(about, "rows", beside), whole(about, "columns", beside)


def write_rates_png(path: str | Path, rate: ArrayLike, *, scale: int = 8) -> None:
    """Draw a rate map in the paper's colours above a legend.

    Every tile is a square of `scale` pixels, exactly; the legend tells which share of
    the tiles has each rate, and what share of the full cost they have together.
    Written whole or not at all.

    **Arguments:**

    - `rate`: as in `write_rates_bin`.
    - `scale`: [px] a tile. >= 1.

    **Raises:** as `write_rates_bin`, and `ValueError` for a `scale` below 1.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if scale < 1:
        raise ValueError(f"`scale` must be >= 1 px, got {scale}.")
    rate = checked_map(rate)
    picture = RATES.colour[rate].repeat(scale, axis=0).repeat(scale, axis=1)
    margin, entry, legend = 12, 92, 52
    width = max(picture.shape[1], entry * len(RATES)) + 2 * margin
    height = picture.shape[0] + 2 * margin + legend
    dpi = 100
    figure = Figure(figsize=(width / dpi, height / dpi), dpi=dpi, facecolor="white")
    FigureCanvasAgg(figure)
    left = (width - picture.shape[1]) // 2
    figure.figimage(picture, left, margin + legend, origin="upper")
    _draw_legend(figure, rate, width, margin)
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=dpi)


def _draw_legend(figure, rate: np.ndarray, width: int, margin: int) -> None:
    from matplotlib.patches import Rectangle
    from matplotlib.transforms import Affine2D

    height = figure.bbox.height
    pixels = Affine2D().scale(1 / width, 1 / height) + figure.transFigure
    entry = (width - 2 * margin) / len(RATES)
    shares = np.bincount(rate.ravel(), minlength=len(RATES)) / rate.size
    text = {"transform": pixels, "family": "DejaVu Sans", "color": "black", "size": 7.5}
    for i, (name, share) in enumerate(zip(RATES.names, shares, strict=True)):
        x = margin + i * entry
        swatch = Rectangle(
            (x, margin + 24), 18, 18, facecolor=RATES.colour[i] / 255, transform=pixels
        )
        figure.add_artist(swatch)
        label = f"{name}  {share:.1%}"
        figure.text(x + 23, margin + 33, label, verticalalignment="center", **text)
    cost = float(shares @ (RATES.cost / RATES.cost.max()))
    figure.text(
        margin,
        margin + 6,
        f"coarse pixel, width x height, and share of the {rate.size} tiles;"
        f" shading cost {cost:.1%} of full rate",
        verticalalignment="center",
        **text,
    )


def checked_map(rate: ArrayLike) -> np.ndarray:
    rate = np.asarray(rate)
    if rate.ndim != 2 or rate.size == 0 or rate.dtype.kind not in "iu":
        raise ValueError(
            "`rate` must be whole numbers of shape [rows, columns], "
            f"got {rate.dtype} of shape {rate.shape}."
        )
    if rate.min() < 0 or rate.max() >= len(RATES):
        raise ValueError(
            f"`rate` must be indices from 0 to {len(RATES) - 1}, "
            f"got {rate.min()} to {rate.max()}."
        )
    return rate
