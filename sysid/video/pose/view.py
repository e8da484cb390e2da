"""The points of a film as a straight lens, a still camera and a global shutter would show them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid.roll import Array
from sysid.video.film.track import Track


@dataclass(frozen=True, slots=True)
class View:
    """Points of a body in every frame, freed of lens and shake, and of the shutter when asked for."""

    track: Track
    points: Array
    """Points [px], shape (n, N, 2)."""
    share: Array
    """Mean share of the read-out at which each frame's points are read, shape (n,)."""
    shear: Array
    """Shift of `points` for a second of read-out [px/s], shape (n, N, 2). It moves each point to the time at which their middle is
    read."""

    @classmethod
    def of(
        cls, track: Track, straighten: Callable[[Array], Array], row_share: Callable[[Array], Array]
    ) -> "View":
        """Free points of lens and shake, and find when they are read.

        The lens straightens points as filmed [px], shape (n, N, 2). The sensor reads one at a `row_share` of the read-out.
        """
        filmed = track.points.astype(np.float64)
        points = straighten(filmed)
        if track.shake.moves:
            points = track.shake.undo(points)
        when = row_share(filmed)
        seen = np.isfinite(when)
        count = seen.sum(axis=1)
        share = np.where(seen, when, 0).sum(axis=1) / np.maximum(count, 1)
        share = np.interp(track.time, track.time[count > 0], share[count > 0]) if seen.any() else share
        late = np.nan_to_num(when - share[:, None])[..., None]
        velocity = np.nan_to_num(np.gradient(points, track.time, axis=0))
        return cls(track, points, share, -velocity * late)

    def time(self, readout: float) -> Array:
        """Return when the sensor reads the middle of the points [s], shape (n,)."""
        return self.track.time + readout * self.share
