"""Error of a fitted joint on motion that it was not fitted to: cross-validation."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.fitting.problem import Problem
from sysid.least_squares import Minimum
from sysid.progress import steps
from sysid.roll import Array

FOLDS = 10
"""Groups of releases that are left out in turn (Kohavi 1995); up to so many releases, each is a group of its own."""


def heldout_residuals(problem: Problem, minimum: Minimum) -> tuple[Array, ...]:
    """Return prediction minus measurement of each release [rad or rad/s], shape (n,), by a fit to the others.

    The start of a release cannot be predicted: it is fitted to the release itself. Of one release alone, its second half is
    predicted from its first.
    """
    count = len(problem.records)
    if count == 1:
        return (_forecast(problem, minimum),)
    found: dict[int, Array] = {}
    for first in steps(range(min(FOLDS, count))):
        found.update(_left_out(problem, minimum, range(first, count, FOLDS)))
    return tuple(found[index] for index in range(count))


def _left_out(problem: Problem, minimum: Minimum, group: Sequence[int]) -> dict[int, Array]:
    """Fit the physics to the releases outside a group, then only roll and rate at release to each of the group."""
    others = [index for index in range(len(problem.records)) if index not in group]
    training, start = problem.of(others, minimum.point)
    known = {**problem.fixed, **training.parameters(training.fitted(start, 10, 1e-5).point)}
    found: dict[int, Array] = {}
    for index in group:
        held = problem.with_(records=[problem.records[index]], fixed=known)
        found[index] = held.residuals(held.fitted(problem.own(minimum.point)[index], 12, 1e-7).point)[0]
    return found


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
