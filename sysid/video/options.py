"""Options of a film that overrule inference."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

VIDEO_SUFFIXES = frozenset(
    {".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mpg", ".mpeg", ".3gp", ".3g2", ".mts", ".m2ts"}
)
"""Endings of names of films."""
_OPENING = re.compile(
    rb"(?s).{8}AVI |.{4}(ftyp|moov|wide)|\x1aE\xdf\xa3|GIF8|FLV\x01|\x00\x00\x01\xba|\x30\x26\xb2\x75\x8e\x66\xcf\x11|OggS"
)
"""First bytes of films: AVI, MP4 and QuickTime, Matroska, GIF, Flash, MPEG, Windows Media, Ogg."""


def is_film(path: Path) -> bool:
    """Return whether a file is a film: by its name, else by how it begins."""
    if path.suffix.lower() in VIDEO_SUFFIXES:
        return True
    if not path.is_file():  # a pipe would wait for a writer
        return False
    try:
        with path.open("rb") as file:
            start = file.read(377)
    except OSError:
        return False
    # An MPEG transport stream begins each 188 bytes with the same one.
    stream = len(start) == 377 and start[0] == start[188] == start[376] == 0x47
    return stream or _OPENING.match(start) is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoOptions:
    """How roll is read from a film."""

    method: str = "auto"
    """The tracker that is used: one of `sysid.video.trackers.names()`, or auto."""
    roi: tuple[int, int, int, int] | None = None
    """Left, top, width and height [px] of where the board moves."""
    calibration: Path | None = None
    """Camera calibration: a file with camera matrix and distortion, or a film of a chessboard."""
    readout: float | None = None
    """Time from the sensor's first to its last row [s]; 0 for a global shutter."""
    camera_angle: tuple[float, float] | None = None
    """Direction of the deck's axis in the picture, to the right and down from the line of sight [rad]."""
    pivot: tuple[float, float] | None = None
    """Point that a single thing turns about [px]; fitted if left out."""
    front: bool = False
    """The film is taken from the front of the board, where roll turns the other way."""
    no_shake: bool = False
    """The camera is known to stand still: nothing is taken out by the background."""
    rate: float | None = None
    """True frame rate [Hz], instead of the container's stamps (slow-motion films lie)."""
    overlay: Path | None = None
    """Film to write with the points drawn in; a contact sheet (.png) lands beside it."""
    progress: Callable[[str, float], None] | None = None
    """Called with the name and the share of the work done, frame by frame."""
