"""The dialect of a text table, from its head: encoding, delimiter, decimal sign, header and units."""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import SysidError
from sysid.logs.table.clock import MIN_SAMPLES
from sysid.logs.table.names import parse_unit
from sysid.roll import Array

HEAD_BYTES = 65_536
"""Bytes of the beginning that tell how a file is written: a choice, a hundred times a logger's header."""
DIALECTS = (
    (",", "."),
    ("\t", "."),
    (";", "."),
    (";", ","),
    ("\t", ","),
    ("|", "."),
    ("|", ","),
    (" ", "."),
    (" ", ","),
)
"""Delimiter and decimal sign, in the order of preference; ' ' is any run of blanks."""
COMMENTS = ("#", "%", "//")
_BOMS = ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
_MISSING = {"", "nan", "na", "n/a", "null", "none", "-", "inf", "-inf", "+inf", "#n/a", "<na>"}
_TRUE, _FALSE = {"true", "on"}, {"false", "off"}
_PLAIN = re.compile(r"-?\d+(\.\d+)?")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?")
_DAY = (
    r"\d{4}-\d\d?-\d\d?[T ]|\d{4}/\d\d?/\d\d? |\d\d?[./-]\d\d?[./-]\d{2,4},? |\d\d?[- ][A-Za-z]{3}[- ]\d{4} "
)
DATE = re.compile(rf"({_DAY})?\d{{1,2}}:\d\d(:\d\d([.,]\d+)?)?( ?[AaPp][Mm])?(Z|[+-]\d\d:?\d\d)?")
"""A time of day, or a date and time: 2024-03-31T14:05:00.5, 31.03.2024 14:05, 3/31/2024 2:05:00 PM."""
_DAY_ALONE = re.compile(r"\d{4}-\d\d-\d\d|\d{4}/\d\d?/\d\d?|\d\d?[./-]\d\d?[./-]\d{2,4}")
ARRIVAL = "arrival"
"""Column of the time of day that a serial monitor puts before each line."""
_STAMP = re.compile(rf"\s*(?:\[\s*({DATE.pattern})\s*\]|({DATE.pattern})(?=\s*->))\s*(?:->|:)?[ \t]?")
"""Time stamp of a serial monitor before each line:  '12:34:56.789 -> ' or '[12:34:56.789] '."""
_BOOT = re.compile(r":(0x|\d)|[:=]\s*$")
"""A cell that belongs to no header but to a message of a board that starts."""
_THOUSANDS = {".": re.compile(r"[+-]?\d{1,3}(,\d{3})+\.\d*"), ",": re.compile(r"[+-]?\d{1,3}(\.\d{3})+,\d*")}
"""Numbers with separated thousands, by decimal sign; without that sign 1,234 may as well be a decimal comma."""
_MEASURE = re.compile(r"([+-]?[\d.,]+(?:[eE][+-]?\d+)?)\s*([^\d\s.,+-].*)")
"""A number with its unit in one cell."""


def split_stamp(line: str) -> tuple[str, str]:
    """Return the time of day that a serial monitor put before a line, '' for none, and the line."""
    stamp = _STAMP.match(line) if ":" in line[:40] else None
    return (stamp[0].strip(" \t->[]"), line[stamp.end() :]) if stamp else ("", line)


def split_line(line: str, delimiter: str) -> list[str]:
    """Return the cells of one line, without quotes and blanks around them; a serial monitor's time is the first of them."""
    stamp, line = split_stamp(line)
    if stamp:
        return [stamp, *split_line(line, delimiter)]
    if delimiter == " ":
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    try:
        cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    except (csv.Error, StopIteration):
        cells = line.split(delimiter)
    return [cell.strip() for cell in cells]


def head_of(path: Path) -> tuple[list[str], str]:
    """Return the whole lines at the beginning of a text file, and its encoding.

    Raises:
        SysidError: It is empty, binary, or was not closed well.
    """
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
        file.seek(max(0, file.seek(0, 2) - HEAD_BYTES))
        tail = file.read()
    if not head.strip(b"\xef\xbb\xbf\xfe\xff \r\n\t\0"):
        raise SysidError(f"{path}: the file is empty. Was the recording saved?")
    encoding = next((name for bom, name in _BOMS if head.startswith(bom)), None)
    if encoding is None:
        control = sum(head.count(byte) for byte in (*range(9), *range(14, 32)))
        if control > len(head) // 1000:
            raise SysidError(
                f"{path}: this is a binary file, not a text table. Readable are CSV, TSV, Parquet, MCAP, "
                "phone exports (zip) and video, each with its usual file name ending."
            )
        try:
            head[: head.rfind(b"\n") + 1].decode(encoding := "utf-8")
        except UnicodeDecodeError:
            encoding = "cp1252"
    if b"\0\0" in tail and encoding != "utf-16":
        raise SysidError(f"{path}: zero bytes at its end: the recording was not closed well. Cut them off.")
    lines = head.decode(encoding, errors="replace").replace("\r\n", "\n").replace("\r", "\n").splitlines()
    if len(head) == HEAD_BYTES and len(lines) > 1:
        lines.pop()  # cut in the middle
    if len(head) == HEAD_BYTES and len(lines) < MIN_SAMPLES:
        raise SysidError(
            f"{path}: a line of {max(map(len, lines))} characters: no table with a row for each sample. "
            "If the rows are columns in it, transpose it."
        )
    return lines, encoding


def comment_sign(lines: Sequence[str]) -> str | None:
    """Return the sign at the beginning of comment lines; None without comments."""
    starts = Counter(sign for line in lines for sign in COMMENTS if line.lstrip().startswith(sign))
    return starts.most_common(1)[0][0] if starts else None


def find_dialect(path: Path, lines: Sequence[str]) -> tuple[str, str, int]:
    """Return delimiter, decimal sign and number of columns: the ones that make most cells numbers."""
    sample = [*lines[-200:]]
    best, best_score = None, (0.0, 0)
    for delimiter, decimal in DIALECTS:
        rows = [split_line(line, delimiter) for line in sample]
        rows = [row for row in rows if any(is_number(cell, decimal) and cell for cell in row)]
        if not rows:
            continue
        width = Counter(len(row) for row in rows).most_common(1)[0][0]
        regular = [row for row in rows if len(row) == width]
        cells = [cell for row in regular for cell in row]
        good = sum(is_number(cell, decimal) or _is_date(cell) for cell in cells) / len(cells)
        blanks = 0.95 if delimiter == " " else 1.0  # they are within cells as well, as in a date and time
        score = (round(blanks * good * len(regular) / len(sample), 2), width)
        if score > best_score:
            best, best_score = (delimiter, decimal, width), score
    if best is None or best_score[0] < 0.25:
        where = "only line" if len(lines) == 1 else f"first {len(lines)} lines"
        raise SysidError(
            f"{path}: no rows of numbers in its {where}. Expected a table with a column of "
            "time and one of roll, angle or rotation rate."
        )
    return best


def first_row(rows: Sequence[tuple[int, str]], delimiter: str, decimal: str, width: int) -> int:
    """Return the index of the first of `rows` that is like those below it: numbers and dates where they have some."""
    table = [split_line(line, delimiter) for _, line in rows]
    marked = [[_is_date(cell) or is_number(cell, decimal) for cell in row] for row in table]
    body = [
        marks
        for row, marks in zip(table[-200:], marked[-200:], strict=True)
        if len(row) == width and any(row)
    ]
    numeric = [sum(column) * 2 > len(body) for column in zip(*body, strict=True)]
    fits = [
        len(row) == width
        and all(mark or not wanted for mark, wanted in zip(marks, numeric, strict=True))
        and any(cell and mark for cell, mark in zip(row, marks, strict=True))
        for row, marks in zip(table, marked, strict=True)
    ]
    for index in range(len(rows)):
        after = fits[index + 1 : index + 11]
        if fits[index] and all(after[:1]) and sum(after) * 2 >= len(after):
            return index
    return 0


def find_header(
    lines: Sequence[str], delimiter: str, decimal: str, width: int
) -> tuple[list[str], list[str | None]]:
    """Return the names in the lines above the first row of numbers, and the units below them where there is such a row."""
    above = [
        [*row, ""][:width]
        for row in (split_line(line, delimiter) for line in lines)
        if width - 1 <= len(row) <= width + 1
        and sum(map(bool, row)) * 2 > width
        and not any(_BOOT.search(cell) for cell in row)
        and sum(bool(cell) and is_number(cell, decimal) for cell in row) * 2 < width
    ]
    units = [[parse_unit(cell) for cell in row] for row in above[-2:]]
    known = [sum(unit is not None for unit in row) for row in units]
    if len(above) > 1 and known[0] < known[1] and known[1] * 2 >= sum(map(bool, above[-1])):
        return _with_names_above(above[:-1]), units[1]
    return _with_names_above(above) if above else [], []


def _with_names_above(above: Sequence[list[str]]) -> list[str]:
    """Return the names in the last of some rows; those that are there more than once with the row's above that tell them apart."""
    last = list(above[-1])
    for row in reversed(above[:-1]):
        shared = {before for before, name in zip(row, last, strict=True) if name and last.count(name) > 1}
        if not shared:
            break
        pairs = zip(row, last, strict=True)
        joined = [
            f"{before} {name}" if before in shared and before and name else name for before, name in pairs
        ]
        last = joined if len(set(joined)) > len(set(last)) else last
    return last


def dialect_note(delimiter: str, decimal: str, header: bool) -> str:
    """Return the dialect in words."""
    shown = {",": "commas", "\t": "tabs", ";": "semicolons", "|": "bars", " ": "blanks"}[delimiter]
    comma, numbered = ", decimal comma" * (decimal == ","), ", no header: columns are numbered" * (not header)
    return f"table: separated by {shown}{comma}{numbered}"


def unique_names(names: Sequence[str]) -> tuple[str, ...]:
    """Return column names without quotes, numbered where they are empty or repeated."""
    seen: Counter[str] = Counter()
    unique: list[str] = []
    for number, name in enumerate(names, 1):
        name = name.strip().strip("\ufeff\"'") or f"column {number}"
        seen[name] += 1
        unique.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return tuple(unique)


def _is_date(cell: str) -> bool:
    return bool(DATE.fullmatch(cell) or _DAY_ALONE.fullmatch(cell))


def read_number(cell: str, decimal: str) -> float:
    """Return the number in a cell, NaN where it stands for a missing one.

    Units, brackets, separated thousands and a typographic minus may be around it.

    Raises:
        ValueError: It is neither.
    """
    if decimal == "." and _PLAIN.fullmatch(cell):
        return float(cell)
    plain = cell.strip().lower()
    if plain in _MISSING | _TRUE | _FALSE:
        return float("nan") if plain in _MISSING else float(plain in _TRUE)
    plain = plain.strip("[]").replace("−", "-")
    measure = _MEASURE.fullmatch(plain)
    if measure and parse_unit(measure[2]) is not None:
        plain = measure[1]
    if _THOUSANDS[decimal].fullmatch(plain):
        plain = plain.replace("," if decimal == "." else ".", "")
    plain = plain.replace(",", ".") if decimal == "," else plain
    if not _NUMBER.fullmatch(plain):
        raise ValueError(cell)
    return float(plain.replace("d", "e"))


def unit_beside(cells: Sequence[str]) -> str | None:
    """Return the unit that stands behind the numbers in some cells, if one does."""
    measures = filter(None, map(_MEASURE.fullmatch, cells))
    return next((unit for measure in measures if (unit := parse_unit(measure[2]))), None)


def is_number(cell: str, decimal: str) -> bool:
    """Return whether a cell is a number or stands for a missing one."""
    try:
        read_number(cell, decimal)
    except ValueError:
        return False
    return True


def seconds_of(texts: Sequence[Any]) -> Array:
    """Return dates or times of day, n texts of which some may be missing, as time since the first [s], shape (n,)."""
    import pandas as pd

    clean = pd.Series(list(texts), dtype="str").str.strip()
    clean = clean.str.replace(r"(?<=\d),(?=\d)", ".", regex=True)
    first = next((match for text in clean if (match := DATE.fullmatch(str(text)))), None)
    day = (first and first[1]) or ""
    if not day:
        stamps = _time_of_day(clean.str.lower())
    elif re.match(r"\d{4}-\d\d-", day):
        stamps = pd.to_datetime(clean, errors="coerce", utc=True, format="ISO8601")
    else:
        fields = clean.str.extract(r"^(\d{1,2})\D(\d+)").astype(float)
        # Only differences count: where no day is beyond 12, the usual order of that sign will do.
        day_first = "." in day if (fields <= 12).all(axis=None) else bool((fields[0] > 12).any())
        stamps = pd.to_datetime(clean, errors="coerce", utc=True, format="mixed", dayfirst=day_first)
    return ((stamps - stamps.dropna().iloc[0]) / pd.Timedelta(seconds=1)).to_numpy(dtype=np.float64)


def _time_of_day(texts: Any) -> Any:
    """Return times of day as time deltas: 14:05:00.5, 2:05:00 pm, or minutes and seconds 05:00.5."""
    import pandas as pd

    after, half = texts.str.endswith("pm"), texts.str.endswith("m")
    clock = texts.str.rstrip("apm ")
    short = clock.str.count(":") < 2
    clock = clock.where(~short, clock + ":00" if half.any() else "00:" + clock)
    time, noon = pd.to_timedelta(clock, errors="coerce"), pd.Timedelta(hours=12)
    return time.where(~half, time % noon + after.astype(int) * noon)
