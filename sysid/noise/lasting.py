"""Correlated errors of a film's angle, which last until the deck has moved on.

Compression leaves out motion too small to be drawn, a pattern of pixels shifts an edge. Such an error fades
as e^(-t/τ) (Ornstein and Uhlenbeck's process, exact at any sampling), so that samples that share it tell
less than their number says.
"""

import math

import numpy as np

from sysid.roll import Array, Signal

LASTS = 1 / 8
"""Time constant τ of a film's errors, in periods: they follow the motion, which has four independent values in one."""


def kept_after(step: Array, omega: float) -> Array:
    """Return the share of an error that is left after some time.

    Args:
        step: Time passed [s], shape (n,).
        omega: Natural frequency of the board [rad/s].

    Returns:
        e^(-t/τ), shape (n,).
    """
    return np.exp(-step * omega / (2 * math.pi * LASTS))


def own_std(signal: Signal) -> Array:
    """Return the deviations that are not common to all samples [rad], shape (n,); all of them where that is not known."""
    return signal.std if signal.own_std is None else signal.own_std
