"""Turning points of a noisy swing: the smoothed signal, its pivots and the swings between them."""

from dataclasses import dataclass, replace
from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from sysid.noise.sensor import difference_noise, quantisation_step, runs
from sysid.roll import Array, Signal

SMOOTHING_REACH = 0.25
"""Half-width of the smoothing window, as phase of the fastest motion [rad]: local parabolas over it
reduce a sine by 1e-5."""
ABRUPT = 4.0
"""A step this many times larger than the two steps before and after it is a jump. In a sine, at any sampling rate, the ratio
is at most two."""


@dataclass(frozen=True, slots=True)
class SmoothedSignal:
    """A roll signal on an even time grid, smoothed just enough that its turning points stand out."""

    time: Array
    """Time grid [s], shape (m,), even but for pauses of the record."""
    roll: Array
    """Smoothed roll [rad], shape (m,)."""
    noise: float
    """Standard deviation of the remaining noise of `roll` [rad]."""
    min_movement: float
    """Smallest movement that counts [rad]."""
    plateaus: tuple[tuple[int, int], ...]
    """First and last grid index of each stretch at a constant angle."""
    levels: tuple[float, ...]
    """Mean roll of each of these stretches [rad]."""


@dataclass(frozen=True, slots=True)
class HalfCycle:
    """One swing: the way from one turning point to the next."""

    begin: int
    """Grid index of the turning point it comes from."""
    left: int
    """Last grid index near the turning point it comes from."""
    reached: int
    """First grid index near the turning point it goes to."""
    finish: int
    """Grid index of the turning point it goes to."""
    origin: float
    """Roll at the turning point it comes from [rad]."""
    target: float
    """Roll at the turning point it goes to [rad]."""
    duration: float
    """Time from 10 to 90 % of the way [s]."""
    from_plateau: bool
    """Whether the deck stayed where the swing begins."""
    to_plateau: bool
    """Whether the deck stays where the swing ends."""

    @property
    def way(self) -> float:
        """Signed length of the way [rad]."""
        return self.target - self.origin

    @property
    def size(self) -> float:
        """Length of the way [rad], positive."""
        return max(abs(self.way), 1e-15)


def smooth_signal(time: Array, roll: Array, std: float, slower: float = 1.0) -> SmoothedSignal:
    """Smooth a roll signal and find its turning points.

    Args:
        time: Time [s], shape (n,), increasing; need not be even.
        roll: Roll [rad], shape (n,).
        std: Standard deviation of a sample [rad].
        slower: Ratio of the fastest speed in the log to that of the swing: a kick is faster than the joint.
    """
    interval = float(np.median(np.diff(time)))
    own, time = time, _without_pauses(time, interval)
    grid = time[0] + interval * np.arange(int((time[-1] - time[0]) / interval + 1.5))
    even = np.interp(grid, time, roll)
    grid = grid if own is time else np.interp(grid, time, own)
    span = float(np.percentile(even, 99.9) - np.percentile(even, 0.1)) or float(np.ptp(even))
    jumps = _jumps(even, max(6.0 * std, 0.02 * span))
    steps = np.diff(even, prepend=even[0])
    steps[jumps + 1] = 0.0
    speed = _top_speed(np.cumsum(steps), interval, std) / slower
    quickness = 2.0 * speed / span if span > 0 else 0.0
    if quickness * interval < 0.5 and len(roll) > 7:  # else too few samples to separate noise from motion
        std = max(std, difference_noise(roll, 3), quantisation_step(np.diff(roll)) / np.sqrt(12.0))
    reach = int(SMOOTHING_REACH / (quickness * interval)) if quickness > 0 else 0
    smooth, gain = _smooth(even, std, span, min(reach, 2000))
    noise = std * gain
    step = max(6.0 * noise, 0.02 * span)
    plateaus = _plateaus(smooth, step, quickness * interval)
    levels = tuple(float(smooth[first : last + 1].mean()) for first, last in plateaus)
    return SmoothedSignal(grid, smooth, noise, step, plateaus, levels)


_SMOOTHED: WeakKeyDictionary[Signal, SmoothedSignal] = WeakKeyDictionary()


def _without_pauses(time: Array, interval: float) -> Array:
    """Return a clock with pauses no longer than all samples together: an hour without samples would need a million grid points."""
    longest = len(time) * interval
    steps = np.diff(time)
    if steps.max() <= longest:
        return time
    return time - np.concatenate(([0.0], np.cumsum(np.maximum(steps - longest, 0.0))))


def smoothed(signal: Signal) -> SmoothedSignal:
    """Return the roll of a log or a release smoothed; computed once for each."""
    if signal not in _SMOOTHED:
        _SMOOTHED[signal] = smooth_signal(signal.time, signal.roll, float(np.median(signal.std)))
    return _SMOOTHED[signal]


def half_cycles_of(signal: SmoothedSignal) -> list[HalfCycle]:
    """Return the swings between turning points, in order of time; empty without motion.

    A swing ends at a stretch in which the deck stays. Lifting the deck from rest is a swing of its own, even in the
    direction of the last swing.
    """
    middles = ((first + last) // 2 for first, last in signal.plateaus)
    stays = dict(zip(middles, signal.levels, strict=True))
    bounds = sorted(stays)
    if not signal.plateaus or signal.plateaus[0][0] > 0:
        bounds.insert(0, 0)
    if not signal.plateaus or signal.plateaus[-1][1] < len(signal.roll) - 1:
        bounds.append(len(signal.roll) - 1)
    swings: list[HalfCycle] = []
    for begin, finish in pairwise(bounds):
        pivots = [begin + i for i in _pivots(signal.roll[begin : finish + 1], signal.min_movement)]
        for a, b in pairwise(pivots):
            origin = stays.get(begin) if a == pivots[0] else None
            target = stays.get(finish) if b == pivots[-1] else None
            swings.append(_half_cycle(signal, a, b, origin, target))
    return _without_slow_turns(signal, swings)


def crossing_time(time: Array, level: Array, threshold: float) -> float:
    """Return when `level`, shape (n,), first rises through `threshold` [s], between samples; the last time if never."""
    above = np.flatnonzero(level >= threshold)
    if len(above) == 0:
        return float(time[-1])
    i = int(above[0])
    if i == 0:
        return float(time[0])
    share = (threshold - level[i - 1]) / (level[i] - level[i - 1])
    return float(time[i - 1] + share * (time[i] - time[i - 1]))


def _without_slow_turns(signal: SmoothedSignal, swings: list[HalfCycle]) -> list[HalfCycle]:
    """Remove stays that last no longer than a turning point of the swings beside them."""
    swings = list(swings)
    for i, (one, other) in enumerate(pairwise(swings)):
        pause = float(signal.time[other.left] - signal.time[one.reached])
        shrinking = one.way * other.way < 0 and other.size < 0.8 * one.size
        longest = (2.2 if shrinking else 1.5) * min(one.duration, other.duration)
        if one.to_plateau and pause < longest:
            swings[i : i + 2] = replace(swings[i], to_plateau=False), replace(other, from_plateau=False)
    return swings


def _half_cycle(
    signal: SmoothedSignal, a: int, b: int, stays_at: float | None, will_stay_at: float | None
) -> HalfCycle:
    """Measure the swing between two pivots; at a stay the mean level counts, not the extreme."""
    origin = float(signal.roll[a]) if stays_at is None else stays_at
    target = float(signal.roll[b]) if will_stay_at is None else will_stay_at
    size = max(abs(target - origin), 1e-15)
    way = (signal.roll[a : b + 1] - origin) * np.sign(target - origin)
    near = max(0.05 * size, min(2.5 * signal.noise, 0.3 * size))
    low, high = np.flatnonzero(way <= near), np.flatnonzero(way >= size - near)
    left = a + int(low[-1] if len(low) else 0)
    later = high[high >= left - a]
    reached = a + int(later[0] if len(later) else len(way) - 1)
    time = signal.time[left : b + 1]
    way = way[left - a :]
    # A swing leaves and arrives through these levels once only: `left` is the last time near its origin.
    low, high = max(0.1 * size, near), min(0.9 * size, size - near)
    rise = crossing_time(time, way, high) - crossing_time(time, way, low)
    stretch = 0.8 / ((high - low) / size) if high > low else 1.0
    duration = max(rise * stretch, float(signal.time[1] - signal.time[0]) / 2)
    return HalfCycle(
        a, left, reached, b, origin, target, duration, stays_at is not None, will_stay_at is not None
    )


def _plateaus(roll: Array, step: float, quickness: float) -> tuple[tuple[int, int], ...]:
    """Return the stretches without motion for about a radian of the fastest motion's phase."""
    if quickness <= 0:
        return ((0, len(roll) - 1),)
    half = min(max(1, round(0.5 / quickness)), len(roll))
    padded = np.pad(roll, half, mode="edge")
    still = np.abs(padded[2 * half :] - padded[: -2 * half]) < step
    pieces: list[tuple[int, int]] = []
    for first, end in runs(still).tolist():
        while first < end:  # a slow hand creeps: cut the stretch after too long a way
            part = roll[first:end]
            span = np.maximum.accumulate(part) - np.minimum.accumulate(part)
            last = first + int(np.searchsorted(span, 2.0 * step, side="right")) - 1
            pieces += [(first, last)] if last - first >= max(2, half) else []
            first = last + 1
    return tuple(pieces)


def _jumps(even: Array, least: float) -> npt.NDArray[np.intp]:
    """Return the index before each isolated step of at least `least` [rad] between nearly still samples, shape (k,)."""
    size = np.abs(np.diff(even))
    padded = np.pad(size, 2, mode="edge")
    beside = np.max([padded[i : i + len(size)] for i in (0, 1, 3, 4)], axis=0)
    return np.flatnonzero((size > least) & (size > ABRUPT * beside))


def _top_speed(even: Array, interval: float, std: float) -> float:
    """Return the highest speed that noise cannot explain [rad/s]."""
    best, lag = 0.0, 1
    while lag < len(even):
        change = float(np.abs(even[lag:] - even[:-lag]).max()) - 6.0 * std
        best = max(best, change / (lag * interval))
        lag *= 2
    return best


def _smooth(even: Array, std: float, span: float, reach: int) -> tuple[Array, float]:
    """Smooth by local parabolas (Savitzky and Golay, 1964); return the result and the share of the noise that is left.

    The half-window is the smallest that leaves noise well below the smallest movement, and `reach` at most.
    """
    n = np.arange(reach + 1.0)
    gains = np.sqrt(3 * (3 * n**2 + 3 * n - 1) / ((2 * n + 3) * (2 * n + 1) * (2 * n - 1)))
    enough = np.flatnonzero(6.0 * std * gains <= 0.01 * span)
    half = int(enough[0]) if len(enough) else reach
    if half < 2 or len(even) <= 2 * half + 1:
        return even, 1.0
    weights: Array = np.linalg.pinv(np.vander(np.arange(-half, half + 1.0) / half, 3, increasing=True))[0]
    padded = np.pad(even, half, "reflect", reflect_type="odd")  # which keeps a slope at the very start
    return np.convolve(padded, weights[::-1], mode="valid"), float(gains[half])


def _pivots(roll: Array, step: float) -> tuple[int, ...]:
    """Return the indices of the turning points of more than `step`, and both ends."""
    slope = np.sign(np.diff(roll))
    turns = np.flatnonzero(slope[1:] != slope[:-1]) + 1
    candidates = [0, *turns.tolist(), len(roll) - 1]
    low = high = pivot = candidates[0]
    pivots: list[int] = []
    rising: bool | None = None
    for i in candidates:
        if rising is None:
            low = i if roll[i] < roll[low] else low
            high = i if roll[i] > roll[high] else high
            if roll[high] - roll[low] > step:
                rising = high > low
                pivots.append(low if rising else high)
                pivot = high if rising else low
        elif (roll[i] > roll[pivot]) == rising and roll[i] != roll[pivot]:
            pivot = i
        elif abs(roll[i] - roll[pivot]) > step:
            pivots.append(pivot)
            rising, pivot = not rising, i
    if rising is None:
        return ()
    return (*pivots, pivot)
