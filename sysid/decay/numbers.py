"""The numbers of a linear free decay, each with its uncertainty.

For `I φ̈ + d φ̇ + k φ = 0` below critical damping:

`δ = 2π ζ / √(1 - ζ²)`, `ω_d = ω_n √(1 - ζ²) = 2π / T`, `k = I ω_n²`, `d = 2 ζ √(k I) = 2 ζ ω_n I`.

A free decay fixes ω_n and ζ only, that is k/I and d/I. The roll inertia is measured separately. Its
uncertainty is part of that of k and d.
"""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from sysid.errors import SysidError
from sysid.quantity import Quantity, slide_unit, t95
from sysid.roll import Array

NUMBERS = {
    "log_decrement": ("log decrement δ", "1"),
    "damping_ratio": ("damping ratio ζ", "1"),
    "period": ("period T", "s"),
    "omega_d": ("damped frequency ω_d", "rad/s"),
    "omega_n": ("natural frequency ω_n", "rad/s"),
    "inertia": ("inertia I", "kg*m^2"),
    "stiffness": ("stiffness k = I ω_n²", "N*m/rad"),
    "damping": ("damping d = 2 ζ ω_n I", "N*m*s/rad"),
}
"""Label and unit of each number."""
OF_JOINT = ("inertia", "stiffness", "damping")
"""Numbers with another unit if the joint slides, whose inertia is in kg."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DecayNumbers:
    """A linear free decay in numbers; NaN for those that the decay does not fix, as δ, T and ω_d without a swing (ζ ≥ 1)."""

    log_decrement: Quantity
    """δ, over a full period [1]."""
    damping_ratio: Quantity
    """ζ [1]."""
    period: Quantity
    """T of the damped oscillation [s]."""
    omega_d: Quantity
    """ω_d = 2π/T [rad/s]."""
    omega_n: Quantity
    """ω_n = √(k/I) [rad/s]."""
    inertia: Quantity
    """Roll inertia I about the tilt axis [kg*m^2], as given."""
    stiffness: Quantity
    """k [N*m/rad]."""
    damping: Quantity
    """d [N*m*s/rad]."""

    def items(self) -> list[tuple[str, Quantity]]:
        """Return every quantity with its name, in the order of the definition."""
        return [(field.name, getattr(self, field.name)) for field in fields(self)]

    def to_json(self) -> dict[str, object]:
        """Return the eight quantities under their names of the result file."""
        names = {"period": "period_s"}
        return {names.get(name, name): quantity.to_json() for name, quantity in self.items()}


def decay_numbers(
    omega_n: float,
    damping_ratio: float,
    covariance: Array,
    inertia: Quantity,
    *,
    degrees_of_freedom: float = math.inf,
    method: str = "",
) -> DecayNumbers:
    """Derive all numbers from ω_n and ζ, with first-order propagation of uncertainty.

    Args:
        omega_n: Natural frequency ω_n [rad/s].
        damping_ratio: ζ [1].
        covariance: Covariance of (ω_n, ζ), shape (2, 2), in their units.
        inertia: Roll inertia about the tilt axis [kg*m^2]; independent of the decay.
        degrees_of_freedom: Of the noise estimate behind `covariance`; few give wider intervals (Student's t).
        method: How ω_n and ζ were obtained, for people.
    """
    point = np.array([omega_n, damping_ratio, inertia.value])
    values = _values(*point.tolist()).real
    steps = 1e-200j * np.eye(3)  # complex steps: derivatives without rounding
    jacobian = np.column_stack([_values(*(point + step).tolist()).imag / 1e-200 for step in steps])
    variance = np.einsum("ij,jk,ik->i", jacobian[:, :2], covariance, jacobian[:, :2])
    from_inertia = jacobian[:, 2] ** 2 * (0.0 if math.isnan(inertia.std) else inertia.std**2)
    std = np.sqrt(variance + from_inertia)
    # Student's t for the share of the decay, a normal distribution for the share of I.
    half = np.sqrt(t95(degrees_of_freedom) ** 2 * variance + t95(math.inf) ** 2 * from_inertia)
    slides = inertia.unit == "kg"
    quantities: dict[str, Quantity] = {}
    for (name, (_, unit)), value, s, h in zip(
        NUMBERS.items(), values.tolist(), std.tolist(), half.tolist(), strict=True
    ):
        unit = slide_unit(unit) if slides and name in OF_JOINT else unit
        how = inertia.method if name == "inertia" else method
        quantities[name] = Quantity(value, s, unit, how, (value - h, value + h))
    return DecayNumbers(**quantities)


def without(numbers: DecayNumbers, names: Sequence[str], method: str) -> DecayNumbers:
    """Return the numbers without those that the decay does not fix, and with the reason in their place."""
    gone = {name: Quantity(math.nan, math.nan, NUMBERS[name][1], method) for name in names}
    return replace(numbers, **gone)


def decay_from_peaks(
    period: Quantity, first_peak: Quantity, second_peak: Quantity, inertia: Quantity
) -> DecayNumbers:
    """Return the decay numbers of two successive peaks on the same side.

    This is the published way (HUSKY, RSS 2026, appendix H): δ = ln(A₁/A₂), k = I ((2π/T)² + (δ/T)²)
    and d = 2 I δ/T.

    Args:
        period: Time between the two peaks [s].
        first_peak: Angle of the first peak about rest [rad].
        second_peak: Angle of the next peak on the same side about rest [rad].
        inertia: Roll inertia about the tilt axis [kg*m^2].

    Raises:
        SysidError: The peaks do not decay, or a number is not positive.
    """
    if not (first_peak.value > second_peak.value > 0 and period.value > 0 and inertia.value > 0):
        raise SysidError(
            f"period {period.value:.4g} s, peaks {first_peak.value:.4g} and {second_peak.value:.4g} rad, "
            f"inertia {inertia.value:.4g} kg·m² are no decay: all must be positive and the second peak smaller "
            "than the first. Measure both peaks on the same side, about the rest angle."
        )
    delta = math.log(first_peak.value / second_peak.value)
    delta_std = math.hypot(first_peak.std / first_peak.value, second_peak.std / second_peak.value)
    turn = math.hypot(2 * math.pi, delta)
    omega_n, zeta = turn / period.value, delta / turn
    by_both = np.array(
        [[delta / (turn * period.value), -omega_n / period.value], [(2 * math.pi) ** 2 / turn**3, 0.0]]
    )
    covariance = by_both @ np.diag([delta_std**2, period.std**2]) @ by_both.T
    return decay_numbers(omega_n, zeta, covariance, inertia, method="two peaks on the same side")


def _values(omega_n: complex, zeta: complex, inertia: complex) -> npt.NDArray[np.complex128]:
    """Return the eight numbers in the order of `NUMBERS`, shape (8,)."""
    root = cmath.sqrt(1 - zeta**2) if zeta.real < 1 else math.nan
    omega_d, stiffness, damping = omega_n * root, inertia * omega_n**2, 2 * zeta * omega_n * inertia
    decrement, period = 2 * math.pi * zeta / root, 2 * math.pi / omega_d
    return np.array([decrement, zeta, period, omega_d, omega_n, inertia, stiffness, damping])
