"""MCAP recordings of ROS 2 (and of anything that writes JSON messages)."""

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import SysidError
from sysid.logs.formats.registry import Format
from sysid.logs.formats.tables import SensorTables
from sysid.roll import Array


def open_mcap(path: Path) -> SensorTables:
    """Open an MCAP recording with ROS 2 or JSON messages; every number in every message becomes a column.

    A folder is a ROS 2 recording if it holds one such file.

    Raises:
        SysidError: The reader is not installed, the file is damaged, or no message can be decoded.
    """
    path = _recording(path)
    try:
        import zstandard
        from mcap.exceptions import McapError
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError as error:
        raise SysidError(
            f"{path}: reading MCAP needs an extra: pip install 'husky-sysid[mcap]' (missing: {error.name})."
        ) from error
    rows: dict[str, list[tuple[float, dict[str, float]]]] = {}
    skipped: set[str] = set()
    try:
        with path.open("rb") as file:
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
                    continue
                content = decode(message.data)
                fields = dict(_numbers(content))
                stamp = _stamp(content) or message.log_time * 1e-9
                if fields:
                    rows.setdefault(channel.topic, []).append((stamp, fields))
    except (
        *(McapError, zstandard.ZstdError, struct.error, ValueError, LookupError, EOFError, OSError),
        *(AssertionError, RuntimeError, TypeError, OverflowError, MemoryError),
    ) as error:
        raise SysidError(
            f"{path}: damaged MCAP file ({type(error).__name__}: {str(error)[:100]})."
        ) from error
    if not rows:
        found = f" (encodings {', '.join(sorted(skipped))} are not read)" if skipped else ""
        raise SysidError(f"{path}: no message with numbers in it{found}.")
    start = min(stamps[0][0] for stamps in rows.values())
    clocks = {topic: np.array([stamp for stamp, _ in stamps]) - start for topic, stamps in rows.items()}
    columns: dict[str, tuple[str, Array]] = {}
    for topic, stamps in rows.items():
        for field in stamps[0][1]:
            values = np.array([fields.get(field, np.nan) for _, fields in stamps])
            columns[f"{topic}.{field}"] = (topic, values)
    topics = ", ".join(f"{topic} ({len(stamps)})" for topic, stamps in rows.items())
    return SensorTables(path, clocks, columns, (f"table: MCAP recording with topics {topics}",))


def _stamp(content: Any) -> float | None:
    """Return the header's time stamp [s] of a ROS message, if it was set."""
    header = content.get("header") if isinstance(content, dict) else getattr(content, "header", None)
    stamp = header.get("stamp") if isinstance(header, dict) else getattr(header, "stamp", None)
    if stamp is None:
        return None
    parts: dict[str, Any] = (
        stamp if isinstance(stamp, dict) else {name: getattr(stamp, name) for name in _slots(stamp)}
    )
    return float(parts.get("sec", 0)) + 1e-9 * float(parts.get("nanosec", parts.get("nsec", 0))) or None


def _numbers(content: Any, prefix: str = "") -> Iterator[tuple[str, float]]:
    """Yield the numbers in a decoded message with their dotted names; joints by the joint's name."""
    fields = (
        content if isinstance(content, dict) else {name: getattr(content, name) for name in _slots(content)}
    )
    joints = fields.get("name") if isinstance(fields.get("name"), list) else None
    for name, value in fields.items():
        if name == "header" or "covariance" in name:
            continue
        label = f"{prefix}{name}"
        if isinstance(value, bool):
            continue
        if isinstance(value, int | float):
            yield label, float(value)
        elif isinstance(value, list | tuple) and len(value) <= 32:
            for index, item in enumerate(value):
                if isinstance(item, int | float):
                    yield f"{label}.{joints[index] if joints and index < len(joints) else index}", float(item)
        elif isinstance(value, dict) or _slots(value):
            yield from _numbers(value, f"{label}.")


def _slots(value: Any) -> tuple[str, ...]:
    return tuple(name for name in getattr(type(value), "__slots__", ()) if not name.startswith("_"))


def _recording(path: Path) -> Path:
    return next(path.glob("*.mcap")) if path.is_dir() else path


def _sniff(path: Path, head: bytes) -> bool:
    return head.startswith(b"\x89MCAP") or (path.is_dir() and len(list(path.glob("*.mcap"))) == 1)


FORMAT = Format(name="MCAP", order=2, sniff=_sniff, open=open_mcap)
