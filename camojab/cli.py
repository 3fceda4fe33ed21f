"""The command line of camojab.

Only what the help needs is imported at the top; everything that computes is imported by
the command that uses it.
"""

import csv
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TYPE_CHECKING

import typer

from ._command import environment, release, run, Unusable


if TYPE_CHECKING:
    import camojab


app = typer.Typer(add_completion=False)

Precision = Annotated[
    Literal["32", "64"],
    typer.Option(help="Bits of the numbers that the model computes with."),
]
Output = Annotated[
    Path, typer.Option("-o", "--output", help="The CSV file to write, whole.")
]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv`, or that of the process; returns the exit status.

    0 done, 1 the data cannot be used, 2 the command line is wrong, 130 interrupted.
    """
    return run(app, "camojab", argv)


def _print_version(context: Any, asked: bool) -> bool:
    if asked:
        verbose = context.params["verbose"]
        print(environment("camojab") if verbose else f"camojab {release()}")
        raise typer.Exit()
    return asked


@app.callback()
def options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, help="Print the version and leave."
        ),
    ] = False,
    verbose: Annotated[
        bool,
        # Eager, or its value would not be known yet when the version is printed.
        typer.Option(
            "--verbose",
            is_eager=True,
            help="With --version: the line to paste in a bug report.",
        ),
    ] = False,
) -> None:
    """Judder, aliasing and blur of moving, coarsely shaded textures, in JND."""
    if verbose:
        raise typer.BadParameter("goes with --version.", param_hint="'--verbose'")


@app.command()
def predict(
    conditions: Annotated[Path, typer.Argument(help="CSV file, one condition a row.")],
    output: Output,
    formulation: Annotated[
        Literal["released", "paper"] | None,
        typer.Option(
            help="The authors' program or the equations as printed. By default that "
            "of --parameters, or else released."
        ),
    ] = None,
    precision: Precision = "64",
    parameters: Annotated[
        Path | None,
        typer.Option(
            help="JSON file of fitted constants. By default the published ones."
        ),
    ] = None,
    encoding: Annotated[
        str | None,
        typer.Option(
            help="How the values of image files stand for light: 'linear', 'sRGB' or "
            "another name that colour-science knows. Colour needs it; without it grey "
            "is relative luminance as it stands."
        ),
    ] = None,
) -> None:
    """Predict distortions and quality (JND) for every row of a table.

    Columns: texture, mean_luminance_cd_m2, refresh_rate_hz, velocity_deg_s,
    persistence, ppd, rate_x, rate_y, mip_level; optionally beta, and vrs,
    eye_blur, judder (0 or 1). Others are kept as they are. Added are
    spatial_distortion, temporal_distortion, quality_jnd.

    A texture is the path of an image or .npy file (from the working folder, or
    else from the table's), jindal2021:NAME for a published one such as grass,
    or builtin:NAME for one such as brick.
    """
    table = _read(conditions)
    _check_output(output)
    with _precision(precision):
        from ._predict import ADDED, known, predictions, REQUIRED

        with _naming(conditions, table.lines):
            table.check(required=("texture", *REQUIRED), added=ADDED)
            constants, statement = _model(formulation, parameters)
            _check_encoding(encoding)
            with _progress(len(table.rows)) as advance:
                added = predictions(
                    table.columns(known()),
                    formulation=statement,
                    parameters=constants,
                    textures={},
                    encoding=encoding,
                    folder=conditions.parent,
                    progress=advance,
                )
        model = f"{statement.value}, {constants.report()}"
    if "beta" in table.header:
        model += " (but beta of each row)"
    _write(output, table, added, known())
    print(f"camojab {release()}, {model}, float{precision}")


@app.command()
def sensitivity(
    table: Annotated[Path, typer.Argument(help="CSV file, one grating a row.")],
    output: Output,
    precision: Precision = "64",
) -> None:
    """Contrast sensitivity for every row of a table.

    Columns: spatial_frequency_cpd, temporal_frequency_hz, luminance_cd_m2.
    Others are kept as they are. Added is sensitivity.
    """
    gratings = _read(table)
    _check_output(output)
    with _precision(precision):
        import jax.numpy as jnp
        import numpy as np

        from ._columns import check_finite, not_negative, numbers, positive, TableError
        from ._csf import sensitivity

        rules = {
            "spatial_frequency_cpd": not_negative("cycles/deg"),
            "temporal_frequency_hz": not_negative("Hz"),
            "luminance_cd_m2": positive("cd/m^2"),
        }
        with _naming(table, gratings.lines):
            gratings.check(required=rules, added=["sensitivity"])
            dtype = np.dtype(jnp.result_type(float))
            values, problems = numbers(gratings.columns(rules), rules, dtype)
            if problems:
                raise TableError.of(problems)
            added = {"sensitivity": np.asarray(sensitivity(*values.values()))}
            check_finite("sensitivity", added["sensitivity"])
    _write(output, gratings, added, rules)
    print(f"camojab {release()}, float{precision}")


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


class _Table(NamedTuple):
    """A CSV file as it stands; `lines` has the line at which each row begins."""

    header: list[str]
    rows: list[list[str]]
    lines: list[int]

    def check(self, *, required: Iterable[str], added: Iterable[str]) -> None:
        from ._columns import check_columns

        check_columns(self.header, required=required, added=added)

    def columns(self, names: Iterable[str]) -> dict[str, list[str]]:
        """Those of the named columns that the table has."""
        indices = {
            name: self.header.index(name) for name in names if name in self.header
        }
        return {name: [row[i] for row in self.rows] for name, i in indices.items()}


def _read(path: Path) -> _Table:
    rows, lines, ragged = [], [], []
    # Spreadsheets put a byte order mark before the first name.
    with path.open(encoding="utf-8-sig", newline="") as file:
        reader = csv.reader(file, strict=True)
        try:
            header = next(reader, [])
            line = reader.line_num + 1
            for row in reader:
                if row and len(row) != len(header):
                    rule = f"must have {_count(len(header), 'cell')}, as the header"
                    ragged.append(f"{path}, line {line}: {rule}, got {len(row)}.")
                if row:
                    rows.append(row)
                    lines.append(line)
                line = reader.line_num + 1
        except UnicodeDecodeError as error:
            raise Unusable(f"{path}: must be text in UTF-8 ({error}).") from error
        except csv.Error as error:
            where = f"{path}, line {reader.line_num}"
            raise Unusable(f"{where}: must be CSV ({error}).") from error
    if not header:
        raise Unusable(f"{path}: must begin with the names of the columns.")
    if ragged:
        raise Unusable(*ragged)
    return _Table(header, rows, lines)


def _write(
    path: Path, table: _Table, added: Mapping[str, Any], used: Iterable[str]
) -> None:
    """Write the table with the added columns, and say which ones were not used."""
    from ._files import replacing

    with (
        replacing(path) as temporary,
        temporary.open("w", encoding="utf-8", newline="") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*table.header, *added])
        # The shortest digits that give the same number back.
        digits = [[repr(float(value)) for value in column] for column in added.values()]
        for row, new in zip(table.rows, zip(*digits, strict=True), strict=True):
            writer.writerow([*row, *new])
    kept = ", ".join(name for name in table.header if name not in set(used))
    note = f"; kept as they are: {kept}" if kept else ""
    print(f"{path}: {_count(len(table.rows), 'row')}{note}")


def _check_output(path: Path) -> None:
    """Fail before the work rather than after it."""
    if path.is_dir():
        raise Unusable(f"{path}: must be a file to write, got a folder.")


@contextmanager
def _naming(path: Path, lines: Sequence[int]) -> Iterator[None]:
    """Name the file, and the line in it, of what is wrong with its table."""
    from ._columns import TableError

    try:
        yield
    except TableError as error:
        problems = [
            f"{path}, line {lines[problem.row]}: "
            + problem.message.replace("`encoding`", "`--encoding`")
            for problem in error.problems
        ]
        raise Unusable(*(problems or [f"{path}: {error}"])) from error


def _precision(bits: str) -> AbstractContextManager[Any]:
    import jax

    return jax.enable_x64(bits == "64")


def _model(
    name: str | None, file: Path | None
) -> tuple["camojab.Parameters", "camojab.Formulation"]:
    """The constants and the formulation that they belong to."""
    from ._parameters import Formulation, load_parameters, Parameters

    chosen = Formulation(name or "released")
    if file is None:
        return Parameters.published(chosen), chosen
    try:
        constants, fitted = load_parameters(file)
    except ValueError as error:
        raise Unusable(str(error)) from error
    if name is not None and fitted is not chosen:
        raise typer.BadParameter(
            f"must be that of {file}, {fitted.value}, got {name}.",
            param_hint="'--formulation'",
        )
    return constants, fitted


def _check_encoding(name: str | None) -> None:
    if name is not None:
        import numpy as np

        from ._spectrum import luminance

        try:
            luminance(np.zeros((1, 1)), encoding=name)
        except ValueError as error:
            raise typer.BadParameter(str(error), param_hint="'--encoding'") from error


@contextmanager
def _progress(rows: int) -> Iterator[Callable[[int], None]]:
    """A bar on the terminal, if that is where the error stream goes."""
    from rich.console import Console
    from rich.progress import Progress

    console, silent = Console(stderr=True), not sys.stderr.isatty()
    with Progress(console=console, transient=True, disable=silent) as bar:
        task = bar.add_task("conditions", total=rows)
        yield lambda done: bar.advance(task, done)
