"""Light gates: times at which a swing passes give its period, and how long it takes between two edges its decrement."""

import re

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


def refuse_with_numbers(log: LogFile) -> None:
    """Report period and decrement of gate events, which hold no angle.

    Raises:
        SysidError: The log holds gate events.
    """
    found = _passes(log)
    if found is None:
        return
    time, lasting = found
    steps = np.rint(np.diff(time) / np.median(np.diff(time)))
    order = np.append(
        0, np.cumsum(np.maximum(steps, 1))
    )  # two passes a period, of unequal halves beside the rest
    period = _slope(np.stack((order / 2, np.ones_like(order), order % 2), axis=1), time, "s")
    told = f"{log.path}: {time.size} passes of a light gate, no angle: period T = {period} s"
    if lasting is None:
        raise SysidError(
            f"{told}. A second gate, or the time for which the one is blocked, gives the decrement."
        )
    since = np.stack(((time - time[0]) / period.value, np.ones_like(time)), axis=1)
    raise SysidError(f"{told}, log decrement δ = {_slope(since, np.log(lasting), '1')}.")


def _slope(design: Array, values: Array, unit: str) -> Quantity:
    """Return the first coefficient of a line through values, shape (n,), with its 95 % interval."""
    found, *_ = np.linalg.lstsq(design, values, rcond=None)
    free = max(len(values) - design.shape[1], 1)
    variance = float(np.sum((values - design @ found) ** 2)) / free
    std = float(np.sqrt(variance * np.linalg.inv(design.T @ design)[0, 0]))
    value, half = float(found[0]), t95(free) * std
    return Quantity(value, std, unit, "light gates", (value - half, value + half))


def _passes(log: LogFile) -> tuple[Array, Array | None] | None:
    """Return when a swing passes [s] and how long from edge to edge [s], shape (n,); None for other logs, or for a single edge."""
    if not any(map(_NAMES.search, log.names)) or len(log.names) > 3:
        return None
    columns = {name: values[np.isfinite(values)] for name, values in numbers_of(log).items()}
    times = [name for name, v in columns.items() if v.size and np.all(np.diff(v) > 0)]
    states = [name for name, v in columns.items() if v.size and name not in times]
    if any(np.unique(columns[name]).size > 2 for name in states):
        return None  # a motion beside a gate
    edges: list[Array] = []
    for name in times:
        unit = parse_column(name).unit
        edges.append(columns[name] * (time_scale(columns[name], unit)[0] if unit else 1.0))
    if len(edges) == 1 and states:  # the edges of each pass, or the passes of two gates, one after the other
        pairs = [edges[0][first:] for first in (0, 1)]
        edges = min(
            ([one[: one.size // 2 * 2][k::2] for k in (0, 1)] for one in pairs),
            key=lambda ends: float(np.median(ends[1] - ends[0])) if ends[0].size else np.inf,
        )
    count = min(map(len, edges), default=0)
    if not 1 <= len(edges) <= 2 or count < MIN_SAMPLES:
        return None
    first, second = edges[0][:count], edges[-1][:count]
    if len(edges) == 1:
        return first, None
    lasting = np.abs(second - first)
    usable = lasting.min() > 0 and np.median(lasting) < 0.5 * np.median(np.diff(first))
    return (0.5 * (first + second), lasting) if usable else None
