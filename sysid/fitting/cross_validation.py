"""How well a fitted joint predicts motion that it was not fitted to."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.fitting.problem import Problem, Record
from sysid.fitting.search import replace_records
from sysid.least_squares import Minimum, minimise
from sysid.roll import Array

PIECES = 3
"""Into how many pieces one release alone is cut, each of which is predicted from the others."""


def held_out(problem: Problem, minimum: Minimum) -> tuple[Array, ...]:
    """Return what is missed of each release, predicted from the others; of one alone, of each third of it.

    Roll, rate and internal states at the start cannot be predicted, so those are fitted to the stretch itself.

    Returns:
        Prediction minus measurement [rad or rad/s], one array a release.
    """
    if len(problem.records) > 1:
        return tuple(_left_out(problem, minimum, index) for index in range(len(problem.records)))
    cut, start = _cut(problem, minimum)
    fitted = minimise(cut.normal, start, *cut.bounds(), iterations=15, tolerance=1e-5)
    return (np.concatenate([_left_out(cut, fitted, index) for index in range(PIECES)]),)


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


def _cut(problem: Problem, minimum: Minimum) -> tuple[Problem, Array]:
    """Return the problem with its one release cut in pieces, and a start where the fit of the whole passes the cuts."""
    record, width = problem.records[0], problem.average
    count = len(problem.observed[0])
    edges = np.linspace(0, count, PIECES + 1).astype(int)
    pieces = [
        _piece(record, width * int(a), width * int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True)
    ]
    free = problem.free_states or bool(problem.structure.memories)
    cut = replace(problem, records=pieces, free_states=free)
    path = problem.residuals(minimum.point)[0] + problem.observed[0]
    start = cut.start(problem.parameters(minimum.point))
    if not record.is_rate:
        slope = np.gradient(path, width * float(np.median(np.diff(record.time))))
        start[len(cut.names) :] = _begins(cut, start, path[edges[:-1]], slope[edges[:-1]])
    return cut, start


def _begins(cut: Problem, start: Array, rolls: Array, rates: Array) -> Array:
    """Return each piece's own unknowns with roll and rate where the whole motion has them."""
    begins = start[len(cut.names) :].reshape(PIECES, cut.own).copy()
    sizes = cut.sizes()[len(cut.names) : len(cut.names) + 2]
    begins[:, 0], begins[:, 1] = rolls / sizes[0], rates / sizes[1]
    return begins.ravel()


def _piece(record: Record, first: int, last: int) -> Record:
    """Return a stretch of a record; only its first one was released from a hold."""
    release = record.release
    if first == 0:
        return replace(record, time=record.time[:last], signal=record.signal[:last])
    begin = float(record.time[first])
    inside = release.time - release.time[0] >= begin - 1e-9

    def part(values: Array | None) -> Array | None:
        return None if values is None else values[inside]

    rest = replace(
        release, time=release.time[inside], roll=release.roll[inside], std=release.std[inside], rate=part(release.rate),
        rate_std=part(release.rate_std), own_std=part(release.own_std), hold=0.0,
    )  # fmt: skip
    return replace(
        record, release=rest, time=record.time[first:last] - begin, signal=record.signal[first:last]
    )


def pooled(errors: Sequence[Array]) -> float:
    """Return the root mean square of what was missed."""
    return float(np.sqrt(np.mean(np.concatenate(list(errors)) ** 2)))
