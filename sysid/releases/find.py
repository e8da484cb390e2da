"""Find the free decays of a log.

Turning points locate a decay (`sysid.releases.chains`), without a threshold on angle or rate. The torque that a linear law misses gives the
stretch in which only the joint acts (`sysid.releases.contact`).
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Literal

import numpy as np

from sysid.errors import SysidError
from sysid.noise.sensor import runs
from sysid.releases.chains import MANY, STILL, Segment, free_segments, half_period_of
from sysid.releases.contact import Span, free_stretches
from sysid.releases.extrema import HalfCycle, SmoothedSignal, crossing_time, half_cycles_of, smooth_signal
from sysid.roll import Array, Release, Roll
from sysid.text import display

FEWEST_SAMPLES = 8
"""Fewest samples of a decay."""
COARSE = math.sin(math.pi / 6)
"""Largest step between neighbours, over the range of the motion, of a sine with six samples a period; fewer samples are too few."""
SLOWER = (5.0, 25.0)
"""Ratios of the speed of a kick to that of the joint, tried if nothing swings at the pace of the fastest motion."""
SETS_OFF = 0.25
"""Share of a hold, at its end, in which a hand may already let go: a choice."""


def find_releases(
    roll: Roll, *, start: float | None = None, stop: float | None = None, releases: Sequence[float] = ()
) -> list[Release]:
    """Find every free decay in a log.

    Args:
        roll: The whole log.
        start: Begin of the search [s].
        stop: End of the search [s].
        releases: Times at which the deck was let go [s], instead of finding them; the end of each decay is still found.

    Returns:
        The free decays in order of time, at least one.

    Raises:
        SysidError: There is no free decay, or a time lies outside the log.
    """
    part = _cut(roll, start, stop)
    if releases:
        found = _let_go_at(part, sorted(releases))
    elif part.free is not None and not part.free.all():
        found = _where_free(part)
    else:
        found = _found(part)
    return [replace(one, number=number) for number, one in enumerate(found, 1)]


def _let_go_at(roll: Roll, times: Sequence[float]) -> list[Release]:
    """Return the first decay from each given time on [s], up to the next."""
    found: list[Release] = []
    for time, until in pairwise((*times, math.inf)):
        inside = (roll.time >= time) & (roll.time < until)
        if time < roll.time[0] or np.count_nonzero(inside) < FEWEST_SAMPLES:
            raise SysidError(
                f"{roll.log}: nothing moves after a release at {time:.6g} s for {FEWEST_SAMPLES} samples; the log runs from "
                f"{roll.time[0]:.6g} s to {roll.time[-1]:.6g} s."
            )
        part = replace(roll[inside], free=None)
        first = _found(part, begins_free=True)[0]
        if first.start - first.hold > float(part.time[: FEWEST_SAMPLES + 1][-1]):
            raise SysidError(
                f"{roll.log}: nobody let the deck go at {time:.6g} s: it rests then, or a hand moves it. It leaves a hand at about "
                f"{first.start:.4g} s; give such a time, or leave --release away."
            )
        found.append(first)
    return found


def _where_free(roll: Roll) -> list[Release]:
    """Return the free decays in the parts of a log that a column marks as free."""
    assert roll.free is not None
    found: list[Release] = []
    trouble = SysidError(
        f"{roll.log}: the joint is never free for {FEWEST_SAMPLES} samples: a motor or a brake acts. Release it, or mark the free "
        "part (--release)."
    )
    for first, last in runs(roll.free).tolist():
        if last - first < FEWEST_SAMPLES:
            continue
        try:
            found += _found(roll[first:last], begins_free=True)
        except SysidError as error:  # it stands still, or swings in another part
            trouble = error
    if not found:
        raise trouble
    return found


def _found(roll: Roll, *, begins_free: bool = False) -> list[Release]:
    """Return the free decays of a log; unless it begins with the joint free, a single swing without a rest is a hand's."""
    std = float(np.nan_to_num(np.median(roll.std), posinf=0.0))
    signal = smooth_signal(roll.time, roll.roll, std)
    swings = half_cycles_of(signal)
    if not swings:
        show = display(is_rate=False, slides=roll.slides)
        step = float(np.abs(np.diff(roll.roll)).max())
        coarse = (
            f"Neighbouring samples differ by up to {show(step, 2)}, nearly as much as all of it: if it swings, "
            f"{roll.sampling_rate:.3g} Hz may be too low. "
        )
        raise SysidError(
            f"{roll.log}: nothing moves by more than {show(signal.min_movement, 2)} (noise {show(signal.noise, 2)}), so there is "
            f"no decay. {coarse if step > COARSE * float(np.ptp(roll.roll)) else ''}Is it the right column (--column) and the right stretch of the log (--from, --to)?"
        )
    segments = free_segments(signal, swings)
    for slower in () if any(len(one.wide) > 1 for one in segments) else SLOWER:
        other = smooth_signal(roll.time, roll.roll, std, slower)
        again = free_segments(other, half_cycles_of(other))
        if any(len(one.wide) >= MANY for one in again):
            signal, segments = other, again
            break
    first, *later = swings
    if begins_free and not segments:
        segments = [Segment((first,), first.target, False, later[0] if later else None)]
    elif begins_free and segments[0].swings[0] in later[:1] and not first.to_plateau:  # a late time cuts it
        segments[0] = replace(segments[0], swings=(first, *segments[0].swings))
    found = _free(roll, signal, segments, begins_free=begins_free)
    found = [one for one in found if len(one.time) >= FEWEST_SAMPLES]
    if not found:
        raise SysidError(
            f"{roll.log}: it moves, but no stretch swings freely to rest. Give the times at which the deck "
            "was let go (--release), or the stretch to look at (--from, --to)."
        )
    return found


def _free(
    roll: Roll, signal: SmoothedSignal, segments: Sequence[Segment], *, begins_free: bool
) -> list[Release]:
    """Return the decays of all segments, in order of time; if the log begins free, the first one has no hand unless one holds it."""
    if not segments:
        return []
    # A push makes the first swing longer.
    later = [swing.duration for segment in segments for swing in segment.wide[1:4] or segment.wide]
    period = 2 * half_period_of(float(np.median(later)))
    spans: list[Span] = []
    moved = 0
    for segment, other in zip(segments, [*segments[1:], None], strict=True):
        begin, hold = (segment.driven_until, 0.0) if segment.driven_until else _let_go(signal, segment, moved)
        moved = segment.swings[-1].left
        caught = segment.after is not None and not segment.settles
        last = len(signal.time) - 1
        if segment.after is not None:  # the model tells a hand's motion from the joint's
            last = segment.after.reached if caught else segment.after.left
        stop = float(signal.time[last if other is None else min(last, other.swings[0].left)])
        end = max(begin, _rested(signal, segment, begin, stop))
        let_go = _pulled(signal, segment, begin, period) if hold else begins_free and not spans
        if let_go or not hold or len(segment.swings) > 1:  # else a hand moves it from one stay to another
            spans.append(Span(begin, end, segment, hold, let_go, caught))
    if roll.free is None:
        stretches = free_stretches(roll.time, roll.roll, spans, period)
    else:  # a column of the log marks the free samples
        stretches = [[(span.begin, span.end)] for span in spans]
    found: list[Release] = []
    for span, parts in zip(spans, stretches, strict=True):
        kept = [(b, e) for b, e in parts if b == span.begin or _swings_in(signal, span.segment, b, e)]
        # In one swing a hand and a nonlinear joint look alike.
        found += [_release(roll, signal, span, *part) for part in kept or [(span.begin, span.end)]]
    return found


def _pulled(signal: SmoothedSignal, segment: Segment, begin: float, period: float) -> bool:
    """Whether the joint returns from a hold at `begin` [s] as fast as its own torque pulls it, without a hand.

    In an eighth of a period a cosine goes 29 % of its way to rest, and 19 % at critical damping. Half of a cosine's counts.
    """
    held, then = np.interp((begin, begin + period / 8), signal.time, signal.roll)
    return bool((held - then) / (held - segment.rest or 1.0) > (1 - math.cos(math.pi / 4)) / 2)


def _swings_in(signal: SmoothedSignal, segment: Segment, begin: float, end: float) -> bool:
    """Whether a joint swings at least twice between two times [s]."""
    time = signal.time
    inside = [one.size for one in segment.swings if begin < time[one.reached] and time[one.left] < end]
    return len(inside) > 1 and inside[0] > STILL * segment.size


def _rested(signal: SmoothedSignal, segment: Segment, begin: float, stop: float) -> float:
    """Return the end of a decay [s]: soon after it settles."""
    if not segment.settles:
        return stop
    first, last, until = (
        segment.swings[0].left,
        segment.swings[-1].reached,
        np.searchsorted(signal.time, stop),
    )
    settled, leaves = settled_between(signal, last, int(until), segment.size, first)
    tail = max(4.0 * segment.pace, 0.5 * (settled - begin))
    if segment.after is not None:  # a hand acts before its motion shows
        leaves -= max(0.5 * segment.pace, 0.25 * (leaves - settled))
    return max(settled, min(settled + tail, leaves))


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


def _release(roll: Roll, signal: SmoothedSignal, span: Span, begin: float, finish: float) -> Release:
    """Cut one free decay out of the log, between two times [s] of a span."""
    segment = span.segment
    hold = span.hold if begin == span.begin else 0.0
    last = signal.roll[within(signal.time, finish - half_period_of(segment.pace), finish)]
    quiet = max(STILL * segment.size / 2, 2.5 * signal.noise)
    end: Literal["rest", "caught", "log"] = "caught"
    if (segment.settles and finish == span.end) or (len(last) and float(np.std(last)) < quiet):
        end = "rest"
    elif finish >= signal.time[-1] - 1e-9:
        end = "log"
    kept = min(hold, finish - begin)  # no more of the hold than of the decay
    before = within(roll.time, begin - kept, begin - SETS_OFF * kept)
    rest = segment.rest
    if end == "rest":
        late = signal.roll[within(signal.time, finish - segment.pace, finish)]
        rest = float(np.median(late)) if late.size else rest  # empty if a sample lasts longer than a swing
    held = roll[before] if kept > 0 and before.stop > before.start else None  # a pause has no samples
    free = roll[within(roll.time, begin - 1e-9, finish + 1e-9)]
    release = Release.of(free, number=1, rest=rest, hold=hold, end=end, held=held)
    return replace(release, driven_until=segment.driven_until)


def within(time: Array, begin: float, end: float) -> slice:
    """Return the samples from one time to another [s], of times of shape (n,): a view, however many releases a log has."""
    return slice(int(np.searchsorted(time, begin)), int(np.searchsorted(time, end, side="right")))


def _let_go(signal: SmoothedSignal, segment: Segment, moved: int) -> tuple[float, float]:
    """Return the time of the release and the duration of the hold before [s], which begins after grid index `moved`."""
    swing = segment.swings[0]
    moved = moved if moved < swing.left else 0
    width = max(5, round(0.25 * segment.pace / float(signal.time[1] - signal.time[0])))
    wide = np.pad(signal.roll[moved : swing.left + 1], (width // 2, width - 1 - width // 2), "edge")
    before = np.convolve(wide, np.ones(width) / width, "valid")
    still = np.abs(before - swing.origin) <= max(3.0 * signal.noise, STILL * segment.size)
    last = int(np.flatnonzero(still)[-1]) if still.any() else swing.left - moved
    moving = np.flatnonzero(~still[:last])
    since, last = moved + (int(moving[-1]) + 1 if len(moving) else 0), moved + last
    # With dry friction later swings are small and quick: the first one gives the duration of a turning point.
    if signal.time[last] - signal.time[since] < 0.5 * max(segment.pace, swing.duration):
        return _onset(signal, swing, swing.origin) if swing.begin else float(signal.time[0]), 0.0
    begin = _onset(signal, swing, float(np.median(before[since - moved : last + 1 - moved])))
    return begin, begin - float(signal.time[since])


def _onset(signal: SmoothedSignal, swing: HalfCycle, level: float) -> float:
    """Return when a swing left its level [s].

    After a release from rest, time is a power series in the square root of the way. It is fitted between 8 and 40 %
    of the way, clear of noise and smoothing. Two terms give an early time, three a late one. The weighted mean is
    right to 0.3 % of a period for ζ from 0.02 to 0.8.
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


def settled_between(
    signal: SmoothedSignal, reached: int, stop: int, amplitude: float, swung: int = 0
) -> tuple[float, float]:
    """Return begin and end [s] of the rest around the first stay after index `reached`, of swings that begin at index `swung`."""
    stays = [(first, last) for first, last in signal.plateaus if last > reached and first < stop]
    first, last = stays[0] if stays else (reached, stop)
    first, last = max(first, reached), min(last, stop)
    level = float(np.median(signal.roll[first : last + 1]))
    away = np.abs(signal.roll[swung : stop + 1] - level)
    loud = swung + np.flatnonzero(away > max(4.0 * signal.noise, 0.01 * amplitude))
    middle = (first + last) // 2
    before, after = loud[loud < middle], loud[loud > middle]
    settled = int(before[-1]) + 1 if len(before) else swung
    leaves = min(int(after[0]) - 1 if len(after) else stop, stop)
    return float(signal.time[settled]), float(signal.time[min(leaves, len(signal.time) - 1)])
