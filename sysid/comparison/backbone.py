"""Period and damping against amplitude."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.comparison.force_surface import derivatives, filter_length
from sysid.comparison.release import ComparedRelease
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
    parts: list[tuple[Array, Array, Array]] = []
    for release, signal in zip(compared, signals, strict=True):
        rest = 0.0 if release.measures_rate else law.rest_angle
        window = filter_length(release, law)
        amplitude, period, damping = _half_swings(release.time, signal - rest, window, noise)
        if release.measures_rate:
            amplitude = amplitude * period * np.sqrt(1 - damping**2) / (2 * np.pi)
        parts.append((amplitude, period, damping))
    amplitude, period, damping = (np.concatenate([part[i] for part in parts]) for i in range(3))
    order = np.argsort(amplitude)
    return Backbone(amplitude[order], period[order], damping[order])


def _half_swings(time: Array, tilt: Array, window: int | None, noise: float) -> tuple[Array, Array, Array]:
    """Return amplitude, period and damping ratio of each half swing between turning points."""
    if window is None:
        return np.empty(0), np.empty(0), np.empty(0)
    y = derivatives(time, tilt, window)[0]
    least = max(6 * noise, 0.01 * float(np.abs(tilt).max()))
    clear = np.flatnonzero(np.abs(y) >= least)
    swings = np.split(clear, np.flatnonzero(np.diff(np.signbit(y[clear]))) + 1)
    peaks = np.array([swing[np.abs(y[swing]).argmax()] for swing in swings if len(swing)], dtype=int)
    peaks = peaks[(peaks > 0) & (peaks < len(y) - 1)]  # a swing cut off by an end has no peak
    if len(peaks) < 2:
        return np.empty(0), np.empty(0), np.empty(0)
    size = np.abs(y[peaks])
    shrink = np.log(size[:-1] / size[1:])
    usable = shrink > 0
    amplitude = np.sqrt(size[:-1] * size[1:])[usable]
    period = 2 * np.diff(time[peaks])[usable]
    damping = (shrink / np.hypot(np.pi, shrink))[usable]
    return amplitude, period, damping
