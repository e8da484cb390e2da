"""Policies that need no learning: what a learned one must beat, and what shows the world without one."""

from collections.abc import Callable

import numpy as np

from policy_runtime.commands import Command
from policy_runtime.motions import Motion, load_motions
from policy_runtime.policy import Policy, action_for
from policy_runtime.robots import RobotState
from sim.skate.clock import STILL_SPEED, Clock
from sim.skate.g1 import JOINTS, default_pose
from sim.skate.poses import load_poses
from sysid.errors import HuskyError, did_you_mean
from sysid.roll import Array

EASE_STEPS = 10
"""Policy steps over which a script leads from where the joints are to where it begins."""


class Scripted:
    """Follows joint targets that a function gives for command and step; without feedback."""

    def __init__(self, name: str, targets: Callable[[Command, int], Array]) -> None:
        """Take the script."""
        self.name = name
        self._targets = targets
        self._start = default_pose()
        self._ticks = 0
        self.action = np.zeros(len(JOINTS))

    def reset(self, state: RobotState) -> None:
        """Begin from where the joints are."""
        self._start, self._ticks = state.joint_position.copy(), 0

    def act(self, state: RobotState, command: Command, step: int) -> Array:
        """Return joint targets [rad], shape (23,)."""
        self._ticks += 1
        share = min(self._ticks / EASE_STEPS, 1.0)
        target = (1 - share) * self._start + share * self._targets(command, step)
        self.action = action_for(target)
        return target


def zero_action() -> Scripted:
    """Answer zero always: the default pose, one foot on the ground, one on the deck."""
    return Scripted("zero", lambda command, step: default_pose())


def standing() -> Scripted:
    """Hold the steering pose always: ride whatever comes."""
    pose = load_poses()["steer"].joints
    return Scripted("stand", lambda command, step: pose)


def scripted_push(clip: Motion | None = None, clock: Clock | None = None) -> Scripted:
    """Replay a pushing clip, step on the board, hold the steering pose, step off: the cycle without feedback.

    Args:
        clip: What to push like; the shipped clip whose speed is nearest to the command if None.
        clock: The cycle.
    """
    clock = clock or Clock()
    clips = [clip] if clip is not None else load_motions()
    speeds = np.array([_speed(motion) for motion in clips])
    poses = load_poses()
    push, steer = poses["push"].joints, poses["steer"].joints

    def targets(command: Command, step: int) -> Array:
        if command.speed < STILL_SPEED:
            return default_pose()
        motion = clips[int(np.argmin(np.abs(speeds - command.speed)))]
        step = step % clock.period
        if clock.pushing(step):
            return motion.joints[step % len(motion.joints)]
        if clock.mounting(step):
            last = motion.joints[(clock.push - 1) % len(motion.joints)]
            return _blend(last, steer, (step - clock.push) / clock.mount)
        if clock.steering(step):
            return steer
        return _blend(steer, push, (step - clock.push - clock.mount - clock.steer) / clock.dismount)

    return Scripted("push", targets)


def _blend(start: Array, end: Array, share: float) -> Array:
    return start + (end - start) * (share * share * (3 - 2 * share))


def _speed(motion: Motion) -> float:
    return float(np.linalg.norm(motion.position[-1, :2] - motion.position[0, :2]) / motion.duration)


SCRIPTS: dict[str, Callable[[], Policy]] = {"zero": zero_action, "stand": standing, "push": scripted_push}
"""Scripted policies by name."""


def scripted(name: str) -> Policy:
    """Return a scripted policy by its name.

    Raises:
        HuskyError: There is none of that name.
    """
    if name not in SCRIPTS:
        raise HuskyError(
            f"unknown script '{name}'.{did_you_mean(name, SCRIPTS)} Scripted policies: {', '.join(SCRIPTS)}; "
            "anything else must be an ONNX file."
        )
    return SCRIPTS[name]()
