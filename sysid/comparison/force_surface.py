"""The missing torque of a model: over tilt and rate, and averaged over either."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.comparison.release import ComparedRelease
from sysid.joint.law import JointLaw
from sysid.joint.torques import memoryless_torque
from sysid.progress import steps
from sysid.roll import Array

SHARE_OF_PERIOD = 1 / 6
"""Length of the differentiating filter, over the period: a local quartic follows a swing over it to 0.1 %."""
FEW_A_BIN, MOST_BINS = 1.5, 15
"""Fewest independent samples [1] of a bin of a profile, and largest number of bins."""
BINS = 15
"""Cells of a surface, in tilt and in rate: an odd number, so that one is about rest; each is some 7 % of the swing."""
SIGN_TILT_SHARE = 0.1
"""Tilt over the largest one below which noise decides the sign."""
LARGEST_SHARE = 1 / 3
"""Largest length of the filter, over the period, with few samples: a parabola then reduces both swings by a tenth."""
QUARTIC_WINDOW = 7
"""Fewest samples of a local quartic that smooths; a local parabola needs five."""


@dataclass(frozen=True, slots=True)
class TorqueProfile:
    """The missing torque against tilt or rate alone, with less noise than the surface."""

    at: Array
    """Mean tilt [rad] or rate [rad/s] of each bin, shape (n,)."""
    torque: Array
    """Mean missing torque [N*m], shape (n,)."""
    std: Array
    """Standard deviation of that mean [N*m], shape (n,), with the correlation of neighbours in time."""


@dataclass(frozen=True, slots=True)
class MissingTorque:
    """Restoring-force surface of the missing torque (Masri and Caughey, 1979)."""

    angle: Array
    """Edges of the bins in tilt [rad], shape (a + 1,)."""
    rate: Array
    """Edges of the bins in rate [rad/s], shape (b + 1,)."""
    torque: Array
    """Mean missing torque [N*m], shape (a, b); NaN in bins without data."""
    count: Array
    """Samples in each bin, shape (a, b)."""
    over_angle: TorqueProfile
    over_rate: TorqueProfile


def missing_torque(compared: Sequence[ComparedRelease], law: JointLaw) -> MissingTorque | None:
    """Return the difference of the torques of measured and simulated motion, averaged over tilt and rate.

    A local quartic over a sixth of the measured period differentiates the signal; with too few samples, a local
    parabola. A rate needs one derivative; its angle is the simulated one plus the integral of the difference of both
    rates. Both motions pass the same filter and law, so that the error of the filter cancels for a correct model.

    Args:
        compared: Releases, measured and simulated by the law.
        law: The law.

    Returns:
        The surface, or None if the sampling is too slow to differentiate.
    """
    tilts: list[Array] = []
    rates: list[Array] = []
    torques: list[Array] = []
    windows: list[int] = []
    for release in steps(compared):
        window = filter_length(release, law)
        if window is None:
            continue
        measured = _motion(release, release.measured, window)
        simulated = _motion(release, release.simulated, window)
        windows.append(window)
        demanded = _torque_left(law, measured) - _torque_left(law, simulated)
        inner = slice(3, -3)
        tilts.append(measured[0][inner] - law.rest_angle)
        rates.append(measured[1][inner])
        torques.append(demanded[inner])
    if not tilts:
        return None
    tilt, rate, torque = (np.concatenate(part) for part in (tilts, rates, torques))
    a, b = (np.linspace(-1, 1, BINS + 1) * float(np.abs(axis).max()) * 1.001 for axis in (tilt, rate))
    count, _, _ = np.histogram2d(tilt, rate, bins=(a, b))
    total, _, _ = np.histogram2d(tilt, rate, bins=(a, b), weights=torque)
    with np.errstate(invalid="ignore"):
        mean = np.where(count > 2, total / np.maximum(count, 1), np.nan)
    together = float(np.mean(windows))
    return MissingTorque(
        a,
        b,
        np.asarray(mean, np.float64),
        np.asarray(count, np.float64),
        _profile(tilt, torque, together),
        _profile(rate, torque, together),
    )


def _motion(release: ComparedRelease, signal: Array, window: int) -> tuple[Array, Array, Array]:
    """Return angle [rad], rate [rad/s] and acceleration [rad/s^2] of a measured or simulated signal, shape (n,) each."""
    if not release.measures_rate:
        return derivatives(release.time, signal, window)
    off = signal - release.simulated  # without the sensor's bias, which both have
    rate, acceleration, _ = derivatives(release.time, release.rate + off, window)
    steps_between = np.diff(release.time)
    gone = np.concatenate([[0.0], np.cumsum((off[1:] + off[:-1]) / 2 * steps_between)])
    return derivatives(release.time, release.roll + gone, window)[0], rate, acceleration


def _profile(at: Array, torque: Array, together: float) -> TorqueProfile:
    """Average a torque over bins; `together` neighbouring samples are worth one."""
    order = np.argsort(at)
    parts = [np.sort(part) for part in np.split(order, _ends(at[order], together))]
    means = np.array([float(np.mean(torque[part])) for part in parts])
    squares = np.array(
        [float(np.sum((torque[part] - mean) ** 2)) for part, mean in zip(parts, means, strict=True)]
    )
    # Differentiated noise cancels from sample to sample; a missing torque does not. The variance of sums of neighbours, over the
    # sum of their variances, measures this.
    runs = [
        float(np.sum(torque[run] - mean)) ** 2
        for part, mean in zip(parts, means, strict=True)
        for run in np.split(part, np.flatnonzero(np.diff(part) > 1) + 1)
    ]
    shared = sum(runs) / max(float(squares.sum()), 1e-300)
    counts = np.array([len(part) for part in parts])
    return TorqueProfile(
        np.array([float(np.mean(at[part])) for part in parts]), means, np.sqrt(shared * squares) / counts
    )


def _ends(at: Array, together: float) -> list[int]:
    """Return the ends of the bins of sorted values, shape (n,): bins of equal count, or of equal width if that is smaller.

    Most of a decay is near its rest, so with equal counts one bin would hold all wide swings.
    """
    few = FEW_A_BIN * together
    ends, begin, width, many = list[int](), 0, float(at[-1] - at[0]) / MOST_BINS, len(at) / MOST_BINS
    while True:
        end = int(np.ceil(max(few, min(many, np.searchsorted(at, at[begin] + width) - begin)))) + begin
        if len(at) - end < few:
            return ends
        ends.append(end)
        begin = end


def filter_length(release: ComparedRelease, law: JointLaw) -> int | None:
    """Return the filter length in samples, or None if a swing has too few.

    The period is that of the measurement if it crosses its rest three times: that of a wrong model would hide its
    error.

    Args:
        release: The measured signal.
        law: Gives the rest angle, and the period of a release with fewer crossings.
    """
    time = release.time
    tilt = release.measured - (0.0 if release.measures_rate else law.rest_angle)
    clear = np.flatnonzero(np.abs(tilt) > SIGN_TILT_SHARE * np.abs(tilt).max())
    turns = np.flatnonzero(np.diff(np.signbit(tilt[clear])))
    crossings = (time[clear[turns]] + time[clear[turns + 1]]) / 2
    period = 2 * float(np.mean(np.diff(crossings))) if len(crossings) >= 3 else 2 * np.pi / law.frequency
    samples = period / float(np.median(np.diff(time)))
    window = max(int(SHARE_OF_PERIOD * samples) | 1, 5)
    return window if window <= min(LARGEST_SHARE * samples, len(time) // 2) else None


def derivatives(time: Array, roll: Array, window: int) -> tuple[Array, Array, Array]:
    """Return roll [rad], rate [rad/s] and acceleration [rad/s^2], shape (n,) each, smoothed over an odd number of samples.

    Savitzky–Golay filter (1964): a local polynomial about each sample; at both ends that of the outermost window. SciPy's
    takes longer to load than a comparison.
    """
    half, order = window // 2, 4 if window >= QUARTIC_WINDOW else 2
    fit = np.linalg.pinv(np.vander(np.arange(-half, half + 1) / half, order + 1))
    centre = np.clip(np.arange(len(roll)), half, len(roll) - 1 - half)
    curve = np.stack([np.convolve(roll, row[::-1], "valid") for row in fit])[:, centre - half]
    powers = ((np.arange(len(roll)) - centre) / half) ** np.arange(order, -1, -1)[:, None]
    slope = curve[:-1] * np.arange(order, 0, -1)[:, None]
    bend = slope[:-1] * np.arange(order - 1, 0, -1)[:, None]
    step = half * float(np.median(np.diff(time)))
    smooth, rate, acceleration = ((part * powers[-len(part) :]).sum(axis=0) for part in (curve, slope, bend))
    return smooth, rate / step, acceleration / step**2


def _torque_left(law: JointLaw, motion: tuple[Array, Array, Array]) -> Array:
    """Return I φ̈ less the law's torques without memory [N*m], shape (n,), of roll, rate and acceleration."""
    roll, rate, acceleration = motion
    return law.inertia_ratio * law.inertia * acceleration - memoryless_torque(law, roll, rate)
