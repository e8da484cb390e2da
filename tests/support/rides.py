"""Rides whose every step is known: the robot does as it is told."""

from typing import Any

import numpy as np

from policy_runtime.evaluation.metrics import Rides
from sysid.roll import Array


def made_rides(pushing: Array, steering: Array, told: tuple[float, ...] = (1.0,), **changes: Any) -> Rides:
    """Return an episode for each speed told [m/s]: all as asked for, but for what is changed.

    Args:
        pushing: Whether it pushes at each step, shape (n,).
        steering: Whether it steers, shape (n,).
        told: Speed of each episode [m/s].
        changes: Fields by name, shape (n, episodes) and more.
    """
    shape = (len(pushing), len(told))
    zero, no = np.zeros(shape), np.zeros(shape, bool)
    deck = np.zeros((*shape, 2), bool)
    deck[..., 1] = True
    deck[steering] = True
    speed = np.broadcast_to(np.array(told), shape).copy()
    values: dict[str, Any] = {name: zero.copy() for name in Rides.__slots__} | {
        "alive": ~no, "pushing": pushing[:, None] & ~no, "steering": steering[:, None] & ~no, "still": no,
        "commanded_speed": speed, "board_speed": speed.copy(), "joint_position": np.zeros((*shape, 23)),
        "foot_on_ground": np.zeros((*shape, 2), bool), "foot_on_deck": deck, "succeeded": np.ones(len(told), bool),
    }  # fmt: skip
    return Rides(**(values | changes))
