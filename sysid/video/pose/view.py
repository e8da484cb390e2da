"""The points of a film as a straight lens, a still camera and a global shutter would show them.

Frames are worked on a few at a time: what is kept of a long film is the points in its pictures alone.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from sysid.roll import Array
from sysid.video.film.track import Track
from sysid.video.types import Rows

CHUNK_FRAMES = 256
"""Frames that are worked on at once."""


@dataclass(frozen=True, slots=True)
class View:
    """Points of a body in every frame, freed of lens, shake and shutter when asked for."""

    track: Track
    straighten: Callable[[Array], Array]
    """The lens: points as filmed to points as a pinhole shows them, shape (..., 2)."""
    row_share: Callable[[Array], Array]
    """When, from 0 to 1 of the read-out, the sensor reads a point as filmed."""
    share: Array = field(init=False)
    """Mean of that over each frame's points, shape (n,)."""

    def __post_init__(self) -> None:
        """Find when each frame's points are read."""
        share = np.full(len(self), np.nan)
        for rows in self.chunks():
            when = self.row_share(self._filmed(rows))
            seen = np.isfinite(when)
            count = seen.sum(axis=1)
            mean = np.where(seen, when, 0).sum(axis=1) / np.maximum(count, 1)
            share[rows] = np.where(count > 0, mean, np.nan)
        known = np.isfinite(share)
        if known.any():
            share = np.interp(self.track.time, self.track.time[known], share[known])
        object.__setattr__(self, "share", share)

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.track.time)

    def chunks(self) -> Iterator[Rows]:
        """Yield the frames' numbers [1], a few hundred at a time, shape (m,)."""
        for begin in range(0, len(self), CHUNK_FRAMES):
            yield np.arange(begin, min(begin + CHUNK_FRAMES, len(self)))

    def time(self, readout: float) -> Array:
        """Return when the sensor reads the middle of the points [s], shape (n,)."""
        return self.track.time + readout * self.share

    def points(self, rows: Rows) -> Array:
        """Return the points of some frames [px], shape (m, N, 2), as filmed by a global shutter."""
        points = self.straighten(self._filmed(rows))
        return self.track.shake.undo(points, rows) if self.track.shake.significant else points

    def _filmed(self, rows: Rows) -> Array:
        return self.track.points[rows].astype(np.float64)

    def shear(self, rows: Rows) -> Array:
        """Return what to add to `points` for each second of read-out [px/s], shape (m, N, 2).

        That moves every point along its path to the moment at which the middle of the points is read.
        """
        here = np.clip(rows[:, None] + np.arange(-1, 2), 0, len(self) - 1)
        every, where = np.unique(here, return_inverse=True)
        three = self.points(every)[where.reshape(here.shape)]
        late = self.row_share(self._filmed(rows)) - self.share[rows, None]
        return -velocity(three, self.track.time[here]) * np.nan_to_num(late)[..., None]

    def all_points(self, readout: float) -> Array:
        """Return the points of all frames [px], shape (n, N, 2), at the times of `time(readout)`."""
        return np.concatenate([self.points(rows) + readout * self.shear(rows) for rows in self.chunks()])


def velocity(points: Array, time: Array) -> Array:
    """Velocity in the middle one of three frames [px/s], shape (m, N, 2).

    The slope of the parabola through all three, so that an uneven rate does no harm; zero where a
    neighbour does not show the point (and no motion is known).

    Args:
        points: Points in three neighbouring frames [px], shape (m, 3, N, 2).
        time: Their times [s], shape (m, 3).
    """
    before, after = np.diff(time, axis=1).T[:, :, None, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        ahead = (points[:, 2] - points[:, 1]) / after
        behind = (points[:, 1] - points[:, 0]) / before
        slope = (ahead * before + behind * after) / (before + after)
    return np.where(np.isfinite(slope), slope, 0.0)
