"""Bounded nonlinear least squares: Levenberg–Marquardt on normal equations.

A joint fit has an exact Jacobian and a dozen unknowns. Its normal equations are summed release by release, which scipy's
solvers cannot use.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

Status = Literal["converged", "stalled", "out of iterations"]


@dataclass(frozen=True, slots=True)
class Normal:
    """Cost and normal equations at one point."""

    cost: float
    """Half the sum of squared residuals; inf if the model cannot be evaluated."""
    gradient: Array
    """Jᵀ r, shape (p,)."""
    hessian: Array
    """Jᵀ J, shape (p, p)."""


@dataclass(frozen=True, slots=True)
class Minimum:
    """Result of a minimisation."""

    point: Array
    normal: Normal
    status: Status
    evaluations: int
    at_bound: npt.NDArray[np.bool_]
    """Which variables ended on a bound, shape (p,)."""


def minimise(
    evaluate: Callable[..., Normal],
    start: Array,
    low: Array,
    high: Array,
    *,
    iterations: int = 60,
    tolerance: float | Callable[[float], float] = 1e-7,
    abandons: bool = False,
) -> Minimum:
    """Minimise half the sum of squares over a box (Marquardt 1963; Moré 1978 for the scaling).

    Args:
        evaluate: Of a point, shape (p,).
        start: Start, shape (p,), each variable in a unit of its own; it is moved into the box.
        low: Lower bounds, shape (p,).
        high: Upper bounds, shape (p,).
        tolerance: Relative fall of the cost, predicted and found, at which the search ends; or a function of the cost that gives it.
        abandons: Whether `evaluate` also takes the current cost; it may stop at a larger one and return infinity, as the step fails.
    """
    point = np.clip(start, low, high)
    here, evaluations, factor = evaluate(point), 1, 1e-3
    status: Status = "out of iterations"
    for _ in range(iterations):
        small = tolerance(here.cost) if callable(tolerance) else tolerance
        trial = np.clip(point + _step(here, point, low, high, factor), low, high)
        moved = trial - point
        predicted = -float(here.gradient @ moved + 0.5 * moved @ here.hessian @ moved)
        if predicted <= small * here.cost:
            status = "converged"
            if factor <= 1.0:
                break
        there = evaluate(trial, here.cost) if abandons else evaluate(trial)
        evaluations += 1
        fall = here.cost - there.cost
        if np.isfinite(there.cost) and fall > 0:
            share = fall / max(predicted, 1e-300)
            point, here = trial, there
            factor = max(factor * (0.1 if share > 0.75 else 0.4 if share > 0.25 else 2.0), 1e-9)
            if fall <= small * here.cost and predicted <= 10 * small * here.cost:
                status = "converged"
                break
            status = "out of iterations"
        else:
            if status == "converged":
                break
            factor *= 8.0
            if factor > 1e9:
                status = "stalled"
                break
    span = 1e-9 * np.maximum(1.0, np.abs(point))
    return Minimum(point, here, status, evaluations, (point <= low + span) | (point >= high - span))


def _step(here: Normal, point: Array, low: Array, high: Array, factor: float) -> Array:
    """Return the damped Gauss–Newton step within the box.

    Variables whose step leaves the box go to their bound, and the step of the others is computed again.
    """
    step = np.zeros_like(point)
    held = ((point <= low) & (here.gradient > 0)) | ((point >= high) & (here.gradient < 0))
    for _ in range(len(point)):
        free = ~held
        if not free.any():
            break
        if free.all():
            step = _solve(here.hessian, here.gradient, factor)
        else:
            gradient = here.gradient[free] + here.hessian[np.ix_(free, held)] @ step[held]
            step[free] = _solve(here.hessian[np.ix_(free, free)], gradient, factor)
        outside = free & ((point + step < low) | (point + step > high))
        if not outside.any():
            break
        step[outside] = np.clip(point + step, low, high)[outside] - point[outside]
        held = held | outside
    return step


def _solve(hessian: Array, gradient: Array, factor: float) -> Array:
    diagonal = hessian.diagonal()
    floor = max(float(diagonal.max()), 1e-279) * 1e-12
    damped = hessian.copy()
    damped.flat[:: len(damped) + 1] += factor * np.maximum(diagonal, floor)
    # The diagonal of a variable without influence may be negative by rounding.
    scale = 1.0 / np.sqrt(np.maximum(damped.diagonal(), factor * floor))
    scaled = damped * (scale[:, None] * scale)
    try:
        return -scale * np.linalg.solve(scaled, scale * gradient)
    except np.linalg.LinAlgError:
        return -scale * (np.linalg.pinv(scaled) @ (scale * gradient))
