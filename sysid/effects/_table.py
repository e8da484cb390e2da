"""A smooth curve through a table of torques, for effects without a formula.

The table holds the torque at `2 n` knots, n on each side of zero. At zero it is 0. Keys' cubic interpolates between the knots. It
passes through every value, has a continuous slope and is local. Beyond the last knot the curve is constant.
"""

import numpy as np

from sysid.effects._algebra import Algebra, Value
from sysid.effects._base import Parameter
from sysid.least_squares import Array


def knots(n: int, grading: float) -> Array:
    """Return the knots as shares of the reach [1], shape (2n,), ascending and without zero; the inverse of `position`.

    Args:
        grading: Share of the reach that holds about half of the knots of a side: a small one is dense near zero.
    """
    s = np.arange(1, n + 1) / n
    x = grading * s / (1 + grading - s)
    return np.concatenate([-x[::-1], x])


def position(m: Algebra, share: Value, grading: float) -> Value:
    """Return the position of a share of the reach on the even scale of the knots, both from -1 to 1."""
    return (1 + grading) * share / (m.abs(share) + grading)


def cardinals(m: Algebra, s: Value, n: int) -> list[Value]:
    """Return the weight of each value of a table at a position from -1 to 1 (Keys, IEEE Trans. ASSP 29, 1981).

    Args:
        s: Position on the even scale.
        n: Knots to either side, 2 or more.
    """
    u = n * s
    cell = m.maximum(-n, m.minimum(n - 1, m.floor(u)))
    t = u - cell
    # Weights of the knots before the cell, at its ends, and after it; all others are zero.
    near = (
        t * (t * (1 - 0.5 * t) - 0.5),
        1 + t * t * (1.5 * t - 2.5),
        t * (0.5 + t * (2 - 1.5 * t)),
        0.5 * t * t * (t - 1),
    )
    here = {j: cell == j for j in range(-n, n)}
    at: dict[int, Value] = {
        j: sum(weight * here[j + 1 - k] for k, weight in enumerate(near) if j + 1 - k in here)
        for j in range(-n - 1, n + 2)
    }
    for side in (-1, 1):  # a parabola extrapolates the point beyond the table: Keys' boundary
        ghost = at.pop(side * (n + 1))
        for back, weight in ((0, 3.0), (1, -3.0), (2, 1.0)):
            at[side * (n - back)] = at[side * (n - back)] + weight * ghost
    return [at[j] for j in range(-n, n + 1) if j != 0]


def bending(n: int) -> Array:
    """Return the quadratic form of a table's roughness in its values [1], shape (2n, 2n).

    It sums the squared second differences along the knots, including the zero in the middle. A small weight of the values, that of
    one wave over the whole reach, makes unmeasured parts zero.
    """
    second = np.diff(np.eye(2 * n + 1), 2, axis=0)
    second = np.delete(second, n, axis=1)
    return second.T @ second + (np.pi / n) ** 4 * np.eye(2 * n)


def table_value(name: str) -> Parameter:
    """Return the parameter that is one value of a table; its size is a tenth of the spring's torque."""
    return Parameter(name, "N*m", lambda s: 0.1 * s.torque, low=-100.0, high=100.0, starts=(0.0,))
