"""The exports of phone apps (phyphox, Sensor Logger): one table a sensor, in a zip archive or a folder."""

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


def open_export(path: Path) -> LogFile:
    """Open a phone's export as it came, or unpacked; of an archive, only the tables of motion sensors are unpacked.

    Raises:
        SysidError: It is damaged, too large, or holds no tables of motion sensors.
    """
    if path.is_dir():
        return merge(path, sorted(file for file in path.iterdir() if file.is_file() and _is_table(file)))
    with (
        undamaged(path, "archive"),
        tempfile.TemporaryDirectory() as folder,
        zipfile.ZipFile(path) as archive,
    ):
        tables = [m for m in archive.infolist() if not m.is_dir() and _is_table(Path(m.filename))]
        needed = motion_first(tables, lambda member: Path(member.filename).stem)
        refuse_larger(path, sum(member.file_size for member in needed))
        with named_as(path, Path(folder)):
            return merge(path, [Path(archive.extract(member, folder)) for member in needed])


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
