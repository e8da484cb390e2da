"""Spreadsheets, such as phyphox's .xls: one table a sensor on each sheet."""

import csv
import tempfile
from pathlib import Path

from sysid.errors import SysidError, needs_extra
from sysid.logs.formats.phone_exports import merge
from sysid.logs.formats.registry import Format, undamaged
from sysid.logs.table.file import LogFile


def open_workbook(path: Path) -> LogFile:
    """Open a spreadsheet: each sheet is a table with a column of time.

    Raises:
        SysidError: The reader is not installed, the file is damaged, or holds no table of a sensor.
    """
    otherwise = "Or convert it: libreoffice --headless --convert-to csv FILE."
    with needs_extra("formats", f"{path}: reading spreadsheets", otherwise):
        from python_calamine import CalamineWorkbook
    with undamaged(path, "spreadsheet"):
        book = CalamineWorkbook.from_path(str(path))
        sheets = {name: book.get_sheet_by_name(name).to_python() for name in book.sheet_names}
    with tempfile.TemporaryDirectory() as folder:
        files: list[Path] = []
        for number, (name, rows) in enumerate(sheets.items()):
            file = Path(folder) / str(number) / f"{name.replace('/', ' ')}.csv"
            file.parent.mkdir()
            with file.open("w", newline="", encoding="utf-8") as out:
                csv.writer(out).writerows(rows)
            files.append(file)
        try:
            return merge(path, [file for file in files if file.stat().st_size > 0])
        except SysidError as error:  # says it of what was unpacked
            raise SysidError(str(error).replace(folder, str(path))) from error


def _sniff(path: Path, head: bytes) -> bool:
    old = head.startswith(b"\xd0\xcf\x11\xe0")
    return old or (head.startswith(b"PK") and path.suffix.lower() in (".xlsx", ".ods"))


FORMAT = Format(name="spreadsheet", order=0, sniff=_sniff, open=open_workbook)
