"""JSON in the shapes that tables are written in: records, columns, rows beside their names, a line for each record, sensors apart."""

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import SysidError
from sysid.logs.formats import dialect
from sysid.logs.formats.csv import seconds_of
from sysid.logs.formats.long_table import SENSOR, by_sensor
from sysid.logs.formats.registry import MAX_UNPACKED, Format
from sysid.logs.formats.tables import MOTION, merge_logs, motion_first
from sysid.logs.table.clock import MIN_SAMPLES
from sysid.logs.table.file import LogFile, held
from sysid.roll import Array

Table = dict[str, list[Any]]


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
    found = [
        (name, table)
        for name, table in _tables(path.stem, content)
        if len(next(iter(table.values()))) >= MIN_SAMPLES
    ]
    if not found:
        raise SysidError(
            f"{path}: no table of numbers in it: neither records, nor columns, nor rows beside their names."
        )
    logs = {name: _log(path, name, table) for name, table in found}
    if len(logs) == 1 and not MOTION.search(found[0][0]):
        return logs[found[0][0]]
    return merge_logs(path, {name: logs[name] for name in motion_first(logs)}, "JSON")


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
    """Yield the tables in a value with their names, that of each its key's."""
    if isinstance(value, list):
        records = [row for row in value if isinstance(row, dict)]
        if len(records) >= MIN_SAMPLES:
            flat = [dict(_flat(row)) for row in records]
            names = dict.fromkeys(key for record in flat for key in record)
            yield name, {key: [record.get(key) for record in flat] for key in names}
        elif records:
            for row in records:
                own = next((str(row[key]) for key in SENSOR if isinstance(row.get(key), str)), name)
                yield from _tables(own, row)
        elif (
            len(value) > MIN_SAMPLES
            and isinstance(value[0], list)
            and all(isinstance(cell, str) for cell in value[0])
        ):
            yield name, dict(zip(value[0], map(list, zip(*value[1:], strict=False)), strict=False))
    elif isinstance(value, dict):
        columns = {key: column for key, item in value.items() if (column := _column(item))}
        usual = max(map(len, columns.values()), default=0)
        if rows := _rows(value):
            yield name, rows
        elif usual >= MIN_SAMPLES:
            yield name, {key: column for key, column in columns.items() if len(column) == usual}
        else:
            for key, item in value.items():
                yield from _tables(key, item)


def _column(value: Any) -> list[Any] | None:
    """Return a list of numbers or texts, or the numbers of a dictionary whose keys count; None where it is neither."""
    if isinstance(value, dict) and value and all(str(key).isdigit() for key in value):
        value = list(value.values())
    if not isinstance(value, list) or not value or any(isinstance(item, list | dict) for item in value):
        return None
    return list(value)


def _rows(value: Mapping[str, Any]) -> Table | None:
    """Return rows that stand beside a list of as many names as they have cells."""
    lists = [item for item in value.values() if isinstance(item, list) and item]
    for rows in lists:
        if not isinstance(rows[0], list) or len(rows) < MIN_SAMPLES:
            continue
        for names in lists:
            if len(names) == len(rows[0]) and all(isinstance(name, str) for name in names):
                return dict(zip(names, map(list, zip(*rows, strict=False)), strict=False))
    return None


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
    """Return a table as a log; one with a column of sensors as those of its sensors."""
    texts = {key for key, column in table.items() if all(isinstance(item, str) for item in column)}
    sensor = next((key for key in table if key in texts and key.lower() in SENSOR), None)
    columns: dict[str, Array] = {}
    dates: set[str] = set()
    for key, column in table.items():
        given = [item for item in column if item is not None]
        if given and all(isinstance(item, str) and dialect.DATE.fullmatch(item) for item in given):
            columns[key] = seconds_of(column)
            dates.add(key)
        elif key != sensor and np.isfinite(values := np.array([_number(item) for item in column])).any():
            columns[key] = values
    log = held(path, columns, (f"table: JSON, '{name}'",), dates=frozenset(dates))
    return log if sensor is None else by_sensor(path, log, np.array(table[sensor]), sensor)


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
