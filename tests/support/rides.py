"""Rides whose every step is known: the robot does as it is told."""

from typing import Any

import numpy as np

from policy_runtime.evaluation.metrics import Rides
from sysid.roll import Array


def made_rides(pushing: Array, steering: Array, **changes: Any) -> Rides:
    """Return an episode at 1 m/s that follows its commands, with some changes.

    Args:
        pushing: Whether it pushes at each step, shape (n,).
        steering: Whether it steers, shape (n,).
        changes: Fields by name, shape (n, 1) and more.
    """
    shape = (len(pushing), 1)
    zero, no = np.zeros(shape), np.zeros(shape, bool)
    deck = np.zeros((*shape, 2), bool)
    deck[..., 1] = True
    deck[steering] = True
    values: dict[str, Any] = {name: zero.copy() for name in Rides.__slots__} | {
        "alive": ~no, "pushing": pushing[:, None], "steering": steering[:, None], "still": no,
        "commanded_speed": zero + 1, "board_speed": zero + 1, "joint_position": np.zeros((*shape, 23)),
        "foot_on_ground": np.zeros((*shape, 2), bool), "foot_on_deck": deck, "succeeded": np.ones(1, bool),
    }  # fmt: skip
    return Rides(**(values | changes))
