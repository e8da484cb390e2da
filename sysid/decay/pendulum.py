"""The free swing of a pendulum at any amplitude, with its derivatives.

The law is `m ẍ + τ ẋ + sin x = 0`, with m = I/k and τ = d/k; x is counted from rest. `y = e^(β t/2) x` with β = τ/m obeys a
law without a damping term, which Numerov's method integrates with an error of the sixth power of the step. One Newton step
on all nodes at once corrects a motion that is nearly one of the law. The same band matrix gives the derivatives of the
motion, and its response to another torque.
"""

import math
from dataclasses import dataclass

import numpy as np

from sysid.roll import Array


@dataclass(frozen=True, slots=True)
class Swing:
    """A motion of a pendulum on an even grid, and all that are near it."""

    poles: Array
    """(ln m, τ) of the law, shape (2,)."""
    grid: Array
    """[s], shape (m,)"""
    angle: Array
    """[rad], shape (m,)"""
    rate: Array
    """[rad/s], shape (m,)"""
    by_start: Array
    """Derivative of the angle by its first two values, shape (m, 2)."""
    by_law: Array
    """Derivative of the angle by 1/m and β, in which the law is linear, shape (m, 2)."""

    def moved(self, poles: Array) -> Array:
        """Return how far (1/m [1/s²], β [1/s]) of other poles are from those of the motion, shape (2,)."""
        return np.subtract(*(np.array(_constants(one, self.grid)[1:]) for one in (poles, self.poles)))

    def seen(self, time: Array, *, rate: bool) -> tuple[Array, Array, Array]:
        """Return angle [rad] or rate [rad/s] at some times [s], shape (n,), and its derivatives by start and law, shape (n, 2) each."""
        from scipy.interpolate import CubicHermiteSpline

        stiffness, tau = math.exp(-self.poles[0]), float(self.poles[1])
        bend = -stiffness * (tau * self.rate + np.sin(self.angle))
        value, slope = (self.rate, bend) if rate else (self.angle, self.rate)
        tables = (self.by_start, self.by_law)
        moved = [np.gradient(one, self.grid, axis=0) if rate else one for one in tables]
        columns = [np.column_stack([np.interp(time, self.grid, column) for column in one.T]) for one in moved]
        return CubicHermiteSpline(self.grid, value, slope)(time), columns[0], columns[1]

    def response(self, torque: Array, *, rate: bool) -> Array:
        """Return the response of the angle [rad], or of its rate [rad/s], to a torque over k on the grid [1], shape (m,)."""
        step, stiffness, beta = _constants(self.poles, self.grid)
        band, _ = _equations(self.angle, step, stiffness, beta)
        answer = _solve(band, stiffness * step**2 / 12 * _weighed(torque, math.exp(beta * step / 2))[:, None])
        return np.gradient(answer[:, 0], self.grid) if rate else answer[:, 0]


def swing_near(poles: Array, grid: Array, angle: Array) -> Swing:
    """Return the motion with the first two angles of a given one, shape (m,), of which it is a Newton step away.

    Args:
        poles: (ln m, τ).
        grid: Even [s], shape (m,).
        angle: About rest [rad], shape (m,).
    """
    step, stiffness, beta = _constants(poles, grid)
    q = math.exp(beta * step / 2)
    band, left = _equations(angle, step, stiffness, beta)
    pull = _torque(angle, stiffness, beta)
    ahead, back = _ahead(angle, q), _ahead(pull, q)
    by_stiffness = step**2 / 12 * _weighed(np.sin(angle), q)
    by_beta = step / 2 * ahead - step**2 / 12 * (step / 2 * back + beta / 2 * _weighed(angle, q))
    corrected, by_law = np.split(_solve(band, -np.column_stack([left, by_stiffness, by_beta])), [1], axis=1)
    starts = np.zeros((len(grid) - 2, 2))
    by_start = _solve(band, starts, np.eye(2))
    angle = angle + corrected[:, 0]
    pull = _torque(angle, stiffness, beta)
    slope = np.empty_like(angle)
    slope[1:-1] = _ahead(angle, q) / (2 * step) - step / 12 * _ahead(pull, q)
    slope[0] = (q * angle[1] - angle[0]) / step - step / 6 * (2 * pull[0] + q * pull[1])
    slope[-1] = (angle[-1] - angle[-2] / q) / step + step / 6 * (2 * pull[-1] + pull[-2] / q)
    return Swing(poles, grid, angle, slope - beta / 2 * angle, by_start, by_law)


def _constants(poles: Array, grid: Array) -> tuple[float, float, float]:
    """Return the step [s], k/I [1/s²] and β [1/s]."""
    stiffness = math.exp(-poles[0])
    return float(grid[1] - grid[0]), stiffness, float(poles[1]) * stiffness


def _torque(angle: Array, stiffness: float, beta: float) -> Array:
    return -stiffness * np.sin(angle) + beta**2 / 4 * angle


def _weighed(values: Array, q: float) -> Array:
    """Return Numerov's mean of each node and its neighbours, times 12, shape (m - 2,)."""
    return q * values[2:] + 10 * values[1:-1] + values[:-2] / q


def _ahead(values: Array, q: float) -> Array:
    """Return the difference of the neighbours of each node, shape (m - 2,)."""
    return q * values[2:] - values[:-2] / q


def _equations(angle: Array, step: float, stiffness: float, beta: float) -> tuple[Array, Array]:
    """Return the band matrix of Numerov's equations near a motion, shape (3, m), and their residual [rad], shape (m - 2,)."""
    q, share = math.exp(beta * step / 2), step**2 / 12
    left = q * angle[2:] - 2 * angle[1:-1] + angle[:-2] / q
    left -= share * _weighed(_torque(angle, stiffness, beta), q)
    slope = share * (beta**2 / 4 - stiffness * np.cos(angle))
    band = np.ones((3, len(angle)))  # the first two nodes are given
    band[0, 2:] = q * (1 - slope[2:])
    band[1, 1:-1] = -2 - 10 * slope[1:-1]
    band[1, 0] = 0.0
    band[2, :-2] = (1 - slope[:-2]) / q
    return band, left


def _solve(band: Array, sides: Array, starts: Array | None = None) -> Array:
    """Solve the equations for right sides, shape (m - 2, k), with the first two nodes given, shape (2, k); zero if left out."""
    from scipy.linalg import solve_banded

    first = np.zeros((2, sides.shape[1])) if starts is None else starts
    return np.asarray(solve_banded((2, 0), band, np.vstack([first, sides])), dtype=np.float64)
