"""The clock of a log: from the stamps as they were written to one strictly increasing time in seconds."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from sysid.errors import SysidError
from sysid.logs.table.names import TIME_UNITS
from sysid.roll import Array, shown
from sysid.text import count

MIN_SAMPLES = 8
"""Fewer tell nothing: a decaying sine about a rest angle has five unknowns, and its noise is one more."""
GAP = 4.5
"""A step this many times the usual one is a gap: four samples in a row are lost. At random, one sample in twenty being lost, that
happens once in 160 000."""
SAMPLE = 200_000
"""As many steps tell how the stamps of a long log come."""
COUNTERS = {2.0**32: "32-bit", 2.0**16: "16-bit"}
"""Counts after which a counter of time begins again at zero."""
DAY, HOUR = 86400.0, 3600.0
"""What a clock on the wall goes back by at midnight, and in autumn [s]."""
OWN_TIMES = 1e5
"""Times are kept as the log has them up to here [s], a day and a bit; later ones (since the epoch, since a robot was
switched on last week) have too many digits to be typed, and count from the first sample."""
MAX_STEP_ERROR = 0.4
"""Share [1] of a sample by which a step may be off a whole number of them that it surely spans."""
WINDOW = 64
"""Rows over which the step of the stamps is averaged before it is judged: longer than most bursts."""


@dataclass(slots=True)
class Clock:
    """Time of the samples that stay."""

    time: Array
    """Seconds as the log has them, strictly increasing; since the first sample where those are too large."""
    keep: npt.NDArray[np.intp] | None = None
    """Rows that stay, in their order in time; None for all as they are."""
    notes: list[str] = field(default_factory=list[str])
    warnings: list[str] = field(default_factory=list[str])

    def of(self, signal: Array) -> Array:
        """Return the rows of a signal in any unit, shape (n,) or (n, m), that stay."""
        return signal if self.keep is None else signal[self.keep]

    def select(self, rows: npt.NDArray[np.intp]) -> None:
        """Keep only these of the rows that have stayed so far, numbers without unit of shape (m,), in this order."""
        self.keep = rows if self.keep is None else self.keep[rows]
        self.time = self.time[rows]


def even_clock(count: int, rate: float, kept: npt.NDArray[np.intp] | None = None) -> Clock:
    """Return the clock of `count` rows sampled at `rate` [Hz], at the rows that were `kept`, shape (n,)."""
    rows = np.arange(count) if kept is None else kept
    clock = Clock((rows - rows[0]) / rate, notes=[f"time from --rate: {rate:g} Hz"])
    if clock.time.size > 1:
        _report_gaps(clock, np.diff(clock.time))
    return clock


def time_scale(stamps: Array, unit: str | None) -> tuple[float, str]:
    """Return seconds per unit of the stamps, shape (n,), and how that is known.

    Where the name gives no unit, the size of an epoch stamp or the usual step gives it: sampling rates of
    boards lie between 5 Hz and 5 kHz, and the units are a thousand apart.
    """
    if unit == "100 us" and typical_step(stamps) * TIME_UNITS[unit] > 0.2:
        unit = "us"  # Xsens counts so in its trackers, and in microseconds in its DOTs
    if unit is not None:
        return TIME_UNITS[unit], f"in {unit}, by its name"
    first, step = abs(float(stamps[0])), typical_step(stamps)
    if first > 1e8:
        for unit, low, high in (("ns", 1e17, 1e20), ("us", 1e14, 1e17), ("ms", 1e11, 1e14), ("s", 1e8, 1e11)):
            if low <= first < high and 2e-4 <= step * TIME_UNITS[unit] <= 0.2:
                return TIME_UNITS[unit], f"since the epoch in {unit}, by its size"
    for unit, high in (("s", 0.2), ("ms", 200.0), ("us", 2e5)):
        if step <= high:
            return TIME_UNITS[unit], f"in {unit}, by the step of {step:.4g}"
    return TIME_UNITS["ns"], f"in ns, by the step of {step:.4g}"


def typical_step(stamps: Array) -> float:
    """Return the step of most stamps in their unit, shape (n,): neither a pause nor stamps that come in bursts move it."""
    width = max(1, min(WINDOW, stamps.size // 8))
    while width < stamps.size:
        step = abs(float(np.median(stamps[width:] - stamps[:-width]))) / width
        if step > 0:
            return step
        width *= 2
    return abs(float(stamps[-1] - stamps[0])) / max(stamps.size - 1, 1)


def repair_clock(
    stamps: Array, signal: Array, unit: str | None, name: str, *, computed: bool = False
) -> Clock:
    """Make a strictly increasing clock of a log's stamps.

    Counter overflows are undone, a restarted counter is said and its parts are put one after the other,
    rows out of order are sorted, copies dropped, samples that a slow sensor repeated dropped, and stamps
    that are late (in bursts, or jittering while the signal is smooth on an even clock) replaced by the even
    clock of the sensor. Gaps are kept and said.

    Args:
        stamps: Finite stamps in the order of the file, shape (n,).
        signal: The signal that they belong to, shape (n,); tells late stamps from late samples.
        unit: Unit of the stamps, or None.
        computed: The signal was computed for just these times, as by `husky-sysid roll`: uneven ones are not late.

    Raises:
        SysidError: The stamps do not increase, so they are no clock.
    """
    scale, why = time_scale(stamps, unit)
    clock = Clock(stamps if stamps[0] == 0 and scale == 1 else (stamps - stamps[0]) * scale)
    begin = float(stamps[0]) * scale
    own = abs(begin) < OWN_TIMES
    since = "" if begin == 0 else f", from {begin:.4g} s on" if own else ", counted from the first sample"
    clock.notes.append(f"time: '{name}' {why}{since}")
    steps = np.diff(clock.time)
    if steps.size == 0 or steps.min() == steps.max() == 0:
        raise SysidError(
            f"the time column '{name}' never changes. Name another with --time-column, or give --rate."
        )
    if steps.min() <= 0:
        if steps.min() < 0:
            _undo_going_back(clock, scale, float(np.ptp(stamps)), name)
        if np.diff(clock.time).min() <= 0:
            _drop_copies(clock, clock.of(signal))
    drop_repeats(clock, clock.of(signal))
    if clock.time.size < MIN_SAMPLES:
        raise SysidError(
            f"only {clock.time.size} of {stamps.size} rows are measurements of their own by their time '{name}'; at "
            f"least {MIN_SAMPLES} are needed. Name another column with --time-column, or give --rate."
        )
    if clock.time.size != stamps.size or steps.min() <= 0:
        steps = np.diff(clock.time)
    if (not computed or steps.min() <= 0) and _even_out(clock, clock.of(signal), steps):
        steps = np.diff(clock.time)
    if own and begin:
        clock.time = clock.time + begin
    _report_gaps(clock, steps)
    return clock


def usual_step(time: Array) -> float:
    """Return the median step of a clock [s], shape (n,), or of enough of its middle."""
    first = max(0, (time.size - SAMPLE) // 2)
    return float(np.median(np.diff(time[first : first + SAMPLE])))


def drop_repeats(clock: Clock, signal: Array) -> None:
    """Keep one row a measurement where a slow sensor was logged faster than it measures, by its signal in any unit, shape (n,).

    A held value stands for the same number of rows while the signal moves fast; an encoder between two
    counts does so only while it moves slowly, in steps of a count.
    """
    held = _held_rows(signal)
    if held < 2:
        return
    changed = np.flatnonzero(np.diff(signal, prepend=np.nan) != 0)  # NaN differs from everything
    length = np.diff(np.append(changed, signal.size))
    place = np.arange(signal.size) - np.repeat(changed, length)
    left = np.repeat(length, length) - place
    keep = np.flatnonzero((place % held == 0) & ((place == 0) | (left > held / 2)))
    clock.select(keep)
    clock.notes.append(
        f"time: the sensor repeats each value over {held} rows: {signal.size - keep.size} repeats dropped, "
        f"{keep.size} measurements left"
    )


def _held_rows(signal: Array) -> int:
    """Return for how many rows the sensor holds a value; 1 where it does not."""
    length = min(5000, signal.size)
    starts = np.unique(np.linspace(0, signal.size - length, 20).astype(np.intp))
    windows = signal[starts[:, None] + np.arange(length)]
    changes = np.diff(windows, axis=1)
    sizes = np.abs(changes[changes != 0])
    if sizes.size < 40:
        return 1
    step = sizes.min()
    runs: list[npt.NDArray[np.intp]] = []
    for row in changes:
        at = np.flatnonzero(row)
        fast = np.abs(row[at]) > 4 * step
        runs.append(np.diff(at)[fast[1:]])
    lengths = np.concatenate(runs)
    if lengths.size < 20:
        return 1
    held = int(np.median(lengths))
    return held if np.mean(np.abs(lengths - held) <= 1) > 0.9 and np.mean(lengths == 1) < 0.1 else 1


def _undo_going_back(clock: Clock, scale: float, spread: float, name: str) -> None:
    """Undo what makes a clock go back, where its stamps are `spread` apart in their own unit, a count being `scale` [s].

    No counter holds numbers that are further apart than it can count, and what begins again goes back by most of that way.

    Raises:
        SysidError: It goes back too often for a clock.
    """
    time = clock.time = clock.time.copy()
    steps = np.diff(time)
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    resets = {
        modulus * scale: f"the {bits} counter of time overflowed"
        for modulus, bits in COUNTERS.items()
        if spread < modulus
    }
    resets |= {DAY: "the time of day passed midnight", HOUR: "the clock was set back by an hour"}
    for length, what in resets.items():
        lost = (steps < -length / 2) & (np.abs(steps + length) < 1000 * usual)
        if lost.any() and length > 20 * usual:
            time[1:] += np.cumsum(lost) * length
            clock.notes.append(f"time: {what} {count(int(np.count_nonzero(lost)), 'time')}, undone")
            steps = np.diff(time)
    back = np.flatnonzero(steps < 0)
    if back.size == 0:
        return
    row, total = int(back[0]) + 1, steps.size
    if back.size <= 10 and np.all(-steps[back] > 20 * usual):
        shift = np.zeros_like(time)
        shift[back + 1] = 1.0 - steps[back]
        time += np.cumsum(shift)
        clock.warnings.append(
            f"time restarts {count(back.size, 'time')}, first at row {row + 1}: taken as recordings one after the other, "
            "1 s apart"
        )
        return
    if back.size > total // 20:
        raise SysidError(
            f"time '{name}' goes back at {back.size} of {total} rows, first at row {row + 1}: it is no clock. "
            "Name another column with --time-column, or give --rate."
        )
    clock.select(np.argsort(time, kind="stable"))
    clock.time = clock.time - clock.time[0]
    clock.warnings.append(f"{back.size} rows were out of order, first at row {row + 1}: sorted by time")


def _drop_copies(clock: Clock, signal: Array) -> None:
    same_time = np.diff(clock.time) == 0
    if not same_time.any() or np.any(np.diff(signal)[same_time] != 0):
        return  # different measurements with one stamp: late or coarse stamps
    clock.select(np.flatnonzero(np.concatenate(([True], ~same_time))))
    clock.warnings.append(f"{np.count_nonzero(same_time)} rows are copies of the row before: dropped")


def _even_out(clock: Clock, signal: Array, steps: Array) -> bool:
    """Replace late stamps by the even clock of the sensor; return whether the clock has changed."""
    first = max(0, (steps.size - SAMPLE) // 2)
    some = np.sort(steps[first : first + SAMPLE])
    low, usual, high = np.percentile(some, (5, 50, 95))
    mean = float(some[: some.size - max(3, some.size // 400)].mean())  # a few gaps aside
    forced = bool(steps.min() <= 0)
    if not forced and high - low < 0.02 * usual and mean < 1.5 * usual:
        return False
    bursts = bool(np.mean(some < 0.25 * mean) > 0.2)
    even = _even_times(clock.time)
    stamps = _spread(clock.time) if forced else clock.time
    smoother = even is not None and bursts  # no sensor measures in bursts, but it may well measure unevenly
    if even is not None and not bursts:
        with np.errstate(all="ignore"):  # stamps that nearly coincide; NaN then keeps them as they are
            smoother = _roughness(even, signal) < 0.7 * _roughness(stamps, signal)
    if even is None or not smoother:
        if forced:
            clock.time = stamps
            clock.warnings.append("several rows share one time stamp: spread evenly up to the next stamp")
        elif even is not None and high - low > 0.2 * usual:
            clock.notes.append(
                f"time: uneven sampling kept (steps {low * 1e3:.3g} to {high * 1e3:.3g} ms): the signal is as "
                "smooth on it as on an even clock"
            )
        return forced
    late = float(np.percentile(np.abs(clock.time - even - np.median(clock.time - even)), 95))
    clock.time = even - even[0]
    clock.warnings.append(
        f"time stamps {'come in bursts' if bursts else 'jitter'} (up to {late * 1e3:.3g} ms off): "
        f"replaced by the sensor's even clock of {1 / float(np.median(np.diff(even))):.4g} Hz"
    )
    return True


def _even_times(time: Array) -> Array | None:
    """Fit an even clock to stamps that may be late, with whole samples missing here and there.

    Where the stamps come in bursts, they are never early by much, so the lowest of (stamp − index · period) within a window longer than a
    burst is the true offset; where that steps up and stays up, samples are missing.
    """
    count = time.size
    steps = np.diff(time)
    lengths = steps / float(np.median(steps) or np.inf)
    whole = np.round(lengths)
    # Each step says how many samples it spans, unless more are lost than are there: those come in bursts.
    if whole.min() > 0 and whole.sum() < 2 * count and np.abs(lengths - whole).max() < MAX_STEP_ERROR:
        index = np.append(0.0, np.cumsum(whole))
        period, start = np.polyfit(index, time, 1)
        return start + period * index
    positive = steps[steps > 0]
    large = np.flatnonzero(steps > 0.3 * np.percentile(positive, 99))
    burst = int(np.percentile(np.diff(large), 95)) if large.size > 2 else 1
    window = min(max(16, 8 * burst), count // 8)
    if window < max(4, 2 * burst):
        return None
    period = float(np.median((time[window:] - time[:-window]) / window))
    if period <= 0:
        return None
    from scipy.ndimage import minimum_filter1d  # slow to load, and seldom needed

    start = 0.0
    index = np.arange(count, dtype=np.float64)
    for _ in range(2):
        offset = time - period * np.arange(count)
        lowest = minimum_filter1d(offset, window, mode="nearest")
        rows = np.arange(count)
        before = lowest[np.maximum(rows - window // 2, 0)]  # over the window that ends just before the row
        after = lowest[np.minimum(rows + window // 2, count - 1)]  # over the window that starts at it
        jump = after - before
        jump[:window] = 0.0
        at = np.flatnonzero(jump > max(0.7 * period, 8 * float(np.median(np.abs(jump)))))
        groups = np.split(at, np.flatnonzero(np.diff(at) > 1) + 1) if at.size else []
        if len(groups) > max(3, count // 200):
            return None
        index = rows.astype(np.float64)
        for group in groups:
            place = int(group[np.argmax(jump[group] + 1e-9 * np.diff(time, prepend=time[0])[group])])
            index[place:] += max(1.0, np.round(jump[place] / period))
        period, start = (float(value) for value in np.polyfit(index, time, 1))
    even = start + period * index
    return even if period > 0 and np.diff(even).min() > 0 else None


def _roughness(time: Array, signal: Array) -> float:
    """Median misfit of samples in motion to the cubic through their four neighbours, per unit of noise."""
    centre = np.arange(2, signal.size - 2)
    centre = centre[:: max(1, centre.size // 50_000)]
    offsets = np.array((-2, -1, 1, 2))
    nodes = time[centre[:, None] + offsets] - time[centre, None]
    weights = np.ones_like(nodes)
    for i in range(4):
        for j in range(4):
            if i != j:
                weights[:, i] *= nodes[:, j] / (nodes[:, j] - nodes[:, i])
    values = signal[centre[:, None] + offsets]
    misfit = np.abs(signal[centre] - np.sum(weights * values, axis=1)) / np.sqrt(
        1 + np.sum(weights**2, axis=1)
    )
    slope = np.abs(values[:, 2] - values[:, 1])
    return float(np.median(misfit[slope >= np.percentile(slope, 75)]))


def _spread(time: Array) -> Array:
    first = np.flatnonzero(np.concatenate(([True], np.diff(time) > 0)))
    spread = np.interp(np.arange(time.size), first, time[first])
    tail = time.size - first[-1]
    spread[first[-1] :] += np.arange(tail) / tail * float(np.median(np.diff(time[first])))
    return spread


def _report_gaps(clock: Clock, steps: Array) -> None:
    limit = GAP * usual_step(clock.time)
    if steps.max() <= limit:
        return
    gaps = np.flatnonzero(steps > limit)
    worst = int(gaps[np.argmax(steps[gaps])])
    clock.warnings.append(
        f"{count(gaps.size, 'gap')} in the record, the longest of {steps[worst]:.3g} s at {shown(float(clock.time[worst]))}: "
        "nothing was filled in"
    )
