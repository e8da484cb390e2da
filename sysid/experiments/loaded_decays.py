"""Stiffness under load, from decays of the deck with known weights on it.

A weight m at height h above the tilt axis, of inertia J about its own axis, changes the joint to
`(I + m h² + J) φ̈ + d φ̇ + (k − m g h) φ = 0`.

The natural frequency of each decay gives `k = (I + m h² + J) ω_n² + m g h`. A line through k against m g gives the change per newton.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.errors import SysidError
from sysid.quantity import GRAVITY, Quantity, propagate, t95
from sysid.roll import Array
from sysid.text import count


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedDecay:
    """One decay with a weight on the deck."""

    mass: Quantity
    """[kg]; 0 for the bare deck."""
    height: Quantity
    """Of its centre of mass above the tilt axis [m]."""
    own: Quantity
    """Its roll inertia about its own centre of mass [kg*m^2]."""
    natural_frequency: Quantity
    """ω_n of the decay [rad/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedStiffness:
    """Stiffness of the spring against load."""

    stiffness: tuple[Quantity, ...]
    """Under each of the weights [N*m/rad]."""
    bare: Quantity
    """Without load [N*m/rad]."""
    per_newton: Quantity
    """Change per newton of load [m/rad]."""
    covariance: Array
    """Of the two, shape (2, 2)."""
    chi_square: float
    """Of the readings about the line."""
    degrees_of_freedom: int

    def under(self, load: float) -> Quantity:
        """Return the spring under a load [N], in N*m/rad; an extrapolation beyond the weights used."""
        value = self.bare.value + load * self.per_newton.value
        row = np.array([1.0, load])
        std = math.sqrt(float(row @ self.covariance @ row))
        half = t95(self.degrees_of_freedom) * std
        return Quantity(value, std, "N*m/rad", self.bare.method, (value - half, value + half))


def loaded_stiffness(readings: Sequence[LoadedDecay], inertia: Quantity) -> LoadedStiffness:
    """Return the spring under load, by a line of generalised least squares.

    The error of the deck's inertia is common to all readings. Scatter about the line beyond the stated deviations widens the
    intervals.

    Args:
        readings: At least three, with two different weights at least.
        inertia: Roll inertia of the bare deck about its tilt axis [kg*m^2].

    Raises:
        SysidError: They are too few or of one weight, or have no deviations.
    """
    if len(readings) < 3:
        raise SysidError(
            f"{count(len(readings), 'decay')} (--reading); a line with a check needs at least 3: the bare deck and two weights."
        )
    gravity = GRAVITY.value

    def spring(mass: float, height: float, own: float, omega: float) -> float:
        return (inertia.value + mass * height**2 + own) * omega**2 + mass * gravity * height

    springs = [
        propagate(spring, (r.mass, r.height, r.own, r.natural_frequency), "N*m/rad", "a decay under load")
        for r in readings
    ]
    loads = np.array([reading.mass.value * gravity for reading in readings])
    if np.ptp(loads) <= 0:
        raise SysidError("all decays are under the same weight; use at least two different ones.")
    values, own = (np.array([getattr(q, name) for q in springs]) for name in ("value", "std"))
    common = np.array([r.natural_frequency.value**2 * inertia.std for r in readings])
    if not np.all(own > 0):
        raise SysidError(
            "every decay needs the deviation of its frequency or of its weight; give it as 9.5±0.1."
        )
    weights = np.linalg.inv(np.diag(own**2) + np.outer(common, common))
    design = np.column_stack([np.ones_like(loads), loads])
    covariance = np.linalg.inv(design.T @ weights @ design)
    line = covariance @ design.T @ weights @ values
    residuals, freedom = values - design @ line, len(values) - 2
    chi_square = float(residuals @ weights @ residuals)
    covariance = covariance * max(1.0, chi_square / freedom)
    method = f"{len(readings)} decays under load"
    half = t95(freedom) * np.sqrt(np.diag(covariance))
    bare, slope = (
        Quantity(float(v), float(s), unit, method, (float(v - h), float(v + h)))
        for v, s, h, unit in zip(line, np.sqrt(np.diag(covariance)), half, ("N*m/rad", "m/rad"), strict=True)
    )
    return LoadedStiffness(
        stiffness=tuple(springs), bare=bare, per_newton=slope,
        covariance=np.asarray(covariance, dtype=np.float64), chi_square=chi_square,
        degrees_of_freedom=freedom,
    )  # fmt: skip
