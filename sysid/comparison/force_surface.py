"""The torque that a model lacks: over tilt and rate, and averaged over either."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.comparison.release import ComparedRelease
from sysid.joint.law import JointLaw
from sysid.joint.torques import memoryless_torque
from sysid.progress import steps
from sysid.roll import Array

SHARE_OF_PERIOD = 1 / 6
"""Length of the filter that differentiates, over the period: a local quartic follows a swing over it to 0.1 %."""
FEW_A_BIN, MOST_BINS = 1.5, 15
"""Independent samples [1] that a bin of a profile holds at least, and bins, of as many samples each or as wide as each other, beyond which a
curve shows no more."""
BINS = 15
"""Cells of a surface, in tilt and in rate: an odd number, so that one is about rest; each is then some 7 % of the swing."""
SIGN_TILT_SHARE = 0.1
"""Share of the largest tilt within which a sign is the noise's."""
LARGEST_SHARE = 1 / 3
"""The same where samples are few: a parabola over a third of a period takes a tenth off a swing, measured and simulated."""
QUARTIC_WINDOW = 7
"""Samples that a local quartic needs to smooth at all; a local parabola makes do with five."""


@dataclass(frozen=True, slots=True)
class TorqueProfile:
    """The missing torque against tilt or rate alone: noise that fills a map averages out, and a law shows its shape."""

    at: Array
    """Mean tilt [rad] or rate [rad/s] of each bin, shape (n,)."""
    torque: Array
    """Mean missing torque [N*m], shape (n,)."""
    std: Array
    """Standard deviation of that mean [N*m], shape (n,), with what neighbours in time have in common."""


@dataclass(frozen=True, slots=True)
class MissingTorque:
    """Restoring-force surface of what the model lacks (Masri and Caughey, 1979)."""

    angle: Array
    """Edges of the bins in tilt [rad], shape (a + 1,)."""
    rate: Array
    """Edges of the bins in rate [rad/s], shape (b + 1,)."""
    torque: Array
    """Mean missing torque [N*m], shape (a, b); NaN where there was no data."""
    count: Array
    """Samples in each bin, shape (a, b)."""
    over_angle: TorqueProfile
    over_rate: TorqueProfile


def missing_torque(
    compared: Sequence[ComparedRelease], law: JointLaw, component: Sequence[Array] = ()
) -> MissingTorque | None:
    """Return the torque that measured and simulated motion differ by, averaged over tilt and rate.

    The measured signal is differentiated by a local quartic over a sixth of its own period, by a local parabola where
    that holds too few samples. A rate needs one derivative; its angle is the simulated one and the integral of the
    difference of both rates. Both motions go through the same filter and law, so that what the filter does to a
    correct model cancels.

    Args:
        compared: Releases, measured and simulated by the law.
        law: The law.
        component: Torque of a part of the law along each simulated release [N*m], shape (n,) each, which is shown together with the
            residual: a component-plus-residual plot (Larsen and McCleary, Technometrics 14, 1972).

    Returns:
        The surface, or None where the sampling is too slow to differentiate.
    """
    tilts: list[Array] = []
    rates: list[Array] = []
    torques: list[Array] = []
    windows: list[int] = []
    for number, release in enumerate(steps(compared)):
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
        torques.append(demanded[inner] + (component[number][inner] if component else 0.0))
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
    """Average a torque over bins; `together` neighbouring samples say the same."""
    order = np.argsort(at)
    parts = [np.sort(part) for part in np.split(order, _ends(at[order], together))]
    means = np.array([float(np.mean(torque[part])) for part in parts])
    squares = np.array(
        [float(np.sum((torque[part] - mean) ** 2)) for part, mean in zip(parts, means, strict=True)]
    )
    # Noise that was differentiated cancels from sample to sample; what the model lacks does not. What neighbours in time make of
    # the scatter together, over what each makes alone, tells which it is.
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
    """Return where bins of sorted values, shape (n,), end and the next begin: of as many samples each, or as wide as each other where that is less.

    Most of a decay is near its rest: of as many samples each, one bin would hold all that is beyond.
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
    """Return how many samples to smooth over, or None where a swing has too few.

    The period is the measurement's own where it crosses its rest three times: a wrong model must not blind the
    comparison that is to show it.

    Args:
        release: The measured signal.
        law: Gives the rest angle, and the period of what does not swing.
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

    By Savitzky and Golay's filter (1964): a polynomial through the samples about each, at both ends the one of the outermost
    window. SciPy's takes longer to load than a comparison takes.
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
