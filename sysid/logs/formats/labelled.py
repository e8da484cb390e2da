"""Text in which each number stands behind its name: prints of a microcontroller, the Arduino plotter, `ros2 topic echo`."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sysid.errors import SysidError
from sysid.logs.formats import dialect
from sysid.logs.formats.csv import seconds_of
from sysid.logs.formats.registry import Format
from sysid.logs.table.file import LogFile
from sysid.logs.table.names import parse_unit
from sysid.roll import Array
from sysid.text import count as count_of

_NUMBER = r"[-+−]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_PAIR = re.compile(
    r"(?<![\w.])([^\W\d][\w .°/()\[\]-]{0,40}?)\s*[:=]\s*"
    rf"({_NUMBER})(?![\w.]*[xX:])(?:\s*((?:°|[^\W\d])[^\s,;|:=]*)(?![^\s,;|])(?!\s*[:=]))?"
)
"""Name, number and, behind it, a word that may be its unit and is no name of the next."""
_HEADING = re.compile(r"(\s*)(?:- )?([^\W\d]\w*):\s*$")
"""A line that names what the indented lines below it belong to."""
_BREAK = "---"


@dataclass
class _Samples:
    """Samples that are read line by line; a new one begins where a name comes again."""

    rows: list[dict[str, str]] = field(default_factory=list[dict[str, str]])
    units: dict[str, str] = field(default_factory=dict[str, str])
    now: dict[str, str] = field(default_factory=dict[str, str])

    def add(self, line: dict[str, str]) -> None:
        if not self.now.keys().isdisjoint(line.keys() - {dialect.ARRIVAL}):
            self.end()
        self.now = line | self.now

    def end(self) -> None:
        if self.now:
            self.rows.append(self.now)
        self.now = {}


def open_labelled(path: Path) -> LogFile:
    """Open a text of names and numbers.

    Raises:
        SysidError: It holds no number behind a name.
    """
    with path.open("rb") as file:
        _, encoding = dialect.decode_head(path, file.read(dialect.HEAD_BYTES))
    with path.open(encoding=encoding, errors="replace") as file:
        rows, units, left_out = _samples(file)
    count = Counter(name for row in rows for name in row)
    names = tuple(name for name, times in count.items() if 2 * times > len(rows))
    if not names:
        raise SysidError(f"{path}: no number behind a name.")
    stamps = frozenset({dialect.ARRIVAL} & set(names))
    notes = [f"table: numbers behind their names, {', '.join(names)}"]
    if left_out:
        notes.append(f"table: {count_of(left_out, 'line')} unlike the others left out")

    def read(wanted: Sequence[str]) -> dict[str, Array]:
        texts = {name: [row.get(name, "nan") for row in rows] for name in wanted}
        return {
            name: seconds_of(column) if name in stamps else np.array(column, dtype=float)
            for name, column in texts.items()
        }

    return LogFile(
        path=path, names=names, units={name: unit for name, unit in units.items() if name in names}, dates=stamps,
        notes=tuple(notes), read=read,
    )  # fmt: skip


def _samples(lines: Iterable[str]) -> tuple[list[dict[str, str]], dict[str, str], int]:
    """Return the numbers of each sample by name as text, the units behind them, and how many lines unlike the others were left out."""
    samples = _Samples()
    parsed = list(_parsed(lines, samples.units))
    kinds = Counter(tuple(line) for line in parsed if line)
    usual, left_out = max(kinds.values(), default=0), 0
    for line in parsed:
        if line is None:
            samples.end()
        elif kinds[tuple(line)] > usual // 10:
            samples.add(line)
        else:
            left_out += 1
    samples.end()
    return samples.rows, samples.units, left_out


def _parsed(lines: Iterable[str], units: dict[str, str]) -> Iterator[dict[str, str] | None]:
    """Yield names and numbers of each line that has some, None at the end of a document."""
    above: list[tuple[int, str]] = []
    for line in lines:
        if line.strip() == _BREAK:
            above.clear()
            yield None
        stamp, rest = dialect.split_stamp(line.rstrip())
        indent = len(rest) - len(rest.lstrip())
        while above and indent <= above[-1][0]:
            above.pop()
        if heading := _HEADING.fullmatch(rest):
            above.append((indent, heading[2]))
            continue
        found: dict[str, str] = {}
        sensor, run = "", list[str]()
        for label, number, unit in _PAIR.findall(rest):
            label = label.strip()
            if len(label) > 1:  # 'Rotation X: 1, Y: 2': bare axes belong to the sensor before them
                sensor, run = (label[:-1] if label[-2:-1] in " ._" and label[-1] in "xyzXYZ" else ""), []
            elif sensor and label in "xyzXYZ":
                label = f"{sensor}{label}"
            name = ".".join((*(parent for _, parent in above), label))
            if name in found:
                name = f"{name} ({1 + sum(other.startswith(name) for other in found)})"
            found[name] = number.replace("−", "-")
            run.append(name)
            if unit and parse_unit(unit):  # and the unit at their end is that of all
                units.update((own, unit) for own in (run if sensor else [name]))
        if found:
            yield {**({dialect.ARRIVAL: stamp} if stamp else {}), **found}


def _sniff(path: Path, head: bytes) -> bool:
    """Return whether most lines at the end of its beginning hold numbers behind names, and no others."""
    if b"\0" in head[:2]:
        return False
    with path.open("rb") as file:
        text = file.read(1 << 16).decode("utf-8", errors="replace")
    lines = [
        rest
        for line in text.splitlines()[-200:]
        if (rest := dialect.split_stamp(line)[1]).strip() not in ("", _BREAK)
    ]
    named = [
        line for line in lines if _HEADING.fullmatch(line) or (_PAIR.search(line) and not _left_over(line))
    ]
    return any(map(_PAIR.search, named)) and 2 * len(named) > len(lines)


def _left_over(line: str) -> bool:
    """Return whether a line has cells that are numbers without a name."""
    return any(
        dialect.is_number(cell, ".") and cell.strip()
        for cell in re.split(r"[\s,;|]+", _PAIR.sub(" ", line))
        if cell
    )


FORMAT = Format(name="labelled text", order=8, sniff=_sniff, open=open_labelled)
