"""Where a log is at rest, held by a hand, let go, swinging freely, and caught again.

Decays are told from what a hand does by the turning points alone (`sysid.releases.chains`), so no threshold
on angle or rate is needed, and the first sample may already be in the middle of a decay.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Literal

import numpy as np

from sysid.errors import SysidError
from sysid.releases.chains import SHARE_OF_HALF, Segment, free_segments, given_segment, segments_after_hands
from sysid.releases.extrema import HalfCycle, SmoothedSignal, crossing_time, half_cycles_of, smooth_signal
from sysid.releases.hand import Span, free_spans
from sysid.roll import Release, Roll
from sysid.text import display

STILL = 0.03
"""A deck within this share of the first amplitude counts as held still."""
FEWEST_SAMPLES = 8
"""Samples of a decay."""
COARSE = 0.5
"""Share of all the motion from which a step between neighbours tells of noise alone or of too few samples: a sine goes that far in one
where it has fewer than six a swing."""
FELT = 0.15
"""Periods for which a hand that catches a deck is felt before it is seen: up to 20 ms of a swing of 0.2 s in random logs."""
STUCK = 0.03
"""Share of a swing by which it may differ from half a cosine to where dry friction holds the deck: a choice."""
SETS_OFF = 0.25
"""Share of a hold, at its end, in which a hand may already set off or let go: a choice."""
_End = Literal["rest", "caught", "log"]
_Seen = tuple[float, float, float, _End]


def find_releases(
    roll: Roll, *, start: float | None = None, stop: float | None = None, releases: Sequence[float] = ()
) -> list[Release]:
    """Find every free decay in a log.

    Args:
        roll: The whole log.
        start: Look from here on only [s].
        stop: Look up to here only [s].
        releases: Times at which the deck was let go [s], instead of finding them; where each decay
            ends is still found.

    Returns:
        The free decays in order of time, at least one.

    Raises:
        SysidError: There is no free decay, or a time lies outside the log.
    """
    part = _cut(roll, start, stop)
    std = float(np.median(part.std))
    signal = smooth_signal(part.time, part.roll, std if math.isfinite(std) else 0.0)
    swings = half_cycles_of(signal)
    if not swings:
        show = display(is_rate=False, slides=roll.slides)
        raise SysidError(
            f"{roll.log}: nothing moves by more than {show(signal.min_movement, 2)} (noise {show(signal.noise, 2)}), so there is no decay. {_coarse(part)}"
            "Is it the right column (--column) and the right stretch of the log (--from, --to)?"
        )
    if releases:
        segments = [given_segment(signal, swings, time, roll.log) for time in sorted(releases)]
        for (one, a), (other, b) in pairwise(zip(segments, sorted(releases), strict=True)):
            if one.swings[0] == other.swings[0]:
                left = signal.time[one.swings[0].left]
                raise SysidError(
                    f"{roll.log}: {a:.6g} and {b:.6g} s are times of one release: the deck has left the hold by {left:.4g} s. "
                    "Give one of them."
                )
    else:
        segments = free_segments(signal, swings)
    seen, free = _spans(signal, segments) if segments else ([], [])
    if segments and not releases:
        after = segments_after_hands(signal, swings, segments, [span.end for span in free])
        if len(after) > len(segments):
            again, spans = _spans(signal, after)
            # No hand stands between two decays that overlap: what looked like one was the noise's.
            if all(a.end <= b.begin < b.end for a, b in pairwise(spans)):
                segments, seen, free = after, again, spans
    found: list[Release] = []
    for segment, one, span in zip(segments, seen, free, strict=True):
        release = _release(part, signal, segment, len(found) + 1, one, span)
        if releases or len(release.time) >= FEWEST_SAMPLES:  # else hands have left nothing of it
            found.append(release)
    if not found:
        raise SysidError(
            f"{roll.log}: it moves, but no stretch swings freely to rest. Give the times at which the deck "
            "was let go (--release), or the stretch to look at (--from, --to)."
        )
    return found


def _coarse(roll: Roll) -> str:
    """Return the doubt that a roll is sampled too slowly, as a sentence; '' where it is not."""
    step = float(np.abs(np.diff(roll.roll)).max())
    if not step > COARSE * float(np.ptp(roll.roll)):
        return ""
    return (
        f"Neighbouring samples differ by up to {display(is_rate=False, slides=roll.slides)(step, 2)}, nearly as much as all of it: if it swings, "
        f"{roll.sampling_rate:.3g} Hz may be too low. "
    )


def _spans(signal: SmoothedSignal, segments: Sequence[Segment]) -> tuple[list[_Seen], list[Span]]:
    """Return what the turning points say of each segment, and what is left of it without a hand."""
    limits = [signal.time[one.swings[0].left] if one.start is None else one.start for one in segments[1:]]
    seen = [_seen(signal, segment, limit) for segment, limit in zip(segments, [*limits, None], strict=True)]
    spans = [
        Span(
            begin, finish, segment.rest, segment.swings[0].origin,
            tuple((float(signal.time[swing.finish]), swing.size) for swing in segment.swings),
        )
        for (begin, _, finish, _), segment in zip(seen, segments, strict=True)
    ]  # fmt: skip
    # A hand that pushes makes the first swing last.
    later = [swing.duration for segment in segments for swing in segment.wide[1:4] or segment.wide]
    period = 2 * float(np.median(later)) / SHARE_OF_HALF
    return seen, free_spans(signal, spans, period)


def _cut(roll: Roll, start: float | None, stop: float | None) -> Roll:
    """Return the part of the log between two times, on the same clock."""
    begin, end = float(roll.time[0]), float(roll.time[-1])
    low, high = begin if start is None else start, end if stop is None else stop
    inside = (roll.time >= low) & (roll.time <= high)
    if np.count_nonzero(inside) < FEWEST_SAMPLES:
        raise SysidError(
            f"{roll.log}: {np.count_nonzero(inside)} samples between {low:.6g} s and {high:.6g} s; the log runs "
            f"from {begin:.6g} s to {end:.6g} s. A decay needs at least {FEWEST_SAMPLES} samples."
        )
    return roll if inside.all() else roll[inside]


def _seen(signal: SmoothedSignal, segment: Segment, limit: float | None) -> _Seen:
    """Return when the deck left its hold, how long it was held, when the decay ends [s], and why, by its turning points."""
    begin, hold = _let_go(signal, segment)
    finish, end = _ending(signal, segment, begin)
    if limit is not None and limit <= finish:
        finish, end = float(np.nextafter(limit, -math.inf)), "caught"
    return begin, hold, finish, end


def _release(
    roll: Roll, signal: SmoothedSignal, segment: Segment, number: int, seen: _Seen, free: Span
) -> Release:
    """Cut one free decay out of the log."""
    begin, hold, finish, end = seen
    still = min(hold, finish - begin)  # as much as there is of the decay is enough
    before = (roll.time >= begin - still) & (roll.time <= begin - SETS_OFF * still)
    held = roll[before] if still > 0 else None
    if segment.start is None and free.begin > begin:
        begin, hold = free.begin, 0.0  # a hand pushed it on its way: it starts from no hold
    if free.end < finish:
        last = signal.roll[(signal.time >= free.end - segment.half_period) & (signal.time <= free.end)]
        finish, end = free.end, "rest" if np.ptp(last) < STILL * segment.sizes[0] else "caught"
    if end == "caught":
        finish -= FELT * min(2 * segment.half_period, finish - begin)
    inside = (roll.time >= begin - 1e-9) & (roll.time <= finish + 1e-9)
    rest = segment.rest
    if end == "rest":
        last = signal.roll[(signal.time >= finish - segment.pace) & (signal.time <= finish)]
        rest = (
            float(np.median(last)) if last.size else segment.rest
        )  # where a sample lasts longer than a swing
    return Release.of(roll[inside], number=number, rest=rest, hold=hold, end=end, held=held)


def _let_go(signal: SmoothedSignal, segment: Segment) -> tuple[float, float]:
    """Return when the deck was let go and how long it had been held still before [s]."""
    swing = segment.swings[0]
    width = max(5, round(0.25 * segment.pace / float(signal.time[1] - signal.time[0])))
    wide = np.pad(signal.roll[: swing.left + 1], (width // 2, width - 1 - width // 2), "edge")
    before = np.convolve(wide, np.ones(width) / width, "valid")
    still = np.abs(before - swing.origin) <= max(3.0 * signal.noise, STILL * segment.sizes[0])
    last = int(np.flatnonzero(still)[-1]) if still.any() else swing.left
    moving = np.flatnonzero(~still[:last])
    since = int(moving[-1]) + 1 if len(moving) else 0
    # Where friction holds it, later swings are small and quick: the first one tells how long a turning point lasts.
    if signal.time[last] - signal.time[since] < 0.5 * max(segment.pace, swing.duration):
        found = _onset(signal, swing, swing.origin) if swing.begin else float(signal.time[0])
        return found if segment.start is None else segment.start, 0.0
    found = _onset(signal, swing, float(np.median(before[since : last + 1])))
    begin = found if segment.start is None else segment.start
    moving = begin > found + signal.time[1] - signal.time[0]
    return begin, 0.0 if moving else begin - float(signal.time[since])


def _onset(signal: SmoothedSignal, swing: HalfCycle, level: float) -> float:
    """Return when a swing left its level [s].

    Released from rest, the square root of the way gone is a power series in time, so time is one in that
    root. Fitted between 8 and 40 % of the way, clear of noise and smoothing, two terms come out early and
    three late; mixed as here they are right to 0.3 % of a period for ζ from 0.02 to 0.8.
    """
    side = math.copysign(1.0, swing.target - swing.origin)
    way = side * (signal.roll[swing.left : swing.finish + 1] - level)
    time = signal.time[swing.left : swing.finish + 1]
    size = abs(swing.target - level)
    shares = np.linspace(max(0.08, min(0.3, 3.0 * signal.noise / size)), 0.4, 14)
    times = np.array([crossing_time(time, way, share * size) for share in shares])
    series = np.vander(np.sqrt(shares), 3, increasing=True)
    two, three = (np.linalg.lstsq(series[:, :terms], times, rcond=None)[0][0] for terms in (2, 3))
    start = float(0.35 * two + 0.65 * three)
    return min(max(start, float(signal.time[swing.left]) - swing.duration), float(times[0]))


def _ending(signal: SmoothedSignal, segment: Segment, begin: float) -> tuple[float, _End]:
    """Return when the free decay ends [s], and why."""
    last = segment.swings[-1]
    stop = len(signal.time) - 1 if segment.after is None else segment.after.left
    if segment.after is None and not segment.settles:
        return float(signal.time[-1]), "log"
    if _last_swing_is_cut(signal, segment):
        return _followed(signal, segment, last.begin), "caught"
    if segment.settles:
        settled, leaves = settled_between(signal, last.reached, stop, segment.sizes[0])
        tail = max(4.0 * segment.pace, 0.5 * (settled - begin))
        if segment.after is not None:  # a hand is felt before it is seen
            leaves -= max(0.5 * segment.pace, 0.25 * (leaves - settled))
        return max(settled, min(settled + tail, leaves)), "rest"
    return _followed(signal, segment, last.finish), "caught"


def _last_swing_is_cut(signal: SmoothedSignal, segment: Segment) -> bool:
    """Whether the last swing ends where no free deck would: held away from rest, taken there, or braked far too much."""
    sizes, still = segment.sizes, 3.0 * signal.noise
    if len(segment.swings) < 3:
        return len(sizes) > 2 and segment.settles and sizes[-1] > 0.3 * sizes[0] + still
    # Dry friction that takes 2 F/k off each swing can hold the deck up to F/k beside the middle of the last of them.
    turns = np.array([swing.target for swing in segment.swings[-4:]])
    middle = float(np.mean(turns[-3:-1] + turns[-4:-2]) / 2) if len(turns) == 4 else segment.rest
    *before, last = -np.diff(np.abs(turns - middle))
    usual = max(0.0, *before)
    final = segment.swings[-1]  # no free deck jumps from where it stays to where it stays again
    taken = final.from_plateau and final.to_plateau and final.duration < 0.2 * segment.pace
    taken = taken and final.size > still
    held = segment.settles and abs(turns[-1] - middle) > 0.65 * usual + still + 0.01 * sizes[0]
    braked = last > 1.6 * usual + signal.min_movement
    return taken or ((held or braked) and not _stands_at_its_turn(signal, segment))


def _stands_at_its_turn(signal: SmoothedSignal, segment: Segment) -> bool:
    """Whether the last swing is half a cosine to where the deck then stays: dry friction holds it there, and no hand has taken it."""
    turn, target, half = segment.swings[-1].begin, segment.swings[-1].target, segment.half_period
    later = signal.time[turn:] - signal.time[turn]
    later = later[later <= half]
    here = signal.roll[turn : turn + len(later)]
    path = target + (here[0] - target) * (1 + np.cos(math.pi / half * later)) / 2
    beside = 0.5 * math.pi / half * float(signal.time[1] - signal.time[0])  # a turn is between two samples
    room = max(4.0 * signal.noise, (STUCK + beside) * abs(float(here[0]) - segment.rest))
    return segment.settles and bool(np.all(np.abs(here - path) <= room))


def _followed(signal: SmoothedSignal, segment: Segment, turn: int) -> float:
    """Return how long the deck goes on as predicted after its last good turning point [s]."""
    half = segment.half_period
    sizes = [size for size in segment.sizes if size > 3.0 * signal.noise]
    ratio = (sizes[-1] / sizes[0]) ** (1 / max(1, len(sizes) - 1)) if len(sizes) > 1 else 0.1
    decay, omega = -math.log(min(ratio, 0.99)) / half, math.pi / half
    later = signal.time[turn:] - signal.time[turn]
    later = later[later <= half]
    seen = signal.roll[turn : turn + len(later)] - segment.rest
    size = float(signal.roll[turn]) - segment.rest
    wave = np.cos(omega * later) + decay / omega * np.sin(omega * later)
    error = np.abs(seen - size * np.exp(-decay * later) * wave)
    off = np.flatnonzero(error > max(4.0 * signal.noise, 0.08 * abs(size)))
    reach = float(later[off[0]]) - 0.12 * half if len(off) else float(later[-1])
    return float(signal.time[turn]) + max(0.0, reach)


def settled_between(signal: SmoothedSignal, reached: int, stop: int, amplitude: float) -> tuple[float, float]:
    """Return from when until when the deck stays at rest, about its first stay after index `reached` [s]."""
    stays = [(first, last) for first, last in signal.plateaus if last > reached and first < stop]
    first, last = stays[0] if stays else (reached, stop)
    first, last = max(first, reached), min(last, stop)
    level = float(np.median(signal.roll[first : last + 1]))
    loud = np.flatnonzero(np.abs(signal.roll - level) > max(4.0 * signal.noise, 0.01 * amplitude))
    middle = (first + last) // 2
    before, after = loud[loud < middle], loud[loud > middle]
    settled = int(before[-1]) + 1 if len(before) else 0
    leaves = min(int(after[0]) - 1 if len(after) else stop, stop)
    return float(signal.time[settled]), float(signal.time[leaves])
