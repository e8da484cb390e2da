"""What an MP4 or QuickTime file says of its film beside the pictures: which part is shown, and how fast it was filmed.

Both are boxes of the index (ISO 14496-12, and Apple's metadata keys, which Android uses as well); OpenCV passes
neither on. A file of another kind, or one whose index is damaged, says nothing.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

CONTAINERS = frozenset({b"moov", b"trak", b"mdia", b"edts", b"meta", b"udta", b"ilst"})
MAX_INDEX = 1 << 28
"""Largest index that is looked through [bytes]; an hour at 240 frames/s has 20 MB."""
CAPTURE_RATE = b"com.android.capture.fps"
READOUT = b"com.apple.quicktime.camera.framereadouttimeinmicroseconds"
MAX_RATE, MAX_READOUT = 1e5, 0.1
"""What no camera reaches: frames a second [Hz], and time for reading a frame [s]."""
NORMAL_RATE = 0x10000
"""The rate of an edit that plays its part as it was taken."""


@dataclass(frozen=True, slots=True)
class Container:
    """What is said of a film."""

    shown: float = 1.0
    """Share of the frames that are shown: phones trim by an edit list, and leave the others in the file."""
    capture_rate: float | None = None
    """Frames a second when it was filmed [Hz], where the phone notes it."""
    readout: float | None = None
    """Time from the sensor's first to its last row [s], where the phone notes it."""
    ramped: bool = False
    """Whether an edit list plays parts of it faster or slower than others."""


def read_container(path: Path) -> Container:
    """Return what the index of a film says."""
    try:
        found = list(_boxes(_index(path)))
        shown, ramped = _shown(found)
        noted = _noted(found)
        rate, readout = noted.get(CAPTURE_RATE, 0.0), noted.get(READOUT, 0.0)
        return Container(
            shown,
            rate if 0 < rate < MAX_RATE else None,
            1e-6 * readout if 0 < readout < 1e6 * MAX_READOUT else None,
            ramped,
        )
    except (OSError, struct.error, ValueError, IndexError):
        return Container()


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


def _boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield kind and content of all boxes that hold no others, and b"trak" where a track begins."""
    for kind, content in _plain(data):
        if kind == b"trak":
            yield kind, b""
        if kind == b"ilst":
            yield from ((b"item" + item, value) for item, value in _plain(content))
        elif kind in CONTAINERS:
            # QuickTime's `meta` holds boxes at once, ISO's has a version before them.
            yield from _boxes(content[4:] if kind == b"meta" and content[4:8] != b"hdlr" else content)
        else:
            yield kind, content


def _plain(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield kind and content of boxes in a row, up to one that is damaged."""
    while len(data) >= 8:
        size, kind = struct.unpack_from(">I4s", data)
        if not 8 <= size <= len(data):
            return
        yield kind, data[8:size]
        data = data[size:]


def _shown(found: list[tuple[bytes, bytes]]) -> tuple[float, bool]:
    """Length of the video track's edits over that of its media, and whether some play at another speed."""
    scale = 0
    track: dict[bytes, bytes] = {}
    for kind, content in [*found, (b"trak", b"")]:
        if kind == b"mvhd":
            scale = struct.unpack_from(">I", content, 20 if content[0] else 12)[0]
        if kind == b"trak":
            if track.get(b"hdlr", b"")[8:12] == b"vide" and b"elst" in track and b"mdhd" in track:
                seconds, ramped = _edited(track[b"elst"], scale)
                return min(1.0, seconds / _media(track[b"mdhd"])), ramped
            track = {}
        elif kind in (b"hdlr", b"elst", b"mdhd"):
            track.setdefault(kind, content)
    return 1.0, False


def _edited(content: bytes, scale: int) -> tuple[float, bool]:
    """Seconds of media that an edit list shows, and whether at another speed."""
    long, count = content[0], struct.unpack_from(">I", content, 4)[0]
    entries = struct.iter_unpack(">QqI" if long else ">IiI", content[8 : 8 + count * (20 if long else 12)])
    shown = [(duration, rate) for duration, start, rate in entries if start >= 0]
    return sum(duration for duration, _ in shown) / scale, any(rate != NORMAL_RATE for _, rate in shown)


def _media(content: bytes) -> float:
    """Seconds that a track's media last."""
    scale, duration = struct.unpack_from(">IQ" if content[0] else ">II", content, 20 if content[0] else 12)
    return duration / scale


def _noted(found: list[tuple[bytes, bytes]]) -> dict[bytes, float]:
    """Numbers that the phone notes, by name."""
    keys = next((content for kind, content in found if kind == b"keys"), b"")
    names = [name for _, name in _plain(keys[8:])]  # their kind is where they are defined: b"mdta"
    noted: dict[bytes, float] = {}
    for kind, content in found:
        if kind[:4] == b"item" and len(kind) == 8 and content[4:8] == b"data":
            number = struct.unpack(">I", kind[4:])[0]
            if 0 < number <= len(names) and names[number - 1] in (CAPTURE_RATE, READOUT):
                noted[names[number - 1]] = _number(content[8:12], content[16:])
    return noted


def _number(kind: bytes, value: bytes) -> float:
    """Apple's well-known types: text, whole numbers with and without sign, and two lengths of decimal ones."""
    if kind in (b"\0\0\0\x17", b"\0\0\0\x18"):
        return float(struct.unpack(">f" if kind[3] == 0x17 else ">d", value)[0])
    if kind in (b"\0\0\0\x15", b"\0\0\0\x16"):
        return float(int.from_bytes(value, "big", signed=kind[3] == 0x15))
    return float(value)
