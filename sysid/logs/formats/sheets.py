"""Spreadsheets, such as phyphox's .xls: one table a sensor on each sheet."""

import csv
import re
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from sysid.errors import SysidError, needs_extra
from sysid.logs.formats.phone_exports import merge
from sysid.logs.formats.registry import MAX_UNPACKED, Format, named_as, refuse_larger, undamaged
from sysid.logs.table.clock import MIN_SAMPLES
from sysid.logs.table.file import LogFile

CELL = 64
"""Memory of a cell in Python [bytes]."""


def open_workbook(path: Path) -> LogFile:
    """Open a spreadsheet: each sheet is a table with a column of time.

    Raises:
        SysidError: The reader is not installed, the file is damaged, or holds no table of a sensor.
    """
    otherwise = "Or convert it: libreoffice --headless --convert-to csv FILE."
    with needs_extra("formats", f"{path}: reading spreadsheets", otherwise):
        from python_calamine import CalamineWorkbook
    with undamaged(path, "spreadsheet"):
        if zipfile.is_zipfile(path):
            _refuse_bomb(path)
        book = CalamineWorkbook.from_path(str(path))
        sheets = {name: book.get_sheet_by_name(name).to_python() for name in book.sheet_names}
    with tempfile.TemporaryDirectory() as folder:
        files: list[Path] = []
        for number, (name, rows) in enumerate(sheets.items()):
            file = Path(folder) / str(number) / f"{name.replace('/', ' ')}.csv"
            file.parent.mkdir()
            with file.open("w", newline="", encoding="utf-8") as out:
                csv.writer(out).writerows(_table(rows))
            files.append(file)
        with named_as(path, Path(folder)):
            return merge(path, [file for file in files if file.stat().st_size > 0])


def _table(rows: Sequence[Sequence[Any]]) -> Iterator[list[Any]]:
    """Yield the rows of a sheet without the columns that are too short for a log: notes and stray cells."""
    filled = [sum(cell not in ("", None) for cell in column) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [cell for cell, count in zip(row, filled, strict=True) if count >= MIN_SAMPLES]
        if any(cell not in ("", None) for cell in cells):
            yield cells


def _refuse_bomb(path: Path) -> None:
    """Refuse a workbook that is too large unpacked, or as the grid from its first to its last cell, which a reader fills."""
    with zipfile.ZipFile(path) as book:
        refuse_larger(path, sum(part.file_size for part in book.infolist()))
        for part in book.namelist():
            if not re.search(r"worksheets/[^/]*\.xml$", part):
                continue
            cells = re.findall(rb'<c r="([A-Z]{1,3})(\d{1,7})"', book.read(part))
            width = max((_column(letters) for letters, _ in cells), default=0)
            height = max((int(row) for _, row in cells), default=0)
            if CELL * width * height > MAX_UNPACKED:
                raise SysidError(
                    f"{path}: a cell far from the others (column {width}, row {height}) makes a table of "
                    f"{width * height:.1e} cells. Delete it, or save the sheet as CSV."
                )


def _column(letters: bytes) -> int:
    """Return the number of a column, 1 for A and 27 for AA."""
    number = 0
    for letter in letters:
        number = 26 * number + letter - 64
    return number


def _sniff(path: Path, head: bytes) -> bool:
    old = head.startswith(b"\xd0\xcf\x11\xe0")
    return old or (head.startswith(b"PK") and path.suffix.lower() in (".xlsx", ".xlsm"))


FORMAT = Format(name="spreadsheet", order=0, sniff=_sniff, open=open_workbook)
