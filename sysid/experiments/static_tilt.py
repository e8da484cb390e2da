"""Static tilt test: known weights at known offsets give the stiffness itself.

A decay gives k/I. With k from weights the two measure the roll inertia without an assumed shape.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.errors import SysidError
from sysid.inertia import ON_AXIS, UNIT
from sysid.quantity import GRAVITY, Quantity, propagate, t95


@dataclass(frozen=True, slots=True, kw_only=True)
class Weighing:
    """One reading of the static tilt test."""

    mass: Quantity
    """Put on the deck [kg]."""
    offset: Quantity
    """Of the mass from the tilt axis, right positive [m]."""
    roll: Quantity
    """Roll read then, right edge down positive [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TiltTest:
    """Result of a static tilt test."""

    stiffness: Quantity
    """k [N*m/rad]."""
    rest: Quantity
    """Roll without a weight [rad]."""
    chi_square: float
    """Of the readings about the line, with the stated deviations."""
    degrees_of_freedom: int
    residuals: tuple[float, ...]
    """Reading minus line [rad]."""

    def inertia(self, natural_frequency: Quantity) -> Quantity:
        """Return I = k / ω_n², with ω_n [rad/s] from a decay of the same deck."""
        inputs = self.stiffness, natural_frequency
        return propagate(lambda k, w: k / w**2, inputs, UNIT, "static tilt test and a decay")


def static_tilt(readings: Sequence[Weighing], height: Quantity = ON_AXIS) -> TiltTest:
    """Return the stiffness from known weights at known offsets, by a weighted line φ = φ₀ + τ/k.

    The torque is τ = m g (r cos φ + z sin φ). Every reading has the deviation of its angle and, through the slope, of its torque.
    Scatter beyond these deviations widens the interval.

    Args:
        readings: At least three, best to both sides.
        height: z of the weights above the tilt axis [m].

    Raises:
        SysidError: The readings are too few or at one torque, or show no spring.
    """
    if len(readings) < 3:
        raise SysidError(f"{len(readings)} readings; a line with a check needs at least 3.")
    torques = [_torque(reading, height) for reading in readings]
    x = np.array([torque.value for torque in torques])
    y = np.array([reading.roll.value for reading in readings])
    if np.ptp(x) <= 1e-9:
        raise SysidError("all weights make the same torque; use different weights or offsets, on both sides.")
    slope = float(np.polyfit(x, y, 1)[0])
    variance = np.array(
        [r.roll.std**2 + (slope * t.std) ** 2 for r, t in zip(readings, torques, strict=True)]
    )
    given = bool(np.all(variance > 0))
    weights = 1 / variance if given else np.ones_like(y)
    design = np.column_stack((np.ones_like(x), x))
    covariance = np.linalg.inv(design.T @ (design * weights[:, None]))
    rest, slope = (covariance @ (design.T @ (weights * y))).tolist()
    residuals = y - rest - slope * x
    freedom = len(y) - 2
    chi_square = float(np.sum(weights * residuals**2))
    scatter = chi_square / freedom
    covariance = covariance * (max(1.0, scatter) if given else scatter)
    if slope <= 2 * math.sqrt(covariance[1, 1]):
        raise SysidError(
            "the roll does not grow with the torque beyond its scatter; check that right offsets and right-down "
            "angles are both positive, and use larger weights."
        )
    t = t95(freedom) if not given or scatter > 1 else t95(math.inf)
    relative = math.sqrt(covariance[1, 1]) / slope
    common = GRAVITY.std / GRAVITY.value
    k, total = 1 / slope, math.hypot(relative, common)
    half = math.hypot(t * relative, t95(math.inf) * common) * k
    method = f"static tilt, {len(y)} readings"
    return TiltTest(
        stiffness=Quantity(k, k * total, "N*m/rad", method, (k - half, k + half)),
        rest=Quantity(rest, math.sqrt(covariance[0, 0]), "rad", method),
        chi_square=chi_square if given else math.nan,
        degrees_of_freedom=freedom,
        residuals=tuple(residuals.tolist()),
    )


def _torque(reading: Weighing, height: Quantity) -> Quantity:
    phi, g = reading.roll.value, GRAVITY.value

    def about_axis(m: float, r: float, z: float) -> float:
        return m * g * (r * math.cos(phi) + z * math.sin(phi))

    return propagate(about_axis, (reading.mass, reading.offset, height), "N*m", "weight")
