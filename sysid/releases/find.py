"""Where a log is at rest, held by a hand, let go, swinging freely, and caught again.

Decays are told from what a hand does by the turning points alone (`sysid.releases.chains`), so no threshold
on angle or rate is needed, and the first sample may already be in the middle of a decay.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from sysid.errors import HuskyError
from sysid.releases.chains import Chain, free_chains, given_chain
from sysid.releases.extrema import Leg, Swing, crossing_time, find_swing, legs_of
from sysid.roll import Release, Roll

STILL = 0.03
"""A deck within this share of the first amplitude counts as held still."""
HALF_SWING = 1 / 0.59
"""Half a period in units of the 10 to 90 % time of one leg of a lightly damped swing."""

_Ending = tuple[float, Literal["rest", "caught", "log"]]


@dataclass(frozen=True, slots=True)
class Phase:
    """A stretch of the log in which one thing happens."""

    start: float
    """[s] on the log's clock."""
    end: float
    """[s] on the log's clock."""
    kind: Literal["rest", "held", "free", "caught"]


def find_releases(
    roll: Roll,
    *,
    start: float | None = None,
    stop: float | None = None,
    releases: Sequence[float] = (),
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
        HuskyError: There is no free decay, or a time lies outside the log.
    """
    part = _cut(roll, start, stop)
    std = float(np.median(part.std))
    swing = find_swing(part.time, part.roll, std if math.isfinite(std) else 0.0)
    legs = legs_of(swing)
    if not legs:
        raise HuskyError(
            f"{roll.log}: nothing moves by more than {math.degrees(swing.step):.2g}° "
            f"(noise {math.degrees(swing.noise):.2g}°), so there is no decay. "
            "Is it the right column (--column) and the right stretch of the log (--from, --to)?"
        )
    if releases:
        chains = [given_chain(swing, legs, time, roll.log) for time in sorted(releases)]
    else:
        chains = free_chains(swing, legs)
    if not chains:
        raise HuskyError(
            f"{roll.log}: it moves, but no stretch swings freely to rest. Give the times at which the deck "
            "was let go (--release), or the stretch to look at (--from, --to)."
        )
    limits = [*(chain.start for chain in chains[1:]), None]
    return [
        _release(part, swing, chain, number, limit)
        for number, (chain, limit) in enumerate(zip(chains, limits, strict=True), start=1)
    ]


def log_phases(roll: Roll, releases: Sequence[Release]) -> list[Phase]:
    """Return what happens when in a log, without gaps, from its first sample to its last.

    Between two decays the deck is at rest, then held from when it last leaves the rest angle; after a
    catch it is caught until it is at rest or held for the next release. Where friction stops it, it may rest anywhere
    between the levels at which the decays before and after it end.
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
    swing = find_swing(release.time, release.roll, float(np.median(release.std)))
    legs = legs_of(swing)
    return _settled(swing, legs[-1].reached if legs else 0, len(swing.time) - 1, release.amplitude)[0]


def _cut(roll: Roll, start: float | None, stop: float | None) -> Roll:
    """Return the part of the log between two times, on the same clock."""
    begin, end = float(roll.time[0]), float(roll.time[-1])
    low, high = begin if start is None else start, end if stop is None else stop
    inside = (roll.time >= low) & (roll.time <= high)
    if np.count_nonzero(inside) < 8:
        raise HuskyError(
            f"{roll.log}: {np.count_nonzero(inside)} samples between {low:.6g} s and {high:.6g} s; the log runs "
            f"from {begin:.6g} s to {end:.6g} s. A decay needs at least 8 samples."
        )
    if inside.all():
        return roll
    return replace(
        roll,
        time=roll.time[inside],
        roll=roll.roll[inside],
        std=roll.std[inside],
        own_std=None if roll.own_std is None else roll.own_std[inside],
        rate=None if roll.rate is None else roll.rate[inside],
        rate_std=None if roll.rate_std is None else roll.rate_std[inside],
    )


def _release(roll: Roll, swing: Swing, chain: Chain, number: int, limit: float | None) -> Release:
    """Cut one free decay out of the log."""
    begin, hold = _let_go(swing, chain)
    finish, end = _ending(swing, chain, begin)
    if limit is not None and limit <= finish:
        finish, end = float(np.nextafter(limit, -math.inf)), "caught"
    if end != "caught" and (hand := _caught_in_motion(swing, chain, begin, finish)) is not None:
        finish, end = hand, "caught"
    inside = (roll.time >= begin - 1e-9) & (roll.time <= finish + 1e-9)
    rest = chain.rest
    if end == "rest":
        rest = float(np.median(swing.roll[(swing.time >= finish - chain.pace) & (swing.time <= finish)]))
    return Release(
        log=roll.log,
        number=number,
        time=roll.time[inside],
        roll=roll.roll[inside],
        std=roll.std[inside],
        own_std=None if roll.own_std is None else roll.own_std[inside],
        origin=roll.origin,
        rate=None if roll.rate is None else roll.rate[inside],
        rate_std=None if roll.rate_std is None else roll.rate_std[inside],
        rest=rest,
        hold=hold,
        end=end,
    )


def _let_go(swing: Swing, chain: Chain) -> tuple[float, float]:
    """Return when the deck was let go and how long it had been held still before [s]."""
    leg = chain.legs[0]
    width = max(5, round(0.25 * chain.pace / float(swing.time[1] - swing.time[0])))
    before = np.convolve(
        np.pad(swing.roll[: leg.left + 1], (width // 2, width - 1 - width // 2), "edge"),
        np.ones(width) / width,
        "valid",
    )
    still = np.abs(before - leg.origin) <= max(3.0 * swing.noise, STILL * chain.sizes[0])
    last = int(np.flatnonzero(still)[-1]) if still.any() else leg.left
    moving = np.flatnonzero(~still[:last])
    since = int(moving[-1]) + 1 if len(moving) else 0
    if chain.start is not None:
        return chain.start, max(0.0, chain.start - float(swing.time[since]))
    if swing.time[last] - swing.time[since] < 0.5 * chain.pace:
        return _onset(swing, leg, leg.origin) if leg.begin else float(swing.time[0]), 0.0
    begin = _onset(swing, leg, float(np.median(before[since : last + 1])))
    return begin, begin - float(swing.time[since])


def _onset(swing: Swing, leg: Leg, level: float) -> float:
    """Return when a leg left its level [s].

    Released from rest, the square root of the way gone is a power series in time, so time is one in that
    root. Fitted between 8 and 40 % of the way, clear of noise and smoothing, two terms come out early and
    three late; mixed as here they are right to 0.3 % of a period for ζ from 0.02 to 0.8.
    """
    way = (swing.roll[leg.left : leg.finish + 1] - level) * math.copysign(1.0, leg.target - leg.origin)
    time = swing.time[leg.left : leg.finish + 1]
    size = abs(leg.target - level)
    shares = np.linspace(max(0.08, min(0.3, 3.0 * swing.noise / size)), 0.4, 14)
    times = np.array([crossing_time(time, way, share * size) for share in shares])
    series = np.vander(np.sqrt(shares), 3, increasing=True)
    two, three = (np.linalg.lstsq(series[:, :terms], times, rcond=None)[0][0] for terms in (2, 3))
    start = float(0.35 * two + 0.65 * three)
    return min(max(start, float(swing.time[leg.left]) - leg.duration), float(times[0]))


def _ending(swing: Swing, chain: Chain, begin: float) -> _Ending:
    """Return when the free decay ends [s], and why."""
    last = chain.legs[-1]
    stop = len(swing.time) - 1 if chain.after is None else chain.after.left
    if chain.after is None and not chain.settles:
        return float(swing.time[-1]), "log"
    if _last_leg_is_cut(swing, chain):
        return _followed(swing, chain, last.begin), "caught"
    if chain.settles:
        settled, leaves = _settled(swing, last.reached, stop, chain.sizes[0])
        tail = max(4.0 * chain.pace, 0.5 * (settled - begin))
        if chain.after is not None:  # a hand is felt before it is seen
            leaves -= max(0.5 * chain.pace, 0.25 * (leaves - settled))
        return max(settled, min(settled + tail, leaves)), "rest"
    return _followed(swing, chain, last.finish), "caught"


def _caught_in_motion(swing: Swing, chain: Chain, begin: float, finish: float) -> float | None:
    """Return when a hand stopped a deck that still swung [s], or None if none did.

    A free deck loses no more of its swing in a half period than in those before it: in proportion with viscous
    damping, the same amount with dry friction. A hand stops it at once, and it stays.
    """
    half = HALF_SWING * chain.pace
    rest = float(np.median(swing.roll[(swing.time >= finish - half) & (swing.time <= finish)]))
    power = np.concatenate([[0.0], np.cumsum((swing.roll - rest) ** 2)])
    width = max(2, round(half / float(swing.time[1] - swing.time[0])))
    first, last = np.searchsorted(swing.time, (begin, finish))
    starts = np.arange(first, last - width, max(1, width // 4))
    if len(starts) < 24:
        return None
    amplitude = np.sqrt(
        np.maximum(2 * (power[starts + width] - power[starts]) / width - 2 * swing.noise**2, 0.0)
    )
    for index in range(16, len(starts)):
        before = amplitude[index - 16 : index - 3 : 4]  # the four half periods before this one
        lost = float(np.max(-np.diff(before)))
        expected = before[-1] - CAUGHT_LOSS * max(lost, 0.0)
        gone = amplitude[index:] < CAUGHT * expected
        if expected > 4 * swing.noise and before[-1] > 0.005 * amplitude[0] and gone.all():
            return float(swing.time[starts[index]])
    return None


CAUGHT, CAUGHT_LOSS = 0.4, 1.5
"""Share of the swing that is expected below which the deck was caught, and how many times the last largest loss of a half
period may be lost freely."""


def _last_leg_is_cut(swing: Swing, chain: Chain) -> bool:
    """Whether the last leg ends where no free deck would: held away from rest, or braked far too much."""
    sizes = chain.sizes
    if len(chain.legs) == 1:
        return False
    lost = [one - other for one, other in pairwise(sizes)]
    room = 3.0 * swing.noise + 0.05 * sizes[0]
    if len(lost) < 3:
        return chain.settles and sizes[-1] > 0.25 * sizes[0] + room
    # Dry friction that takes 2 F/k off each swing can hold the deck up to F/k beside the middle.
    held = 3.0 * swing.noise + 0.02 * sizes[0] + float(np.median(lost[:-1]))
    return lost[-1] > 1.6 * max(lost[:-1]) + room or (chain.settles and sizes[-1] > held)


def _followed(swing: Swing, chain: Chain, turn: int) -> float:
    """Return how long the deck goes on as predicted after its last good turning point [s]."""
    half = HALF_SWING * chain.pace
    sizes = [size for size in chain.sizes if size > 3.0 * swing.noise]
    ratio = (sizes[-1] / sizes[0]) ** (1 / max(1, len(sizes) - 1)) if len(sizes) > 1 else 0.1
    decay, omega = -math.log(min(ratio, 0.99)) / half, math.pi / half
    later = swing.time[turn:] - swing.time[turn]
    later = later[later <= half]
    size = float(swing.roll[turn]) - chain.rest
    wave = np.cos(omega * later) + decay / omega * np.sin(omega * later)
    error = np.abs(swing.roll[turn : turn + len(later)] - chain.rest - size * np.exp(-decay * later) * wave)
    off = np.flatnonzero(error > max(4.0 * swing.noise, 0.08 * abs(size)))
    reach = float(later[off[0]]) - 0.12 * half if len(off) else float(later[-1])
    return float(swing.time[turn]) + max(0.0, reach)


def _settled(swing: Swing, reached: int, stop: int, amplitude: float) -> tuple[float, float]:
    """Return from when until when the deck stays at rest, about its first stay after index `reached` [s]."""
    stays = [(first, last) for first, last in swing.stays if last > reached and first < stop]
    first, last = stays[0] if stays else (reached, stop)
    first, last = max(first, reached), min(last, stop)
    level = float(np.median(swing.roll[first : last + 1]))
    loud = np.flatnonzero(np.abs(swing.roll - level) > max(4.0 * swing.noise, 0.01 * amplitude))
    middle = (first + last) // 2
    before, after = loud[loud < middle], loud[loud > middle]
    settled = int(before[-1]) + 1 if len(before) else 0
    leaves = min(int(after[0]) - 1 if len(after) else stop, stop)
    return float(swing.time[settled]), float(swing.time[leaves])


def _between(
    roll: Roll,
    begin: float,
    finish: float,
    release: Release,
    near: Sequence[Release],
    caught: bool,
    hold: float,
) -> list[Phase]:
    """Split the time between two decays into what a hand does and rest."""
    inside = (roll.time >= begin) & (roll.time <= finish)
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
