"""Which of many patches belong to the board: those that are seen with it wherever it turns.

A wheel, or the wall that a hand passed in front of, agrees with a deck that is held still, and is lost when
the deck turns. So does the deck's own side, which turns out of sight. Neither tells a turn, but many of
them at once draw the common motion to themselves.
"""

import numpy as np
import numpy.typing as npt

from sysid.roll import Array
from sysid.video.types import Complex

ATTITUDE_STEP = np.radians(2.0)
"""Turns this far apart are different attitudes [rad]."""
ATTITUDES_SEEN = 0.4
"""Share of the attitudes in which a patch of the board is seen, against one that is seen in most."""
REWEIGHTINGS = 8
"""Rounds in which points that do not turn with the others lose their weight (a choice)."""


def rigid_group(points: Array, fewest: int) -> npt.NDArray[np.bool_]:
    """Tell which points belong to the body that turns.

    Args:
        points: Points in all pictures [px], shape (n, N, 2); NaN where one is not seen.
        fewest: So many are kept at least: those that are seen in most attitudes.

    Returns:
        Shape (N,).
    """
    seen = np.asarray(np.isfinite(points).all(axis=2), np.bool_)
    place = np.where(seen, points[..., 0] + 1j * points[..., 1], 0)
    home = place[int(np.argmax(seen.sum(axis=1)))]
    common = seen & seen[int(np.argmax(seen.sum(axis=1)))]
    enough = common.sum(axis=1) >= 3
    if not enough.any():
        return np.ones(points.shape[1], np.bool_)
    attitude = np.round(rough_turn(home, place[enough], common[enough]) / ATTITUDE_STEP).astype(int)
    shown = np.array([seen[enough][attitude == one].mean(axis=0) > 0.5 for one in np.unique(attitude)])
    count = shown.sum(axis=0)
    most = np.sort(count)[-fewest:].min()
    return np.asarray(count >= min(most, ATTITUDES_SEEN * count.max()), np.bool_)


def rough_turn(home: Complex, place: Complex, seen: npt.NDArray[np.bool_]) -> Array:
    """Return the turn in the picture on which most points agree, for each frame [rad], shape (n,).

    Args:
        home: Points in one frame, shape (N,).
        place: Points in n frames, shape (n, N).
        seen: Which of them are seen there, at least two a frame.
    """
    weight = seen.astype(np.float64)
    turn = np.ones(len(place), np.complex128)
    for _ in range(REWEIGHTINGS):
        total = weight.sum(axis=1, keepdims=True)
        arm = home - (weight * home).sum(axis=1, keepdims=True) / total
        here = place - (weight * place).sum(axis=1, keepdims=True) / total
        turn = (weight * here * arm.conj()).sum(axis=1) / np.maximum(
            (weight * np.abs(arm) ** 2).sum(axis=1), 1e-9
        )
        off = np.abs(here - turn[:, None] * arm)
        typical = np.array([np.median(row[good]) for row, good in zip(off, seen, strict=True)])[:, None] + 0.5
        weight = seen / (1 + (off / (2 * typical)) ** 2) ** 2
    return np.angle(turn)
