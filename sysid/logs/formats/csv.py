"""Text tables in any dialect: the head tells the dialect, numpy reads the rest."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import SysidError
from sysid.logs.formats import dialect
from sysid.logs.formats.json_text import SENSOR, log_of_records
from sysid.logs.formats.registry import Format, refuse_larger
from sysid.logs.formats.tables import VALUE
from sysid.logs.table.file import LogFile
from sysid.logs.table.names import of_sensor
from sysid.roll import Array

COMMA_FOR_POINT = str.maketrans(",.", ".'")
"""A decimal comma as numbers are read, and the sign between thousands as no number is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TextTable:
    """How the columns of a text table are read."""

    path: Path
    names: tuple[str, ...]
    delimiter: str
    decimal: str
    encoding: str
    width: int
    """Cells in a row, an empty one behind a last delimiter included."""
    skip: int
    """Lines before the first row of numbers."""
    comment: str | None
    dates: frozenset[str]
    """Columns that hold dates or times of day instead of numbers."""
    stamped: bool
    """Whether a serial monitor put the time of day before each line."""

    def read(self, names: Sequence[str]) -> dict[str, Array]:
        """Return whole columns, shape (n,), in the log's units; missing values as NaN, dates as seconds.

        Raises:
            SysidError: A cell is not a number, or the rows have different lengths.
        """
        wanted = [self.names.index(name) for name in names]
        dates = [index for index in wanted if self.names[index] in self.dates]
        try:
            columns = self._loaded([index for index in wanted if index not in dates], np.float64)
            columns |= self._loaded(dates, np.str_)
        except ValueError:
            # missing cells, units in the cells, thousands, words between the rows: slower, cell by cell
            columns = self._by_rows(wanted)
        return {
            self.names[index]: dialect.seconds_of(columns[index])
            if index in dates
            else np.asarray(columns[index], dtype=np.float64)
            for index in wanted
        }

    def _loaded(self, wanted: Sequence[int], kind: type[np.generic]) -> dict[int, Sequence[Any]]:
        """Return columns of plain numbers or of texts by their index.

        Raises:
            ValueError: A cell is no plain number, a row has another length, or a stamp stands before it.
        """
        if not wanted:
            return {}
        if self.stamped:
            raise ValueError("a time of day before each line")
        with self.path.open(encoding=self.encoding, errors="replace") as file:
            lines = file if self.decimal == "." else (line.translate(COMMA_FOR_POINT) for line in file)
            cells = np.loadtxt(
                lines,
                dtype=kind,
                delimiter=None if self.delimiter == " " else self.delimiter,
                comments=self.comment,
                skiprows=self.skip,
                usecols=None if len(wanted) == self.width else wanted,
                quotechar='"',
                ndmin=2,
            )
        order = range(self.width) if len(wanted) == self.width else wanted
        return dict(zip(order, np.ascontiguousarray(cells.T), strict=True))

    def _by_rows(self, wanted: Sequence[int]) -> dict[int, Sequence[Any]]:
        """Return columns by their index, read cell by cell; lines of words between the rows, and rows that were cut, are missing.

        Raises:
            SysidError: A cell among numbers is a text, or a row is too long.
        """
        rows: list[list[Any]] = []
        words: list[str] = []
        cut = ""
        for number, cells in self.cells():
            if cut:  # a log may be cut in its last row, and no other
                raise SysidError(f"{self.path}: {cut}")
            row = [self._value(cells, index) for index in wanted]
            if wrong := [index for index, value in zip(wanted, row, strict=True) if value is None]:
                said = (
                    f"line {number}, column '{self.names[wrong[0]]}': '{cells[wrong[0]][:40]}' is not a number. "
                    "Mend the line, or name another column with --column."
                )
                if any(value is not None and value == value for value in row):
                    cut = said
                else:
                    words.append(said)
            elif len(cells) > self.width:
                raise SysidError(
                    f"{self.path}: line {number} has {len(cells)} fields where {self.width} were expected; "
                    "two writers, or a text with the delimiter in it. Mend or delete the line."
                )
            rows.append([np.nan] * len(row) if wrong else row)
        if 2 * len(words) > len(rows):
            raise SysidError(f"{self.path}: {words[0]}")
        return dict(zip(wanted, zip(*rows, strict=True), strict=True))

    def cells(self) -> Iterator[tuple[int, list[str]]]:
        """Yield the number of each line that is no comment, from the first row on, and its cells."""
        with self.path.open(encoding=self.encoding, errors="replace") as file:
            for number, line in enumerate(file, 1):
                said = self.comment and line.lstrip().startswith(self.comment)
                if number > self.skip and not said and line.strip():
                    yield number, dialect.split_line(line.rstrip("\n"), self.delimiter)

    def _value(self, cells: Sequence[str], index: int) -> Any:
        """Return a number, NaN where it is missing, the text of a date, or None where it is neither."""
        cell = cells[index] if index < len(cells) else ""
        if self.names[index] in self.dates:
            return cell if dialect.DATE.fullmatch(cell) else None if cell else np.nan
        try:
            return dialect.read_number(cell, self.decimal)
        except ValueError:
            return None


def open_csv(path: Path) -> LogFile:
    """Find a text table's dialect from its first 64 KiB.

    Raises:
        SysidError: The file is empty, binary, or holds no rows of numbers.
    """
    lines, encoding = dialect.head_of(path)
    refuse_larger(path, path.stat().st_size)
    comment = dialect.comment_sign(lines)
    rows = [
        (number, line)
        for number, line in enumerate(lines)
        if line.strip() and not (comment and line.lstrip().startswith(comment))
    ]
    delimiter, decimal, cells = dialect.find_dialect(path, [line for _, line in rows])
    first = dialect.first_row(rows, delimiter, decimal, cells)
    skip = rows[first][0]
    above = [line for _, line in rows[:first]]
    if not above and comment:  # numpy.savetxt and gnuplot write the header as a comment
        above = [line.strip().lstrip("#%/ ") for line in lines[:skip]]
    header, units = dialect.find_header(above, delimiter, decimal, cells)
    sample = [dialect.split_line(line, delimiter) for _, line in rows[first : first + 50]]
    width = cells
    while width > 1 and not any(len(row) >= width and row[width - 1] for row in (*sample, header)):
        width -= 1  # a delimiter at the end of each line
    notes = [dialect.dialect_note(delimiter, decimal, bool(header))]
    if skip > bool(header) + bool(units):
        notes.append(f"table: {skip} lines before the first row of numbers")
    if stamped := any(dialect.split_stamp(line)[0] for _, line in rows[first : first + 50]):
        header = [dialect.ARRIVAL, *(header or [""] * width)[1:]]
    names = of_sensor(path.stem, dialect.unique_names(header[:width] if header else [""] * width))
    columns = [[row[n] for row in sample if n < len(row)] for n in range(width)]
    dates = frozenset(
        name for name, column in zip(names, columns, strict=True) if all(map(dialect.DATE.fullmatch, column))
    )
    known = dict(zip(names, units, strict=False))
    for name, column in zip(names, columns, strict=True):
        known[name] = "s" if name in dates else known.get(name) or dialect.unit_beside(column)
    table = TextTable(
        path=path, names=names, delimiter=delimiter, decimal=decimal, encoding=encoding, width=cells, skip=skip,
        comment=comment and comment[0], dates=dates, stamped=stamped,
    )  # fmt: skip
    if any(
        name.lower() in SENSOR and not all(dialect.is_number(cell, decimal) for cell in column)
        for name, column in zip(names, columns, strict=True)
    ) and any(name.lower() in (*VALUE, *"xyz") for name in names):  # each row says of which sensor it is
        return log_of_records(path, [dict(zip(names, row, strict=False)) for _, row in table.cells()])
    return LogFile(
        path=path, names=names, units={name: unit for name, unit in known.items() if unit},
        notes=tuple(notes), read=table.read,
    )  # fmt: skip


FORMAT = Format(name="text table", order=9, sniff=lambda path, head: True, open=open_csv)
