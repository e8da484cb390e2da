"""When nothing drives the joint, where a column beside the motion tells: a switch of the torque, a current, a goal."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from sysid.logs.table.clock import MIN_SAMPLES
from sysid.logs.table.names import Column
from sysid.logs.table.noise import noise_of
from sysid.logs.table.remarks import Remarks, note, warning
from sysid.roll import Array, shown

_TELLS = {
    "switch": re.compile(r"(torque|motor|servo|drive|power)\W*_?(enabled?|on|active)\b|\benabled?\b", re.I),
    "current": re.compile(r"(?<![a-z])(current|amps|iq|i_q)(?![a-z])", re.I),
    "goal": re.compile(r"goal|target|setpoint|desired|command|(^|_)(q_?)?(des|cmd|ref)\b", re.I),
}
"""Names of columns that tell, the surest kind first."""


def telling_column(columns: Sequence[Column], motion: str) -> tuple[str, str] | None:
    """Return the kind and the name of the column that tells when the joint is free; of several joints, the motion's own."""
    for kind, pattern in _TELLS.items():
        found = [
            c.name for c in columns
            if pattern.search(c.name) and c.name != motion and (c.kind == "angle") == (kind == "goal")
            and (kind == "goal" or not _TELLS["goal"].search(c.name))
        ]  # fmt: skip
        if found:
            return kind, max(found, key=lambda name: _alike(name, motion))
    return None


def _alike(one: str, other: str) -> int:
    """Return how many words two names share: of 'elbow.pos', the current is 'elbow.current'."""
    words = [set(re.split(r"[\W_]+", name.lower())) for name in (one, other)]
    return len(words[0] & words[1])


def free_rows(
    kind: str, name: str, values: Array, time: Array, motion: Array
) -> tuple[npt.NDArray[np.bool_] | None, Remarks]:
    """Return whether nothing drives the joint, shape (n,), None where the column does not tell; and how that is known.

    Args:
        kind: Of `telling_column`.
        name: The column's.
        values: Its values in the log's unit, shape (n,).
        time: [s], shape (n,).
        motion: The joint's angle in the unit of the log, shape (n,).
    """
    from scipy.ndimage import binary_opening, find_objects, label

    if kind == "switch":
        free = ~(np.nan_to_num(values) > 0.5)
    elif kind == "current":
        near = np.abs(values) <= 5 * noise_of(time, np.nan_to_num(values)).std
        # One that changes its sign is near zero for a moment.
        free = np.asarray(binary_opening(near, np.ones(MIN_SAMPLES)), np.bool_)
    else:
        free = _left_behind(values, motion)
    if free.all() or (kind != "switch" and not free.any()):
        return None, Remarks()
    if not free.any():
        return free, warning(f"'{name}' says that the joint is driven all the time: nothing swings freely")
    numbered: Any = label(free)  # its stubs do not know that it returns two
    stretches = [time[rows] for (rows,) in find_objects(numbered[0])]
    spans = [f"{shown(float(s[0]))} to {shown(float(s[-1]))}" for s in stretches if s.size >= MIN_SAMPLES]
    listed = ", ".join(spans[:5]) + (f" and {len(spans) - 5} more" if len(spans) > 5 else "")
    return free, note("free", f"'{name}' reports a free joint from {listed}")


def _left_behind(goal: Array, motion: Array) -> npt.NDArray[np.bool_]:
    """Return the rows after which the joint never comes back to a goal that stays where it is, shape (n,)."""
    behind = np.abs(motion - goal)
    behind[~np.isfinite(behind)] = np.inf  # no goal
    follows = behind[np.isfinite(behind)]
    if not follows.size:
        return np.zeros(goal.size, dtype=np.bool_)
    last = int(np.flatnonzero(behind <= max(4 * float(np.percentile(follows, 25)), 1e-9))[-1])
    free = np.arange(goal.size) > last
    after = goal[free][np.isfinite(goal[free])]
    stays = after.size == 0 or np.ptp(after) < 1e-6 * max(float(np.nanmax(np.abs(goal))), 1e-12)
    enough = np.count_nonzero(free) >= MIN_SAMPLES and last + 1 >= MIN_SAMPLES
    return free if stays and enough else np.zeros(goal.size, dtype=np.bool_)
