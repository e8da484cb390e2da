"""The torque that a model lacks, over tilt and rate."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.comparison.release import ComparedRelease
from sysid.effects import effect
from sysid.joint.law import JointLaw
from sysid.joint.torques import effect_torque
from sysid.roll import Array


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


def missing_torque(
    compared: Sequence[ComparedRelease], law: JointLaw, *, bins: tuple[int, int] = (15, 15)
) -> MissingTorque | None:
    """Return the torque that measured and simulated motion differ by, averaged over tilt and rate.

    The measured roll is differentiated by a local quartic over a sixth of a period. Both motions go through
    the same filter and law, so that what the filter does to a correct model cancels.

    Args:
        compared: Releases.
        law: The law that was simulated.
        bins: Number of bins in tilt and rate.

    Returns:
        The surface, or None where the sampling is too slow to differentiate.
    """
    tilts: list[Array] = []
    rates: list[Array] = []
    torques: list[Array] = []
    for release in compared:
        measured = derivatives(release.time, release.measured, law)
        simulated = derivatives(release.time, release.simulated, law)
        if measured is None or simulated is None:
            continue
        demanded = _torque_left(law, release.time, measured) - _torque_left(law, release.time, simulated)
        inner = slice(3, -3)
        tilts.append(measured[0][inner] - law.rest_angle)
        rates.append(measured[1][inner])
        torques.append(demanded[inner])
    if not tilts:
        return None
    tilt, rate, torque = (np.concatenate(part) for part in (tilts, rates, torques))
    a = np.linspace(-1, 1, bins[0] + 1) * float(np.abs(tilt).max()) * 1.001
    b = np.linspace(-1, 1, bins[1] + 1) * float(np.abs(rate).max()) * 1.001
    count, _, _ = np.histogram2d(tilt, rate, bins=(a, b))
    total, _, _ = np.histogram2d(tilt, rate, bins=(a, b), weights=torque)
    with np.errstate(invalid="ignore"):
        mean = np.where(count > 2, total / np.maximum(count, 1), np.nan)
    return MissingTorque(a, b, mean, count)


def derivatives(time: Array, roll: Array, law: JointLaw) -> tuple[Array, Array, Array] | None:
    """Return smoothed roll, rate and acceleration (Savitzky–Golay), or None if too few samples a swing."""
    from scipy.signal import savgol_filter

    step = float(np.median(np.diff(time)))
    window = int(2 * np.pi / law.frequency / 6 / step) | 1
    if window < 7 or window > len(roll) // 2:
        return None
    roll0, rate, acceleration = (
        np.asarray(savgol_filter(roll, window, 4, deriv=order, delta=step)) for order in range(3)
    )
    return roll0, rate, acceleration


def _torque_left(law: JointLaw, time: Array, motion: tuple[Array, Array, Array]) -> Array:
    """Return I φ̈ less the law's torques without memory [N*m]."""
    roll, rate, acceleration = motion
    effects: Mapping[str, tuple[float, ...]] = dict(law.effects)
    ratio = effects.get("inertia", (1.0,))[0]
    left = ratio * law.inertia * acceleration + law.stiffness * (roll - law.rest_angle) + law.damping * rate
    for name in effects:
        if effect(name).role == "torque" and not effect(name).states:
            left = left - effect_torque(law, name, time, roll, rate)
    return left
