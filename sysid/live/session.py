"""State of a live measurement: releases, stiffness and damping so far, and which release would help most."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid.board import Board
from sysid.errors import SysidError
from sysid.free_decay import FreeDecay, fit_decay
from sysid.recording import Recording
from sysid.roll import Release
from sysid.text import DEGREES, display

EACH_SIDE = 3
"""Releases from each side that a diagnosis is well served with: one of them can be left out and two remain."""
AMPLITUDE_RATIO = 3.0
"""Least ratio of the widest to the smallest first amplitude, to show effects of the amplitude."""
BEGINNING = 0.3
"""Stretch at the beginning of a log before anybody touches the deck [s]."""
SAME_REST = 0.4
"""Share of an amplitude by which two rest levels may differ: friction makes less, a hand that holds the deck all of it."""
DEFAULT_ANGLE = np.radians(10.0)
"""Angle of the first release [rad]."""
_NUMBERS = ("no", "one", "two", "three")


@dataclass(slots=True)
class Session:
    """A measurement that grows."""

    board: Board
    releases: list[Release] = field(default_factory=list[Release])
    """The free decays that have ended."""
    decay: FreeDecay | None = None
    """Of all of them."""
    trouble: str = ""
    """Why they have no numbers."""

    def take(self, recordings: Sequence[Recording]) -> dict[int, Release]:
        """Take all logs read so far, and return the releases that have ended since, by their numbers."""
        found = [release for recording in recordings for release in _ended(recording)]
        known = {(release.log, round(release.start, 1)) for release in self.releases}
        new = {
            number: release
            for number, release in enumerate(found, 1)
            if (release.log, round(release.start, 1)) not in known
        }
        if not new:
            return new
        self.releases = found
        try:
            self.decay, self.trouble = fit_decay(found, board=self.board), ""
        except SysidError as error:
            self.trouble = str(error)
        return new

    @property
    def next_step(self) -> str:
        """Which release would help most, in words; or that there are enough."""
        return next_release(self.releases, self.board)


def _ended(recording: Recording) -> list[Release]:
    """Return the free decays of a log that is still being written, without a hand that has tilted the deck and holds it.

    That looks like a decay to where the deck is held, until it is let go. A decay ends where the others do, or where the
    deck was when the log began.
    """
    roll = recording.roll
    begun = float(np.median(roll.roll[roll.time < roll.time[0] + BEGINNING]))
    level = float(np.median([begun, *(release.rest for release in recording.releases)]))
    return [r for r in recording.releases if abs(r.rest - level) < SAME_REST * r.amplitude]


def next_release(releases: Sequence[Release], board: Board) -> str:
    """Return which release would help most: from which side, and from how far."""
    show = display(is_rate=False, slides=board.slides)
    names = (
        {"right": "right", "left": "left"}
        if board.geometry
        else {"right": "positive side", "left": "negative side"}
    )
    counts = {side: sum(r.side == side for r in releases) for side in names}
    side = min(counts, key=lambda name: counts[name])
    needed = EACH_SIDE - counts[side]
    sizes = [r.amplitude for r in releases]
    if not sizes:
        wide = f"{0.5 * board.tilt['range'].value * show.scale if board.slides else DEGREES * DEFAULT_ANGLE:.2g}{show.unit}"
        if board.geometry:
            return f"Hold the deck still at {wide}, {side} edge down, let go, and leave it until it rests."
        return f"Hold the joint still {wide} from its rest, let go, and leave it until it rests."
    widest, smallest = max(sizes), min(sizes)
    small = f"{float(f'{show.scale * widest / AMPLITUDE_RATIO:.1g}'):g}{show.unit}"
    if needed > 0:
        angle = small if widest < AMPLITUDE_RATIO * smallest else show(widest, 2)
        return f"{_NUMBERS[needed].capitalize()} more from the {names[side]}, from {angle}."
    if widest < AMPLITUDE_RATIO * smallest:
        return f"One more from {small}: all so far were about as wide, and what grows with amplitude does not show."
    return "Enough for a diagnosis; more releases make it surer."
