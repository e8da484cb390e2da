"""Period and damping against amplitude: straight and level for a linear joint, bent by everything else."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.roll import Array

CLEAR = 4.0
"""Amplitude of the smallest swing that counts, in standard deviations of the noise."""


@dataclass(frozen=True, slots=True)
class Backbone:
    """One point for each half swing of each release."""

    amplitude: Array
    """Mean of the amplitudes at both ends of the half swing [rad], shape (m,)."""
    period: Array
    """Twice the time of the half swing [s], shape (m,)."""
    damping_ratio: Array
    """ζ from the ratio of both amplitudes [1], shape (m,)."""


def backbone(traces: Sequence[tuple[Array, Array, float]], noise: float) -> Backbone:
    """Take period and damping of every half swing.

    Args:
        traces: Time [s] and roll [rad] of shape (n,), and rest angle [rad], of each release.
        noise: Standard deviation of one sample [rad].
    """
    rows: list[tuple[float, float, float]] = []
    for time, roll, rest in traces:
        turns = _turning_points(time, roll - rest, CLEAR * noise)
        for (t0, a0), (t1, a1) in zip(turns, turns[1:], strict=False):
            decrement = math.log(a0 / a1)
            rows.append(((a0 + a1) / 2, 2 * (t1 - t0), decrement / math.hypot(math.pi, decrement)))
    table = np.array(rows).reshape(-1, 3)
    return Backbone(table[:, 0], table[:, 1], table[:, 2])


def _turning_points(time: Array, tilt: Array, least: float) -> list[tuple[float, float]]:
    """Return time [s] and amplitude [rad] of the extremes between passages through rest."""
    passages = np.flatnonzero(np.diff(np.sign(tilt)) != 0) + 1
    points: list[tuple[float, float]] = []
    for begin, end in zip([0, *passages], [*passages, len(tilt)], strict=True):
        piece = np.abs(tilt[begin:end])
        index = int(np.argmax(piece))
        if piece[index] < least:
            if points:
                break
            continue
        # A parabola through the top of the swing: a noisy sample must not set time and height.
        near = np.flatnonzero(piece > 0.85 * piece[index])
        if len(near) < 5 or index in (0, len(piece) - 1):
            points.append((float(time[begin + index]), float(piece[index])))
            continue
        t = time[begin + near] - time[begin + index]
        c, b, a = np.polyfit(t, piece[near], 2)
        top = -b / (2 * c) if c < 0 else 0.0
        if not t[0] <= top <= t[-1]:
            top = 0.0
        points.append((float(time[begin + index] + top), float(a + b * top + c * top**2)))
    return points
