"""The experiment that decides between two fitted laws: the fewest releases that tell them apart at 95 %."""

from dataclasses import dataclass

import numpy as np

from sysid.board import Board
from sysid.diagnosis.evidence import ODDS
from sysid.errors import SysidError
from sysid.fitting.result import JointFit
from sysid.joint.trajectory import simulate
from sysid.text import display

WIDER = 1.5
"""A release may go so many times wider than the widest one in the logs, within the joint's range."""
MOST = 5
"""Releases that one is ready to make."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """Releases that tell two laws apart."""

    angle: float
    """Release angle from rest [rad]."""
    number: int
    duration: float
    """Of each [s]."""
    difference: float
    """Largest difference between the two predictions [rad]."""


def deciding(one: JointFit, other: JointFit, board: Board) -> Experiment | None:
    """Return the release that gains the most odds between two laws, as few as decide; None where `MOST` would not.

    The expected gain of log odds is half the squared difference of the predictions over the noise. The start of the new release is
    fitted too, so that only the difference beside it counts. The error that the better law leaves counts as noise.
    """
    record = one.records[0]
    seen = max(float(np.abs(r.release.roll - r.release.rest).max()) for r in one.records)
    limit = min(WIDER * seen, max(board.tilt["range"].value, seen) if "range" in board.tilt else WIDER * seen)
    time = np.arange(0.0, float(max(r.time[-1] for r in one.records)), float(np.median(np.diff(record.time))))
    noise = max(one.rmse, one.noise.std)
    possible = {*(abs(r.release.roll[0] - r.release.rest) for r in one.records), limit}
    found: list[Experiment] = []
    for angle in possible:
        for side in (1.0, -1.0):
            try:
                first, second = (
                    simulate(fit.law, time, fit.law.rest_angle + side * float(angle)) for fit in (one, other)
                )
            except SysidError:
                continue
            a, b = (first.rate, second.rate) if record.is_rate else (first.roll, second.roll)
            own = np.column_stack([a - (0.0 if record.is_rate else one.law.rest_angle), np.gradient(a, time)])
            apart = a - b - own @ np.linalg.lstsq(own, a - b, rcond=None)[0]
            odds = 0.5 * float(apart @ apart) / noise**2
            number = int(np.ceil(np.log(ODDS) / max(odds, 1e-9)))
            if number <= MOST:
                found.append(
                    Experiment(
                        float(side * angle),
                        number,
                        float(time[-1]),
                        float(np.abs(first.roll - second.roll).max()),
                    )
                )
    return min(found, key=lambda e: (e.number, abs(e.angle)), default=None)


def in_words(found: Experiment | None, one: str, other: str, board: Board) -> str:
    """Return an experiment as a sentence."""
    if found is None:
        return f"No release of up to {MOST} decides between {one} and {other}."
    show = display(is_rate=False, slides=board.slides)
    times = "Release once" if found.number == 1 else f"Release {found.number} times"
    side = "positive" if found.angle > 0 else "negative"
    return (
        f"{times} from {show.scale * abs(found.angle):.3g}{show.unit} to the {side} side and record {found.duration:.2g} s: {one} and "
        f"{other} then differ by up to {show(found.difference, 2)}, which decides at 95 %."
    )
