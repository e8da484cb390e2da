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


def find_wraps(angle: Array, turn: float) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the rows before and after each jump by a whole turn; rows between them lie within the jump.

    Args:
        angle: Shape (n,), in any unit.
        turn: A whole turn in its unit.
    """
    steps = np.concatenate(([0.0], np.diff(angle), [0.0]))  # before each row, and behind the last
    side = np.where(np.abs(steps) > turn / (4 * MAX_ROWS), np.sign(steps), 0.0)
    edges = np.flatnonzero(np.diff(side))
    found: list[tuple[int, int]] = []
    for first, last in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        rows, jump = last - first, abs(float(angle[last] - angle[first]))
        beside = abs(steps[first]), abs(steps[last + 1])  # another jump may be on one side of a short one
        quiet = max(beside) if 2 * rows > MAX_ROWS else min(beside)
        whole = side[last] and abs(jump / turn - 1) < 1 - NEARLY
        if whole and (rows == 1 or (rows <= MAX_ROWS and quiet < SUDDEN * jump / rows)):
            found.append((first, last))
    pairs = np.array(found, dtype=np.intp).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def unit_by_wraps(angle: Array) -> str | None:
    """Return the unit in which an angle without one, shape (n,), jumps by a whole turn and stays within one; None if it does not."""
    for unit, turn in TURNS.items():
        if NEARLY * turn < np.ptp(angle) < 1.02 * turn:
            before, after = find_wraps(angle, turn)
            if before.size and np.median(np.abs(angle[after] - angle[before])) > 0.9 * turn:
                return unit
    return None


def without_wraps(angle: Array, turn: float) -> tuple[Array, npt.NDArray[np.intp] | None, int]:
    """Return an angle in the unit of the turn, shape (n,), without jumps by a turn. Return also the rows outside jumps (None for all), and the number of jumps."""
    before, after = find_wraps(angle, turn)
    turns = np.zeros(angle.size)
    turns[after] = -np.sign(angle[after] - angle[before])
    # Resampling spreads a jump over several rows; it may begin and end within a step.
    inside = [r for a, b in zip(before, after, strict=True) if b > a + 1 for r in range(a, b + 1)]
    kept = np.delete(np.arange(angle.size), inside) if inside else None
    return angle + np.cumsum(turns) * turn, kept, before.size
