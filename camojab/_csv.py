"""CSV files as they stand, with the line at which each row begins."""

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from ._columns import Problem, TableError


class CsvTable(NamedTuple):
    """Header and rows of texts; `lines` has the line at which each row begins."""

    path: Path
    header: list[str]
    rows: list[list[str]]
    lines: list[int]

    def columns(self, names: Iterable[str]) -> dict[str, list[str]]:
        """Those of the named columns that the table has."""
        indices = {n: self.header.index(n) for n in names if n in self.header}
        return {name: [row[i] for row in self.rows] for name, i in indices.items()}

    def ragged(self) -> list[Problem]:
        """A problem for each row that has not as many cells as the header."""
        count = len(self.header)
        rule = f"must have {count} cell{'' if count == 1 else 's'}, as the header"
        return [
            Problem(number, f"{rule}, got {len(row)}.")
            for number, row in enumerate(self.rows)
            if len(row) != count
        ]

    def error(self, problems: Sequence[Problem]) -> TableError:
        """The error of these problems, a sentence each that names its line."""
        ordered = sorted(problems)
        lines = [f"{self.path}, line {self.lines[p.row]}: {p.message}" for p in ordered]
        return TableError("\n".join(lines), ordered)


def read_csv(path: Path) -> CsvTable:
    """Read a table whose rows all have as many cells as its header; no empty lines.

    **Raises:** `TableError` naming the file, and the line of everything that is wrong;
    `OSError` if the file cannot be read.
    """
    table = read_rows(path)
    if ragged := table.ragged():
        raise table.error(ragged)
    return table


def read_rows(path: Path) -> CsvTable:
    """Read a table whose rows may have any number of cells; otherwise as `read_csv`."""
    rows, lines = [], []
    # Spreadsheets put a byte order mark before the first name.
    with path.open(encoding="utf-8-sig", newline="") as file:
        reader = csv.reader(file, strict=True)
        try:
            header = next(reader, [])
            line = reader.line_num + 1
            for row in reader:
                if row:
                    rows.append(row)
                    lines.append(line)
                line = reader.line_num + 1
        except UnicodeDecodeError as error:
            raise TableError(f"{path}: must be text in UTF-8 ({error}).") from error
        except csv.Error as error:
            where = f"{path}, line {reader.line_num}"
            raise TableError(f"{where}: must be CSV ({error}).") from error
    if not header:
        raise TableError(f"{path}: must begin with the names of the columns.")
    return CsvTable(path, header, rows, lines)
