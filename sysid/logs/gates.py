"""Light gates: times at which a swing passes give its period, and how long it takes between two gives its decrement."""

import re
from dataclasses import dataclass

import numpy as np

from sysid.errors import SysidError
from sysid.logs.table.clock import MIN_SAMPLES, time_scale
from sysid.logs.table.content import numbers_of
from sysid.logs.table.file import LogFile
from sysid.logs.table.names import parse_column
from sysid.quantity import Quantity, t95
from sysid.roll import Array

_NAMES = re.compile(r"gate|beam|block|lichtschranke|barri|fotocell|photo", re.I)
"""Names of gates and of their events."""


@dataclass(frozen=True, slots=True)
class Passes:
    """Passes of a swing through one or two gates."""

    time: Array
    """Of each pass [s], shape (n,)."""
    lasting: Array | None
    """From the first gate to the second, or while the one is blocked [s], shape (n,)."""

    @property
    def period(self) -> Quantity:
        """Period [s]: two passes make one, of unequal halves where the gate stands beside the rest."""
        order = np.append(
            0, np.cumsum(np.maximum(np.rint(np.diff(self.time) / np.median(np.diff(self.time))), 1))
        )
        design = np.stack((order / 2, np.ones_like(order), order % 2), axis=1)
        return _slope(design, self.time, "s", f"{self.time.size} passes of a gate")

    @property
    def decrement(self) -> Quantity | None:
        """Logarithmic decrement of a period [1]: the speed falls with the amplitude; None for a single gate without durations."""
        if self.lasting is None:
            return None
        since = (self.time - self.time[0]) / self.period.value
        return _slope(
            np.stack((since, np.ones_like(since)), axis=1),
            np.log(self.lasting),
            "1",
            "time through the gates",
        )


def _slope(design: Array, values: Array, unit: str, how: str) -> Quantity:
    """Return the first coefficient of a line through values, shape (n,), with its 95 % interval."""
    found, *_ = np.linalg.lstsq(design, values, rcond=None)
    free = len(values) - design.shape[1]
    variance = float(np.sum((values - design @ found) ** 2)) / max(free, 1)
    std = float(np.sqrt(variance * np.linalg.inv(design.T @ design)[0, 0]))
    half = t95(free) * std
    value = float(found[0])
    return Quantity(value, std, unit, how, (value - half, value + half))


def passes_of(log: LogFile) -> Passes | None:
    """Return the passes of a log of gate events: times of one or two gates, or a time beside a gate's state; None for others."""
    if not any(_NAMES.search(name) for name in log.names) or len(log.names) > 3:
        return None
    columns = {name: values for name, values in numbers_of(log).items() if np.isfinite(values).any()}
    times = {name: v for name, v in columns.items() if np.all(np.diff(v[np.isfinite(v)]) > 0)}
    states = {
        name: v
        for name, v in columns.items()
        if name not in times and np.isin(v[np.isfinite(v)], (0, 1)).all()
    }
    if not times or len(times) + len(states) != len(columns) or len(states) > 1 or len(times) > 2:
        return None
    scaled: list[Array] = []
    for name, values in times.items():
        known = values[np.isfinite(values)]
        unit = parse_column(name).unit
        scaled.append((values if states else known) * (time_scale(known, unit)[0] if unit else 1.0))
    first = scaled[0]
    if states:
        (state,) = states.values()
        begin, end = first[1:][np.diff(state) > 0], first[1:][np.diff(state) < 0]
        end = end[end > begin[0]] if begin.size else end
        count = min(begin.size, end.size)
        first, second = begin[:count], end[:count]
    elif len(scaled) == 2:
        count = min(map(len, scaled))
        first, second = scaled[0][:count], scaled[1][:count]
    else:
        return Passes(first, None) if first.size >= MIN_SAMPLES else None
    lasting = np.abs(second - first)
    usable = (
        count >= MIN_SAMPLES and lasting.min() > 0 and np.median(lasting) < 0.5 * np.median(np.diff(first))
    )
    return Passes(0.5 * (first + second), lasting) if usable else None


def refuse_with_numbers(log: LogFile) -> None:
    """Report the period and the decrement of gate events, which hold no angle.

    Raises:
        SysidError: The log holds gate events.
    """
    passes = passes_of(log)
    if passes is None:
        return
    decrement = passes.decrement
    told = f"period T = {passes.period} s" + ("" if decrement is None else f", log decrement δ = {decrement}")
    more = (
        " A second gate, or the time for which the one is blocked, gives the decrement."
        if decrement is None
        else ""
    )
    raise SysidError(f"{log.path}: {passes.time.size} passes of a light gate, no angle: {told}.{more}")
