"""Tables of a model along the path of a joint, as the first harmonics of its position."""

import numpy as np

from sysid.effects._algebra import NUMPY, Algebra, Value, Values
from sysid.effects._base import Parameter, Scales
from sysid.roll import Array

HARMONICS = ("constant", "sine", "cosine", "sine2", "cosine2", "sine3", "cosine3")
"""The terms 1, sin φ, cos φ, sin 2φ, ... cos 3φ. The weight of a rigid body on a hinge has the second and third, on a slide the
first."""
FORMULA = "c + Σ (aₙ sin nφ + bₙ cos nφ), n = 1, 2, 3"
"""Their sum, as printed."""


def value_of(m: Algebra, roll: Value, parameters: Values) -> Value:
    """Return c + Σ (aₙ sin nφ + bₙ cos nφ)."""
    return sum(parameters[name] * term for name, term in zip(HARMONICS, _terms(m, roll), strict=True))


def slope_of(m: Algebra, roll: Value, parameters: Values) -> Value:
    """Return its derivative by φ."""
    terms = _terms(m, roll)
    # Of sin nφ it is n cos nφ, of cos nφ -n sin nφ.
    pairs = ((n, HARMONICS[2 * n - 1], HARMONICS[2 * n], terms[2 * n - 1], terms[2 * n]) for n in (1, 2, 3))
    return sum(n * (parameters[a] * cosine - parameters[b] * sine) for n, a, b, sine, cosine in pairs)


def _terms(m: Algebra, roll: Value) -> tuple[Value, ...]:
    waves = (wave(n * roll) for n in (1, 2, 3) for wave in (m.sin, m.cos))
    return 1.0 + 0 * roll, *waves


def of_table(roll: Array, values: Array) -> tuple[dict[str, float], float]:
    """Return the parameters of a table of values at rolls [rad], shape (n,) each, and their largest error, in the unit of the values."""
    columns = np.column_stack(_terms(NUMPY, roll))
    found, missed = np.zeros(len(HARMONICS)), 0.0
    for count in (1, 3, 5, 7):  # the fewest that fit: on a short path all look alike
        found[:count] = np.linalg.lstsq(columns[:, :count], values, rcond=1e-12)[0]
        missed = float(np.abs(columns @ found - values).max())
        if missed < 1e-6 * max(float(np.abs(values).max()), 1e-12):
            break
    found[np.abs(found) < 1e-10 * np.abs(found).max(initial=1e-12)] = 0.0
    return dict(zip(HARMONICS, map(float, found), strict=True)), missed


def held(unit: str) -> tuple[Parameter, ...]:
    """Return the parameters of a table that a model states."""

    def size(scales: Scales) -> float:
        return scales.inertia if unit.startswith("kg") else scales.torque / scales.amplitude

    return tuple(
        Parameter(name, unit, size, low=-1e3, high=1e3, starts=(0.0,), held=True) for name in HARMONICS
    )
