"""Whether an MP4 or QuickTime file plays parts of its film faster or slower than others: FFmpeg passes that over."""

import mmap
import re
import struct
from pathlib import Path

HEAD, ENTRY = 16, {0: ">IiHH", 1: ">QqHH"}
"""An edit list (ISO 14496-12): bytes before its entries, which are size, name, version and number of entries. An entry of each version:
length, start, and speed with its fraction."""


def plays_ramps(path: Path) -> bool:
    """Return whether an edit list of a file, that is not empty, plays parts at another speed."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        for found in re.finditer(b"elst", data):
            begin = found.start() + 12
            if len(head := data[begin - HEAD : begin]) < HEAD:
                break
            size, version, count = struct.unpack(">I4xB3xI", head)
            entry, end = struct.Struct(ENTRY.get(version, ">")), begin - HEAD + size
            if size != HEAD + count * entry.size or end > len(data):
                continue  # these four letters are part of something else
            if any(start >= 0 and speed != [1, 0] for _, start, *speed in entry.iter_unpack(data[begin:end])):
                return True
    return False
