"""Formats that are not read here, and what to do with them instead."""

from pathlib import Path
from typing import Never

from sysid.errors import HuskyError
from sysid.logs.formats.registry import Format

ADVICE = {
    b"SQLite format 3": "a ROS 2 recording in SQLite. Convert it: mcap convert recording.db3 recording.mcap.",
    b"#ROSBAG": "a ROS 1 bag. Convert it: mcap convert recording.bag recording.mcap.",
    b"\x1f\x8b": "compressed with gzip. Unpack it first.",
    b"\xd0\xcf\x11\xe0": "an Excel sheet. Save it as CSV.",
}
"""First bytes, and what to do."""


def _is_sheet(path: Path, head: bytes) -> bool:
    return head.startswith(b"PK") and path.suffix.lower() in (".xlsx", ".ods")


def _sniff(path: Path, head: bytes) -> bool:
    return head.startswith(tuple(ADVICE)) or _is_sheet(path, head)


def refuse(path: Path) -> Never:
    """Say how such a file can be read.

    Raises:
        HuskyError: Always.
    """
    with path.open("rb") as file:
        head = file.read(16)
    advice = next((text for start, text in ADVICE.items() if head.startswith(start)), None)
    raise HuskyError(f"{path}: {advice or 'a spreadsheet. Save it as CSV.'}")


FORMAT = Format(name="elsewhere", order=0, sniff=_sniff, open=refuse)
