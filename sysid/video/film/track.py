"""One pass through a clip: what is followed on the board, and how the camera moved."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from sysid.errors import HuskyError
from sysid.roll import Array
from sysid.video.film.background import Background
from sysid.video.film.camera import Lens
from sysid.video.film.frames import Clip, Frame
from sysid.video.film.shake import Shake

Box = tuple[int, int, int, int]


class Tracker(Protocol):
    """Follows points on the board from frame to frame."""

    @property
    def points(self) -> int:
        """Number of points N."""
        ...

    @property
    def box(self) -> Box:
        """Left, top, right and bottom [px] of where the board may come, as far as is known at first."""
        ...

    def update(self, frame: Frame) -> Array | None:
        """Return the points in this frame [px], shape (N, 2), NaN where one is not seen; None if none is."""
        ...


@dataclass(frozen=True, slots=True)
class Track:
    """The points of a whole clip."""

    time: Array
    """Stamps [s], shape (n,), strictly increasing, not shifted."""
    points: npt.NDArray[np.float32]
    """Points in the pictures [px], shape (n, N, 2); NaN where not seen."""
    shake: Shake
    index: npt.NDArray[np.intp]
    """Number of each frame in the clip, shape (n,)."""
    repeated: int
    """Frames left out because their stamp was not later than the one before."""

    @property
    def lost(self) -> int:
        """Frames in which nothing was seen."""
        return int(np.isnan(self.points).all(axis=(1, 2)).sum())


def follow(clip: Clip, tracker: Tracker, lens: Lens, rate: float | None = None) -> Track:
    """Run a tracker through a clip, frame by frame; nothing but the points is kept.

    Raises:
        HuskyError: The clip is damaged or cut, or has fewer than 8 frames.
    """
    background = Background(tracker.box, lens)
    stamps: list[float] = []
    indices: list[int] = []
    rows: list[npt.NDArray[np.float32]] = []
    repeated = 0
    nothing = np.full((tracker.points, 2), np.nan, np.float32)
    for frame in clip.ahead():
        if rate is not None:
            frame = Frame(frame.index, frame.index / rate, frame.picture)
        if stamps and frame.time <= stamps[-1]:
            repeated += 1
            continue
        try:
            background.update(frame)
        except HuskyError as error:
            raise HuskyError(f"{clip.path}: {error}") from None
        found = tracker.update(frame)
        stamps.append(frame.time)
        indices.append(frame.index)
        rows.append(nothing if found is None else found.astype(np.float32))
    if len(stamps) < 8:
        raise HuskyError(
            f"{clip.path}: {len(stamps)} frames are too few for a decay. Film at least a second."
        )
    return Track(np.array(stamps), np.array(rows), background.result(), np.array(indices, np.intp), repeated)
