"""When nothing drives the joint, where a column beside the motion says whether its torque is on."""

import re
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from sysid.logs.table.clock import MIN_SAMPLES
from sysid.logs.table.names import Column
from sysid.logs.table.remarks import Remarks, note, warning
from sysid.roll import Array, shown

_SWITCH = re.compile(r"(torque|motor|servo|drive|power)\W*_?(enabled?|on|active)\b|\benabled?\b", re.I)


def switch_of(columns: Sequence[Column], motion: str) -> str | None:
    """Return the name of the column that switches the torque; of several joints, the one that shares most words with the motion's."""

    def words(name: str) -> set[str]:
        return set(re.split(r"[\W_]+", name.lower()))

    found = [c.name for c in columns if _SWITCH.search(c.name) and c.name != motion and c.kind != "angle"]
    return max(found, key=lambda name: len(words(name) & words(motion)), default=None)


def free_rows(name: str, values: Array, time: Array) -> tuple[npt.NDArray[np.bool_] | None, Remarks]:
    """Return whether nothing drives the joint, shape (n,), None where the switch is off all the time; and how that is known.

    Args:
        name: Of the column of the switch.
        values: 1 for on, shape (n,).
        time: [s], shape (n,).
    """
    free = ~(np.nan_to_num(values) > 0.5)
    if free.all():
        return None, Remarks()
    if not free.any():
        return free, warning(f"'{name}' says that the joint is driven all the time: nothing swings freely")
    edges = np.flatnonzero(np.diff(np.concatenate(([False], free, [False])).astype(np.int8)))
    spans = [
        f"{shown(float(time[a]))} to {shown(float(time[b - 1]))}"
        for a, b in zip(edges[::2], edges[1::2], strict=True)
        if b - a >= MIN_SAMPLES
    ]
    listed = ", ".join(spans[:5]) + (f" and {len(spans) - 5} more" if len(spans) > 5 else "")
    return free, note("free", f"'{name}' reports a free joint from {listed}")
