"""Error of a fit on motion that it did not see."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.fitting.problem import Problem
from sysid.least_squares import Minimum
from sysid.progress import steps
from sysid.roll import Array


def heldout_residuals(problem: Problem, minimum: Minimum) -> tuple[Array, ...]:
    """Return prediction minus measurement of each release [rad or rad/s], shape (n,), by a fit to the others.

    The start of a release cannot be predicted: it is fitted to the release itself. Of one release alone, its second half is
    predicted from its first.
    """
    if len(problem.records) == 1:
        return (_forecast(problem, minimum),)
    return tuple(_left_out(problem, minimum, index) for index in steps(range(len(problem.records))))


def _training(problem: Problem, point: Array, index: int) -> tuple[Problem, Array]:
    """Return the problem of all releases but one, and the same point in it."""
    return problem.of([i for i in range(len(problem.records)) if i != index], point)


def _left_out(problem: Problem, minimum: Minimum, index: int) -> Array:
    """Fit the physics to the other releases, then only roll and rate at release to this one."""
    training, start = _training(problem, minimum.point, index)
    known = {**problem.fixed, **training.parameters(training.fitted(start, 10, 1e-5).point)}
    held = problem.with_(records=[problem.records[index]], fixed=known)
    return held.residuals(held.fitted(problem.own(minimum.point)[index], 12, 1e-7).point)[0]


def _forecast(problem: Problem, minimum: Minimum) -> Array:
    """Fit the first half of the motion and predict the second."""
    record = problem.records[0]
    half = len(record.time) // 2
    first = replace(record, time=record.time[:half], signal=record.signal[:half])
    training = problem.with_(records=[first])
    return problem.residuals(training.fitted(minimum.point, 25, 1e-7).point)[0][half:]


def rms(residuals: Sequence[Array]) -> float:
    """Return the root mean square of residuals, shape (n,) each, all samples alike [their unit]."""
    return float(np.sqrt(np.mean(np.concatenate(residuals) ** 2)))
