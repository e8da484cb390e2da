"""The policy's observation: 78 numbers a step, five steps at a time; training and runtime share this code.

The five frames follow each other oldest first (`frame-major`): 390 numbers. After a reset all five are
the first frame. The HUSKY release feeds 79 numbers, with the absolute heading as third, and groups the history
by term. Its policy turns as well with that heading held at zero; here it is left out, as in the paper.

The turn that is left is the commanded one less the pelvis' yaw since the command, which the robot's IMU measures. The paper
feeds the commanded turn; a tenth of a second of history does not show how much of it is done.
"""

from typing import Any

import numpy as np

from sim.skate.arrays import constant, namespace, wrap_angle

FRAMES = 5
"""Frames that the policy sees: this one and the four before."""
PARTS = (
    ("command", 2, (2.0, 1.0), 0.0),  # speed [m/s], turn that is left [rad]
    ("angular_velocity", 3, (0.25,) * 3, 0.2),  # of the pelvis, its own frame [rad/s]
    ("gravity", 3, (1.0,) * 3, 0.05),  # unit vector down in the pelvis frame
    ("joint_position", 23, (1.0,) * 23, 0.01),  # less the default pose [rad]
    ("joint_velocity", 23, (0.05,) * 23, 1.5),  # [rad/s]
    ("last_action", 23, (1.0,) * 23, 0.0),
    ("phase", 1, (1.0,), 0.0),  # of the cycle, 0 to 1
)
"""Name, size, scale and noise in training (half-width of a uniform distribution, before scaling) of each part of a frame, in order."""

FRAME_SIZE = sum(size for _, size, _, _ in PARTS)
"""Numbers a frame."""
OBSERVATION_SIZE = FRAMES * FRAME_SIZE
SCALE = tuple(scale for _, _, scales, _ in PARTS for scale in scales)
NOISE = tuple(noise for _, size, _, noise in PARTS for _ in range(size))


def part_of(number: int) -> str:
    """Return the name of the part that a number of the observation belongs to."""
    number %= FRAME_SIZE
    for name, size, _, _ in PARTS:
        if number < size:
            return name
        number -= size
    raise AssertionError("PARTS add up to FRAME_SIZE")


def still_to_turn(turn: Any, yaw: Any, yaw_then: Any) -> Any:
    """Return the commanded turn less the yaw of the pelvis since it was told, within ±π [rad], shape (...,)."""
    return wrap_angle(turn - (yaw - yaw_then))


def raw_frame(*parts: Any) -> Any:
    """Return one frame before noise and scaling, shape (..., 78), from `PARTS` in order, each of shape (..., size)."""
    return namespace(parts[0]).concatenate(parts, axis=-1)


def scale_frame(frame: Any) -> Any:
    """Return a raw frame, shape (..., 78), in the units of the policy's input."""
    return frame * constant(SCALE, frame)


class History:
    """The last five frames of one robot (NumPy), filled with the first frame after a reset."""

    def __init__(self) -> None:
        """Start empty."""
        self._frames: np.ndarray | None = None

    def reset(self) -> None:
        """Forget everything; the next frame fills all five places."""
        self._frames = None

    def push(self, frame: np.ndarray) -> np.ndarray:
        """Add a scaled frame, shape (78,), and return the observation, shape (390,), oldest first."""
        if self._frames is None:
            self._frames = np.tile(frame, (FRAMES, 1))
        else:
            self._frames = np.vstack((self._frames[1:], frame))
        return self._frames.reshape(-1)
