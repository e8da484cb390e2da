"""The canonical poses on the board: where transitions end, and what steering holds.

They are our own, solved by inverse kinematics from constraints that `data/motions/make_poses.py` states
and the file repeats. Frame: the board's, level; origin on the tilt axis midway between the trucks,
x forward, y left, z up.
"""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sim.skate.robot.g1 import JOINTS
from sysid.errors import SysidError
from sysid.files import shipped_data
from sysid.roll import Array

POSES = ("push", "steer")
CLIP_JOINTS = np.r_[7:26, 29:33]
"""Columns of a stored clip that hold the 23 joints in policy order: wrists (26–28 and 33–35) left out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """One whole-body pose on the board."""

    name: str
    recipe: str
    """The constraints that it was solved from, for people."""
    position: Array
    """Pelvis position in the board frame [m], shape (3,)."""
    quaternion: Array
    """Pelvis orientation in the board frame, unit quaternion wxyz, shape (4,)."""
    joints: Array
    """Joint angles in the order of `JOINTS` [rad], shape (23,)."""

    def qpos(self) -> Array:
        """Return the robot's MuJoCo configuration in the board frame, shape (30,)."""
        return np.concatenate([self.position, self.quaternion, self.joints])


def load_poses(path: Path | None = None) -> dict[str, Pose]:
    """Read the canonical poses, 'push' and 'steer', from `path` or from the shipped file.

    Raises:
        SysidError: The file is missing, is not TOML, or a pose in it is missing, of the wrong shape,
            or not finite.
    """
    path = path or shipped_data() / "motions" / "poses.toml"
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SysidError(f"{path}: cannot be read ({error.strerror}). Expected a file of poses.") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SysidError(f"{path}: not a TOML file ({error}).") from error
    return {name: _pose(path, name, raw.get(name)) for name in POSES}


def load_transition(name: str) -> Array:
    """Return the robot's configurations in the shipped plain clip, board frame, 'mount' or 'dismount', shape (frames, 30)."""
    table = np.load(shipped_data() / "motions" / "transitions" / f"{name}-plain.npy")
    end = load_poses()[{"mount": "steer", "dismount": "push"}[name]]
    table[:, :3] += end.position - table[-1, :3]  # the clip's board stands in the world
    return np.hstack((table[:, :7], table[:, CLIP_JOINTS]))


def _pose(path: Path, name: str, raw: Any) -> Pose:
    if not isinstance(raw, dict):
        raise SysidError(f"{path}: pose '[{name}]' is missing; expected the poses {', '.join(POSES)}.")
    joints: Any = raw.get("joints")
    short = [joint.removesuffix("_joint") for joint in JOINTS]
    if not isinstance(joints, dict) or set(joints) != set(short):
        raise SysidError(
            f"{path}: '[{name}.joints]' must name these {len(short)} joints: {', '.join(short)}."
        )
    quaternion = _numbers(path, f"{name}.quaternion", raw.get("quaternion"), 4)
    if abs(np.linalg.norm(quaternion) - 1) > 1e-3:
        raise SysidError(
            f"{path}: '{name}.quaternion' has length {np.linalg.norm(quaternion):.4g}; expected 1."
        )
    return Pose(
        name=name,
        recipe=str(raw.get("recipe", "")),
        position=_numbers(path, f"{name}.position", raw.get("position"), 3),
        quaternion=quaternion / np.linalg.norm(quaternion),
        joints=_numbers(path, f"{name}.joints", [joints[key] for key in short], len(short)),
    )


def _numbers(path: Path, where: str, raw: Any, count: int) -> Array:
    try:
        numbers = np.asarray(raw, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape != (count,) or not np.all(np.isfinite(numbers)):
        raise SysidError(f"{path}: '{where}' is {raw!r}; expected {count} finite numbers.")
    return numbers
