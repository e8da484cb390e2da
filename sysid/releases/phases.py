"""Phases of a log: rest, a hand that holds or catches the deck, and free decays."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sysid.releases.chains import STILL
from sysid.releases.extrema import half_cycles_of, smoothed
from sysid.releases.find import settled_between
from sysid.roll import Release, Roll


@dataclass(frozen=True, slots=True)
class Phase:
    """A stretch of the log of one kind."""

    start: float
    """[s] on the log's clock."""
    end: float
    """[s] on the log's clock."""
    kind: Literal["rest", "held", "free", "caught"]


def log_phases(roll: Roll, releases: Sequence[Release]) -> list[Phase]:
    """Return the phases of a log without gaps, from its first sample to its last.

    Between two decays the deck is at rest. It is held from the time at which it last leaves the rest angle. After a
    catch it is caught until it rests or is held for the next release. With dry friction it may rest anywhere between
    the final levels of the decays before and after.
    """
    phases: list[Phase] = []
    done, caught = float(roll.time[0]), False
    for i, release in enumerate(releases):
        near = releases[max(i - 1, 0) : max(i - 1, 0) + 2]
        phases += _between(roll, done, release.start, release, near, caught, release.hold)
        settled = settling_time(release)
        phases.append(Phase(release.start, settled, "free"))
        done, caught = float(release.time[-1]), release.end == "caught"
        phases.append(Phase(settled, done, "rest"))
    if releases:
        phases += _between(roll, done, float(roll.time[-1]), releases[-1], releases[-2:], caught, 0.0)
    return _merged(phases)


def settling_time(release: Release) -> float:
    """Return when the deck came to rest [s]; the end of the stretch if it did not."""
    if release.end != "rest":
        return float(release.time[-1])
    signal = smoothed(release)
    swings = half_cycles_of(signal)
    return settled_between(
        signal, swings[-1].reached if swings else 0, len(signal.time) - 1, release.amplitude
    )[0]


def _between(
    roll: Roll,
    begin: float,
    finish: float,
    release: Release,
    near: Sequence[Release],
    caught: bool,
    hold: float,
) -> list[Phase]:
    """Split the time between two decays into phases of hand and rest."""
    inside = slice(int(np.searchsorted(roll.time, begin)), int(np.searchsorted(roll.time, finish, "right")))
    rests = [other.rest for other in near]
    time, angle = roll.time[inside], roll.roll[inside]
    offset = np.abs(angle - np.clip(angle, min(rests), max(rests)))
    band = max(3.0 * float(np.median(release.std)), STILL * release.amplitude)
    level = np.flatnonzero(offset < band)
    if len(level) == 0 or time[level[-1]] - time[level[0]] < 0.05 * (finish - begin):
        held = finish - hold if caught else begin
        return [Phase(begin, held, "caught"), Phase(held, finish, "held")]
    first, last = float(time[level[0]]), float(time[level[-1]])
    return [
        Phase(begin, first, "caught" if caught else "held"),
        Phase(first, last, "rest"),
        Phase(last, finish, "held"),
    ]


def _merged(phases: Sequence[Phase]) -> list[Phase]:
    """Drop empty phases and join equal neighbours."""
    merged: list[Phase] = []
    for phase in phases:
        if phase.end - phase.start <= 1e-9:
            continue
        if merged and merged[-1].kind == phase.kind:
            merged[-1] = Phase(merged[-1].start, phase.end, phase.kind)
        else:
            merged.append(phase)
    return merged
