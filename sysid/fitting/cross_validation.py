"""How well a fitted joint predicts motion that it was not fitted to."""

from dataclasses import replace

import numpy as np

from sysid.fitting.problem import Problem
from sysid.fitting.search import replace_records
from sysid.least_squares import Minimum, minimise
from sysid.roll import Array


def held_out(problem: Problem, minimum: Minimum) -> tuple[Array, ...]:
    """Return what is missed of each release, predicted from the others; of one alone, of its second half.

    Roll and rate at release cannot be predicted, so those are fitted to the release itself.

    Returns:
        Prediction minus measurement [rad or rad/s], one array a release; the second half only, if there is one.
    """
    count = len(problem.records)
    if count == 1:
        return (_forecast(problem, minimum),)
    return tuple(_left_out(problem, minimum, index) for index in range(count))


def _left_out(problem: Problem, minimum: Minimum, index: int) -> Array:
    shared, own = len(problem.names), problem.own
    others = [i for i in range(len(problem.records)) if i != index]
    training = replace_records(problem, [problem.records[i] for i in others])
    pick = np.r_[0:shared, *(np.arange(shared + i * own, shared + (i + 1) * own) for i in others)]
    fitted = minimise(training.normal, minimum.point[pick], *training.bounds(), iterations=10, tolerance=1e-5)
    held = Problem(
        problem.structure, [problem.records[index]], problem.scales, bias=problem.bias,
        fixed={**problem.fixed, **training.parameters(fitted.point)}, free_states=problem.free_states,
        steps_per_period=problem.steps_per_period, average=problem.average,
    )  # fmt: skip
    start = minimum.point[shared + index * own : shared + (index + 1) * own]
    found = minimise(held.normal, start, *held.bounds(), iterations=12)
    return held.residuals(found.point)[0]


def _forecast(problem: Problem, minimum: Minimum) -> Array:
    record = problem.records[0]
    half = len(record.time) // 2 // problem.average * problem.average
    first = replace(record, time=record.time[:half], signal=record.signal[:half])
    training = replace_records(problem, [first])
    fitted = minimise(training.normal, minimum.point, *training.bounds(), iterations=25)
    return problem.residuals(fitted.point)[0][half // problem.average :]
