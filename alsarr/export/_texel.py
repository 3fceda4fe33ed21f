"""Packed records as a floating-point texture, for engines without raw buffers."""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from camojab._files import replacing, write_text

from ..tables import QualityTables
from ._json import read_object, whole
from ._records import Records, records


WIDTH = 2048
"""Texels in a row: OpenGL ES 3.0 and everything newer takes as many."""

_HIGHEST = 16384
_SCHEMA = "alsarr-records-texture/1"


class Texels(NamedTuple):
    """A texture of RGBA32F texels whose rows hold whole records.

    Record `i` begins in column `i % records_a_row * texels_a_record` of row
    `i // records_a_row`; its number `k` is channel `k % 4` of texel `k // 4` after
    that. What is left of a row is 0.

    - `pixels`: the top row first.
    - `texels_a_record`: 3 for ten coefficients.
    - `records_a_row`: 682 for ten coefficients.
    """

    pixels: Float32[np.ndarray, "height width 4"]
    texels_a_record: int
    records_a_row: int


def texels(tables: QualityTables | Records) -> Texels:
    """Lay records out as texels: 2048 in a row, as many rows as are needed.

    **Raises:** `ValueError` if a record is longer than a row, or more than 16384 rows
    are needed.
    """
    found = tables if isinstance(tables, Records) else records(tables)
    each = found.floats // 4
    a_row = WIDTH // each
    if not a_row:
        raise ValueError(f"`tables` must have records of {WIDTH} texels, got {each}.")
    height = -(-found.count // a_row)
    if height > _HIGHEST:
        raise ValueError(
            f"`tables` must fit {_HIGHEST} rows of {WIDTH} texels, got {height} rows."
        )
    rows = np.zeros((height * a_row, each, 4), np.float32)
    rows[: found.count] = found.padded().reshape(-1, each, 4)
    rows = rows.reshape(height, a_row * each, 4)
    pixels = np.pad(rows, ((0, 0), (0, WIDTH - a_row * each), (0, 0)))
    return Texels(pixels, each, a_row)


def write_rgba32f(path: str | Path, tables: QualityTables | Records) -> None:
    """Write the texels of `texels` as raw little-endian RGBA32F, without a header.

    What the bytes do not tell is written beside them, as JSON in the file `path` +
    `.json`: width, height, texels of a record, records of a row, and their number.
    Each is written whole or not at all.

    **Raises:** as `texels`.
    """
    found = tables if isinstance(tables, Records) else records(tables)
    made = texels(found)
    directions, textures, mips, rates, _ = found.coefficients.shape
    about = {
        "schema": _SCHEMA,
        "format": "RGBA32F, little-endian, the top row first",
        "width": made.pixels.shape[1],
        "height": made.pixels.shape[0],
        "texels_a_record": made.texels_a_record,
        "records_a_row": made.records_a_row,
        "records": found.count,
        "textures": textures,
        "mips": mips,
        "rates": rates,
        "directions": directions,
        "index": "((direction * textures + texture) * mips + mip) * rates + rate",
    }
    with replacing(path) as temporary:
        temporary.write_bytes(made.pixels.astype("<f4").tobytes())
    write_text(f"{path}.json", json.dumps(about, indent=1) + "\n")


def read_rgba32f(path: str | Path) -> Float32[np.ndarray, "records floats"]:
    """Read the records that `write_rgba32f` wrote, in order, with their padding.

    **Raises:** `ValueError` naming the file for JSON beside it that is of another
    schema or contradicts itself, for another number of bytes than it tells, for a
    number that is not finite, and for anything but 0 beside the records.
    `FileNotFoundError` if there is none.
    """
    beside = Path(f"{path}.json")
    about = read_object(beside)
    if about.get("schema") != _SCHEMA:
        raise ValueError(
            f"{beside}: `schema` must be {_SCHEMA!r}, got {about.get('schema')!r}."
        )
    names = ("width", "height", "texels_a_record", "records_a_row", "records")
    width, height, each, a_row, count = (whole(about, n, beside) for n in names)
    if a_row * each > width or not (height - 1) * a_row < count <= height * a_row:
        raise ValueError(
            f"{beside}: `records` must fill {height} rows of {width} texels, got "
            f"{count} of {each} texels, {a_row} a row."
        )
    data = Path(path).read_bytes()
    if len(data) != width * height * 16:
        raise ValueError(
            f"{path}: must have {width * height * 16} bytes, got {len(data)}."
        )
    pixels = np.frombuffer(data, "<f4").astype(np.float32).reshape(height, width, 4)
    used = pixels[:, : a_row * each].reshape(height * a_row, each * 4)
    if not np.isfinite(pixels).all():
        raise ValueError(f"{path}: must hold finite numbers.")
    if np.any(pixels[:, a_row * each :]) or np.any(used[count:]):
        raise ValueError(f"{path}: must be 0 beside the records.")
    return used[:count]
