"""How well a fit foretells motion that it has not seen."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.fitting.problem import Problem
from sysid.least_squares import Minimum, minimise
from sysid.roll import Array


def heldout_residuals(problem: Problem, minimum: Minimum) -> tuple[Array, ...]:
    """Return the residuals of each release, predicted without it [rad or rad/s].

    With one release it is the second half of its motion, predicted from the first.

    Args:
        problem: What was fitted.
        minimum: Where the fit ended.
    """
    if len(problem.records) == 1:
        return (_forecast(problem, minimum),)
    return tuple(_left_out(problem, minimum, index) for index in range(len(problem.records)))


def rms(residuals: Sequence[Array]) -> float:
    """Return the root mean square of residuals of several releases, all samples alike."""
    return float(np.sqrt(np.mean(np.concatenate(residuals) ** 2)))


def _left_out(problem: Problem, minimum: Minimum, index: int) -> Array:
    """Fit the physics to the other releases, then only roll and rate at release to this one."""
    shared, own = len(problem.names), problem.n_local
    others = [i for i in range(len(problem.records)) if i != index]
    training = problem.with_(records=[problem.records[i] for i in others])
    pick = np.r_[0:shared, *(np.arange(shared + i * own, shared + (i + 1) * own) for i in others)]
    fitted = minimise(training.normal, minimum.point[pick], *training.bounds(), iterations=10, tolerance=1e-5)
    known = {**problem.fixed, **training.parameters(fitted.point)}
    held = problem.with_(records=[problem.records[index]], fixed=known, average=1)
    start = minimum.point[shared + index * own : shared + (index + 1) * own]
    found = minimise(held.normal, start, *held.bounds(), iterations=12)
    return held.residuals(found.point)[0]


def _forecast(problem: Problem, minimum: Minimum) -> Array:
    """Fit the first half of the motion and predict the second."""
    record = problem.records[0]
    half = len(record.time) // 2
    first = replace(record, time=record.time[:half], signal=record.signal[:half])
    training = problem.with_(records=[first])
    fitted = minimise(training.normal, minimum.point, *training.bounds(), iterations=25)
    return problem.residuals(fitted.point)[0][half:]
