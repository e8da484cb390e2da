"""Logs that were compressed as one file: gzip, bzip2, xz."""

import bz2
import gzip
import lzma
import tempfile
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from sysid.logs.formats.registry import Format, named_as, open_log, refuse_larger, undamaged
from sysid.logs.table.file import LogFile
from sysid.roll import Array

UNPACKERS: Mapping[bytes, Callable[[Path], gzip.GzipFile | bz2.BZ2File | lzma.LZMAFile]] = {
    b"\x1f\x8b": gzip.GzipFile,
    b"BZh": bz2.BZ2File,
    b"\xfd7zXZ": lzma.LZMAFile,
}
"""First bytes, and what unpacks."""


def open_compressed(path: Path) -> LogFile:
    """Open the log in a compressed file.

    Raises:
        SysidError: It is damaged, or too large.
    """

    def read(names: Sequence[str]) -> dict[str, Array]:
        with _unpacked(path) as log:  # anew whenever something is read of it
            return log.read(names)

    with _unpacked(path) as log:
        return replace(log, path=path, notes=("table: unpacked", *log.notes), read=read)


@contextmanager
def _unpacked(path: Path) -> Generator[LogFile]:
    """Unpack a log for a while; errors name the user's file."""
    with path.open("rb") as file:
        head = file.read(16)
    unpack = next(opener for magic, opener in UNPACKERS.items() if head.startswith(magic))
    with tempfile.TemporaryDirectory() as folder:
        inside = Path(folder) / (path.stem or "log")
        with undamaged(path, "packed file"), unpack(path) as packed, inside.open("wb") as file:
            size = 0
            while block := packed.read(1 << 20):
                size += file.write(block)
                refuse_larger(path, size)
        with named_as(path, inside):
            yield open_log(inside)


FORMAT = Format(
    name="compressed",
    order=4,
    sniff=lambda path, head: head.startswith(tuple(UNPACKERS)),
    open=open_compressed,
)
