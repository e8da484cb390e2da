"""Rolling shutter: the sensor reads its rows one after another, so each point has a time of its own."""

import numpy as np

from sysid.roll import Array

READOUT_CEILING = 1 / 30
"""No sensor takes longer for a frame [s]."""


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
