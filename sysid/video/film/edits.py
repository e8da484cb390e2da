"""Whether an MP4 or QuickTime file plays parts of its film faster or slower than others: FFmpeg passes that over."""

import struct
from collections.abc import Iterator
from pathlib import Path

PARENTS = frozenset({b"moov", b"trak", b"edts"})
"""Boxes of the index (ISO 14496-12) that lead to an edit list."""
MAX_INDEX = 1 << 28
"""Largest index that is looked through [bytes]; an hour at 240 frames/s has 20 MB."""
NORMAL_RATE = 0x10000
"""The rate of an edit that plays its part as it was taken."""


def plays_ramps(path: Path) -> bool:
    """Return whether an edit list plays parts at another speed; False where the file has no index that can be read."""
    try:
        return any(rate != NORMAL_RATE for content in _edit_lists(_index(path)) for rate in _rates(content))
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


def _edit_lists(data: bytes) -> Iterator[bytes]:
    """Yield the content of each edit list."""
    while len(data) >= 8:
        size, kind = struct.unpack_from(">I4s", data)
        if size < 8:
            return
        if kind in PARENTS:
            yield from _edit_lists(data[8:size])
        elif kind == b"elst":
            yield data[8:size]
        data = data[size:]


def _rates(content: bytes) -> Iterator[int]:
    """Yield the rate of each edit that shows something."""
    long, count = content[0], struct.unpack_from(">I", content, 4)[0]
    for _, start, rate in struct.iter_unpack(
        ">QqI" if long else ">IiI", content[8 : 8 + count * (20 if long else 12)]
    ):
        if start >= 0:
            yield rate
