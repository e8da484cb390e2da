"""JSON in the shapes that loggers write: records, columns, a line for each record, sensors apart."""

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import SysidError
from sysid.logs.formats import dialect
from sysid.logs.formats.registry import MAX_UNPACKED, Format
from sysid.logs.formats.tables import MOTION, merge_logs, motion_first
from sysid.logs.table.clock import MIN_SAMPLES
from sysid.logs.table.file import LogFile, held
from sysid.roll import Array

Table = dict[str, list[Any]]
SENSOR = ("sensor", "topic", "variable", "name")
"""Fields that say which sensor a record is of."""


def open_json(path: Path) -> LogFile:
    """Open a JSON file.

    Raises:
        SysidError: It is damaged, or holds no table.
    """
    if 2 * path.stat().st_size > MAX_UNPACKED:  # Python's objects take ten times the memory of the text
        raise SysidError(f"{path}: more than 0.5 GiB of JSON. Cut it into parts, or write it as CSV.")
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        content = _lines(text) if isinstance(error, ValueError) else None
        if content is None:
            raise SysidError(
                f"{path}: damaged JSON ({error}). Was the recording saved to its end?"
            ) from error
    return log_of_records(path, content)


def log_of_records(path: Path, content: Any) -> LogFile:
    """Return the tables in the content of a file as one log.

    Raises:
        SysidError: It holds no table of numbers.
    """
    logs = {
        name: _log(path, name, table)
        for name, table in _tables(path.stem, content)
        if len(next(iter(table.values()))) >= MIN_SAMPLES
    }
    if not logs:
        raise SysidError(f"{path}: no table of numbers in it, neither records nor columns. Write it as CSV.")
    if len(logs) == 1 and not MOTION.search(next(iter(logs))):
        return next(iter(logs.values()))
    return merge_logs(path, {name: logs[name] for name in motion_first(logs)}, "records")


def _lines(text: str) -> list[Any] | None:
    """Return a record from each line, without a last one that was cut; None for other texts."""
    records: list[Any] = []
    lines = [line.strip().rstrip(",") for line in text.splitlines() if line.strip()]
    for number, line in enumerate(lines):
        try:
            records.append(json.loads(line))
        except ValueError:
            if number < len(lines) - 1:
                return None
    return records or None


def _tables(name: str, value: Any) -> Iterator[tuple[str, Table]]:
    """Yield the tables in a value with their names: a sensor's, or else its key's."""
    if isinstance(value, list):
        records = [row for row in value if isinstance(row, dict)]
        of_sensor: dict[str, list[dict[str, Any]]] = {}
        for row in records:
            if len(records) < MIN_SAMPLES:
                yield from _tables(_sensor(row) or name, row)
            else:
                of_sensor.setdefault(_sensor(row), []).append(dict(_flat(row)))
        for sensor, rows in of_sensor.items():
            names = dict.fromkeys(key for row in rows for key in row)
            yield sensor or name, {key: [row.get(key) for row in rows] for key in names}
    elif isinstance(value, dict):
        columns = {key: column for key, item in value.items() if (column := _column(item))}
        usual = max(map(len, columns.values()), default=0)
        if usual >= MIN_SAMPLES:
            yield name, {key: column for key, column in columns.items() if len(column) == usual}
        else:
            for key, item in value.items():
                yield from _tables(key, item)


def _column(value: Any) -> list[Any]:
    """Return a list of numbers or texts, also as pandas writes it by its index; else nothing."""
    if isinstance(value, dict) and all(key.isdigit() for key in value):
        value = list(value.values())
    return value if isinstance(value, list) and value and not isinstance(value[0], list | dict) else []


def _sensor(record: Mapping[str, Any]) -> str:
    """Return the name of the sensor that a record is of, '' without one."""
    return next((record[key] for key in SENSOR if isinstance(record.get(key), str)), "")


def _flat(record: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the plain values of a record with their dotted names; 'values' is no name."""
    for key, value in record.items():
        label = prefix + key
        if isinstance(value, dict):
            yield from _flat(value, prefix if key == "values" else f"{label}.")
        elif isinstance(value, list) and len(value) <= 4:
            yield from _flat({f"{key}[{index}]": item for index, item in enumerate(value)}, prefix)
        elif not isinstance(value, list):
            yield label, value


def _log(path: Path, name: str, table: Table) -> LogFile:
    """Return the columns of a table that hold numbers or dates."""
    columns: dict[str, Array] = {}
    units: dict[str, str] = {}
    for key, column in table.items():
        given = [item for item in column if item is not None]
        if given and all(isinstance(item, str) and dialect.DATE.fullmatch(item) for item in given):
            columns[key] = dialect.seconds_of(column)
            units[key] = "s"
        elif np.isfinite(values := np.array([_number(item) for item in column])).any():
            columns[key] = values
    return held(path, columns, (f"table: JSON, '{name}'",), units)


def _number(value: Any) -> float:
    """Return a value as a number, else NaN; texts may be numbers."""
    try:
        return float(value)
    except (TypeError, ValueError):
        return float("nan")


FORMAT = Format(
    name="JSON",
    order=7,
    sniff=lambda path, head: bool(re.match(rb'(\xef\xbb\xbf)?\s*(\{\s*["}]|\[\s*[\[{])', head)),
    open=open_json,
)
