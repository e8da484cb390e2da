"""Phases of a log: rest, a hand that holds or catches the deck, and free decays."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sysid.releases.chains import STILL
from sysid.releases.extrema import half_cycles_of, smoothed
from sysid.releases.find import settled_between, within
from sysid.roll import Release, Roll

Kind = Literal["rest", "held", "free", "caught"]


@dataclass(frozen=True, slots=True)
class Phase:
    """A stretch of the log of one kind."""

    start: float
    """[s] on the log's clock."""
    end: float
    """[s] on the log's clock."""
    kind: Kind


def log_phases(roll: Roll, releases: Sequence[Release]) -> list[Phase]:
    """Return the phases of a log without gaps, from its first sample to its last.

    Between two decays the deck is at rest. It is held from the time at which it last leaves the rest angle. After a
    catch it is caught until it rests or is held for the next release. With dry friction it may rest anywhere between
    the final levels of the decays before and after.
    """
    ends: list[tuple[float, Kind]] = []
    begin = done = float(roll.time[0])
    caught = False
    for i, release in enumerate(releases):
        near = releases[max(i - 1, 0) : max(i - 1, 0) + 2]
        ends += _between(roll, (done, release.start), release, near, caught, release.hold)
        done, caught = float(release.time[-1]), release.end == "caught"
        ends.append((settling_time(release), "free"))
        ends.append((done, "rest"))
    if releases:
        ends += _between(roll, (done, float(roll.time[-1])), releases[-1], releases[-2:], caught, 0.0)
    phases: list[Phase] = []
    for end, kind in ends:
        if end - begin <= 1e-9:
            continue
        if phases and phases[-1].kind == kind:
            begin = phases.pop().start
        phases.append(Phase(begin, end, kind))
        begin = end
    return phases


def settling_time(release: Release) -> float:
    """Return when the deck came to rest [s]; the end of the stretch if it did not."""
    if release.end != "rest":
        return float(release.time[-1])
    signal = smoothed(release)
    swings = half_cycles_of(signal)
    last = swings[-1].reached if swings else 0
    return settled_between(signal, last, len(signal.time) - 1, release.amplitude)[0]


def _between(
    roll: Roll,
    span: tuple[float, float],
    release: Release,
    near: Sequence[Release],
    caught: bool,
    hold: float,
) -> list[tuple[float, Kind]]:
    """Return end [s] and kind of the phases between two decays."""
    begin, finish = span
    inside = within(roll.time, begin, finish)
    rests = [other.rest for other in near]
    time, angle = roll.time[inside], roll.roll[inside]
    offset = np.abs(angle - np.clip(angle, min(rests), max(rests)))
    band = max(3.0 * float(np.median(release.std)), STILL * release.amplitude)
    level = time[offset < band]
    if len(level) == 0 or level[-1] - level[0] < 0.05 * (finish - begin):
        return [(finish - hold if caught else begin, "caught"), (finish, "held")]
    return [(float(level[0]), "caught" if caught else "held"), (float(level[-1]), "rest"), (finish, "held")]
