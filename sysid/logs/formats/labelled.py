"""Text in which each number stands behind its name: prints of a microcontroller, the Arduino plotter."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from sysid.errors import SysidError
from sysid.logs.formats import dialect
from sysid.logs.formats.registry import Format
from sysid.logs.table.file import LogFile, held
from sysid.logs.table.names import parse_unit
from sysid.text import count as count_of

_NUMBER = r"[-+−]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_PAIR = re.compile(
    r"(?<![\w.])([^\W\d][\w .°/()\[\]-]{0,40}?)\s*[:=]\s*"
    rf"({_NUMBER})(?![\w.]*[xX:])(?:\s*((?:°|[^\W\d])[^\s,;|:=]*)(?![^\s,;|])(?!\s*[:=]))?"
)
"""Name, number and, behind it, a word that may be its unit and is no name of the next."""


def open_labelled(path: Path) -> LogFile:
    """Open a text of names and numbers.

    Raises:
        SysidError: It holds no number behind a name.
    """
    _, encoding = dialect.head_of(path)
    units: dict[str, str] = {}
    with path.open(encoding=encoding, errors="replace") as file:
        rows, left_out = _samples(list(_parsed(file, units)))
    count = Counter(name for row in rows for name in row)
    names = tuple(name for name, times in count.items() if 2 * times > len(rows))
    if not names:
        raise SysidError(f"{path}: no number behind a name.")
    notes = [f"table: numbers behind their names, {', '.join(names)}"]
    if left_out:
        notes.append(f"table: {count_of(left_out, 'line')} unlike the others left out")
    texts = {name: [row.get(name, "nan") for row in rows] for name in names}
    columns = {
        name: dialect.seconds_of(column) if name == dialect.ARRIVAL else np.array(column, dtype=float)
        for name, column in texts.items()
    }
    return held(path, columns, tuple(notes), {**units, dialect.ARRIVAL: "s"})


def _samples(lines: list[dict[str, str]]) -> tuple[list[dict[str, str]], int]:
    """Return the numbers of each sample by name as text, and how many lines unlike the others were left out.

    A sample may take several lines; a new one begins where a name comes again.
    """
    kinds = Counter(map(tuple, lines))
    usual = [line for line in lines if kinds[tuple(line)] > max(kinds.values()) // 10]
    rows: list[dict[str, str]] = []
    for line in usual:
        if rows and rows[-1].keys().isdisjoint(line.keys() - {dialect.ARRIVAL}):
            rows[-1] = line | rows[-1]
        else:
            rows.append(line)
    return rows, len(lines) - len(usual)


def _parsed(lines: Iterable[str], units: dict[str, str]) -> Iterator[dict[str, str]]:
    """Yield names and numbers of each line that has some, and collect the units behind them."""
    for line in lines:
        stamp, rest = dialect.split_stamp(line.rstrip())
        found = {dialect.ARRIVAL: stamp} if stamp else {}
        sensor, run = "", list[str]()
        for label, number, unit in _PAIR.findall(rest):
            name = label.strip()
            if len(name) > 1:  # 'Rotation X: 1, Y: 2': bare axes belong to the sensor before them
                sensor, run = (name[:-1] if name[-2:-1] in " ._" and name[-1] in "xyzXYZ" else ""), []
            elif sensor and name in "xyzXYZ":
                name = f"{sensor}{name}"
            if name in found:
                name = f"{name} ({1 + sum(other.startswith(name) for other in found)})"
            found[name] = number.replace("−", "-")
            run.append(name)
            if unit and parse_unit(unit):  # and the unit at their end is that of all
                units.update((own, unit) for own in (run if sensor else [name]))
        if found.keys() - {dialect.ARRIVAL}:
            yield found


def _sniff(path: Path, head: bytes) -> bool:
    """Return whether most lines at the end of its beginning hold numbers behind names, and no others."""
    if b"\0" in head[:2]:
        return False
    with path.open("rb") as file:
        text = file.read(dialect.HEAD_BYTES).decode("utf-8", errors="replace")
    lines = [rest for line in text.splitlines()[-200:] if (rest := dialect.split_stamp(line)[1]).strip()]
    return 2 * sum(bool(_PAIR.search(line)) and not _left_over(line) for line in lines) > len(lines)


def _left_over(line: str) -> bool:
    """Return whether a line has cells that are numbers without a name."""
    cells = re.split(r"[\s,;|]+", _PAIR.sub(" ", line))
    return any(cell and dialect.is_number(cell, ".") for cell in cells)


FORMAT = Format(name="labelled text", order=8, sniff=_sniff, open=open_labelled)
