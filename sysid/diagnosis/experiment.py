"""The experiment that would decide between two models: the fewest releases that tell them apart at 95 %."""

from dataclasses import dataclass

import numpy as np

from sysid.board import Board
from sysid.diagnosis.error_model import Fitted
from sysid.diagnosis.search import Candidate
from sysid.errors import SysidError
from sysid.joint.law import JointLaw
from sysid.joint.trajectory import simulate

DECIDED = float(np.log(19.0))
"""Log of the odds at 95 %."""
ANGLES = np.radians([0.2, 0.5, 1, 2, 3, 5, 7, 10, 12, 15, 20, 30, 45, 60, 75, 90, 120, 150])
"""Release angles that a person can set, smallest first [rad]."""
CLEAR, SMALL, WIDE = 50.0, 0.25, 1.5
"""Release angles run from the larger of so many times the noise and that share of the largest tilt seen, to so many times that tilt,
as far as the joint is known to go so far."""
UNKNOWN = 3.14
"""Range of a joint whose record knows none [rad]: half a turn to either side."""
MOST = 5
"""Releases that one is ready to make."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """Releases that tell two models apart."""

    angle: float
    """Release angle from rest, negative for the left edge down [rad]."""
    number: int
    duration: float
    """Of each [s]."""
    difference: float
    """Largest difference between the two predictions [rad]."""


def widest(one: Candidate, board: Board) -> float:
    """Return from how far a deck may be let go [rad]: within its range, or as far as the logs show that it goes."""
    seen = one.problem.scales.amplitude
    known = board.tilt["range"].value if "range" in board.tilt else UNKNOWN
    return min(WIDE * seen, max(known, seen)) if known < UNKNOWN else seen


def deciding(one: Candidate, other: Candidate, errors: Fitted, limit: float) -> Experiment | None:
    """Return the fewest releases that decide between two fitted models, from the smallest angle that does; None if there are none.

    Args:
        one: Taken for true.
        other: Its rival, as fitted.
        errors: Of the sensor, and how far the better model is from exact.
        limit: Widest angle of a release [rad].
    """
    laws = [_law(model) for model in (one, other)]
    record, seen = one.problem.records[0], one.problem.scales.amplitude
    step = one.problem.average * float(np.median(np.diff(record.time)))  # the errors are those of such means
    duration = float(max(r.time[-1] for r in one.problem.records))
    time = np.arange(0.0, duration, step)
    period = 2 * np.pi / one.problem.scales.frequency
    noise = record.std / (one.problem.scales.frequency if record.is_rate else 1.0)
    lowest = max(CLEAR * noise, SMALL * seen)
    possible = ANGLES[(lowest <= ANGLES) & (limit >= ANGLES)]
    found: list[Experiment] = []
    for angle in possible if len(possible) else np.array([seen]):
        for side in (1.0, -1.0):
            rest = laws[0].rest_angle
            try:
                first, second = (simulate(law, time, rest + side * float(angle)) for law in laws)
            except SysidError:
                continue
            pairs = (first.rate, second.rate) if record.is_rate else (first.roll, second.roll)
            missed = pairs[0] - pairs[1]
            swing = float(angle) * np.exp(-time / max(duration / 3, 1e-9))
            white = errors.white**2 + (errors.jitter * np.gradient(pairs[0], step)) ** 2
            per_block = max(
                1.0, period / step / 4
            )  # samples that are wrong together where a model is not exact
            variance = white + per_block * ((errors.discrepancy * swing) ** 2 + errors.coloured**2)
            # From how far, and when, it will have been let go is fitted to the new release: only what that leaves decides.
            mean = 0.0 if record.is_rate else rest
            own = np.column_stack([pairs[0] - mean, np.gradient(pairs[0], step)])
            apart, *own = np.column_stack([missed, own]).T / np.sqrt(np.maximum(variance, 1e-300))
            fitted = np.linalg.lstsq(np.array(own).T, apart, rcond=None)[0]
            odds = 0.5 * float(np.sum((apart - fitted @ np.array(own)) ** 2))
            number = int(np.ceil(DECIDED / max(odds, 1e-9)))
            if number <= MOST:
                largest = float(np.abs(first.roll - second.roll).max())
                loud = np.flatnonzero(np.abs(first.roll - rest) > 0.02 * angle)
                lasts = float(time[loud[-1]]) if len(loud) else duration
                found.append(Experiment(float(side * angle), number, lasts, largest))
    return min(found, key=lambda e: (e.number, abs(e.angle)), default=None)


def _law(model: Candidate) -> JointLaw:
    problem = model.problem
    return JointLaw.from_vector(problem.structure, problem.vector_of(problem.parameters(model.minimum.point)))
