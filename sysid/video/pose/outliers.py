"""Single frames that the frames before and after them do not bear out.

A deck has inertia: its angle cannot jump from one frame to the next and back. Where it seems to, something was
in front of what is followed, or another thing was taken for it.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from sysid.roll import Array

SPIKE_PATTERN = np.array([1 / 6, -2 / 3, 1.0, -2 / 3, 1 / 6])
"""What one wrong frame does to the deviations of five from the cubics through their neighbours."""
SPIKE_LIKENESS = 0.9
"""Correlation of the deviations with that pattern: a letting go, or a fast swing, has another one."""
SPIKE_STDS = 5.0
"""Deviation that is no noise, in standard deviations."""


def outlier_frames(time: Array, angle: Array, std: Array) -> Array:
    """Return how far each frame is off from what its neighbours say [rad], shape (n,); 0 for all but lone ones.

    Args:
        time: Times [s], shape (n,).
        angle: Angles [rad]; NaN where not seen.
        std: Their standard deviations.
    """
    seen = np.flatnonzero(np.isfinite(angle))
    wrong = np.zeros(len(angle))
    if len(seen) < 9:
        return wrong
    t, x = time[seen], angle[seen]
    off = np.zeros(len(x))
    off[2:-2] = x[2:-2] - _between(t, x)
    five = sliding_window_view(off, 5)[2:-2]  # about all but the outer four
    usual = np.median(sliding_window_view(np.sqrt(2.0) * std[seen], 9), axis=1)
    size = np.abs(five @ SPIKE_PATTERN)
    length = np.linalg.norm(SPIKE_PATTERN)
    likeness = size / np.maximum(np.linalg.norm(five, axis=1) * length, 1e-15)
    size /= length**2
    wrong[seen[4:-4]] = np.where((likeness > SPIKE_LIKENESS) & (size > SPIKE_STDS * usual), size, 0.0)
    return wrong


def _between(time: Array, angle: Array) -> Array:
    """Angle at each time but the outer two, by the cubic through two neighbours on either side; shape (n - 4,)."""
    others = [0, 1, 3, 4]
    step = (sliding_window_view(time, 5)[:, others] - time[2:-2, None]) / np.median(np.diff(time))
    cubic = np.linalg.solve(step[..., None] ** np.arange(4), sliding_window_view(angle, 5)[:, others, None])
    return np.asarray(cubic[:, 0, 0], np.float64)
