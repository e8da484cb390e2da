"""How well a fitted joint predicts motion that it was not fitted to.

What other motion leaves open of the parameters is no fault of a law: a release is predicted with parameters as uncertain
as the sensor's noise on the others leaves them: they may move towards it within their covariance, and no further.
"""

import itertools
from collections.abc import Sequence

import numpy as np

from sysid.fitting.problem import Problem
from sysid.least_squares import Minimum, Normal, minimise
from sysid.roll import Array

PIECES = 3
"""Stretches of one release alone, each of which is predicted from the others."""


def heldout_residuals(problem: Problem, minimum: Minimum) -> tuple[Array, ...]:
    """Return what is missed of each release, predicted from the others; of one alone, of each third of it.

    Roll and rate at a release cannot be predicted, so those are fitted to the release itself.

    Returns:
        Prediction minus measurement [rad or rad/s], shape (n,) for each release.
    """
    if len(problem.records) > 1:
        return tuple(_left_out(problem, minimum, index) for index in range(len(problem.records)))
    return (_interrupted(problem, minimum),)


def _left_out(problem: Problem, minimum: Minimum, index: int) -> Array:
    """Predict one release from the others."""
    shared, own = len(problem.names), problem.n_local
    others = [i for i in range(len(problem.records)) if i != index]
    training = problem.with_(records=[problem.records[i] for i in others])
    pick = np.r_[0:shared, *(np.arange(shared + i * own, shared + (i + 1) * own) for i in others)]
    fitted = minimise(training.normal, minimum.point[pick], *training.bounds(), iterations=10, tolerance=1e-5)
    held = problem.with_(records=[problem.records[index]])
    begin = minimum.point[shared + index * own : shared + (index + 1) * own]
    known = np.zeros((shared + own, shared + own))
    known[:shared, :shared] = _information(fitted, shared)
    return _predicted(held, np.r_[fitted.point[:shared], begin], known)


def _interrupted(problem: Problem, minimum: Minimum) -> Array:
    """Predict each stretch of one release from what is before and after it, on one motion through all of it.

    The first eighth of a period stays: where the motion starts cannot be predicted.
    """
    count = len(problem.observed[0])
    first = int(
        np.searchsorted(problem.records[0].time[:: problem.average], np.pi / 4 / problem.scales.frequency)
    )
    missed = problem.residuals(minimum.point)[0].copy()
    for begin, end in itertools.pairwise(np.linspace(first, count, PIECES + 1).astype(int)):
        hidden = np.zeros(count)
        hidden[begin:end] = 1.0
        training = problem.with_(weights=[1.0 - hidden])
        fitted = minimise(training.normal, minimum.point, *training.bounds(), iterations=15, tolerance=1e-5)
        known = _information(fitted, len(fitted.point))
        missed[begin:end] = _predicted(problem.with_(weights=[hidden]), fitted.point, known)[begin:end]
    return missed


def _information(fitted: Minimum, count: int) -> Array:
    """Return the inverse covariance of the first unknowns of a fit, whatever the others are, shape (count, count)."""
    hessian = fitted.normal.hessian
    inner, mixed, other = hessian[:count, :count], hessian[:count, count:], hessian[count:, count:]
    return inner - mixed @ np.linalg.pinv(other) @ mixed.T


def _predicted(problem: Problem, start: Array, known: Array) -> Array:
    """Return what is missed of one release by a motion that stays within what is known of its unknowns."""

    def normal(point: Array) -> Normal:
        here, off = problem.normal(point), point - start
        return Normal(
            here.cost + 0.5 * float(off @ known @ off), here.gradient + known @ off, here.hessian + known
        )

    found = minimise(normal, start, *problem.bounds(), iterations=12)
    return problem.residuals(found.point)[0]


def rms(residuals: Sequence[Array]) -> float:
    """Return the root mean square of residuals, shape (n,) each, all samples alike [their unit]."""
    return float(np.sqrt(np.mean(np.concatenate(residuals) ** 2)))
