"""The points that were followed through a whole clip, and how the camera moved meanwhile."""

from dataclasses import dataclass

import numpy as np

from sysid.roll import Array
from sysid.video.film.shake import Shake
from sysid.video.types import Points, Rows


@dataclass(frozen=True, slots=True)
class Track:
    """The points of a whole clip."""

    time: Array
    """Stamps since the film's first frame [s], shape (n,), strictly increasing, not shifted."""
    points: Points
    """Points in the pictures [px], shape (n, N, 2); NaN where not seen."""
    shake: Shake
    index: Rows
    """Number of each frame in the clip, shape (n,)."""
    repeated: int
    """Frames left out because their stamp was not later than the one before."""

    @property
    def lost(self) -> int:
        """Number of frames without any point."""
        return int(np.isnan(self.points).all(axis=(1, 2)).sum())
