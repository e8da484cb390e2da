"""Whether an MP4 or QuickTime file plays parts of its film faster or slower than others: FFmpeg passes that over."""

import re
import struct
from collections.abc import Iterator
from pathlib import Path

HEAD, ENTRY = 16, {0: ">IiI", 1: ">QqI"}
"""Bytes of an edit list (ISO 14496-12) before its entries: size, name, version and their number; and an entry of each version."""
MAX_INDEX = 1 << 28
"""Largest index that is looked through [bytes]; an hour at 240 frames/s has 20 MB."""
NORMAL_RATE = 0x10000
"""The rate of an edit that plays its part as it was taken."""


def plays_ramps(path: Path) -> bool:
    """Return whether an edit list plays parts at another speed; False where the file has no index that can be read."""
    try:
        return any(rate != NORMAL_RATE for rate in _rates(_index(path)))
    except (OSError, struct.error):
        return False


def _index(path: Path) -> bytes:
    """Return the box `moov` with all that is in it; nothing where there is none."""
    with path.open("rb") as file:
        while len(head := file.read(8)) == 8:
            size, kind = struct.unpack(">I4s", head)
            begin = 8
            if size == 1:
                size, begin = struct.unpack(">Q", file.read(8))[0], 16
            if kind == b"moov":
                return head + file.read(min(size, MAX_INDEX) - 8)
            if size < begin or not kind.isascii():
                break
            file.seek(size - begin, 1)
    return b""


def _rates(index: bytes) -> Iterator[int]:
    """Yield the rate of each edit that shows something."""
    for found in re.finditer(b"elst", index):
        at = found.start() - 4
        size, _, version, count = struct.unpack_from(">I4sB3xI", index, at)
        entry = struct.Struct(ENTRY.get(version, ">"))
        if size == HEAD + count * entry.size:  # else these four letters are part of something else
            for _, start, rate in entry.iter_unpack(index[at + HEAD : at + size]):
                if start >= 0:
                    yield rate
