"""Angles that begin again after a whole turn: where they do, and the unit that this gives away."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from sysid.logs.table.names import ANGLE_UNITS
from sysid.roll import Array

TURNS: Mapping[str, float] = {unit: 2 * np.pi / ANGLE_UNITS[unit] for unit in ("deg", "rad")}
"""A whole turn by unit."""
NEARLY = 0.75
"""Share of a turn that is too far for a motion from one row to the next."""
MAX_ROWS = 6
"""Rows over which a jump may be spread by resampling."""
SUDDEN = 0.2
"""Beside such a jump, the steps are below this share of those in it. A hardly sampled swing through most of a turn
has larger ones: a half cycle of six rows begins with a fourth of its mean step."""
PER_ROW, MAX_REST = 0.005, 0.03
"""Shares of a turn: one more row in a jump must explain the first; noise and motion may leave the second."""


def find_wraps(angle: Array, turn: float) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the rows before and after each jump by a whole turn; rows between them lie within the jump.

    Args:
        angle: Shape (n,), in any unit.
        turn: A whole turn in its unit.
    """
    steps = np.diff(angle)
    if not np.ptp(angle) > NEARLY * turn:
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    outside = np.concatenate(([0.0], steps, [0.0]))  # before each row
    candidates = [(turn, int(row), 1) for row in np.flatnonzero(np.abs(steps) > NEARLY * turn)]
    for rows in range(1, MAX_ROWS + 1):
        jump = angle[rows:] - angle[:-rows]
        (start,) = np.nonzero(np.abs(np.abs(jump) - turn) < (1 - NEARLY) * turn)
        before, after = outside[start], outside[start + rows + 1]
        motion = jump[start] - np.copysign(turn, jump[start])
        # The rest of the jump is motion, as fast as beside it; the next jump may follow on one side.
        quiet = np.where(np.abs(before) < np.abs(after), before, after)
        both = np.maximum(np.abs(before), np.abs(after)) < SUDDEN * turn / rows
        beside = np.where(both, (before + after) / 2, quiet)
        cost = np.abs(motion - rows * beside) + PER_ROW * turn * (rows + MAX_ROWS * ~both)
        sudden = (np.abs(quiet) < SUDDEN * turn / rows) & (both | (rows <= MAX_ROWS // 2))
        inside = np.array([np.ptp(np.sign(steps[row : row + rows])) == 0 for row in start], dtype=bool)
        plausible = sudden & inside & (np.abs(motion - rows * beside) < rows * MAX_REST * turn)
        candidates += zip(
            cost[plausible].tolist(), start[plausible].tolist(), [rows] * int(plausible.sum()), strict=True
        )
    taken = np.zeros(steps.size, dtype=np.bool_)
    found: list[tuple[int, int]] = []
    for _, row, rows in sorted(candidates):
        if not taken[row : row + rows].any():
            taken[row : row + rows] = True
            found.append((row, row + rows))
    pairs = np.array(sorted(found), dtype=np.intp).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def unit_by_wraps(angle: Array) -> str | None:
    """Return the unit in which an angle without one, shape (n,), jumps by a whole turn and stays within one; None if it does not."""
    for unit, turn in TURNS.items():
        if not NEARLY * turn < np.ptp(angle) < 1.02 * turn:
            continue
        before, after = find_wraps(angle, turn)
        jumps = np.abs(angle[after] - angle[before])
        if jumps.size and np.median(jumps) > 0.9 * turn:
            return unit
    return None


def without_wraps(angle: Array, turn: float) -> tuple[Array, npt.NDArray[np.intp] | None, int]:
    """Return an angle in the unit of the turn, shape (n,), without jumps by a turn. Return also the rows outside jumps (None for all), and the number of jumps."""
    before, after = find_wraps(angle, turn)
    turns = np.zeros(angle.size)
    turns[after] = -np.sign(angle[after] - angle[before]) * np.maximum(
        1, np.round(np.abs(angle[after] - angle[before]) / turn)
    )
    inside = [row for start, stop in zip(before, after, strict=True) for row in range(start + 1, stop)]
    kept = np.delete(np.arange(angle.size), inside) if inside else None
    return angle + np.cumsum(turns) * turn, kept, before.size
