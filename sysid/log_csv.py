"""Text tables in any dialect: the head tells delimiter, decimal sign, header and units; pandas reads the rest."""

import csv
import re
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sysid.errors import HuskyError
from sysid.log_names import parse_unit
from sysid.roll import Array

HEAD_BYTES = 1 << 18
HEAD_LINES = 2000
MAX_LINE = 20_000
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
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?")
_DATE = re.compile(r"(\d{4}-\d\d-\d\d[T ])?\d{1,2}:\d\d(:\d\d([.,]\d+)?)?(Z|[+-]\d\d:?\d\d)?")


@dataclass(frozen=True, slots=True)
class CsvTable:
    """A text table whose columns are read when asked for."""

    path: Path
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    """From a row of units below the header; None where there is none."""
    has_header: bool
    delimiter: str
    decimal: str
    encoding: str
    width: int
    """Cells in a row, an empty one behind a last delimiter included."""
    skip: int
    """Lines before the first row of numbers."""
    comment: str | None
    blanks: bool
    """Whether blanks follow delimiters."""
    dates: frozenset[str]
    """Columns that hold dates or times of day instead of numbers."""
    notes: tuple[str, ...]

    def read(self, names: Sequence[str]) -> dict[str, Array]:
        """Return whole columns, missing values as NaN, dates as seconds.

        Raises:
            HuskyError: A cell is not a number, or the rows have different lengths.
        """
        import pandas as pd

        wanted = [self.names.index(name) for name in names]
        self._require_memory(len(wanted))
        kinds: Any = {index: "str" if self.names[index] in self.dates else "float64" for index in wanted}
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # pandas on columns that are not used
                frame: Any = pd.read_csv(
                    self.path,
                    sep=r"\s+" if self.delimiter == " " else self.delimiter,
                    decimal=self.decimal,
                    header=None,
                    names=list(range(len(self.names))),
                    usecols=None if len(wanted) == self.width else wanted,
                    dtype=kinds,
                    index_col=False,
                    skiprows=self.skip,
                    comment=self.comment,
                    encoding=self.encoding,
                    encoding_errors="replace",
                    skipinitialspace=self.blanks,  # costs half as much again, so only where needed
                    skip_blank_lines=True,
                    na_values=["-"],
                    engine="c",
                )
        except MemoryError as error:
            raise HuskyError(
                f"{self.path}: too large for this computer's memory. Cut it into parts."
            ) from error
        except (ValueError, OverflowError) as error:  # pandas' ParserError is a ValueError
            raise HuskyError(f"{self.path}: {self._explain(error, wanted)}") from error
        columns: dict[str, Array] = {}
        for index in wanted:
            name = self.names[index]
            columns[name] = self._seconds(frame[index]) if name in self.dates else frame[index].to_numpy()
        return columns

    def _require_memory(self, columns: int) -> None:
        """Refuse what would not fit, before the computer starts to swap."""
        size = self.path.stat().st_size
        free = _free_memory()
        with self.path.open("rb") as file:
            file.seek(size // 2)
            probe = file.read(1 << 16)
        needed = size * max(1, probe.count(b"\n")) / len(probe) * 8 * (2 * columns + 4)
        if free is not None and needed > free:
            raise HuskyError(
                f"{self.path}: {size / 1e9:.1f} GB of rows need about {needed / 1e9:.1f} GB of memory, and "
                f"{free / 1e9:.1f} GB are free. Cut it into parts."
            )

    def _seconds(self, texts: Any) -> Array:
        """Turn dates or times of day into seconds since the first."""
        import pandas as pd

        clean = texts.str.replace(",", ".", regex=False)
        dated = "-" in str(clean.iloc[0]) if len(clean) else False
        stamps = (
            pd.to_datetime(clean, errors="coerce", utc=True, format="ISO8601")
            if dated
            else pd.to_timedelta(clean.where(clean.str.count(":") > 1, "00:" + clean), errors="coerce")
        )
        return ((stamps - stamps.iloc[0]) / pd.Timedelta(seconds=1)).to_numpy(dtype=np.float64)

    def _explain(self, error: Exception, wanted: Sequence[int]) -> str:
        """Return why pandas could not read the file, with the line and the cell where it is one."""
        found = re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", str(error))
        if found:
            return (
                f"line {found[2]} has {found[3]} fields where {found[1]} were expected; "
                "two writers, or a text with the delimiter in it. Mend or delete the line."
            )
        try:
            with self.path.open(encoding=self.encoding, errors="replace", newline="") as file:
                for number, line in enumerate(file, 1):
                    if (
                        number <= self.skip
                        or not line.strip()
                        or line.lstrip().startswith(self.comment or "\0")
                    ):
                        continue
                    cells = split_line(line.rstrip("\r\n"), self.delimiter)
                    for index in wanted:
                        cell = cells[index] if index < len(cells) else ""
                        if self.names[index] not in self.dates and not _is_number(cell, self.decimal):
                            return (
                                f"line {number}, column '{self.names[index]}': '{cell[:40]}' is not a number. "
                                "Mend the line, or name another column with --column."
                            )
        except OSError:
            pass
        return f"cannot be read as a table ({str(error).splitlines()[0][:120]})."


def open_csv(path: Path) -> CsvTable:
    """Find a text table's dialect from its first 256 KiB.

    Raises:
        HuskyError: The file is empty, binary, or holds no rows of numbers.
    """
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
        _refuse_binary_middle(path, file)
    text, encoding = _decode(path, head)
    lines = text.splitlines()
    if len(head) == HEAD_BYTES and len(lines) > 1:
        lines.pop()  # cut in the middle
    del lines[HEAD_LINES:]
    if not text.strip("\ufeff \r\n\t\0"):
        raise HuskyError(f"{path}: the file is empty. Was the recording saved?")
    if max(map(len, lines)) > MAX_LINE:
        raise HuskyError(
            f"{path}: a line of {max(map(len, lines))} characters: no table with a row for each sample. "
            "If the rows are columns in it, transpose it."
        )
    comment = _comment_sign(lines)
    rows = [
        (number, line)
        for number, line in enumerate(lines)
        if line.strip() and not (comment and line.lstrip().startswith(comment))
    ]
    delimiter, decimal, cells = _dialect(path, [line for _, line in rows])
    width = cells
    first = _first_row(rows, delimiter, decimal, width)
    header, units = _header(lines, rows, first, delimiter, decimal, width, comment)
    sample = [split_line(line, delimiter) for _, line in rows[first : first + 50]]
    while (
        width > 1
        and not any(len(row) >= width and row[width - 1] for row in sample)
        and not (header and header[width - 1])
    ):
        width -= 1  # a delimiter at the end of each line
    names = _unique(header[:width] if header else [f"column {n}" for n in range(1, width + 1)])
    dates = frozenset(
        name for n, name in enumerate(names) if all(_DATE.fullmatch(row[n]) for row in sample if n < len(row))
    )
    skipped = rows[first][0]
    notes = [_dialect_note(delimiter, decimal, bool(header))]
    if skipped > (1 if header else 0) + bool(units):
        notes.append(f"{skipped} lines before the first row of numbers")
    return CsvTable(
        path=path,
        names=names,
        units=tuple(units[:width]) if units else (None,) * width,
        has_header=bool(header),
        delimiter=delimiter,
        decimal=decimal,
        encoding=encoding,
        width=cells,
        skip=skipped,
        comment=comment[0] if comment else None,
        blanks=delimiter != " " and any(delimiter + " " in line for _, line in rows),
        dates=dates,
        notes=tuple(notes),
    )


def split_line(line: str, delimiter: str) -> list[str]:
    """Return the cells of one line, without quotes and blanks around them."""
    if delimiter == " ":
        return line.split()
    try:
        cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    except (csv.Error, StopIteration):
        cells = line.split(delimiter)
    return [cell.strip() for cell in cells]


def _decode(path: Path, head: bytes) -> tuple[str, str]:
    if not head.strip():
        raise HuskyError(f"{path}: the file is empty. Was the recording saved?")
    encoding = next((name for bom, name in _BOMS if head.startswith(bom)), None)
    if encoding is None:
        control = sum(head.count(byte) for byte in (*range(9), *range(14, 32)))
        if control > len(head) // 1000:
            raise HuskyError(
                f"{path}: this is a binary file, not a text table. Readable are CSV, TSV, Parquet, MCAP, "
                "phone exports (zip) and video, each with its usual file name ending."
            )
        encoding = "utf-8"
        try:
            head[: head.rfind(b"\n") + 1].decode("utf-8")
        except UnicodeDecodeError:
            encoding = "cp1252"
    text = head.decode(encoding, errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    return text, encoding


def _refuse_binary_middle(path: Path, file: BinaryIO) -> None:
    """Look into a large file at several places: a text that goes over into zero bytes was not closed well."""
    size = file.seek(0, 2)
    file.seek(0)
    utf16 = file.read(2) in (b"\xff\xfe", b"\xfe\xff")
    for place in range(HEAD_BYTES, size, max(HEAD_BYTES, size // 64)):
        file.seek(place)
        if not utf16 and b"\0\0" in file.read(4096):
            raise HuskyError(
                f"{path}: zero bytes from about byte {place} on: the recording was not closed well, or this is no "
                "text table. Cut the file off before them."
            )


def _free_memory() -> float | None:
    """Return the memory that is free for use [bytes], None where the system does not say."""
    try:
        text = Path("/proc/meminfo").read_text(encoding="ascii")
    except OSError:
        return None
    found = re.search(r"MemAvailable:\s*(\d+) kB", text)
    return float(found[1]) * 1024 if found else None


def _comment_sign(lines: Sequence[str]) -> str | None:
    starts = Counter(sign for line in lines for sign in COMMENTS if line.lstrip().startswith(sign))
    return starts.most_common(1)[0][0] if starts else None


def _dialect(path: Path, lines: Sequence[str]) -> tuple[str, str, int]:
    """Return delimiter, decimal sign and number of columns: the ones that make most cells numbers."""
    sample = [*lines[-200:]]
    best, best_score = None, (0.0, 0)
    for delimiter, decimal in DIALECTS:
        rows = [split_line(line, delimiter) for line in sample]
        rows = [row for row in rows if any(_is_number(cell, decimal) and cell for cell in row)]
        if not rows:
            continue
        width = Counter(len(row) for row in rows).most_common(1)[0][0]
        regular = [row for row in rows if len(row) == width]
        cells = [cell for row in regular for cell in row]
        good = sum(_is_number(cell, decimal) or bool(_DATE.fullmatch(cell)) for cell in cells) / len(cells)
        score = (round(good * len(regular) / len(sample), 2), width)
        if score > best_score:
            best, best_score = (delimiter, decimal, width), score
    if best is None or best_score[0] < 0.25:
        raise HuskyError(
            f"{path}: no rows of numbers in its first {len(lines)} lines. Expected a table with a column of "
            "time and one of roll, angle or rotation rate."
        )
    return best


def _first_row(rows: Sequence[tuple[int, str]], delimiter: str, decimal: str, width: int) -> int:
    for index, (_, line) in enumerate(rows):
        cells = split_line(line, delimiter)
        numbers = sum(bool(_NUMBER.fullmatch(_plain(cell, decimal))) for cell in cells)
        if len(cells) == width and numbers and numbers * 2 >= sum(1 for cell in cells if cell):
            return index
    return 0


def _header(
    lines: Sequence[str],
    rows: Sequence[tuple[int, str]],
    first: int,
    delimiter: str,
    decimal: str,
    width: int,
    comment: str | None,
) -> tuple[list[str], list[str | None]]:
    """Return the names above the first row of numbers, and the units below them where there is such a row."""
    above = [split_line(line, delimiter) for _, line in rows[:first]]
    if not above and comment:  # numpy.savetxt and gnuplot write the header as a comment
        commented = [line.strip().lstrip("#%/ ") for line in lines[: rows[first][0]]]
        above = [
            cells for cells in (split_line(line, delimiter) for line in commented) if len(cells) == width
        ]
    above = [row for row in above if width - 1 <= len(row) <= width + 1 and sum(map(bool, row)) * 2 > width]
    if not above:
        return [], []
    last = [*above[-1], ""][:width] if len(above[-1]) < width else above[-1][:width]
    units = [parse_unit(cell) for cell in last]
    filled = sum(map(bool, last))
    if len(above) > 1 and sum(unit is not None for unit in units) * 2 >= filled and len(set(last)) <= filled:
        names = [*above[-2], ""][:width] if len(above[-2]) < width else above[-2][:width]
        if sum(parse_unit(cell) is not None for cell in names) < sum(unit is not None for unit in units):
            return names, list(units)
    return last, []


def _dialect_note(delimiter: str, decimal: str, header: bool) -> str:
    shown = {",": "commas", "\t": "tabs", ";": "semicolons", "|": "bars", " ": "blanks"}[delimiter]
    return (
        f"table separated by {shown}"
        + (", decimal comma" if decimal == "," else "")
        + ("" if header else ", no header: columns are numbered")
    )


def _unique(names: Sequence[str]) -> tuple[str, ...]:
    seen: Counter[str] = Counter()
    unique: list[str] = []
    for number, name in enumerate(names, 1):
        name = name.strip().strip("\ufeff\"'") or f"column {number}"
        seen[name] += 1
        unique.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return tuple(unique)


def _plain(cell: str, decimal: str) -> str:
    return cell.replace(",", ".") if decimal == "," else cell


def _is_number(cell: str, decimal: str) -> bool:
    return cell.lower() in _MISSING or bool(_NUMBER.fullmatch(_plain(cell, decimal)))
