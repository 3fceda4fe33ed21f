"""Rate maps for engines whose plugins map names to their own enumeration."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import ArrayLike, Int

from camojab._files import write_text

from .._rates import RATES, TILE
from ._json import read_object, whole
from ._rate_map import check_tile, checked_map


_SCHEMA = "alsarr-rates/1"


def write_rates_json(path: str | Path, rate: ArrayLike, *, tile: int = TILE) -> None:
    """Write a rate map as names of rates, for Unity, Unreal and whoever asks by name.

    `map` has one list of names a row of tiles, the top row first; `map_flipped_y` is
    the same with the bottom row first, for interfaces whose images start there.
    `rates` gives width and height of each coarse pixel in pixels, and its code in
    Direct3D 12 and Vulkan. Unity: `ShadingRateInfo.QueryNativeValue` turns the name
    into the byte of the platform; Unreal: copy into the texture that an
    `IVariableRateShadingImageGenerator` gives. Written whole or not at all.

    **Arguments:**

    - `rate`: as in `write_rates_bin`.
    - `tile`: width and height of a tile. [px], 8, 16 or 32.

    **Raises:** as `write_rates_bin`.
    """
    rate = checked_map(rate)
    head = {
        "schema": _SCHEMA,
        "rows": rate.shape[0],
        "columns": rate.shape[1],
        "tile_px": check_tile(tile),
        "origin": "top-left",
        "rates": _RATES,
    }
    rows = [json.dumps([RATES.names[i] for i in row]) for row in rate]
    text = json.dumps(head, indent=1).removesuffix("\n}")
    text += ',\n "map": [\n' + ",\n".join(rows)
    text += '\n ],\n "map_flipped_y": [\n' + ",\n".join(rows[::-1]) + "\n ]\n}\n"
    write_text(path, text)


def read_rates_json(path: str | Path) -> Int[np.ndarray, "rows columns"]:
    """Read a rate map that `write_rates_json` wrote, as indices of rates.

    **Raises:** `ValueError` naming the file and what is wrong with it: no JSON, another
    schema or table of rates, a map of another size or with another name, or a flipped
    map that is not the same. `FileNotFoundError` if there is none.
    """
    document = read_object(path)
    for name, value in {"schema": _SCHEMA, "rates": _RATES}.items():
        if document.get(name) != value:
            raise ValueError(
                f"{path}: `{name}` must be {value!r}, got {document.get(name)!r}."
            )
    rows, columns = whole(document, "rows", path), whole(document, "columns", path)
    rate = _indices(document, "map", path, (rows, columns))
    flipped = _indices(document, "map_flipped_y", path, (rows, columns))
    if np.any(flipped[::-1] != rate):
        raise ValueError(f"{path}: `map_flipped_y` must be `map` upside down.")
    return rate


_RATES = {
    name: {"width_px": int(m), "height_px": int(n), "d3d12_vulkan_code": int(code)}
    for name, (m, n), code in zip(RATES.names, RATES.size, RATES.code, strict=True)
}


def _indices(
    document: dict[str, Any], name: str, path: str | Path, shape: tuple[int, int]
) -> np.ndarray:
    rows = document.get(name)
    try:
        if not isinstance(rows, list):
            raise TypeError
        rate = np.array([[RATES.names.index(one) for one in row] for row in rows])
        if rate.shape != shape:
            raise TypeError
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"{path}: `{name}` must be {shape[0]} lists of {shape[1]} names of rates."
        ) from error
    return rate
