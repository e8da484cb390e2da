"""Edits two tables of an MP4 or MOV file in place: frame stamps, and the rotation flag of a phone held upright."""

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from sysid.roll import Array

TIMESCALE = 10_000
"""Ticks a second of the stamps written here."""
ROTATIONS = {0: (1, 0, 0, 1), 90: (0, 1, -1, 0), 180: (-1, 0, 0, -1), 270: (0, -1, 1, 0)}


def set_stamps(path: Path, stamps: Array) -> None:
    """Give the frames of a clip these stamps [s], so that its rate varies as a phone's does.

    Replaces the time-to-sample table (ISO/IEC 14496-12, 8.6.1.2). Works for files whose index
    follows the pictures, as OpenCV writes them, and which have no reordered frames.
    """
    data = path.read_bytes()
    ticks = np.diff(np.round(np.append(stamps, 2 * stamps[-1] - stamps[-2]) * TIMESCALE)).astype(int)
    table = b"".join(struct.pack(">II", 1, tick) for tick in ticks)
    stts = struct.pack(">II", 0, len(ticks)) + table
    moov = _replace(data, ("moov", "trak", "mdia", "minf", "stbl", "stts"), lambda _: stts)
    total = int(ticks.sum())

    def media_header(body: bytes) -> bytes:
        return body[:12] + struct.pack(">II", TIMESCALE, total) + body[20:]

    moov = _replace(moov, ("moov", "trak", "mdia", "mdhd"), media_header)
    moov = _replace(moov, ("moov", "trak", "edts"), lambda _: None)
    path.write_bytes(moov)


def set_rotation(path: Path, degrees: int) -> None:
    """Mark a clip as to be shown turned clockwise by 0, 90, 180 or 270 degrees (track header matrix)."""
    a, b, c, d = (value << 16 for value in ROTATIONS[degrees])
    matrix = struct.pack(">iiiiiiiii", a, b, 0, c, d, 0, 0, 0, 1 << 30)
    data = _replace(path.read_bytes(), ("moov", "trak", "tkhd"), lambda body: body[:40] + matrix + body[76:])
    path.write_bytes(data)


def _replace(data: bytes, path: tuple[str, ...], change: Callable[[bytes], bytes | None]) -> bytes:
    """Return the boxes in `data` with the body of the box at `path` changed, or the box removed."""
    result = bytearray()
    position = 0
    while position + 8 <= len(data):
        size, kind = struct.unpack(">I4s", data[position : position + 8])
        header = 8
        if size == 1:
            size = struct.unpack(">Q", data[position + 8 : position + 16])[0]
            header = 16
        box = data[position : position + size]
        if path and kind == path[0].encode() and (len(path) > 1 or header == 8):
            body = _replace(box[header:], path[1:], change) if len(path) > 1 else change(box[header:])
            box = b"" if body is None else struct.pack(">I4s", len(body) + 8, kind) + body
        result += box
        position += max(size, 8)
    return bytes(result)
