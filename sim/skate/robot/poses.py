"""The canonical poses on the board: where transitions end, and what steering holds.

They are our own, solved by inverse kinematics from constraints that `data/motions/make_poses.py` states
and the file repeats. Frame: the board's, level; origin on the tilt axis midway between the trucks,
x forward, y left, z up.
"""

import tomllib
from functools import cache

import numpy as np

from sim.skate.robot.g1 import JOINTS, MOTORS, pose_vector
from sysid.files import shipped_data
from sysid.roll import Array

CLIP_JOINTS = np.array([7 + MOTORS.index(joint) for joint in JOINTS])
"""Columns of a stored clip that hold the 23 joints in policy order, after the pelvis' position and quaternion."""


@cache
def load_poses() -> dict[str, Array]:
    """Return the robot's MuJoCo configuration in the board frame, shape (30,), in the canonical poses 'push' and 'steer'."""
    raw = tomllib.loads((shipped_data() / "motions" / "poses.toml").read_text(encoding="utf-8"))
    poses: dict[str, Array] = {}
    for name, pose in raw.items():
        turn = np.array(pose["quaternion"])
        poses[name] = np.r_[pose["position"], turn / np.linalg.norm(turn), pose_vector(pose["joints"])]
        poses[name].setflags(write=False)
    return poses


def load_transition(name: str) -> Array:
    """Return the robot's configurations in the shipped plain clip, board frame, 'mount' or 'dismount', shape (frames, 30)."""
    table = np.load(shipped_data() / "motions" / "transitions" / f"{name}-plain.npy")
    end = load_poses()[{"mount": "steer", "dismount": "push"}[name]]
    table[:, :3] += end[:3] - table[-1, :3]  # the clip's board stands in the world
    return np.hstack((table[:, :7], table[:, CLIP_JOINTS]))
