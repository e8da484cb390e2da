"""How well a fitted joint predicts motion that it was not fitted to.

Two questions, one training fit. What error is to be expected of the numbers that a fit writes down: `heldout_residuals`, with
the physics of the other releases as it is. And is a law wrong: `surprising_residuals`. There, what other motion leaves open of
the parameters is no fault of the law: they may move towards a release within the covariance that the sensor's noise on
the others leaves them, and no further. That covariance is of a joint that is nearly linear in its parameters; where one of them
has no say it is boundless, and a law could have others in each release. So what is missed counts as no less than what the fit to all
releases misses, which have one set of parameters.
"""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from sysid.fitting.problem import Problem
from sysid.least_squares import Minimum, Normal, minimise
from sysid.progress import steps
from sysid.roll import Array

PIECES = 3
"""Stretches of one release alone, each of which is predicted from the others."""
_LEAST_SHARE = 1e-9
"""Share of what a fit says of a direction that is left of it in any case [1]: an information stays positive."""


def heldout_residuals(problem: Problem, minimum: Minimum) -> tuple[Array, ...]:
    """Return how each release is missed, predicted without it; of one alone, its second half from its first.

    Roll and rate at a release cannot be predicted, so those are fitted to the release itself. Prediction minus measurement
    [rad or rad/s], shape (n,) for each release.
    """
    if len(problem.records) == 1:
        return (_forecast(problem, minimum),)
    return tuple(_left_out(problem, minimum, index) for index in steps(range(len(problem.records))))


def surprising_residuals(problem: Problem, minimum: Minimum) -> tuple[Array, ...]:
    """Return the prediction errors of each release that the open parameters of the others cannot explain; of one release alone, of each third of it.

    Prediction minus measurement [rad or rad/s], shape (n,) for each release.
    """
    together = problem.residuals(minimum.point)
    if len(problem.records) == 1:
        predicted = [_interrupted(problem, minimum, together[0])]
    else:
        predicted = [_within_noise(problem, minimum, index, t) for index, t in enumerate(together)]
    with np.errstate(all="ignore"):  # a prediction that ran away is worse than any fit
        return tuple(t if t @ t > p @ p else p for p, t in zip(predicted, together, strict=True))


def _training(problem: Problem, point: Array, index: int) -> tuple[Problem, Array]:
    """Return the problem of all releases but one, and the same point in it."""
    return problem.of([i for i in range(len(problem.records)) if i != index], point)


def _left_out(problem: Problem, minimum: Minimum, index: int) -> Array:
    """Fit the physics to the other releases, then only roll and rate at release to this one."""
    training, start = _training(problem, minimum.point, index)
    known = {**problem.fixed, **training.parameters(training.fitted(start, 10, 1e-5).point)}
    held = problem.with_(records=[problem.records[index]], fixed=known, average=1)
    return held.residuals(held.fitted(problem.own(minimum.point)[index], 12, 1e-7).point)[0]


def _forecast(problem: Problem, minimum: Minimum) -> Array:
    """Fit the first half of the motion and predict the second."""
    record = problem.records[0]
    half = len(record.time) // 2
    first = replace(record, time=record.time[:half], signal=record.signal[:half])
    training = problem.with_(records=[first])
    return problem.residuals(training.fitted(minimum.point, 25, 1e-7).point)[0][half:]


def _within_noise(problem: Problem, minimum: Minimum, index: int, together: Array) -> Array:
    """Predict one release by physics that may move as far as the noise on the others leaves it open.

    What the fit to all releases misses of it is known `together`, shape (n,).
    """
    training, start = _training(problem, minimum.point, index)
    held, point = problem.with_(priors={}, smoothing=()).of([index], minimum.point)
    here, shared = held.normal(point), len(problem.names)
    there = _without(minimum.normal, here, problem.places[index][0], shared)
    fitted = training.fitted(start, 10, known=there)
    known = np.zeros((len(point), len(point)))
    known[:shared, :shared] = _information(fitted, start, there, shared)
    return _predicted(held, np.r_[fitted.point[:shared], point[shared:]], known, point, here, together)


def _without(whole: Normal, part: Normal, where: npt.NDArray[np.intp], shared: int) -> Normal:
    """Return normal equations of all releases without those of one, whose unknowns are at `where`, the shared ones first."""
    gradient, hessian = whole.gradient.copy(), whole.hessian.copy()
    gradient[where] -= part.gradient
    hessian[np.ix_(where, where)] -= part.hessian
    kept = np.setdiff1d(np.arange(len(gradient)), where[shared:])
    return Normal(whole.cost - part.cost, gradient[kept], hessian[np.ix_(kept, kept)])


def _interrupted(problem: Problem, minimum: Minimum, together: Array) -> Array:
    """Predict each stretch of one release from what is before and after it, on one motion through all of it.

    The first eighth of a period stays: where the motion starts cannot be predicted.
    """
    count = len(problem.observed[0])
    first = int(
        np.searchsorted(problem.records[0].time[:: problem.average], np.pi / 4 / problem.scales.frequency)
    )
    missed = together.copy()
    for begin, end in itertools.pairwise(np.linspace(first, count, PIECES + 1).astype(int)):
        hidden = np.zeros(count)
        hidden[begin:end] = 1.0
        training = problem.with_(weights=[1.0 - hidden])
        there = training.normal(minimum.point)
        fitted = training.fitted(minimum.point, 15, known=there)
        known = _information(fitted, minimum.point, there, len(fitted.point))
        held = problem.with_(weights=[hidden])
        here = held.normal(minimum.point)
        missed[begin:end] = _predicted(held, fitted.point, known, minimum.point, here, together)[begin:end]
    return missed


def _information(fitted: Minimum, start: Array, there: Normal, count: int) -> Array:
    """Return the inverse covariance of the first unknowns of a fit, whatever the others are, shape (count, count).

    A rough cost is steeper at its least than it is wide: towards where the fit began, at `start`, shape (p,), it rises by no more
    than it is higher `there`. Of other directions it says what it said.
    """
    hessian = fitted.normal.hessian
    inner, mixed, other = hessian[:count, :count], hessian[:count, count:], hessian[count:, count:]
    known = inner - mixed @ np.linalg.pinv(other) @ mixed.T
    off = (start - fitted.point)[:count]
    slope = known @ off
    rise, real = 0.5 * float(off @ slope), there.cost - fitted.normal.cost
    if not rise > 0:
        return known
    share = np.clip(real / rise, _LEAST_SHARE, 1.0)  # a search may end where it is no lower
    return known - (1 - share) / (2 * rise) * np.outer(slope, slope)


def _predicted(
    problem: Problem, expected: Array, known: Array, point: Array, here: Normal, together: Array
) -> Array:
    """Return what is missed of one release by a motion that stays within what is known of its unknowns.

    Args:
        expected: Its unknowns as the others have them, in units of their sizes, shape (p,).
        known: Inverse covariance of these, shape (p, p).
        point: The unknowns that fit all releases: a start in the right valley where the others leave that open.
        together: What is missed there, shape (n,).
    """

    def with_others(here: Normal, point: Array) -> Normal:
        off = point - expected
        return Normal(
            here.cost + 0.5 * float(off @ known @ off), here.gradient + known @ off, here.hessian + known
        )

    def search(start: Array, begin: Normal | None = None) -> Minimum:
        return minimise(
            lambda p: with_others(problem.normal(p), p), start, *problem.bounds(), iterations=12, tolerance=problem.unnoticed, known=begin,
        )  # fmt: skip

    begin = with_others(here, point)
    found = search(point, begin)
    if begin.cost - found.normal.cost <= problem.unnoticed(begin.cost) * begin.cost:
        return (
            together  # what fits all releases is what the others and this one say, as for all that is linear
        )
    found = min(found, search(expected), key=lambda m: m.normal.cost)
    return problem.residuals(found.point)[0]


def rms(residuals: Sequence[Array]) -> float:
    """Return the root mean square of residuals, shape (n,) each, all samples alike [their unit]."""
    return float(np.sqrt(np.mean(np.concatenate(residuals) ** 2)))
