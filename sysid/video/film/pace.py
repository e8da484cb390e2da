"""How fast a swing is for a film, and whether the film keeps its pace."""

import numpy as np

from sysid.roll import Array

WINDOW_FRAMES = (40, 28, 20, 14)
"""Frames after the fastest one that are looked at: the deck is free there, until somebody takes it again."""
EXPLAINED = 0.05
"""Share of a swing up to which a fit may be off: more, and the window holds more than a free swing."""
RAMP, STEADY = 1.9, 1.25
"""Ratio of half periods before and after, from which on no joint but a change of the film's speed explains it at once,
and within each of both that a joint may show (stiffness and play change a period little by little)."""
RAMP_STDS, RAMP_SWING = 8.0, 0.02
"""Least half swing that is looked at: in standard deviations, and as a share of the whole."""
DAMPING_RATIOS = np.array([0.003, 0.05, 0.15, 0.3, 0.45, 0.6, 0.75])
"""Damping ratios that are tried."""


def frames_per_period(time: Array, roll: Array, std: Array) -> float | None:
    """Return the frames in one period of the free swing, or None where nothing swings.

    A damped sine is fitted to the frames that follow the fastest one, on a grid of periods and damping
    ratios (each is a linear problem for the rest). Of all that fit equally well the longest period
    counts, so that noise or a short window never makes a film look too slow.

    Args:
        time: Times of the frames [s], shape (n,).
        roll: Roll [rad], shape (n,).
        std: Its standard deviation [rad], shape (n,).
    """
    step = np.diff(roll)
    if len(step) < 8:
        return None
    # The stated deviation holds what is common to all frames as well, a read-out that is not known above all: it
    # would hide a swing. Noise alone is what differs from frame to frame where the deck rests, most of a film.
    noise = min(float(np.median(std)), 1.4826 * float(np.median(np.abs(np.diff(step)))) / np.sqrt(6))
    if np.ptp(roll) < 8 * noise:
        return None
    rate = np.abs(step) / np.diff(time)
    begin = int(np.argmax(rate))
    widest = roll[begin : begin + WINDOW_FRAMES[0]]
    moved = np.abs(widest - np.median(widest))
    if len(moved) < 6 or moved.max() < 4 * noise:
        return None
    count = (time[begin:] - time[begin]) / float(np.median(np.diff(time)))
    period = np.repeat(np.geomspace(2.1, 150, 90), len(DAMPING_RATIOS))
    ratio = np.tile(DAMPING_RATIOS, 90)
    decay = ratio / np.sqrt(1 - ratio**2)
    found = np.inf
    for frames in WINDOW_FRAMES:
        swing = roll[begin : begin + frames]
        wave = np.exp((2 * np.pi / period * (1j - decay))[:, None] * count[: len(swing)])
        basis, _ = np.linalg.qr(np.stack([np.ones_like(wave.real), wave.real, wave.imag], axis=2))
        explained = (basis @ (basis.transpose(0, 2, 1) @ swing)[..., None])[..., 0]
        error = np.mean((swing - explained) ** 2, axis=1)
        tolerance = 1.5 * error.min() + noise**2 + (0.02 * np.std(swing)) ** 2
        found = float(period[error <= tolerance].max())
        if error.min() <= noise**2 + (EXPLAINED * np.std(swing)) ** 2:
            break
    return found


def speed_ramp(time: Array, roll: Array, std: Array) -> float | None:
    """Return when a film changes its speed [s]: where a free decay swings of a sudden at another pace; None if it never does.

    Two half periods or more before and after are compared, in swings that die away: a hand moves otherwise.

    Args:
        time: Times of the frames [s], shape (n,).
        roll: Roll [rad], shape (n,).
        std: Its standard deviation [rad], shape (n,).
    """
    least = max(RAMP_STDS * float(np.median(std)), RAMP_SWING * float(np.ptp(roll)))
    turns = [0]
    for row in range(1, len(roll)):
        up = 1.0 if len(turns) < 2 else np.sign(roll[turns[-1]] - roll[turns[-2]])
        if len(turns) < 2 and abs(roll[row] - roll[0]) > least:
            turns.append(row)
        elif len(turns) > 1 and up * (roll[row] - roll[turns[-1]]) > 0:
            turns[-1] = row
        elif len(turns) > 1 and up * (roll[turns[-1]] - roll[row]) > least:
            turns.append(row)
    half, size = np.diff(time[turns]), np.abs(np.diff(roll[turns]))
    for at in range(2, len(half) - 2):  # the one in which it changes is of both
        before, after = half[at - 2 : at], half[at + 1 : at + 3]
        dies = bool(np.all(np.diff(size[at - 2 : at + 3]) < 0))
        steady = max(np.ptp(np.log(before)), np.ptp(np.log(after))) < np.log(STEADY)
        if dies and steady and abs(np.log(after.mean() / before.mean())) > np.log(RAMP):
            return float(time[turns[at]])
    return None
