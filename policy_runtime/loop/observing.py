"""Observations of a policy from a robot's state: our own layout and that of the HUSKY release."""

import numpy as np
import numpy.typing as npt

from policy_runtime.loop.commands import Command
from policy_runtime.robots import RobotState
from sim.skate import rotation
from sim.skate.cycle.clock import Clock
from sim.skate.mdp.actor_observation import (
    FRAME_SIZE,
    FRAMES,
    OBSERVATION_SIZE,
    PARTS,
    History,
    raw_frame,
    scale_frame,
    still_to_turn,
)
from sim.skate.robot.g1 import JOINTS, default_pose
from sysid.roll import Array

RELEASE_SIZE = FRAMES * (FRAME_SIZE + 1)
"""Numbers that a policy of the HUSKY release takes: 79 a frame, grouped by term."""
DOWN = np.array([0.0, 0.0, -1.0])
_EACH = {
    "command": ("speed", "turn"),
    "angular_velocity": ("x", "y", "z"),
    "gravity": ("x", "y", "z"),
    "phase": ("",),
}
FRAME_NAMES = tuple(f"{part} {each}".strip() for part, *_ in PARTS for each in _EACH.get(part, JOINTS))
"""Of the 78 numbers of a frame."""


class PaperObservation:
    """The observation of the paper, with the commanded turn. See `sim.skate.mdp.actor_observation`."""

    size = OBSERVATION_SIZE
    newest: npt.NDArray[np.intp] = np.arange(OBSERVATION_SIZE - FRAME_SIZE, OBSERVATION_SIZE)
    """Indices of the newest frame in the observation."""
    names = FRAME_NAMES
    """Of the numbers of a frame."""

    def __init__(self) -> None:
        """Start without a history."""
        self._clock, self._default, self._history = Clock(), default_pose(), History()

    def reset(self) -> None:
        """Forget the frames seen."""
        self._history.reset()

    def build(self, state: RobotState, command: Command, last_action: Array, step: int) -> Array:
        """Return the observation of this step, shape (390,)."""
        return self._history.push(self.frame(state, command, last_action, step))

    def frame(self, state: RobotState, command: Command, last_action: Array, step: int) -> Array:
        """Return the newest frame, scaled, shape (78,)."""
        frame = raw_frame(
            np.array(command),
            state.angular_velocity,
            rotation.rotate_back(state.quaternion, DOWN),
            state.joint_position - self._default,
            state.joint_velocity,
            last_action,
            np.array([self._clock.cycle_phase(step)]),
        )
        return scale_frame(frame)


class FeedbackObservation(PaperObservation):
    """The observation that our policies are trained with: how far it still has to turn, by its own yaw."""

    def __init__(self) -> None:
        """Start without a history."""
        super().__init__()
        self._yaw_then: float | None = None

    def reset(self) -> None:
        """Forget the frames seen, and the yaw from which the turn counts."""
        super().reset()
        self._yaw_then = None

    def frame(self, state: RobotState, command: Command, last_action: Array, step: int) -> Array:
        """Return the newest frame, scaled, shape (78,)."""
        yaw = float(rotation.yaw(state.quaternion))
        if self._yaw_then is None or self._clock.begins_steering(step):
            self._yaw_then = yaw
        turn = float(still_to_turn(command.turn, yaw, self._yaw_then))
        return super().frame(state, Command(command.speed, turn), last_action, step)


class ReleaseObservation(PaperObservation):
    """The observation of the HUSKY release: a heading as third number, and the history grouped by term."""

    size = RELEASE_SIZE
    names = (*FRAME_NAMES[:2], "heading", *FRAME_NAMES[2:])
    _sizes = (PARTS[0][1], 1, *(size for _, size, _, _ in PARTS[1:]))
    _order = np.concatenate(
        [
            ((FRAME_SIZE + 1) * np.arange(FRAMES)[:, None] + np.arange(end - size, end)).ravel()
            for end, size in zip(np.cumsum(_sizes), _sizes, strict=True)
        ]
    )
    """Places of its numbers in the frames one after the other."""
    newest = np.argsort(_order)[-len(names) :]

    def build(self, state: RobotState, command: Command, last_action: Array, step: int) -> Array:
        """Return the observation of this step, shape (395,)."""
        return super().build(state, command, last_action, step)[self._order]

    def frame(self, state: RobotState, command: Command, last_action: Array, step: int) -> Array:
        """Return the newest frame, scaled, shape (79,)."""
        frame = super().frame(state, command, last_action, step)
        return np.insert(frame, PARTS[0][1], rotation.yaw(state.quaternion) / np.pi)
