"""What the user says about a film instead of leaving it to inference."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

VIDEO_SUFFIXES = frozenset(
    {".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mpg", ".mpeg", ".3gp", ".3g2", ".mts", ".m2ts"}
)
"""What counts as a film by its name."""
_OPENINGS = (
    (8, b"AVI "), (4, b"ftyp"), (4, b"moov"), (4, b"wide"), (0, b"\x1aE\xdf\xa3"), (0, b"GIF8"), (0, b"FLV\x01"),
    (0, b"\x00\x00\x01\xba"), (0, b"\x30\x26\xb2\x75\x8e\x66\xcf\x11"), (0, b"OggS"),
)  # fmt: skip
"""Where and how films begin: AVI, MP4 and QuickTime, Matroska, GIF, Flash, MPEG, Windows Media, Ogg."""


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
    return stream or any(start[at : at + len(words)] == words for at, words in _OPENINGS)


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
    """Where the deck's axis points in the picture, to the right and down from the line of sight [rad]."""
    pivot: tuple[float, float] | None = None
    """Point that a single thing turns about [px]; fitted if left out."""
    front: bool = False
    """The film is taken from the front of the board, where roll turns the other way."""
    no_shake: bool = False
    """The camera is known to stand still: nothing is taken out by the background."""
    rate: float | None = None
    """True frame rate [Hz], instead of the container's stamps (slow-motion films lie)."""
    overlay: Path | None = None
    """Film to write in which what was followed is drawn; a contact sheet (.png) lands beside it."""
    on_frame: Callable[[float, npt.NDArray[np.uint8]], None] | None = None
    """Called with the time on the roll's clock [s] and the picture of each frame of the overlay."""
    progress: Callable[[str, float], None] | None = None
    """Called with what is being done and which share of it is, frame by frame."""
