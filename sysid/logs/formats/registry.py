"""Registry of log formats, discovered by their files in this folder.

Such a file ends in `FORMAT = Format(...)`. A log is opened by the first format, in their order, that knows it
by its first bytes, whatever its name ends in.
"""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from sysid.errors import SysidError
from sysid.logs import formats as package
from sysid.logs.table.file import LogFile
from sysid.logs.table.found import found_in

HEAD = 16
"""First bytes of a file that formats are shown."""
MAX_UNPACKED = 1 << 30
"""An hour of seven sensors at 1 kHz is 0.3 GiB as text [bytes]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """One kind of file."""

    name: str
    order: int
    """Formats are asked in this order; the last one takes all other files."""
    sniff: Callable[[Path, bytes], bool]
    """Whether a file is of this format, by its path and its first 16 bytes (empty for a folder)."""
    open: Callable[[Path], LogFile]
    """The file as named columns of numbers."""


def refuse_larger(path: Path, size: float) -> None:
    """Refuse a file that unpacks to too many bytes.

    Raises:
        SysidError: It does.
    """
    if size > MAX_UNPACKED:
        raise SysidError(
            f"{path}: is more than 1 GiB, or unpacks to more than 1 GiB. Cut the log into parts."
        )


@contextmanager
def named_as(path: Path, inside: Path) -> Generator[None]:
    """Name the user's file in errors of an unpacked one."""
    try:
        yield
    except SysidError as error:
        raise SysidError(str(error).replace(str(inside), str(path))) from error


@contextmanager
def undamaged(path: Path, kind: str) -> Generator[None]:
    """Say that a file is damaged where its reader fails, which lets through whatever that makes some library raise.

    Raises:
        SysidError: The reader failed.
    """
    try:
        yield
    except SysidError:
        raise
    except Exception as error:
        lines = str(error).splitlines() or [""]
        raise SysidError(
            f"{path}: damaged {kind} ({type(error).__name__}: {lines[0][:100]}). Copy or export it again."
        ) from error


@cache
def formats() -> tuple[Format, ...]:
    """Return every format in their order."""
    return tuple(found_in(package, Format))


def open_log(path: Path) -> LogFile:
    """Open a log, a file or a folder.

    Raises:
        SysidError: It cannot be opened, or is of no known format.
    """
    head = b""
    try:
        if not path.is_dir():
            with path.open("rb") as file:
                head = file.read(HEAD)
    except OSError as error:
        raise SysidError(f"{path}: cannot be opened ({error.strerror}).") from error
    return next(format for format in formats() if format.sniff(path, head)).open(path)
