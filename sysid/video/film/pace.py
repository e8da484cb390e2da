"""How fast a swing is for a film, and whether the film keeps its pace: by the times from turn to turn."""

import numpy as np

from sysid.roll import Array

RAMP, STEADY = 1.9, 1.25
"""Ratio of half periods before and after a change of the film's speed, and the largest ratio from one half
period to the next for a joint, whose stiffness and play change a period little by little."""
MIN_STDS, MIN_SHARE = 8.0, 0.02
"""Least half swing that is looked at: in standard deviations, and as a share of the whole."""


def half_swings(time: Array, roll: Array, std: Array) -> tuple[Array, Array]:
    """Return when a swing turns [s], shape (m + 1,), and how far it goes from turn to turn [rad], shape (m,).

    Args:
        time: Times of the frames [s], shape (n,).
        roll: Roll [rad], shape (n,).
        std: Its standard deviation [rad], shape (n,).
    """
    # The stated deviation includes errors common to all frames, an unknown read-out above all: it
    # would hide a swing. Noise alone is what differs from frame to frame where the deck rests, most of a film.
    noise = min(np.median(std), 1.4826 * np.median(np.abs(np.diff(roll, n=2))) / np.sqrt(6))
    least = max(MIN_STDS * noise, MIN_SHARE * np.ptp(roll))
    turns, way = [0], 0.0
    for row, angle in enumerate(roll):
        if way * (angle - roll[turns[-1]]) > 0:
            turns[-1] = row
        elif abs(angle - roll[turns[-1]]) > least:
            way = float(np.sign(angle - roll[turns[-1]]))
            turns.append(row)
    return time[turns], np.abs(np.diff(roll[turns]))


def frames_per_period(time: Array, roll: Array, std: Array) -> float:
    """Return the frames in one period of the free swing, infinite where nothing swings: of the longest row of swings that die away.

    A deck that is held turns nowhere, and so never makes a film look too slow. Times [s], roll and its deviation [rad], all of shape (n,).
    """
    turns, size = half_swings(time, roll, std)
    runs = np.split(np.arange(len(size)), np.flatnonzero(np.diff(size) > 0) + 1)
    longest = max(runs, key=len)[1:]
    if len(longest) == 0:
        return np.inf
    return float(2 * (turns[longest[-1] + 1] - turns[longest[0]]) / len(longest) / np.median(np.diff(time)))


def speed_ramp(time: Array, roll: Array, std: Array) -> float | None:
    """Return when a film changes its speed [s]: where a free decay swings of a sudden at another pace; None if it never does.

    Two half periods or more before and after are compared, in swings that die away: a hand moves otherwise. Times [s], roll and its
    deviation [rad], all of shape (n,).
    """
    turns, size = half_swings(time, roll, std)
    half = np.diff(turns)
    for at in range(2, len(half) - 2):  # the one in which it changes is of both
        before, after = half[at - 2 : at], half[at + 1 : at + 3]
        dies = bool(np.all(np.diff(size[at - 2 : at + 3]) < 0))
        steady = max(np.ptp(np.log(before)), np.ptp(np.log(after))) < np.log(STEADY)
        if dies and steady and abs(np.log(after.mean() / before.mean())) > np.log(RAMP):
            return float(turns[at])
    return None
