"""The exports of phone apps (phyphox, Sensor Logger): one table a sensor, in a zip archive or a folder."""

import lzma
import re
import shutil
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from sysid.errors import SysidError
from sysid.logs.formats.csv import open_csv
from sysid.logs.formats.registry import Format
from sysid.logs.formats.tables import sensor_tables
from sysid.logs.table.clock import time_scale
from sysid.logs.table.file import LogFile
from sysid.logs.table.names import ACCEL_UNITS, parse_column, sensor_of
from sysid.roll import Array

T = TypeVar("T")
MAX_UNPACKED = 1 << 30
"""An hour of seven sensors at 1 kHz is 0.3 GiB as text."""
MAX_MEMBERS = 10_000
"""Files in an archive; a phone's export has one a sensor, some ten."""
_DAMAGE = (RuntimeError, NotImplementedError, EOFError, OSError, ValueError, OverflowError)
_MOTION = re.compile(r"gyro|acc|orient|attitude|grav|motion|raw|rotation", re.I)
"""Names of the tables of motion sensors; a GPS or a microphone beside them is left alone."""


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
            if sum(member.file_size for member in needed) > MAX_UNPACKED:
                raise SysidError(
                    f"{path}: unpacks to more than 1 GiB. Unpack it and name the one file in it."
                )
            files: list[Path] = []
            for number, member in enumerate(needed):
                target = Path(folder) / str(number) / Path(member.filename).name
                target.parent.mkdir()
                with archive.open(member) as packed, target.open("wb") as file:
                    shutil.copyfileobj(packed, file)
                files.append(target)
            try:
                return merge(path, files)
            except SysidError as error:  # says it of what was unpacked
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
    """Return the tables of motion sensors; a single one whatever it is called."""
    return [table for table in tables if len(tables) == 1 or _MOTION.search(name(table).stem)]


def merge(path: Path, files: Sequence[Path]) -> LogFile:
    """Read the motion sensors among the files of an export."""
    tables: dict[str, tuple[Array, dict[str, Array]]] = {}
    for file in _of_motion(files, lambda file: file):
        table = open_csv(file)
        columns = [parse_column(name, table.units.get(name)) for name in table.names]
        times = sorted((c for c in columns if c.kind == "time"), key=lambda c: c.unit is None)
        if not times:
            continue
        values = table.read(
            [times[0].name, *(c.name for c in columns if c.kind != "time" and c.name not in table.dates)]
        )
        clock = values.pop(times[0].name)
        finite = np.isfinite(clock)
        if np.count_nonzero(finite) < 2:
            continue
        scale, _ = time_scale(clock[finite], times[0].unit)
        tables[file.stem] = (
            clock[finite] * scale,
            {_full_name(file.stem, name): column[finite] for name, column in values.items()},
        )
    if not tables:
        raise SysidError(
            f"{path}: holds no table of a motion sensor (Gyroscope.csv, Accelerometer.csv, ...)."
        )
    _add_gravity(tables)
    columns = {name: (stem, column) for stem, (_, data) in tables.items() for name, column in data.items()}
    clocks = {stem: clock for stem, (clock, _) in tables.items()}
    return sensor_tables(path, clocks, columns, f"table: export with {', '.join(tables)}")


def _full_name(stem: str, name: str) -> str:
    """Put the sensor's name before a bare axis; what the phone fused itself counts as second-hand."""
    sensor, column = sensor_of(stem), parse_column(name)
    if re.search(r"orient|attitude", stem, re.I):
        return f"{sensor} fused {name}"
    if column.kind == "unknown" and column.axis:
        name = f"{sensor} {name}"
    bare = name.startswith(f"{sensor} ") and column.unit is None
    return f"{name} (rad/s)" if bare and re.search("gyro", stem, re.I) else name


def _add_gravity(tables: dict[str, tuple[Array, dict[str, Array]]]) -> None:
    """Make sure that the accelerometer that will be taken holds gravity.

    Sensor Logger's plain accelerometer has gravity taken off and in a file of its own. A total acceleration
    beside it is taken instead, else the two are added.
    """
    accels = {
        stem: names
        for stem, (_, data) in tables.items()
        if re.search("acc", stem, re.I) and len(names := _axes(data)) == 3
    }
    whole = [stem for stem, names in accels.items() if _holds_gravity(tables[stem][1], names)]
    bare = [stem for stem in accels if stem not in whole]
    gravity = next((stem for stem in tables if re.fullmatch("gravity", stem, re.I)), None)
    if not whole and bare and gravity is not None:
        clock, data = tables[bare[0]]
        other_clock, other = tables[gravity]
        for mine, its in zip(accels[bare[0]], _axes(other), strict=False):
            data[mine] = data[mine] + np.interp(clock, other_clock, other[its], left=np.nan, right=np.nan)
        bare = bare[1:]
    for stem in bare if whole else ():
        del tables[stem]
    if gravity is not None:
        del tables[gravity]


def _axes(data: Mapping[str, Array]) -> list[str]:
    found = {parse_column(name).axis: name for name in data if parse_column(name).axis in ("x", "y", "z")}
    return [found[axis] for axis in "xyz" if axis in found]


def _holds_gravity(data: Mapping[str, Array], names: Sequence[str]) -> bool:
    norm = float(np.nanmedian(np.sqrt(sum(data[name] ** 2 for name in names))))
    return any(0.8 < norm * unit / ACCEL_UNITS["g"] < 1.25 for unit in (1.0, ACCEL_UNITS["g"]))


FORMAT = Format(
    name="phone export",
    order=3,
    sniff=lambda path, head: head.startswith(b"PK") or path.is_dir(),
    open=open_export,
)
