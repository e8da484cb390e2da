"""Recordings of ROS: MCAP, also of JSON messages, ROS 1 bags, and ROS 2 recordings in SQLite. Every number in every message is a column."""

import dataclasses
import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sysid.errors import SysidError, needs_extra
from sysid.logs.formats.registry import Format, refuse_larger, undamaged
from sysid.logs.formats.tables import MAX_ELEMENTS, sensor_tables
from sysid.logs.table.file import LogFile
from sysid.roll import Array


def open_mcap(path: Path) -> LogFile:
    """Open an MCAP recording with ROS 2 or JSON messages.

    A folder is a ROS 2 recording if it holds one such file.

    Raises:
        SysidError: The reader is not installed, the file is damaged, or no message can be decoded.
    """
    path = next(path.glob("*.mcap")) if path.is_dir() else path
    with needs_extra("mcap", f"{path}: reading MCAP"):
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    skipped: set[str] = set()

    def messages(file: BinaryIO) -> Iterator[tuple[str, float, Any]]:
        decoders: dict[int, Any] = {}
        factory = DecoderFactory()
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.id not in decoders:
                decoders[channel.id] = (
                    json.loads
                    if channel.message_encoding == "json"
                    else factory.decoder_for(channel.message_encoding, schema)
                )
            decode = decoders[channel.id]
            if decode is None:
                skipped.add(channel.message_encoding)
            else:
                yield channel.topic, message.log_time * 1e-9, decode(message.data)

    _refuse_bomb(path)
    try:
        with undamaged(path, "MCAP file"), path.open("rb") as file:
            return _tables_of(path, "MCAP recording", messages(file))
    except SysidError as error:
        found = f" Encodings {', '.join(sorted(skipped))} are not read." if skipped else ""
        raise SysidError(f"{error}{found}") from error


def _refuse_bomb(path: Path) -> None:
    """Refuse chunks that say, or whose packed frames say, that they unpack to too much."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    with undamaged(path, "MCAP file"), path.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Chunk):
                stated = _frame_size(record.compression, record.data)
                refuse_larger(path, max(record.uncompressed_size, stated))


def _frame_size(method: str, frame: bytes) -> int:
    """Return the unpacked size [bytes] that a packed frame states; 0 without one."""
    if method == "zstd":
        import zstandard

        return max(0, zstandard.frame_content_size(frame))
    if method == "lz4":
        import lz4.frame

        return int(lz4.frame.get_frame_info(frame)["content_size"])
    return 0


def open_bag(path: Path) -> LogFile:
    """Open a ROS 1 bag, or the folder of a ROS 2 recording.

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
        return _tables_of(path, "ROS recording", messages())


def _tables_of(path: Path, kind: str, messages: Iterable[tuple[str, float, Any]]) -> LogFile:
    """Return the numbers of messages: topic, time of arrival [s] and content of each, dictionaries or objects with fields.

    Raises:
        SysidError: There is no number in them.
    """
    rows: dict[str, list[tuple[float, dict[str, float]]]] = {}
    for topic, arrived, content in messages:
        if fields := dict(_numbers(content)):
            rows.setdefault(topic, []).append((_stamp(content) or arrived, fields))
    if not rows:
        raise SysidError(f"{path}: no message with numbers in it.")
    start = min(stamps[0][0] for stamps in rows.values())
    clocks = {topic: np.array([stamp for stamp, _ in stamps]) - start for topic, stamps in rows.items()}
    columns: dict[str, tuple[str, Array]] = {}
    for topic, stamps in rows.items():
        for field in stamps[0][1]:
            values = np.array([fields.get(field, np.nan) for _, fields in stamps])
            columns[f"{topic}.{field}"] = (topic, values)
    topics = ", ".join(f"{topic} ({len(stamps)})" for topic, stamps in rows.items())
    return sensor_tables(path, clocks, columns, f"table: {kind} with topics {topics}")


def _stamp(content: Any) -> float | None:
    """Return the header's time stamp [s] of a ROS message, if it was set."""
    stamp = _fields(_fields(_fields(content).get("header")).get("stamp"))
    return float(stamp.get("sec", 0)) + 1e-9 * float(stamp.get("nanosec", stamp.get("nsec", 0))) or None


def _numbers(content: Any, prefix: str = "") -> Iterator[tuple[str, float]]:
    """Yield the numbers in a decoded message with their dotted names; joints by the joint's name."""
    fields = _fields(content)
    joints = fields.get("name") if isinstance(fields.get("name"), list) else None
    for name, value in fields.items():
        if name == "header" or "covariance" in name:
            continue
        label = f"{prefix}{name}"
        if isinstance(value, bool):
            continue
        if isinstance(value, int | float):
            yield label, float(value)
        elif isinstance(value, list | tuple | np.ndarray) and len(value) <= MAX_ELEMENTS:
            for index, item in enumerate(value):
                if isinstance(item, int | float | np.number):
                    yield f"{label}.{joints[index] if joints and index < len(joints) else index}", float(item)
        else:
            yield from _numbers(value, f"{label}.")


def _fields(value: Any) -> dict[str, Any]:
    """Return the fields of a message by name; nothing for a plain value."""
    if isinstance(value, dict):
        return value
    if dataclasses.is_dataclass(value):
        names: Iterable[str] = (field.name for field in dataclasses.fields(value))
    else:
        names = getattr(type(value), "__slots__", ())
    return {name: getattr(value, name) for name in names if not name.startswith("_")}


MCAP = Format(
    name="MCAP", order=2, open=open_mcap,
    sniff=lambda path, head: head.startswith(b"\x89MCAP") or (path.is_dir() and len(list(path.glob("*.mcap"))) == 1),
)  # fmt: skip
BAG = Format(
    name="ROS bag", order=2, open=open_bag,
    sniff=lambda path, head: head.startswith((b"#ROSBAG", b"SQLite format 3")) or (path.is_dir() and any(path.glob("*.db3"))),
)  # fmt: skip
