"""Policies: they turn states and commands into joint targets."""

from typing import Protocol

import numpy as np

from policy_runtime.loop.commands import Command
from policy_runtime.loop.observing import (
    RELEASE_SIZE,
    FeedbackObservation,
    PaperObservation,
    ReleaseObservation,
)
from policy_runtime.loop.policy_file import PolicyFile
from policy_runtime.robots import RobotState
from sim.skate.robot.g1 import JOINTS, default_pose, servos
from sysid.roll import Array


class Policy(Protocol):
    """Turns state and command into joint targets, once a policy step."""

    name: str
    action: Array
    """The last answer in action units, shape (23,)."""

    def reset(self, state: RobotState) -> None:
        """Begin an episode in this state."""
        ...

    def act(self, state: RobotState, command: Command, step: int) -> Array:
        """Return joint targets [rad], shape (23,)."""
        ...


def action_for(target: Array) -> Array:
    """Return the action that asks for joint targets [rad]; both of shape (23,)."""
    return (target - default_pose()) / servos().action_scale


class OnnxPolicy:
    """Runs an opened policy."""

    def __init__(self, file: PolicyFile) -> None:
        """Take the file; `reset` begins an episode."""
        self.name = file.path.stem
        self.file = file
        ours = FeedbackObservation if file.turn_feedback else PaperObservation
        self.observing: PaperObservation = (ReleaseObservation if file.size == RELEASE_SIZE else ours)()
        """Builds its observation."""
        self.observation = np.zeros(file.size)
        """What it saw last."""
        self._default, self._scale = default_pose(), servos().action_scale
        self.action = np.zeros(len(JOINTS))

    def reset(self, state: RobotState) -> None:
        """Begin an episode; the first 'last action' is the one that asks for the present pose, as in training."""
        self.observing.reset()
        release = self.file.size == RELEASE_SIZE
        self.action = np.zeros(len(JOINTS)) if release else action_for(state.joint_position)

    def act(self, state: RobotState, command: Command, step: int) -> Array:
        """Return joint targets [rad], shape (23,)."""
        self.observation = self.observing.build(state, command, self.action, step)
        batch = {self.file.input_name: self.observation.astype(np.float32)[None]}
        answer = self.file.session.run([self.file.output_name], batch)[0]
        self.action = np.asarray(answer, dtype=np.float64)[0]
        return self._default + self._scale * self.action
