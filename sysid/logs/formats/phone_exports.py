"""The exports of phone apps (phyphox, Sensor Logger): one table a sensor, in a zip archive or a folder."""

import lzma
import shutil
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from sysid.errors import SysidError
from sysid.logs.formats.csv import open_csv
from sysid.logs.formats.registry import Format, refuse_larger
from sysid.logs.formats.tables import MOTION, merge_logs
from sysid.logs.table.file import LogFile
from sysid.logs.table.names import parse_column

T = TypeVar("T")
MAX_MEMBERS = 10_000
"""Files in an archive; a phone's export has one a sensor, some ten."""
_DAMAGE = (RuntimeError, NotImplementedError, EOFError, OSError, ValueError, OverflowError)


def open_zip(path: Path) -> LogFile:
    """Open the zip export of a phone app: one CSV file a sensor.

    Its directory tells what to unpack; nothing else is.

    Raises:
        SysidError: The archive is damaged, too large, or holds no tables.
    """
    try:
        with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(path) as archive:
            listed = archive.infolist()
            if len(listed) > MAX_MEMBERS:
                raise SysidError(
                    f"{path}: {len(listed)} files in one archive, so no phone's export. Unpack it and name the log in it."
                )
            tables = [m for m in listed if not m.is_dir() and _is_table(Path(m.filename))]
            needed = _of_motion(tables, lambda member: Path(member.filename))
            refuse_larger(path, sum(member.file_size for member in needed))
            files: list[Path] = []
            for number, member in enumerate(needed):
                target = Path(folder) / str(number) / Path(member.filename).name
                target.parent.mkdir()
                with archive.open(member) as packed, target.open("wb") as file:
                    shutil.copyfileobj(packed, file)
                files.append(target)
            try:
                return merge(path, files)
            except SysidError as error:  # it names the unpacked file
                raise SysidError(str(error).replace(folder, str(path))) from error
    except (*(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error), *_DAMAGE) as error:
        raise SysidError(f"{path}: damaged or locked archive ({error}). Export it again.") from error


def open_export(path: Path) -> LogFile:
    """Open a phone's export as it came, or unpacked.

    Raises:
        SysidError: It is damaged, or holds no tables of motion sensors.
    """
    if not path.is_dir():
        return open_zip(path)
    return merge(path, sorted(file for file in path.iterdir() if file.is_file() and _is_table(file)))


def _is_table(file: Path) -> bool:
    hidden = any(part.startswith((".", "__")) or part == "meta" for part in file.parts[-2:])
    return file.suffix.lower() in (".csv", ".tsv", ".txt") and not hidden and file.stem.lower() != "metadata"


def _of_motion(tables: Sequence[T], name: Callable[[T], Path]) -> list[T]:
    """Return the tables of motion sensors; all without such a name."""
    return [table for table in tables if MOTION.search(name(table).stem)] or list(tables)


def merge(path: Path, files: Sequence[Path]) -> LogFile:
    """Read the motion sensors among the files of an export; without such a name, the only table with a clock.

    Raises:
        SysidError: They are damaged, or not exactly one table has a clock.
    """
    wanted = _of_motion(files, lambda file: file)
    if len(wanted) == 1 or any(MOTION.search(file.stem) for file in wanted):
        return merge_logs(path, {file.stem: open_csv(file) for file in wanted}, "export")
    clocked = {file.stem: log for file in wanted if (log := _clocked(file)) is not None}
    if len(clocked) > 1:
        raise SysidError(
            f"{path}: several tables have a clock, and no name says which holds the motion: "
            f"{', '.join(map(repr, clocked))}. Save the one that does as a file of its own."
        )
    return merge_logs(path, clocked, "export")


def _clocked(file: Path) -> LogFile | None:
    """Return a table with a column of time; None for notes beside it."""
    try:
        log = open_csv(file)
    except SysidError:
        return None
    return log if any(parse_column(name, log.units.get(name)).kind == "time" for name in log.names) else None


FORMAT = Format(
    name="phone export",
    order=3,
    sniff=lambda path, head: head.startswith(b"PK") or path.is_dir(),
    open=open_export,
)
