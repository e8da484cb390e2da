"""The clock of a log: from the stamps as they were written to one strictly increasing time in seconds."""

from dataclasses import dataclass, field
from datetime import timedelta

import numpy as np
import numpy.typing as npt

from sysid.errors import SysidError
from sysid.logs.table.names import TIME_UNITS
from sysid.logs.table.noise import sixth_differences
from sysid.noise.sensor import DIFFERENCE, quantisation_step
from sysid.quantity import Z95
from sysid.roll import Array, shown
from sysid.text import count

MIN_SAMPLES = 8
"""A decaying sine about a rest angle has five unknowns, and its noise is one more."""
GAP = 4.5
"""A step this many times the usual one is a gap: four samples in a row are lost. At random, one sample in twenty being lost, that
happens once in 160 000."""
COUNTERS = tuple(float(np.iinfo(kind).max) + 1.0 for kind in (np.uint32, np.uint16))
"""Counts after which a counter of time begins again at zero [1]."""
DAY, HOUR = timedelta(days=1).total_seconds(), timedelta(hours=1).total_seconds()
WALL = {"the time of day passed midnight": DAY, "the clock was set back by an hour": HOUR}
"""Steps back of a clock on the wall [s]."""
WINDOW = 64
"""Rows over which the step of the stamps is averaged: longer than most bursts."""


@dataclass(slots=True)
class Clock:
    """Time of the samples that stay, and their columns."""

    time: Array
    """Seconds as the log has them, strictly increasing, shape (n,); since the first sample where those are too large."""
    columns: dict[str, Array]
    """Columns in the log's units, shape (n,) each."""
    notes: list[str] = field(default_factory=list[str])
    warnings: list[str] = field(default_factory=list[str])

    def select(self, rows: npt.NDArray[np.intp]) -> None:
        """Keep only these of the rows that have stayed so far, numbers without unit of shape (m,), in this order."""
        self.time = self.time[rows]
        self.columns = {name: column[rows] for name, column in self.columns.items()}


def even_clock(rows: npt.NDArray[np.intp], rate: float, columns: dict[str, Array]) -> Clock:
    """Return the clock of rows, numbers without unit of shape (n,), sampled at `rate` [Hz]."""
    clock = Clock((rows - rows[0]) / rate, columns, notes=[f"time from --rate: {rate:g} Hz"])
    _report_gaps(clock)
    return clock


def time_scale(stamps: Array, unit: str | None) -> tuple[float, str]:
    """Return seconds per unit of the stamps, shape (n,), and how that is known.

    Without a unit in the name, the size of an epoch stamp or the usual step tells it. Sampling rates lie between 5 Hz
    and 5 kHz, and the units are a thousand apart.
    """
    if unit == "100 us" and typical_step(stamps) * TIME_UNITS[unit] > 0.2:
        unit = "us"  # Xsens counts so in its trackers, and in microseconds in its DOTs
    if unit is not None:
        return TIME_UNITS[unit], f"in {unit}, by its name"
    first, step = abs(float(stamps[0])), typical_step(stamps)
    for unit in ("s", "ms", "us", "ns"):  # 1973 to 5138 in each of them
        if 1e8 <= first * TIME_UNITS[unit] < 1e11 and 2e-4 <= step * TIME_UNITS[unit] <= 0.2:
            return TIME_UNITS[unit], f"since the epoch in {unit}, by its size"
    unit = next((unit for unit in ("s", "ms", "us") if step * TIME_UNITS[unit] <= 0.2), "ns")
    return TIME_UNITS[unit], f"in {unit}, by the step of {step:.4g}"


def rises(stamps: Array) -> bool:
    """Return whether stamps in any unit, shape (n,), go one way as a clock does; a swing goes both ways alike."""
    steps = np.diff(stamps[np.isfinite(stamps)])
    up, down = np.count_nonzero(steps > 0), np.count_nonzero(steps < 0)
    return bool(2 * min(up, down) < max(up, down))


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
    stamps: Array,
    columns: dict[str, Array],
    lively: str,
    unit: str | None,
    name: str,
    *,
    computed: bool = False,
) -> Clock:
    """Make a strictly increasing clock of a log's stamps.

    Repairs: newest row first, counter overflows, restarts, a clock that stops, rows twice or out of order, repeats of
    a slow sensor, late or rounded stamps. Gaps are kept and reported.

    Args:
        stamps: Finite stamps in the order of the file, shape (n,).
        columns: The log's columns, shape (n,) each.
        lively: The one that moves most: it tells late stamps from late samples.
        unit: Unit of the stamps, or None.
        name: Of the column of time.
        computed: The columns were computed for just these times, as by `husky-sysid roll`: uneven ones are not late.

    Raises:
        SysidError: The stamps do not increase, so they are no clock.
    """
    scale, why = time_scale(stamps, unit)
    if stamps.size < 2 or stamps.min() == stamps.max():
        raise SysidError(
            f"the time column '{name}' never changes. Name another with --time-column, or give --rate."
        )
    clock = Clock(stamps, columns)
    if np.mean(np.diff(stamps) < 0) > 0.5:
        clock.select(np.arange(stamps.size)[::-1])
        clock.notes.append("time: newest row first, turned round")
    _cut_torn(clock)
    first = float(clock.time[0])
    begin = first * scale
    own = abs(begin) < DAY  # later times have too many digits to be typed
    clock.time = (clock.time - first) * scale
    since = "" if begin == 0 else f", from {begin:.4g} s on" if own else ", counted from the first sample"
    clock.notes.append(f"time: '{name}' {why}{since}")
    _cut_frozen(clock)
    if np.diff(clock.time).min() < 0:
        _undo_going_back(clock, scale, name)
    _drop_copies(clock, clock.columns[lively])
    if not computed or np.diff(clock.time).min() <= 0:
        _even_out(clock, clock.columns[lively])
    _drop_repeats(clock, clock.columns[lively])
    if clock.time.size < MIN_SAMPLES:
        raise SysidError(
            f"only {clock.time.size} of {stamps.size} rows are measurements of their own by their time '{name}'; at "
            f"least {MIN_SAMPLES} are needed. Name another column with --time-column, or give --rate."
        )
    if own and begin:
        clock.time = clock.time + begin
    _report_gaps(clock)
    return clock


def usual_step(time: Array) -> float:
    """Return the median step of a clock [s], shape (n,)."""
    return float(np.median(np.diff(time)))


def _runs(same: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return where each run of rows begins and how long it is; `same` [(n - 1,)] tells the rows that are like the one before."""
    starts = np.flatnonzero(np.concatenate(([True], ~same)))
    return starts, np.diff(np.append(starts, same.size + 1))


def _cut_torn(clock: Clock) -> None:
    """Leave out a first or last row whose stamp is further from the others than they are from each other."""
    steps = np.abs(np.diff(clock.time))
    lost = [row for row, step in ((0, steps[0]), (steps.size, steps[-1])) if 2 * step > steps.sum()]
    if lost and steps.size > 1:
        clock.select(np.delete(np.arange(clock.time.size), lost))
        clock.warnings.append("the first or last row lies further off in time than the log is long: left out")


def _cut_frozen(clock: Clock) -> None:
    """End the log where its clock stands still for longer than the rest of the log explains."""
    starts, lengths = _runs(np.diff(clock.time) == 0)
    longest = int(np.argmax(lengths))
    usual = int(np.max(np.delete(lengths, longest), initial=1))
    begin, length = int(starts[longest]), int(lengths[longest])
    if length < max(MIN_SAMPLES, 4 * usual):
        return
    end, period = begin + length, typical_step(clock.time)
    if end < clock.time.size and clock.time[end] - clock.time[begin] > 0.5 * length * period:
        return  # the rows came late, and the clock knows of it
    rows = (
        np.arange(begin + 1) if 2 * begin + length > clock.time.size else np.arange(end - 1, clock.time.size)
    )
    left = "after" if rows[0] == 0 else "before"
    clock.warnings.append(
        f"the clock stands still over {length} rows at {shown(float(clock.time[begin]))}: the rows {left} it have no "
        f"time and are left out ({clock.time.size - rows.size})"
    )
    clock.select(rows)


def _drop_repeats(clock: Clock, signal: Array) -> None:
    """Keep one row a measurement where a slow sensor was logged faster than it measures, by its signal in any unit, shape (n,).

    A held value stays for some rows of a fast motion. An encoder repeats a count only while it moves slowly.
    """
    starts, lengths = _runs(np.diff(signal) == 0)
    changes = np.abs(np.diff(signal[starts]))
    if changes.size < 20:
        return
    fast = changes > 4 * changes.min()
    held = lengths[1:-1][fast[:-1] & fast[1:]]
    # Noise of four steps repeats a value by chance in one row of fourteen; a sensor that is held does so in most.
    if held.size < 20 or np.mean(held) < 1.5:
        return
    longest = int(np.percentile(held, 95))
    place = np.arange(signal.size) - np.repeat(starts, lengths)
    left = np.repeat(lengths, lengths) - place
    clock.select(np.flatnonzero((place == 0) | ((place % longest == 0) & (left > longest / 2))))
    clock.notes.append(
        f"time: the sensor repeats each value over {np.mean(held):.2g} rows: {signal.size - clock.time.size} repeats "
        f"dropped, {clock.time.size} measurements left"
    )


def _undo_going_back(clock: Clock, scale: float, name: str) -> None:
    """Undo what makes a clock go back, where a count is `scale` [s].

    No counter holds numbers that are further apart than it can count, and what begins again goes back by most of that way.

    Raises:
        SysidError: It goes back too often for a clock.
    """
    time = clock.time = clock.time.copy()
    usual, spread = typical_step(time), float(np.ptp(time)) / scale
    resets = {
        f"the {np.log2(size):.0f}-bit counter of time overflowed": size * scale
        for size in COUNTERS
        if spread < size
    }
    for what, length in (resets | WALL).items():
        steps = np.diff(time)
        lost = (steps < -length / 2) & (np.abs(steps + length) < 1000 * usual)
        if lost.any() and length > 20 * usual:
            time[1:] += np.cumsum(lost) * length
            clock.notes.append(f"time: {what} {count(int(np.count_nonzero(lost)), 'time')}, undone")
    back = np.flatnonzero(np.diff(time) < 0)
    if back.size == 0:
        return
    parts = np.diff(np.concatenate(([-1], back, [time.size - 1])))
    if parts.min() >= MIN_SAMPLES and np.all(-np.diff(time)[back] > 20 * usual):
        shift = np.zeros_like(time)
        shift[back + 1] = 1.0 - np.diff(time)[back]
        time += np.cumsum(shift)
        clock.warnings.append(
            f"time restarts {count(back.size, 'time')}, first at row {back[0] + 2}: taken as recordings one after the "
            "other, 1 s apart"
        )
    elif back.size > time.size // 20:
        raise SysidError(
            f"time '{name}' goes back at {back.size} of {time.size} rows, first at row {back[0] + 2}: it is no clock. "
            "Name another column with --time-column, or give --rate."
        )
    else:
        clock.select(np.argsort(time, kind="stable"))
        clock.time = clock.time - clock.time[0]
        clock.warnings.append(
            f"{back.size} rows were out of order, first at row {back[0] + 2}: sorted by time"
        )


def _drop_copies(clock: Clock, signal: Array) -> None:
    same_time = np.diff(clock.time) == 0
    if not same_time.any() or np.any(np.diff(signal)[same_time] != 0):
        return  # different measurements with one stamp: late or coarse stamps
    clock.select(np.flatnonzero(np.concatenate(([True], ~same_time))))
    clock.warnings.append(f"{np.count_nonzero(same_time)} rows are copies of the row before: dropped")


def _even_out(clock: Clock, signal: Array) -> None:
    """Replace stamps that are rounded or late by the even clock of the sensor, where there is one.

    Rounded stamps lie within half their resolution of an even clock. Late stamps come in bursts; sensors measure
    evenly. For other stamps the signal decides: time errors make errors that grow with its slope.
    """
    steps = np.diff(clock.time)
    usual, forced = float(np.median(steps)), bool(steps.min() <= 0)
    even = _even_times(clock.time)
    if even is not None:
        off = clock.time - even
        bursts = bool(np.mean(steps < 0.25 * (even[-1] - even[0]) / steps.size) > 0.2)
        if np.abs(off).max() < 1e-3 * usual:
            return
        resolution = quantisation_step(np.diff(steps[: 100 * WINDOW]))
        rounded = not bursts and resolution > 0 and np.ptp(off) < 1.1 * resolution
        if rounded or bursts or _late(_spread(clock.time) if forced else clock.time, even, signal):
            late = float(np.percentile(np.abs(off - np.median(off)), 95))
            clock.time = even - even[0]
            how = f"even clock of {1 / usual_step(even):.4g} Hz"
            if rounded:
                clock.notes.append(f"time: stamps rounded to {resolution:.3g} s; {how}")
            else:
                clock.warnings.append(
                    f"time stamps {'come in bursts' if bursts else 'jitter'} (up to {late * 1e3:.3g} ms off): "
                    f"replaced by the sensor's {how}"
                )
            return
    if forced:
        clock.time = _spread(clock.time)
        clock.warnings.append("several rows share one time stamp: spread evenly up to the next stamp")
    low, high = np.percentile(steps, (5, 95))
    if not forced and high - low > 0.2 * usual:
        clock.notes.append(f"time: uneven sampling kept (steps {low * 1e3:.3g} to {high * 1e3:.3g} ms)")


def _even_times(time: Array) -> Array | None:
    """Fit an even clock to stamps that may be late; None where none fits.

    Steps of whole samples add up to the index. Otherwise each row is a sample, and stamps are late, never early by
    much. Their lower edge, over a window longer than a burst, is even then.
    """
    steps = np.diff(time)
    usual = float(np.median(steps))
    whole = np.round(steps / usual) if usual > 0 else np.zeros(steps.size)
    counted = whole.min() > 0 and whole.sum() < 2 * time.size
    index = np.append(0.0, np.cumsum(whole)) if counted else np.arange(time.size, dtype=np.float64)
    period, start = (float(value) for value in np.polyfit(index, time, 1))
    off = time - (start + period * index)
    if not counted:
        from scipy.ndimage import minimum_filter1d  # slow to load, and seldom needed

        width = min(WINDOW, time.size // 8)
        off = minimum_filter1d(off, width)[width // 2 : -(width // 2)] if width > 1 else off
        off = np.percentile(off, (5, 95)) - np.median(off)
    return start + period * index if period > 0 and np.abs(off).max() < period else None


def _late(stamps: Array, even: Array, signal: Array) -> bool:
    """Return whether the samples were taken on the even clock rather than at their stamps: on it, the signal is smoother.

    Time errors are noise of the signal's slope. In doubt the stamps are right. One in six of the differences is independent.
    """
    rough, smooth = (sixth_differences(time, signal) ** 2 for time in (stamps, even))
    gain = (rough - smooth) / np.maximum(
        rough + smooth, 1e-300
    )  # a release or a knock counts as any other row
    return float(gain.mean()) > Z95 * float(gain.std()) * np.sqrt(DIFFERENCE / gain.size)


def _spread(time: Array) -> Array:
    first = np.flatnonzero(np.concatenate(([True], np.diff(time) > 0)))
    spread = np.interp(np.arange(time.size), first, time[first])
    tail = time.size - first[-1]
    spread[first[-1] :] += np.arange(tail) / tail * float(np.median(np.diff(time[first])))
    return spread


def _report_gaps(clock: Clock) -> None:
    steps = np.diff(clock.time)
    limit = GAP * usual_step(clock.time) if steps.size else 0.0
    if steps.max(initial=0.0) <= limit:
        return
    gaps = np.flatnonzero(steps > limit)
    worst = int(gaps[np.argmax(steps[gaps])])
    clock.warnings.append(
        f"{count(gaps.size, 'gap')} in the record, the longest of {steps[worst]:.3g} s at {shown(float(clock.time[worst]))}: "
        "nothing was filled in"
    )
