"""The exports of phone apps (phyphox, Sensor Logger): one table a sensor, in a zip archive or a folder."""

import shutil
import tempfile
import zipfile
from collections.abc import Sequence
from contextlib import nullcontext, suppress
from pathlib import Path

from sysid.errors import SysidError
from sysid.logs.formats.csv import open_csv
from sysid.logs.formats.registry import Format, named_as, refuse_larger, undamaged
from sysid.logs.formats.tables import MOTION, merge_logs, motion_first
from sysid.logs.table.file import LogFile
from sysid.logs.table.names import parse_column

MAX_MEMBERS = 10_000
"""Files in an archive; a phone's export has one a sensor, some ten."""


def open_zip(path: Path) -> LogFile:
    """Open the zip export of a phone app: one CSV file a sensor.

    Its directory tells what to unpack; nothing else is.

    Raises:
        SysidError: The archive is damaged, too large, or holds no tables.
    """
    with (
        undamaged(path, "archive"),
        tempfile.TemporaryDirectory() as folder,
        zipfile.ZipFile(path) as archive,
    ):
        listed = archive.infolist()
        if len(listed) > MAX_MEMBERS:
            raise SysidError(
                f"{path}: {len(listed)} files in one archive, so no phone's export. Unpack it and name the log in it."
            )
        tables = [m for m in listed if not m.is_dir() and _is_table(Path(m.filename))]
        needed = motion_first(tables, lambda member: Path(member.filename).stem)
        refuse_larger(path, sum(member.file_size for member in needed))
        files: list[Path] = []
        for number, member in enumerate(needed):
            target = Path(folder) / str(number) / Path(member.filename).name
            target.parent.mkdir()
            with archive.open(member) as packed, target.open("wb") as file:
                shutil.copyfileobj(packed, file)
            files.append(target)
        with named_as(path, Path(folder)):
            return merge(path, files)


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


def merge(path: Path, files: Sequence[Path]) -> LogFile:
    """Read the motion sensors among the files of an export; without such a name, the only table with a clock.

    Raises:
        SysidError: They are damaged, or not exactly one table has a clock.
    """
    wanted = motion_first(files, lambda file: file.stem)
    named = len(wanted) == 1 or any(MOTION.search(file.stem) for file in wanted)
    logs: dict[str, LogFile] = {}
    for file in wanted:
        with nullcontext() if named else suppress(SysidError):  # notes beside the table
            log = open_csv(file)
            if named or any(parse_column(name, log.units.get(name)).kind == "time" for name in log.names):
                logs[file.stem] = log
    if not named and len(logs) > 1:
        raise SysidError(
            f"{path}: several tables have a clock, and no name says which holds the motion: "
            f"{', '.join(map(repr, logs))}. Save the one that does as a file of its own."
        )
    return merge_logs(path, logs, "export")


FORMAT = Format(
    name="phone export",
    order=3,
    sniff=lambda path, head: head.startswith(b"PK") or path.is_dir(),
    open=open_export,
)
