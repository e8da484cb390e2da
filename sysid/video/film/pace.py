"""How many frames there are for each period of the fastest swing."""

import numpy as np

from sysid.roll import Array

WINDOW_FRAMES = 40
"""Frames after the fastest one that are looked at: the deck is free there, a hand is slower."""
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
    stop = min(begin + WINDOW_FRAMES, len(roll))
    moved = np.abs(roll[begin:stop] - np.median(roll[begin:stop]))
    if stop - begin < 6 or moved.max() < 4 * noise:
        return None
    interval = float(np.median(np.diff(time)))
    count = (time[begin:stop] - time[begin]) / interval
    period = np.repeat(np.geomspace(2.1, 150, 90), len(DAMPING_RATIOS))
    ratio = np.tile(DAMPING_RATIOS, 90)
    decay = ratio / np.sqrt(1 - ratio**2)
    wave = np.exp((2 * np.pi / period * (1j - decay))[:, None] * count)
    basis, _ = np.linalg.qr(np.stack([np.ones_like(wave.real), wave.real, wave.imag], axis=2))
    swing = roll[begin:stop]
    explained = (basis @ (basis.transpose(0, 2, 1) @ swing)[..., None])[..., 0]
    error = np.mean((swing - explained) ** 2, axis=1)
    tolerance = 1.5 * error.min() + noise**2 + (0.02 * np.std(swing)) ** 2
    return float(period[error <= tolerance].max())
