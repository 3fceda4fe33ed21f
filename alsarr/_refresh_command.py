"""`alsarr refresh`: the best refresh rate and resolution for each velocity."""

import re
from pathlib import Path
from typing import Annotated, TYPE_CHECKING

import typer

from camojab import _command as command
from camojab.cli import Constants, Encoding, Statement

from . import _options


if TYPE_CHECKING:
    import pandas

    from camojab import Spectrum

    from ._refresh import RefreshTable


FILES = ("refresh.csv", "refresh.png")

_COLUMNS = {
    "velocity": "velocity_deg_s",
    "refresh_rate": "refresh_rate_hz",
    "resolution": "resolution",
    "quality": "quality_jnd",
}

_FORMATS = {"velocity_deg_s": "g", "refresh_rate_hz": "g"}

# What the library calls the options.
_OPTIONS = {
    "`texture`": "IMAGE",
    "`encoding`": "`--encoding`",
    "`ppd`": "`--ppd`",
    "`luminance`": "`--luminance`",
    "`persistence`": "`--persistence`",
    "`resolution_px`": "`--size`",
    "`refresh_rates`": "`--rates`",
    "`velocities`": "`--velocities`",
    "`pixels_per_second`": "the budget in px/s",
    "`cells`": "`--cells`",
}


def refresh(
    image: Annotated[
        str,
        typer.Argument(
            help="Picture that stands for what is seen, such as the first frame: a "
            "file, builtin:NAME or jindal2021:NAME. Its top left 512 x 512 pixels."
        ),
    ],
    budget: Annotated[
        list[float] | None,
        typer.Option(
            help="Shaded pixels a second as a share of all pixels at the highest of "
            "--rates, in (0, 1]. May be given several times. 0.0625 and 0.25 if not "
            "given."
        ),
    ] = None,
    pixels_per_second: Annotated[
        list[float] | None,
        typer.Option(help="The same as a number. In the place of --budget."),
    ] = None,
    rates: Annotated[
        str,
        typer.Option(
            help="Refresh rates in Hz: every one of LOW-HIGH or LOW-HIGH:STEP, or a "
            "list with commas between."
        ),
    ] = "30-120",
    velocities: Annotated[
        str,
        typer.Option(help="Velocities of the table in deg/s, written as --rates."),
    ] = "0-60:2",
    size: Annotated[
        str, typer.Option(help="Width and height of the display in pixels.")
    ] = "1920x1080",
    ppd: Annotated[
        float, typer.Option(help="Pixels per degree of the display.")
    ] = 60.0,
    luminance: Annotated[
        float, typer.Option(help="Mean luminance of the picture in cd/m^2.")
    ] = 100.0,
    persistence: Annotated[
        float, typer.Option(help="Share of a frame that the display is lit, in (0, 1].")
    ] = 1.0,
    formulation: Statement = None,
    parameters: Constants = None,
    encoding: Encoding = None,
    cells: Annotated[
        int,
        typer.Option(
            help="Energies that stand for the picture, to be quick; 0 for all."
        ),
    ] = 5000,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder to write into.")
    ] = Path("refresh"),
) -> None:
    """Find the refresh rate and resolution that a budget buys most quality with.

    Prints the tables, and writes refresh.csv and refresh.png.
    """
    from camojab._results import check_folder

    check_folder(output, FILES)
    with command.usable(_OPTIONS), command.stages() as progress:
        from camojab import Exact, Pooled
        from camojab._table_command import check_encoding, model

        from ._refresh import refresh_table

        check_encoding(encoding)
        constants, statement = model(formulation, parameters)
        hertz = _numbers("--rates", rates)
        width, height = _options.size(size, "--size")
        budgets = _budgets(budget, pixels_per_second, width * height * max(hertz))
        spectrum = _spectrum(image, encoding)
        tables = {}
        for done, (name, pixels) in enumerate(budgets.items()):
            progress("budgets", done, len(budgets))
            tables[name] = refresh_table(
                spectrum,
                ppd=ppd,
                luminance=luminance,
                persistence=persistence,
                pixels_per_second=pixels,
                resolution_px=(width, height),
                refresh_rates=hertz,
                velocities=_numbers("--velocities", velocities),
                parameters=constants,
                formulation=statement,
                fidelity=Pooled(cells) if cells else Exact(),
            )
        _write(output, tables)
    line = f"{statement.value}, {constants.report()}, {image}, {ppd:g} px/deg, "
    line += f"{luminance:g} cd/m^2, persistence {persistence:g}, {width} x {height} px"
    for name, table in tables.items():
        command.print_table(f"Budget {name}", _rows(table), _FORMATS)
    print(f"to quote: alsarr {command.release()}, {line}")
    print(f"written: {', '.join(str(output / file) for file in FILES)}")


def _numbers(option: str, text: str) -> list[float]:
    number = r"([0-9]+(?:\.[0-9]+)?)"
    ends = re.fullmatch(rf"{number}-{number}(?::{number})?", text)
    if ends is None:
        parts = text.split(",")
        if not all(re.fullmatch(number, part) for part in parts):
            raise ValueError(
                f"`{option}` must be LOW-HIGH, LOW-HIGH:STEP or numbers with commas "
                f"between, got {text!r}."
            )
        return [float(part) for part in parts]
    low, high, step = (float(end or 1) for end in ends.groups())
    if low > high or step == 0:
        raise ValueError(
            f"`{option}` must go from a lower to a higher number in steps above 0, got "
            f"{text!r}."
        )
    count = int((high - low) / step + 1e-9)
    return [low + step * i for i in range(count + 1)]


def _budgets(
    shares: list[float] | None, pixels: list[float] | None, full: float
) -> dict[str, float]:
    """Budgets in pixels a second by what they are called."""
    if shares and pixels:
        raise ValueError(
            "`--budget` must be left out where --pixels-per-second is given, got both."
        )
    if pixels:
        return {f"{value / 1e6:.4g} Mpx/s": value for value in pixels}
    named = {}
    for share in shares or (0.0625, 0.25):
        if not 0 < share <= 1:
            raise ValueError(f"`--budget` must be in (0, 1], got {share:g}.")
        named[f"{100 * share:.4g} % ({share * full / 1e6:.4g} Mpx/s)"] = share * full
    return named


def _spectrum(image: str, encoding: str | None) -> "Spectrum":
    from camojab import Spectrum
    from camojab._textures import sources

    found, problems = sources([image], {}, encoding, None)
    for problem in problems.values():
        raise ValueError(problem)
    return Spectrum.from_texture(found[image]())


def _rows(table: "RefreshTable") -> "pandas.DataFrame":
    import numpy as np
    import pandas

    column = lambda field: np.asarray(getattr(table, field), float)
    return pandas.DataFrame({name: column(field) for field, name in _COLUMNS.items()})


def _write(output: Path, tables: dict[str, "RefreshTable"]) -> None:
    import pandas

    from camojab._files import replacing, write_text
    from camojab._results import to_csv

    from .plotting import refresh_rates

    parts = []
    for table in tables.values():
        parts.append(_rows(table))
        parts[-1].insert(0, "pixels_per_second", float(table.pixels_per_second))
    write_text(output / FILES[0], to_csv(pandas.concat(parts)))
    with replacing(output / FILES[1]) as temporary:
        refresh_rates(tables).savefig(temporary, format="png", dpi=150)
