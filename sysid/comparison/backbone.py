"""Period and damping against amplitude."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.comparison.release import ComparedRelease, smoothed
from sysid.joint.law import JointLaw
from sysid.roll import Array


@dataclass(frozen=True, slots=True)
class Backbone:
    """Period and damping against amplitude, half swing by half swing."""

    amplitude: Array
    """[rad], shape (m,)."""
    period: Array
    """[s], shape (m,)."""
    damping_ratio: Array
    """[1], shape (m,)."""


def backbone_of(
    compared: Sequence[ComparedRelease], law: JointLaw, signals: Sequence[Array], noise: float
) -> Backbone:
    """Return the backbone of all releases together, about the rest angle.

    The largest rate of a swing is its natural frequency times its amplitude, so a measured rate gives the amplitude too.

    Args:
        signals: Measured or simulated angles [rad], or rates [rad/s] if these were measured, shape (n,) each.
        noise: Their standard deviation.
    """
    parts = [np.empty((3, 0))]
    for release, signal in zip(compared, signals, strict=True):
        if release.window is not None:
            rest = 0.0 if release.record.is_rate else law.rest_angle
            swings = _half_swings(
                release.time, smoothed(release.time, signal - rest, release.window)[0], noise
            )
            if release.record.is_rate:
                swings[0] *= swings[1] * np.sqrt(1 - swings[2] ** 2) / (2 * np.pi)
            parts.append(swings)
    together = np.concatenate(parts, axis=1)
    return Backbone(*together[:, np.argsort(together[0])])


def _half_swings(time: Array, tilt: Array, noise: float) -> Array:
    """Return amplitude, period and damping ratio of each half swing between turning points, shape (3, m)."""
    clear = np.flatnonzero(np.abs(tilt) >= max(6 * noise, 0.01 * float(np.abs(tilt).max())))
    swings = np.split(clear, np.flatnonzero(np.diff(np.signbit(tilt[clear]))) + 1)
    peaks = np.array([swing[np.abs(tilt[swing]).argmax()] for swing in swings if len(swing)], dtype=int)
    peaks = peaks[(peaks > 0) & (peaks < len(tilt) - 1)]  # a swing cut off by an end has no peak
    size = np.abs(tilt[peaks])
    shrink = np.log(size[:-1] / size[1:])
    found = np.stack(
        [np.sqrt(size[:-1] * size[1:]), 2 * np.diff(time[peaks]), shrink / np.hypot(np.pi, shrink)]
    )
    return found[:, shrink > 0]
