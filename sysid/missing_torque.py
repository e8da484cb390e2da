"""The torque that a model lacks, made from what it leaves of the measurement.

If r is measured less simulated roll, the measured motion obeys I φ̈ = τ(φ, φ̇) + τ_missing and the
simulated one I φ̈ = τ(φ, φ̇), so τ_missing = I r̈ + d ṙ + k r to first order in r (the restoring-force
method of Masri and Caughey, J. Appl. Mech. 46, 1979, applied to the residual: it is small, so its
derivatives are much less noisy than those of the roll itself).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.joint import JointLaw
from sysid.roll import Array

if TYPE_CHECKING:
    from sysid.compare import ReleaseComparison

BINS = 9
"""Cells of the map in each direction."""
LEAST = 3
"""Samples below which a cell says nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueMap:
    """Missing torque over angle and rate, with where there was data."""

    angle: Array
    """Edges of the cells: tilt from rest [rad], shape (m + 1,)."""
    rate: Array
    """Edges of the cells: roll rate [rad/s], shape (m + 1,)."""
    torque: Array
    """Mean missing torque [N*m], shape (m, m) as [rate, angle]; NaN where there was no data."""
    count: Array
    """Samples in each cell, shape (m, m)."""


def missing_torque(time: Array, residual: Array, law: JointLaw) -> Array:
    """Return the torque that a law lacks along a motion.

    Args:
        time: Since the release [s], shape (n,).
        residual: Measured less simulated roll [rad], shape (n,).
        law: The joint that was simulated.

    Returns:
        I r̈ + d ṙ + k r [N*m], shape (n,), smoothed over a sixth of a period.
    """
    from scipy.signal import savgol_filter

    n = len(time)
    step = float(time[-1] - time[0]) / (n - 1)
    even = np.linspace(time[0], time[-1], n)
    window = int(2 * np.pi / law.frequency / 6 / step) | 1
    window = min(max(window, 7), n - 1 + n % 2)
    if window < 5:
        return np.zeros(n)
    signal = np.interp(even, time, residual)
    r, rate, acceleration = (
        savgol_filter(signal, window, 3, deriv=order, delta=step, mode="interp") for order in (0, 1, 2)
    )
    torque = law.inertia * acceleration + law.damping * rate + law.stiffness * r
    return np.interp(time, even, torque)


def torque_map(releases: Sequence["ReleaseComparison"]) -> TorqueMap:
    """Average the missing torque of all releases over angle and rate."""
    tilt = np.concatenate([r.measured - r.rest for r in releases])
    rate = np.concatenate([r.rate for r in releases])
    torque = np.concatenate([r.torque for r in releases])
    angle_edges, rate_edges = _edges(tilt), _edges(rate)
    count, _, _ = np.histogram2d(rate, tilt, (rate_edges, angle_edges))
    total, _, _ = np.histogram2d(rate, tilt, (rate_edges, angle_edges), weights=torque)
    mean = np.full_like(total, np.nan)
    np.divide(total, count, out=mean, where=count >= LEAST)
    return TorqueMap(angle=angle_edges, rate=rate_edges, torque=mean, count=count)


def _edges(values: Array) -> Array:
    """Return symmetric cell edges that hold all values."""
    most = float(np.abs(values).max()) * (1 + 1e-9) or 1.0
    return np.linspace(-most, most, BINS + 1)
