"""Formats that are not read here, and what to do with them instead."""

from pathlib import Path
from typing import Never

from sysid.errors import SysidError
from sysid.logs.formats.registry import Format

ADVICE = {
    b"SQLite format 3": "a ROS 2 recording in SQLite. Convert it: mcap convert recording.db3 recording.mcap.",
    b"#ROSBAG": "a ROS 1 bag. Convert it: mcap convert recording.bag recording.mcap.",
    b"\xd0\xcf\x11\xe0": "an Excel sheet (phyphox offers CSV beside it). "
    "Convert it: libreoffice --headless --convert-to csv FILE.",
    b"\x89HDF": "an HDF5 file. Write its columns out as text: h5dump -d DATASET -y -w 0 -o log.csv FILE; "
    "or in Python: pandas.read_hdf(FILE).to_csv('log.csv').",
    b"MATLAB 7.3": "a MATLAB file of version 7.3. In MATLAB: save('log.mat', '-v7'), or writetable.",
}
"""First bytes, and what to do."""


def _is_sheet(path: Path, head: bytes) -> bool:
    return head.startswith(b"PK") and path.suffix.lower() in (".xlsx", ".ods")


def _sniff(path: Path, head: bytes) -> bool:
    return head.startswith(tuple(ADVICE)) or _is_sheet(path, head)


def refuse(path: Path) -> Never:
    """Say how such a file can be read.

    Raises:
        SysidError: Always.
    """
    with path.open("rb") as file:
        head = file.read(16)
    advice = next((text for start, text in ADVICE.items() if head.startswith(start)), None)
    raise SysidError(
        f"{path}: {advice or 'a spreadsheet. Convert it: libreoffice --headless --convert-to csv FILE.'}"
    )


FORMAT = Format(name="elsewhere", order=0, sniff=_sniff, open=refuse)
