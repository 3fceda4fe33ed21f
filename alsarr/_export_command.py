"""`alsarr export`: tables or a rate map in, the files of engines out."""

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, TYPE_CHECKING

import typer

from camojab import _command as command
from camojab._files import DAMAGED

from . import _options


if TYPE_CHECKING:
    import numpy as np


_TABLES = ("hlsl", "glsl", "wgsl", "binary", "rgba32f")
_RATES = ("d3d12", "vulkan", "godot", "unity", "unreal")

# What the library calls the options.
_OPTIONS = {
    "`available`": "`--rates`",
    "`tile`": "`--tile`",
    "`size_px`": "`--size`",
}

_SHADER = {
    "hlsl": "quality.hlsl",
    "glsl450": "quality_450.comp",
    "glsl310es": "quality_310es.comp",
    "wgsl": "quality.wgsl",
}

Files = dict[tuple[str, ...], Callable[[Path], None]]
"""Names of what is written together, with what writes it given the first path."""


def export(
    file: Annotated[
        Path,
        typer.Argument(
            help="Tables (JSON or NPZ), or an NPZ file with the rates of a frame, as "
            "alsarr solve writes it."
        ),
    ],
    to: Annotated[
        str,
        typer.Option(
            help=f"What to write, with commas between. Of tables: {', '.join(_TABLES)}."
            f" Of rates: {', '.join(_RATES)}."
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder to write into.")
    ] = Path("engine"),
    tile: Annotated[
        int | None,
        typer.Option(help="Tile of the hardware [px]: 8, 16 or 32. 16 if not given."),
    ] = None,
    rates: Annotated[
        str | None,
        typer.Option(
            help="Rates that the hardware has, with commas between; others become the "
            "nearest finer. Direct3D 12 without additional rates and Vulkan at its "
            "least: 1x1,1x2,2x1,2x2 and 1x1,2x1,2x2. All seven if not given."
        ),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(
            help="Width and height of the frame [px], as 1920x1080. Whole tiles of "
            "16 px if not given."
        ),
    ] = None,
    columns: Annotated[
        int | None,
        typer.Option(
            help="Tiles in a row of the frame, where the file has but a list."
        ),
    ] = None,
) -> None:
    """Write what engines read: shaders and packed tables, or rate maps.

    Prints the path of every file.
    """
    with command.usable(_OPTIONS):
        if output.exists() and not output.is_dir():
            raise ValueError(f"{output}: must be a folder to write into.")
        if _holds_rates(file):
            names = _checked(to, _RATES, "rates")
            files = _rate_files(file, names, tile, rates, size, columns)
        else:
            names = _checked(to, _TABLES, "tables")
            options = {"tile": tile, "rates": rates, "size": size, "columns": columns}
            for option, value in options.items():
                if value is not None:
                    raise ValueError(
                        f"`--{option}` must go with a file of rates, got tables."
                    )
            files = _table_files(file, names)
        for written, write in files.items():
            write(output / written[0])
            for name in written:
                print(output / name)


def _checked(to: str, known: tuple[str, ...], kind: str) -> list[str]:
    names = to.split(",")
    for name in names:
        if name not in known:
            raise ValueError(
                f"`--to` must be some of {', '.join(known)} for {kind}, got {name!r}."
            )
    return names


def _holds_rates(path: Path) -> bool:
    """Whether a file is an archive with an array named rate."""
    with path.open("rb") as file:
        if not zipfile.is_zipfile(file):
            return False
        try:
            return "rate.npy" in zipfile.ZipFile(file).namelist()
        except zipfile.BadZipFile as error:
            raise ValueError(f"{path}: must be a whole NPZ file.") from error


def _table_files(path: Path, names: list[str]) -> Files:
    from .export import (
        LANGUAGES,
        records,
        texels,
        write_binary,
        write_rgba32f,
        write_shader,
    )
    from .tables import load_tables

    tables = records(load_tables(path))
    files: Files = {}
    for name in names:
        if name == "binary":
            files["tables.bin",] = lambda to: write_binary(to, tables)
        elif name == "rgba32f":
            texels(tables)
            both = "tables.rgba32f", "tables.rgba32f.json"
            files[both] = lambda to: write_rgba32f(to, tables)
        else:
            for language in LANGUAGES:
                if language.startswith(name):
                    write = lambda to, language=language: write_shader(
                        to, tables, language
                    )
                    files[_SHADER[language],] = write
    return files


def _rate_files(
    path: Path,
    names: list[str],
    tile: int | None,
    rates: str | None,
    size: str | None,
    columns: int | None,
) -> Files:
    from ._rates import RATES, TILE
    from .export import (
        adapt_rates,
        write_rates_bin,
        write_rates_godot,
        write_rates_grey,
        write_rates_json,
    )

    tile = TILE if tile is None else tile
    pixels = None if size is None else _options.size(size, "--size")
    rate = adapt_rates(
        _rate_map(path, pixels, columns),
        tile=tile,
        size_px=pixels,
        available=RATES.names if rates is None else tuple(rates.split(",")),
    )
    files: Files = {}
    for name in names:
        if name == "godot":
            files["rates.godot.png",] = lambda to: write_rates_godot(to, rate)
        elif name in ("unity", "unreal"):
            write = lambda to: write_rates_json(to, rate, tile=tile)
            files[f"rates.{name}.json",] = write
        else:
            both = f"rates.{name}.bin", f"rates.{name}.bin.json"
            files[both] = lambda to: write_rates_bin(to, rate, tile=tile)
            files[f"rates.{name}.png",] = lambda to: write_rates_grey(to, rate)
    return files


def _rate_map(
    path: Path, pixels: tuple[int, int] | None, columns: int | None
) -> "np.ndarray":
    """The rates of a file in rows and columns."""
    import numpy as np

    from .export._rate_map import checked_map

    try:
        # Given a path, NumPy leaves files open that it cannot read.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            rate = np.asarray(stored["rate"])
    except DAMAGED as error:
        raise ValueError(f"{path}: must hold whole, plain arrays.") from error
    if rate.ndim == 1:
        wide = _columns(rate.size, pixels) if columns is None else columns
        if wide is None or wide < 1 or rate.size % wide:
            raise ValueError(
                f"`--columns` must divide the {rate.size} tiles of {path}, got {wide}."
            )
        rate = rate.reshape(-1, wide)
    elif columns is not None and columns != rate.shape[-1]:
        raise ValueError(
            f"`--columns` must be that of the map in {path}, {rate.shape[-1]}, got "
            f"{columns}."
        )
    try:
        return checked_map(rate)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _columns(tiles: int, pixels: tuple[int, int] | None) -> int | None:
    """Columns of a frame with so many tiles: partial ones count, or do not."""
    from ._rates import TILE

    if pixels is None:
        return None
    width, height = pixels
    for wide in (-(-width // TILE), width // TILE):
        for high in (-(-height // TILE), height // TILE):
            if wide * high == tiles:
                return wide
    return None
