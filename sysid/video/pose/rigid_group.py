"""Which of many patches belong to the board: those that are seen with it wherever it turns.

A wheel, or the wall that a hand passed in front of, agrees with a deck that is held still, and is lost when
the deck turns. So does the deck's own side, which turns out of sight. Neither tells a turn, but many of
them at once draw the common motion to themselves.
"""

import numpy as np

from sysid.roll import Array
from sysid.video.types import Complex, Mask

ATTITUDE_STEP = np.radians(2.0)
"""Turns this far apart are different attitudes [rad]."""
ATTITUDES_SEEN = 0.4
"""Share of the attitudes in which a patch of the board is seen, against one that is seen in most."""
REWEIGHTINGS = 8
"""Rounds in which points that do not turn with the others lose their weight (a choice)."""


def rigid_group(points: Array, fewest: int) -> Mask:
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
    attitude = np.round(
        np.angle(similarities(home, place[enough], common[enough])[0]) / ATTITUDE_STEP
    ).astype(int)
    shown = np.array([seen[enough][attitude == one].mean(axis=0) > 0.5 for one in np.unique(attitude)])
    count = shown.sum(axis=0)
    most = np.sort(count)[-fewest:].min()
    return np.asarray(count >= min(most, ATTITUDES_SEEN * count.max()), np.bool_)


def similarities(home: Complex, place: Complex, seen: Mask) -> tuple[Complex, Complex]:
    """Return the similarity on which most points agree, for each frame: place = turn * home + shift; each of shape (n,).

    Args:
        home: Points in one frame [px], shape (N,).
        place: Points in n frames [px], shape (n, N).
        seen: Which of them are seen there, at least two a frame.
    """
    weight, half = seen.astype(np.float64), seen.sum(axis=1) // 2
    home, place = np.where(seen, home, 0), np.where(seen, place, 0)
    turn = shift = np.zeros(len(place), np.complex128)
    for _ in range(REWEIGHTINGS):
        total = weight.sum(axis=1)
        middle, there = ((weight * each).sum(axis=1) / total for each in (home, place))
        arm, here = home - middle[:, None], place - there[:, None]
        turn = (weight * here * arm.conj()).sum(axis=1) / np.maximum(
            (weight * np.abs(arm) ** 2).sum(axis=1), 1e-9
        )
        shift = there - turn * middle
        off = np.abs(here - turn[:, None] * arm)
        typical = np.sort(np.where(seen, off, np.inf), axis=1)[np.arange(len(place)), half][:, None] + 0.5
        weight = seen / (1 + (off / (2 * typical)) ** 2) ** 2
    return turn, shift
