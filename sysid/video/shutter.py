"""Rolling shutter: the sensor reads its rows one after another, so each point has a time of its own."""

import numpy as np

from sysid.roll import Array


def at_common_time(points: Array, time: Array, share: Array, readout: float) -> tuple[Array, Array]:
    """Move each point along its path to the moment at which the sensor reads the frame's mean row.

    Args:
        points: Points of the body [px], shape (n, N, 2); NaN where not seen.
        time: Stamps of the frames' first row [s], shape (n,).
        share: When each point is read, from 0 to 1 of the read-out, shape (n, N).
        readout: Time from the first to the last row [s].

    Returns:
        The moved points and the frames' times [s] that go with them.
    """
    if readout == 0:
        return points, time
    with np.errstate(invalid="ignore"):
        seen = np.isfinite(share)
        mean = np.where(seen, share, 0).sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
    known = seen.any(axis=1)
    mean = np.interp(time, time[known], mean[known])
    late = readout * (share - mean[:, None])
    return points - _velocity(points, time) * late[..., None], time + readout * mean


def _velocity(points: Array, time: Array) -> Array:
    """Velocity [px/s] from the neighbours on both sides; zero where there are none (and no motion known)."""
    velocity = np.zeros_like(points)
    step = (time[2:] - time[:-2])[:, None, None]
    before, after = (time[1:-1] - time[:-2])[:, None, None], (time[2:] - time[1:-1])[:, None, None]
    # The parabola through three samples, so that an uneven rate does no harm.
    ahead = (points[2:] - points[1:-1]) / after
    behind = (points[1:-1] - points[:-2]) / before
    velocity[1:-1] = (ahead * before + behind * after) / step
    return np.where(np.isfinite(velocity), velocity, 0.0)
