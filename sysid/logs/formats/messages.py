"""Recorded messages as columns: every number in every message, by topic and field."""

import dataclasses
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import SysidError
from sysid.logs.formats.tables import MAX_ELEMENTS, sensor_tables
from sysid.logs.table.file import LogFile
from sysid.roll import Array


def tables_of(path: Path, kind: str, messages: Iterable[tuple[str, float, Any]]) -> LogFile:
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
