"""Segments of shrinking swings: free decays, separated from motions of a hand.

The swings of a free decay lie between turning points. Each is shorter than the one before; all have the same rest
angle and the same pace. A hand that lifts the deck moves away from that angle, at another pace, or makes swings that grow.
"""

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress, pairwise

import numpy as np
import numpy.typing as npt

from sysid.quantity import SURE
from sysid.releases.extrema import HalfCycle, SmoothedSignal

SMALLEST = 0.1
"""Smallest first swing of a release, over that of the largest release, and of that one over the range of the log."""
MANY = 6
"""So many swings at one pace are a decay."""
PACE = 2.8
"""Largest ratio of the durations of two swings of a decay. A slider that yields in the first swing only makes the later ones up to
2.5 times as quick. A hand takes three times as long as a deck to lift it."""
AGAIN = 0.12
"""A larger move in the same direction as the swing before, over the first swing, is made by a hand."""
STILL = 0.03
"""A deck that moves by less than this share of the first swing is still; so far may a sensor's zero drift in a swing."""


@dataclass(frozen=True, slots=True)
class Segment:
    """Successive swings that shrink: the skeleton of one free decay."""

    swings: tuple[HalfCycle, ...]
    rest: float
    settles: bool
    """Whether the deck stays at rest after the last swing."""
    after: HalfCycle | None
    """The swing that ends the segment: a hand moves the deck again."""
    driven_until: float | None = None
    """End of the driven motion before [s]."""

    @property
    def pace(self) -> float:
        """10 to 90 % time of a swing [s]."""
        return float(np.median([swing.duration for swing in self.swings[:4]]))

    @property
    def size(self) -> float:
        """Widest amplitude of the first swing about rest [rad]."""
        return max(abs(self.swings[0].origin - self.rest), abs(self.swings[0].target - self.rest))

    @property
    def wide(self) -> list[HalfCycle]:
        """Its swings without the small ones at the end, about the angle at which dry friction holds the deck."""
        return [swing for swing in self.swings if swing.size > AGAIN * self.swings[0].size]


def half_period_of(duration: float) -> float:
    """Return half a period of a swing [s] from its 10 to 90 % time [s]: those of (1 - cos θ) / 2, lightly damped."""
    return duration * math.pi / (2 * math.asin(0.8))


def free_segments(signal: SmoothedSignal, swings: list[HalfCycle]) -> list[Segment]:
    """Return the segments that share one rest angle and one pace."""
    segments = _shrinking_segments(signal, swings)
    if not segments:
        return []
    largest = max(segment.swings[0].size for segment in segments)
    if largest < SMALLEST * float(np.ptp(signal.roll)):
        return []
    segments = [segment for segment in segments if segment.swings[0].size > SMALLEST * largest]
    rows = dict.fromkeys(map(tuple, _same_board(segments, signal).tolist()))
    groups = [list(compress(segments, row)) for row in rows]
    return [_undriven(signal, one) for one in max(groups, key=lambda group: _segment_score(group, signal))]


def _undriven(signal: SmoothedSignal, segment: Segment) -> Segment:
    """Return a segment without the driven swings at its beginning.

    A passive joint loses at least as much of a wide swing as of a small one. First swings that lose less than a quarter of
    the later loss are driven. The first and the last swing give the mean loss and its standard deviation.
    """
    whole = segment.swings[:-2]  # a hand or the end of the log cuts the last ones
    sizes = [swing.size for swing in whole if swing.size > AGAIN * segment.swings[0].size]
    best, cut = SURE, 0
    for first in range(MANY, len(sizes) - MANY):
        last = min(len(sizes) - 1, 2 * first)
        before, after = (sizes[0] - sizes[first]) / first, (sizes[first] - sizes[last]) / (last - first)
        doubt = max(2.0 * signal.noise, _cut_off(signal, whole[0])) * math.sqrt(
            2 / first**2 + 2 / (last - first) ** 2
        )
        if before < 0.25 * after and (after - before) / doubt > best:
            best, cut = (after - before) / doubt, first
    if not cut:
        return segment
    until = float(signal.time[segment.swings[cut].begin])
    return replace(segment, swings=segment.swings[cut:], driven_until=until)


def _segment_score(group: list[Segment], signal: SmoothedSignal) -> tuple[float, float, float]:
    """Rank a group of segments: by its swings beyond the first ones, then by the visits of its rest angle, then by its pace.

    A hand makes one swing and stays; a joint comes back to one rest.
    """
    room = max(5.0 * signal.noise, 0.1 * group[0].size)
    rests = np.array([one.rest for one in group])
    there = [bool(np.any(np.abs(level - rests) < room)) for level in signal.levels]
    visits = sum(now and not before for before, now in pairwise([False, *there]))
    return (
        sum(swing.size > signal.min_movement for one in group for swing in one.wide[1:]),
        visits,
        -float(np.median([one.pace for one in group])),
    )


def _same_board(segments: Sequence[Segment], signal: SmoothedSignal) -> npt.NDArray[np.bool_]:
    """Return which of n segments have the same rest angle and the same pace, shape (n, n).

    Many swings at one pace are a decay; their rest angle may have moved, with a sensor or with rubber, by any amount.
    """
    many = np.array([len(one.swings) >= MANY for one in segments])
    size, rest = np.array([(one.size, one.rest) for one in segments]).T
    pace = np.array([float(np.median([swing.duration for swing in one.wide[:4]])) for one in segments])
    # Dry friction holds a deck beside its rest; one or two swings show the rest only to half a swing.
    short = [
        0.5 * min(swing.size for swing in one.swings) if len(one.swings) < 3 else 0.0 for one in segments
    ]
    share = np.where(np.logical_and.outer(many, many), np.inf, 0.35 * np.minimum.outer(size, size))
    share = np.maximum(share, np.maximum(np.maximum.outer(short, short), 5.0 * signal.noise))
    ratio = np.divide.outer(pace, pace)
    return (np.abs(np.subtract.outer(rest, rest)) < share) & (ratio > 0.6) & (ratio < 1.6)


def _shrinking_segments(signal: SmoothedSignal, swings: list[HalfCycle]) -> list[Segment]:
    """Split the swings into segments that shrink, each as long as it continues about its own rest angle."""
    segments: list[Segment] = []
    swings = _with_tails(signal, swings)
    begin = 0
    while begin < len(swings):
        finish = begin + 1
        while finish < len(swings) and _continues(signal, swings[begin], swings[finish - 1], swings[finish]):
            finish += 1
        segment = _segment(signal, swings, begin, finish)
        if segment is not None and _begins_at_rest(signal, segment):
            finish = begin + 1
        elif segment is not None:
            segments.append(segment)
            after = segment.after
            finish = (
                len(swings) if after is None else bisect_left(swings, after.begin, key=lambda one: one.begin)
            )
        begin = finish
    return segments


def _begins_at_rest(signal: SmoothedSignal, segment: Segment) -> bool:
    """Whether its first swing leaves the rest, where a joint stays unless a hand lifts or kicks it."""
    first = segment.swings[0]
    return len(segment.swings) > 1 and abs(first.origin - segment.rest) < _room(signal, first, first)


def _with_tails(signal: SmoothedSignal, swings: list[HalfCycle]) -> list[HalfCycle]:
    """Join a swing from a hold and the creep at its end: an overdamped joint returns ever more slowly."""
    joined: list[HalfCycle] = []
    for swing in swings:
        one = joined[-1] if joined else swing
        pause = _pause(signal, one, swing)
        creeps = one.way * swing.way > 0 and swing.size < AGAIN * one.size and pause < one.duration
        if joined and one.from_plateau and creeps:
            joined[-1] = replace(
                one,
                finish=swing.finish,
                reached=swing.reached,
                target=swing.target,
                to_plateau=swing.to_plateau,
            )
        else:
            joined.append(swing)
    return joined


def _continues(signal: SmoothedSignal, first: HalfCycle, one: HalfCycle, other: HalfCycle) -> bool:
    """Whether the next swing is a shorter one back, of about the same pace, and follows without a stay."""
    shorter = other.size < one.size + _room(signal, first, one)
    same = _same_pace(signal, one.duration, other)
    stayed = one.to_plateau or _stays(signal, one, other, PACE * max(one.duration, other.duration))
    return shorter and same and one.way * other.way < 0 and not stayed


def _pause(signal: SmoothedSignal, one: HalfCycle, other: HalfCycle) -> float:
    """Return the time between two swings [s]."""
    return float(signal.time[other.left] - signal.time[one.reached])


def _stays(signal: SmoothedSignal, one: HalfCycle, other: HalfCycle, longest: float) -> bool:
    """Whether a joint stays between two swings for longer than a turning point [s]; noise may delay a small swing."""
    return _pause(signal, one, other) > longest and other.size > 2.0 * signal.min_movement


def _room(signal: SmoothedSignal, first: HalfCycle, one: HalfCycle) -> float:
    """Return by how much the swing after `one` may be longer without a hand [rad], in a segment that begins with `first`.

    The causes are noise, zero drift and coarse sampling.
    """
    return max(6.0 * signal.noise, STILL * first.size, _cut_off(signal, one))


def _cut_off(signal: SmoothedSignal, one: HalfCycle) -> float:
    """Return by how much the largest sample misses a turning point [rad]: `1 - cos(π / 2n)` of a swing with n samples in half a cycle."""
    count = max(half_period_of(one.duration) / float(signal.time[1] - signal.time[0]), 2.0)
    return one.size * (1 - math.cos(math.pi / (2 * count)))


def _same_pace(signal: SmoothedSignal, pace: float, swing: HalfCycle) -> bool:
    """Whether a swing takes about as long as the others; the duration of a small one is unknown."""
    return pace / PACE < swing.duration < PACE * pace or swing.size < 3.0 * signal.min_movement


def _segment(signal: SmoothedSignal, swings: list[HalfCycle], begin: int, finish: int) -> Segment | None:
    """Build the segment of swings `begin` to `finish` - 1 and of all later swings about the same rest angle.

    Returns None if the swings do not show that angle.
    """
    chosen = swings[begin:finish]
    if len(chosen) == 1 and not chosen[0].to_plateau:
        return None
    rest = _rest_angle(chosen)
    longest = PACE * max(swing.duration for swing in chosen[:3])
    # A slow turning point looks like a stay, and near rest a swing may grow by noise: neither ends the segment.
    while finish < len(swings):
        swing = swings[finish]
        homeward = (rest - swing.origin) * swing.way > 0.3 * swing.size**2
        shorter = swing.size < chosen[-1].size + _room(signal, chosen[0], chosen[-1])
        back = swing.way * chosen[-1].way < 0 or swing.size < AGAIN * chosen[0].size
        stayed = _stays(signal, chosen[-1], swing, longest)
        goes_on = (
            homeward and back and shorter and not stayed and _same_pace(signal, chosen[0].duration, swing)
        )
        away = max(swing.size if homeward else 0.0, abs(swing.target - rest))
        if not goes_on and away > 2.0 * signal.min_movement:
            break
        chosen += [swing] if goes_on else []
        finish += 1
    after = swings[finish] if finish < len(swings) else None
    pause = float(signal.time[-1 if after is None else after.left] - signal.time[chosen[-1].reached])
    settles = chosen[-1].to_plateau or pause > longest
    settles = settles or (after is None and chosen[-1].size < 2.0 * signal.min_movement)
    return Segment(tuple(chosen), rest, settles, after)


def _rest_angle(swings: list[HalfCycle]) -> float:
    """Return the angle to which the turning points of a segment converge [rad].

    Three successive turning points of a linear decay give it exactly, `(a c - b²) / (a + c - 2 b)` (Aitken). Wide
    swings have the largest weight. For one or two swings that end at rest it is the last point.
    """
    turns = np.array([swings[0].origin, *(swing.target for swing in swings)])
    if len(turns) == 2 or (len(turns) == 3 and swings[-1].to_plateau):
        return float(turns[-1])
    a, b, c = turns[:-2], turns[1:-1], turns[2:]
    bend = a + c - 2 * b
    return float(np.sum(bend * (a * c - b * b)) / np.sum(bend**2))
