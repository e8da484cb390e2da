"""ROS 1 bags, and ROS 2 recordings in SQLite."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sysid.errors import needs_extra
from sysid.logs.formats.messages import tables_of
from sysid.logs.formats.registry import Format, undamaged
from sysid.logs.table.file import LogFile

SQLITE = b"SQLite format 3"


def open_bag(path: Path) -> LogFile:
    """Open a ROS 1 bag, or the folder of a ROS 2 recording; every number in every message becomes a column.

    Raises:
        SysidError: The reader is not installed, or the recording is damaged.
    """
    otherwise = f"Or convert it: mcap convert {path.name} {path.stem}.mcap."
    with needs_extra("formats", f"{path}: reading ROS bags", otherwise):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

    def messages() -> Iterator[tuple[str, float, Any]]:
        where = path if path.is_dir() or path.suffix != ".db3" else path.parent  # beside its metadata.yaml
        with AnyReader([where], default_typestore=get_typestore(Stores.LATEST)) as reader:
            for connection, stamp, data in reader.messages():
                yield connection.topic, 1e-9 * stamp, reader.deserialize(data, connection.msgtype)

    with undamaged(path, "ROS recording"):
        return tables_of(path, "ROS recording", messages())


FORMAT = Format(
    name="ROS bag", order=2, open=open_bag,
    sniff=lambda path, head: head.startswith((b"#ROSBAG", SQLITE)) or (path.is_dir() and any(path.glob("*.db3"))),
)  # fmt: skip
