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
    rate: float | None = None
    """True frame rate [Hz], instead of the container's stamps (slow-motion films lie)."""
    overlay: Path | None = None
    """Film to write in which what was followed is drawn; a contact sheet (.png) lands beside it."""
    on_frame: Callable[[float, npt.NDArray[np.uint8]], None] | None = None
    """Called with the time on the roll's clock [s] and the picture of each frame of the overlay."""
