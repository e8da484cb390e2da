"""Motions on a grid with known angle and rate, for tests of the diagnosis."""

import numpy as np

from sysid.diagnosis.motion import Motion
from sysid.diagnosis.smoother import Smoothed


def motion_of_angles(angle, nodes, *, noise=1e-3, frequency=5.0, amplitude=0.2, held=100.0, rate=False):
    """Return a motion that reads an angle, shape (r, n), at each node, over its widest swing."""
    rows, count = angle.shape
    return Motion(
        amplitude=amplitude, frequency=frequency, step=2 * np.pi / nodes, reading=angle, variance=np.full(angle.shape, noise**2),
        lag=np.zeros(angle.shape), length=np.full(rows, count), envelope=np.ones(angle.shape), hold=angle[:, 0],
        held=np.full(rows, held), rest=0.0, is_rate=rate, zero="known", starts=np.zeros(rows),
        releases=np.arange(rows), free=np.tile([0, -1], (rows, 1)),
    )  # fmt: skip


def known_motion(angle, rate):
    """Return a smoothed motion whose rate is known exactly."""
    zeros = np.zeros_like(angle)
    return Smoothed(angle=angle, rate=rate, rate_variance=zeros, misfit=zeros, cost=0.0)


def decaying(nodes=64, periods=6, decay=0.05):
    """Return angle and rate of a lightly damped swing over its amplitude, shape (1, n) each, in the unit of time 1/ω₀."""
    time = np.arange(nodes * periods) * 2 * np.pi / nodes
    envelope = np.exp(-decay * time)
    return (envelope * np.cos(time))[None], (-envelope * (np.sin(time) + decay * np.cos(time)))[None]
