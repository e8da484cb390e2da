"""How fast a swing is for a film, and whether the film keeps its pace: by the times from turn to turn."""

import numpy as np

from sysid.roll import Array

RAMP = 1.9
"""Ratio of half periods before and after a change of the film's speed [1]. An editor slows a film down twofold; turns are known to a
frame."""


def half_swings(time: Array, roll: Array, std: Array) -> tuple[Array, Array]:
    """Return when a swing turns [s], shape (m + 1,), and how far it goes from turn to turn [rad], shape (m,).

    Roll and its deviation [rad] are given at times [s], each (n,). A half swing is longer than the range of n values of normal noise,
    2 σ √(2 ln n).
    """
    least = 2 * np.sqrt(2 * np.log(len(roll))) * np.median(std)
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

    Two half periods before and after are compared, in swings that die away: a hand moves otherwise. The middles of the pairs are three
    half periods apart. A joint that slows down steadily has ratios of RAMP^(1/3) from one to the next.
    Times [s], roll and its deviation [rad], all of shape (n,).
    """
    turns, size = half_swings(time, roll, std)
    half = np.diff(turns)
    for at in range(2, len(half) - 2):  # the one in which it changes is of both
        before, after = half[at - 2 : at], half[at + 1 : at + 3]
        dies = bool(np.all(np.diff(size[at - 2 : at + 3]) < 0))
        steady = max(np.ptp(np.log(before)), np.ptp(np.log(after))) < np.log(RAMP) / 3
        if dies and steady and abs(np.log(after.mean() / before.mean())) > np.log(RAMP):
            return float(turns[at])
    return None
