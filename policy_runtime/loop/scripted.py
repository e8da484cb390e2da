"""Scripted policies: baselines that a learned one must beat, and motions to show the world with."""

from collections.abc import Callable

import numpy as np

from policy_runtime.loop.commands import Command
from policy_runtime.loop.gravity_load import GravityLoad
from policy_runtime.loop.policy import Policy, action_for
from policy_runtime.motion.motion_check import motion_facts
from policy_runtime.motion.motions import Motion, load_motions
from policy_runtime.robots import RobotState
from sim.skate.cycle.clock import STILL_SPEED, Clock
from sim.skate.robot.g1 import JOINTS, default_pose
from sim.skate.robot.poses import load_poses
from sysid.errors import SysidError, did_you_mean
from sysid.roll import Array

EASE_STEPS = 10
"""Policy steps of the way from the current joints to the start of a script."""


THRUST = 60.0
"""Force with which the pushing script thrusts the left foot backwards against the ground [N]."""


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


def standing() -> Scripted:
    """Hold the steering pose against gravity: ride whatever comes."""
    target = GravityLoad().asked(load_poses()["steer"], (True, True))
    return Scripted("stand", lambda command, step: target)


def scripted_push() -> Scripted:
    """Replay a pushing clip while the cycle pushes, and glide on the right foot for the rest of it.

    It pushes like the shipped clip whose speed is nearest to the command. It never steps on the board with both feet:
    without feedback it would only fall.
    """
    clock, load, clips = Clock(), GravityLoad(), load_motions()
    speeds = np.array([motion.speed for motion in clips])
    replays = [_replay(motion, load) for motion in clips]
    glide = load.asked(load_poses()["push"], (False, True))
    still = load.asked(np.r_[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, default_pose()], (True, True))

    def targets(command: Command, step: int) -> Array:
        if command.speed < STILL_SPEED:
            return still
        replay = replays[int(np.argmin(np.abs(speeds - command.speed)))]
        step = step % clock.period
        if clock.pushing(step):
            return replay[step % len(replay)]
        since, left = step - clock.push, clock.period - step
        if since < clock.mount:
            return _blend(replay[(clock.push - 1) % len(replay)], glide, since / clock.mount)
        return _blend(replay[0], glide, min(left / clock.dismount, 1.0))

    return Scripted("push", targets)


def _replay(motion: Motion, load: GravityLoad) -> Array:
    """Return the targets that replay a clip, shape (frames, 23): the left foot bears weight where it stands."""
    steps = zip(motion.qpos, motion_facts(motion, load.model).planted, strict=True)
    return np.array([load.asked(qpos, (bool(down), True), THRUST) for qpos, down in steps])


def _blend(start: Array, end: Array, share: float) -> Array:
    return start + (end - start) * (share * share * (3 - 2 * share))


SCRIPTS: dict[str, Callable[[], Policy]] = {
    "zero": lambda: Scripted("zero", lambda command, step: default_pose()),
    "stand": standing,
    "push": scripted_push,
}
"""Scripted policies by name; 'zero' asks for the default pose, one foot on the ground, one on the deck."""


def scripted(name: str) -> Policy:
    """Return a scripted policy by its name."""
    if name not in SCRIPTS:
        raise SysidError(
            f"unknown script '{name}'.{did_you_mean(name, SCRIPTS)} Scripted policies: {', '.join(SCRIPTS)}. "
            "Shipped ones: pink, black. Anything else must be an ONNX file or an exported folder."
        )
    return SCRIPTS[name]()
