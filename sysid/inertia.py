"""Roll inertia of a deck about its tilt axis, by several methods, and their combination.

A free decay gives k/I and d/I only; the inertia turns them into k and d. Every method returns it with its uncertainty,
propagated to first order from independent inputs. Distances are from the tilt axis, in the plane across the deck.

Symbols: mass m [kg], lengths [m], distance e [m] of the centre of mass from the tilt axis, period T [s] of a full swing.
Further ω [rad/s], stiffness [N*m/rad] and gravity g [m/s^2].
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.board import Board, BoardEffect
from sysid.decay.numbers import decay_from_peaks
from sysid.errors import SysidError
from sysid.quantity import GRAVITY, Z95, Quantity, propagate

UNIT = "kg*m^2"
ON_AXIS = Quantity(0.0, 0.0, "m")
TURNED = ("stiffness", "damping")
"""Quantities of the tilt joint that scale with the inertia."""
AGREEMENT = math.erfc(Z95 / math.sqrt(2))
"""Significance level at which methods disagree [1]: the chance to lie outside a 95 % interval."""


def cuboid(mass: Quantity, width: Quantity, height: Quantity, distance: Quantity = ON_AXIS) -> Quantity:
    """Return the inertia of a uniform cuboid, w across the deck, h high: m (w² + h²) / 12 + m e².

    Without `distance` it is the published method (HUSKY, RSS 2026, appendix H).
    """
    inputs = (mass, width, height, distance)
    return propagate(lambda m, w, h, e: m * (w**2 + h**2) / 12 + m * e**2, inputs, UNIT, "uniform cuboid")


def point(mass: Quantity, distance: Quantity) -> Quantity:
    """Return the inertia of a small part: m e²."""
    return propagate(lambda m, e: m * e**2, (mass, distance), UNIT, "point mass")


def cylinder(mass: Quantity, radius: Quantity, length: Quantity, distance: Quantity = ON_AXIS) -> Quantity:
    """Return the inertia of a solid cylinder of radius r, l long, that lies across the deck: m (3r² + l²) / 12 + m e²."""
    inputs, method = (mass, radius, length, distance), "solid cylinder across the deck"
    return propagate(lambda m, r, h, e: m * (3 * r**2 + h**2) / 12 + m * e**2, inputs, UNIT, method)


def shifted(inertia: Quantity, mass: Quantity, distance: Quantity) -> Quantity:
    """Return an inertia I about a body's centre of mass, moved by e to the tilt axis: I + m e² (parallel axes)."""
    method = f"{inertia.method or 'inertia about the centre of mass'}, parallel axis"
    return propagate(lambda i, m, e: i + m * e**2, (inertia, mass, distance), UNIT, method)


def parts(inertias: Sequence[Quantity]) -> Quantity:
    """Return the inertia of a body of several parts, each already about the tilt axis.

    Raises:
        SysidError: There are none.
    """
    if not inertias:
        raise SysidError("no parts given; name at least one, for example --cuboid 2.58,0.2,0.02.")
    return propagate(lambda *values: sum(values), inertias, UNIT, f"sum of {len(inertias)} parts")


def bifilar(
    mass: Quantity, separation: Quantity, length: Quantity, period: Quantity, distance: Quantity = ON_AXIS,
    gravity: Quantity = GRAVITY,
) -> Quantity:  # fmt: skip
    """Return the inertia of a deck that twists on two parallel strings L long and s apart, its roll axis vertical.

    About the vertical through the centre of mass, midway between the strings, I = m g s² T² / (16 π² L). The tilt axis adds m e².
    For small twists: at 10° the period is 0.2 % long.
    """

    def about_axis(m: float, s: float, length: float, t: float, e: float, g: float) -> float:
        return m * g * (s * t / math.pi) ** 2 / (16 * length) + m * e**2

    return propagate(about_axis, (mass, separation, length, period, distance, gravity), UNIT, "bifilar swing")


def torsional(
    stiffness: Quantity, period: Quantity, mass: Quantity | None = None, distance: Quantity = ON_AXIS
) -> Quantity:
    """Return the inertia of a deck that twists on a wire or rod of known stiffness κ: κ T² / 4π² (+ m e²).

    The wire's axis goes through the centre of mass.

    Raises:
        SysidError: There is a distance but no mass.
    """
    if mass is None and distance.value != 0:
        raise SysidError("the distance to the tilt axis needs the mass of the deck as well; give --mass.")
    inputs = (stiffness, period, mass or Quantity(0.0, 0.0, "kg"), distance)
    return propagate(
        lambda k, t, m, e: k * (t / (2 * math.pi)) ** 2 + m * e**2, inputs, UNIT, "torsional swing"
    )


def compound(
    mass: Quantity,
    pivot: Quantity,
    period: Quantity,
    distance: Quantity = ON_AXIS,
    amplitude: Quantity = Quantity(0.0, 0.0, "rad"),  # noqa: B008  frozen
    gravity: Quantity = GRAVITY,
) -> Quantity:
    """Return the inertia of a deck that swings as a pendulum about an axis parallel to its roll axis.

    About the pivot, l from the centre of mass, `I = m g l T₀² / 4π²`. About the centre of mass it is smaller by m l², and about
    the tilt axis then larger by m e². `T₀ = T / (1 + θ²/16)` corrects for the mean amplitude θ of the timed cycles.

    Raises:
        SysidError: The period is shorter than that of a point mass at the pivot's distance.
    """

    def about_axis(m: float, l: float, t: float, e: float, theta: float, g: float) -> float:  # noqa: E741
        small = t / (1 + theta**2 / 16)
        return m * g * l * (small / (2 * math.pi)) ** 2 - m * l**2 + m * e**2

    inputs = (mass, pivot, period, distance, amplitude, gravity)
    result = propagate(about_axis, inputs, UNIT, "compound pendulum")
    if result.value - mass.value * distance.value**2 <= 0:
        shortest = 2 * math.pi * math.sqrt(pivot.value / gravity.value)
        raise SysidError(
            f"a pendulum {pivot.value:g} m below its pivot has a period of at least {shortest:.3f} s. The measured "
            f"period is {period.value:.3f} s: check the distance to the centre of mass and the count of cycles."
        )
    return result


def added_mass(
    bare: Quantity,
    loaded: Quantity,
    mass: Quantity,
    offset: Quantity,
    height: Quantity = ON_AXIS,
    own: Quantity = Quantity(0.0, 0.0, UNIT),  # noqa: B008  frozen
    gravity: Quantity = GRAVITY,
) -> Quantity:
    """Return the inertia from two decays, without and with a known mass on the deck.

    The spring is the same: `I ω₁² = k` and `(I + ΔI) ω₂² = k − m g z`. So `I = (ΔI ω₂² + m g z) / (ω₁² − ω₂²)`, with
    `ΔI = m (y² + z²) + I_own`. Half of the mass is y to the left and half to the right, z above the tilt axis.

    Raises:
        SysidError: The frequency did not fall by three standard deviations.
    """

    def about_axis(w1: float, w2: float, m: float, y: float, z: float, i: float, g: float) -> float:
        return ((m * (y**2 + z**2) + i) * w2**2 + m * g * z) / (w1**2 - w2**2)

    fall = bare.value - loaded.value
    blur = math.hypot(bare.std, loaded.std)
    if fall < -3 * blur:
        raise SysidError(
            f"the natural frequency rises by {-fall:.3g} rad/s with the added mass, from {bare.value:.4g} to "
            f"{loaded.value:.4g}; mass lowers it. Are --bare and --loaded swapped?"
        )
    if fall <= 0 or fall < 3 * blur:
        raise SysidError(
            f"the added mass lowers the natural frequency by {fall:.3g} ± {1.96 * blur:.2g} rad/s, too little for an "
            "inertia. Put more mass further out, or record more releases."
        )
    inputs = (bare, loaded, mass, offset, height, own, gravity)
    return propagate(about_axis, inputs, UNIT, "two decays with a known added mass")


@dataclass(frozen=True, slots=True, kw_only=True)
class Combination:
    """Several methods' inertia in one number."""

    inertia: Quantity
    """Weighted mean [kg*m^2]; if the methods disagree, their scatter widens its standard deviation."""
    chi_square: float
    degrees_of_freedom: int
    p_value: float
    """Probability of at least this scatter among correct methods [1]."""
    pulls: Mapping[str, float]
    """Each method's distance from the mean of the others, in standard deviations."""

    @property
    def agree(self) -> bool:
        """Whether the scatter agrees with the deviations."""
        return self.p_value >= AGREEMENT

    @property
    def odd_one(self) -> str | None:
        """The method farthest from the others, if at least three disagree."""
        if self.agree or len(self.pulls) < 3:
            return None
        return max(self.pulls, key=lambda name: abs(self.pulls[name]))


def combine(estimates: Mapping[str, Quantity]) -> Combination:
    """Return the mean of several independent methods, weighted by their variances, and whether they agree.

    Raises:
        SysidError: Fewer than two, or one without an uncertainty.
    """
    if len(estimates) < 2:
        raise SysidError(f"{len(estimates)} estimate; combining needs at least 2.")
    for name, quantity in estimates.items():
        if not (math.isfinite(quantity.std) and quantity.std > 0):
            raise SysidError(
                f"'{name}' has no uncertainty; write it as {quantity.value:g}±…, or leave it out."
            )
    from scipy.special import chdtrc

    names = list(estimates)
    values = np.array([quantity.value for quantity in estimates.values()])
    weights = np.array([1 / quantity.std**2 for quantity in estimates.values()])
    mean = float(np.sum(weights * values) / np.sum(weights))
    chi_square = float(np.sum(weights * (values - mean) ** 2))
    freedom = len(values) - 1
    p_value = float(chdtrc(freedom, chi_square))
    widen = math.sqrt(chi_square / freedom) if p_value < AGREEMENT else 1.0
    method = f"weighted mean of {', '.join(names)}" + (", which disagree" if widen > 1 else "")
    # Mean and variance of the other methods.
    others = np.sum(weights) - weights
    without = (np.sum(weights * values) - weights * values) / others
    pulls = (values - without) / np.sqrt(1 / weights + 1 / others)
    return Combination(
        inertia=Quantity(mean, widen / math.sqrt(float(np.sum(weights))), UNIT, method),
        chi_square=chi_square, degrees_of_freedom=freedom, p_value=p_value,
        pulls=dict(zip(names, pulls.tolist(), strict=True)),
    )  # fmt: skip


def with_inertia(board: Board, inertia: Quantity) -> Board:
    """Return the board with another roll inertia about the tilt axis [kg*m^2] and the same motion.

    A decay fixes k/I, d/I and torque/I, so all numbers in N*m or kg*m^2 scale with the inertia. The old check is dropped.
    """
    if board.decay and not board.fit:
        data = board.decay
        numbers = decay_from_peaks(data["period"], data["first_peak"], data["second_peak"], inertia)
        tilt = {"stiffness": numbers.stiffness, "damping": numbers.damping}
    else:
        tilt = {name: _rescaled(board.tilt[name], board.inertia, inertia) for name in TURNED}
    effects = tuple(
        BoardEffect(e.name, {key: _rescaled(q, board.inertia, inertia) for key, q in e.parameters.items()})
        for e in board.effects
    )
    return replace(board.with_tilt(**tilt), inertia=inertia, effects=effects, last_check={})


def _rescaled(quantity: Quantity, old: Quantity, new: Quantity) -> Quantity:
    if not quantity.unit.startswith(("N*m", "kg*m^2")):
        return quantity
    value = quantity.value * new.value / old.value
    if quantity.value == 0:
        return Quantity(0.0, quantity.std * new.value / old.value, quantity.unit)
    # The new inertia's relative variance replaces the old one's.
    relative = (quantity.std / quantity.value) ** 2 - (old.std / old.value) ** 2
    relative = max(relative, 0.0) + (new.std / new.value) ** 2
    return Quantity(value, abs(value) * math.sqrt(relative), quantity.unit)
