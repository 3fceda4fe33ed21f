"""`camojab predict` and `camojab sensitivity`: a table with further columns."""

import csv
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import typer

from ._auto import Auto
from ._columns import (
    check_columns,
    check_finite,
    not_negative,
    numbers,
    positive,
    TableError,
)
from ._command import release, stages, Unusable, usable
from ._csf import sensitivity as contrast_sensitivity
from ._csv import CsvTable, read_csv
from ._exact import Exact
from ._files import replacing
from ._parameters import Formulation, load_parameters, Parameters
from ._predict import ADDED, known, predictions, REQUIRED
from ._spectrum import luminance


_GRATING = {
    "spatial_frequency_cpd": not_negative("cycles/deg"),
    "temporal_frequency_hz": not_negative("Hz"),
    "luminance_cd_m2": positive("cd/m^2"),
}


def predict(
    *,
    conditions: Path,
    output: Path,
    formulation: str | None,
    parameters: Path | None,
    encoding: str | None,
    tolerance: float,
) -> None:
    """Predict for every row, write the table, and print what with."""
    with usable({"`tolerance_jnd`": "`--tolerance`"}):
        fidelity = Auto(tolerance) if tolerance else Exact()
    table = _read(conditions)
    _check_output(output)
    with _naming(table):
        check_columns(table.header, required=("texture", *REQUIRED), added=ADDED)
        constants, statement = model(formulation, parameters)
        check_encoding(encoding)
        with _rows(len(table.rows)) as progress:
            added = predictions(
                table.columns(known()),
                formulation=statement,
                parameters=constants,
                textures={},
                encoding=encoding,
                folder=conditions.parent,
                fidelity=fidelity,
                progress=progress,
            )
    line = f"{statement.value}, {constants.report()}"
    if "beta" in table.header:
        line += " (but beta of each row)"
    if tolerance:
        line += f", within {tolerance:g} JND"
    _write(output, table, added, known())
    print(f"camojab {release()}, {line}, {_dtype().name}")


def sensitivity(*, table: Path, output: Path) -> None:
    """Contrast sensitivity for every row; write the table, and print what with."""
    gratings = _read(table)
    _check_output(output)
    with _naming(gratings):
        check_columns(gratings.header, required=_GRATING, added=["sensitivity"])
        values, problems = numbers(gratings.columns(_GRATING), _GRATING, _dtype())
        if problems:
            raise TableError.of(problems)
        found = np.asarray(contrast_sensitivity(*values.values()))
        check_finite("sensitivity", found)
    _write(output, gratings, {"sensitivity": found}, _GRATING)
    print(f"camojab {release()}, {_dtype().name}")


def _dtype() -> np.dtype:
    return np.dtype(jnp.result_type(float))


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _read(path: Path) -> CsvTable:
    with usable():
        return read_csv(path)


def _write(
    path: Path, table: CsvTable, added: Mapping[str, Any], used: Iterable[str]
) -> None:
    """Write the table with the added columns, and say which ones were not used."""
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
def _naming(table: CsvTable) -> Iterator[None]:
    """Name the file, and the line in it, of what is wrong with its table."""
    try:
        yield
    except TableError as error:
        if not error.problems:
            raise Unusable(f"{table.path}: {error}") from error
        named = str(table.error(error.problems))
        named = named.replace("`encoding`", "`--encoding`")
        raise Unusable(*named.splitlines()) from error


def model(name: str | None, file: Path | None) -> tuple[Parameters, Formulation]:
    """The constants and the formulation that they belong to."""
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


def check_encoding(name: str | None) -> None:
    if name is not None:
        try:
            luminance(np.zeros((1, 1)), encoding=name)
        except ValueError as error:
            raise typer.BadParameter(str(error), param_hint="'--encoding'") from error


@contextmanager
def _rows(total: int) -> Iterator[Callable[[int], None]]:
    """To be told of rows as they are done."""
    done = 0
    with stages() as progress:
        progress("conditions", 0, total)

        def advance(rows: int) -> None:
            nonlocal done
            done += rows
            progress("conditions", done, total)

        yield advance
