"""Correlated errors of a film's angle.

Video compression drops very small motion, and the pixel grid shifts an edge. Such an error lasts until the deck has
moved on. Its correlation falls as e^(-t/τ) (Ornstein–Uhlenbeck process, exact at any sampling).
"""

import math

import numpy as np

from sysid.roll import Array, Signal

PER_PERIOD = 4.0
"""Independent values in a period of an error that follows the motion: it has the motion's frequency and twice that."""


def kept_after(step: Array, omega: float) -> Array:
    """Return the correlation of an error with itself after some time.

    Args:
        step: Time [s], shape (n,).
        omega: Natural frequency of the board [rad/s].

    Returns:
        e^(-t/τ), shape (n,). An error has one independent value in 2 τ.
    """
    return np.exp(-step * omega * PER_PERIOD / math.pi)


def own_std(signal: Signal) -> Array:
    """Return the standard deviations without errors common to all samples [rad], shape (n,); the full ones if unknown."""
    return signal.std if signal.own_std is None else signal.own_std
