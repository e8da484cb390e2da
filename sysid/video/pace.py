"""How many frames there are for each period of the fastest swing."""

import numpy as np

from sysid.roll import Array

WINDOW = 40
"""Frames after the fastest one that are looked at: the deck is free there, a hand is slower."""


def frames_per_period(time: Array, roll: Array, std: Array) -> float | None:
    """Return the frames in one period of the free swing, or None where nothing swings.

    A damped sine is fitted to the frames that follow the fastest one, on a grid of periods and damping
    ratios (each is a linear problem for the rest). Of all that fit equally well the longest period
    counts, so that noise or a short window never makes a film look too slow.
    """
    step = np.diff(roll)
    if len(step) < 8 or np.ptp(roll) < 8 * np.median(std):
        return None
    rate = np.abs(step) / np.diff(time)
    begin = int(np.argmax(rate))
    stop = min(begin + WINDOW, len(roll))
    moved = np.abs(roll[begin:stop] - np.median(roll[begin:stop]))
    if stop - begin < 6 or moved.max() < 4 * np.median(std):
        return None
    interval = float(np.median(np.diff(time)))
    count = (time[begin:stop] - time[begin]) / interval
    frames = np.geomspace(2.1, 150, 90)
    best: list[tuple[float, float]] = []
    for period in frames:
        for ratio in (0.003, 0.05, 0.15, 0.3, 0.45, 0.6, 0.75):
            decay = ratio / np.sqrt(1 - ratio**2) * 2 * np.pi / period
            wave = np.exp((1j * 2 * np.pi / period - decay) * count)
            basis = np.stack([np.ones_like(count), wave.real, wave.imag], axis=1)
            weights, *_ = np.linalg.lstsq(basis, roll[begin:stop], rcond=None)
            best.append((float(np.mean((basis @ weights - roll[begin:stop]) ** 2)), period))
    errors = np.array(best)
    tolerance = 1.5 * errors[:, 0].min() + float(np.median(std)) ** 2 + (0.02 * np.std(roll[begin:stop])) ** 2
    return float(errors[errors[:, 0] <= tolerance, 1].max())
