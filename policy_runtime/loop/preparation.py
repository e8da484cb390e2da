"""Before a policy takes over: the robot is armed, eased into the start pose, checked, and its delay measured.

With a handset, people decide when: 'start' arms, 'A' hands over to the policy, and 'select', or L2 with B as
in the factory's own program, stops at any time. Until 'start' the servos only brake.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from policy_runtime.robots import ARM, BEGIN, PD_PERIOD, JointCommand, Robot, RobotState
from sim.skate.cycle.clock import CONTROL_PERIOD
from sim.skate.robot.g1 import JOINTS, servos
from sysid.roll import Array

MAX_INCLINATION = math.radians(20)
"""Greatest inclination of the pelvis at the start [rad]."""
PROBES, PROBE_STEP, PROBE_STEPS = 6, 0.05, 40
"""Measuring the delay: how many small steps of a target, their size [rad], servo periods watched after each."""
PROBE_JOINT = JOINTS.index("left_elbow_joint")
"""It bears nothing."""


class StoppedError(Exception):
    """A check found why the robot must stop; the text is the reason."""


class Ticks(Protocol):
    """The part of the loop that the preparation needs."""

    robot: Robot

    def tick(self, command: JointCommand) -> RobotState:
        """Check the robot, let it follow a command for one policy step, and return its state before.

        Raises:
            StoppedError: A check failed.
        """
        ...

    def servo_step(self) -> None:
        """Let one period of the servos pass."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Preparation:
    """Preparation of a robot: from its present pose to the policy's start."""

    pose: Array
    """Joint angles that the policy starts from [rad], shape (23,)."""
    ramp: float = 3.0
    """Time from where the joints are to the pose [s]."""
    tolerance: float = 0.5
    """How far a joint may then be from it [rad]; the servos are soft, a hanging leg bends a hip by 0.4."""
    handset: bool = True
    """Wait for the handset before the ramp and before the policy."""
    dry: bool = False
    """Go on holding the pose: the policy decides, but its answers are not sent."""


@dataclass(frozen=True, slots=True)
class Delay:
    """Time from a command's sending to the state that shows the motor's answer [s]."""

    times: tuple[float, ...]
    """One for each probe."""

    def __str__(self) -> str:
        """Return median and range [ms]."""
        low, middle, high = (1e3 * f(self.times) for f in (min, np.median, max))
        return f"{middle:.0f} ms from command to measured torque ({low:.0f} to {high:.0f} in {len(self.times)} probes)"

    def to_json(self) -> dict[str, Any]:
        """Return it for machines."""
        return {"median_ms": float(1e3 * np.median(self.times)), "probes_ms": [1e3 * t for t in self.times]}


def prepare(options: Preparation, loop: Ticks, log: Callable[[str, str], None]) -> Delay:
    """Bring the robot to the start pose and return its delay.

    Raises:
        StoppedError: The robot is not well, does not reach the pose, or does not answer.
    """
    if options.handset:
        log("wait", f"press '{ARM}' on the handset to move to the start pose; 'select' or L2+B stops")
        _wait_for(ARM, loop, JointCommand.brake())
    begin = loop.tick(JointCommand.brake()).joint_position.copy()
    log("ramp", f"{np.abs(options.pose - begin).max():.2f} rad in {options.ramp:g} s")
    for i in range(round(options.ramp / CONTROL_PERIOD) + 1):
        share = min(1.0, i * CONTROL_PERIOD / max(options.ramp, CONTROL_PERIOD))
        loop.tick(JointCommand.hold(begin + share * share * (3 - 2 * share) * (options.pose - begin)))
    _check_pose(options, loop.tick(JointCommand.hold(options.pose)))
    delay = measure_delay(options.pose, loop)
    log("delay", str(delay))
    if options.handset and not options.dry:
        log("ready", f"in the start pose; press '{BEGIN}' to begin")
        _wait_for(BEGIN, loop, JointCommand.hold(options.pose))
        _check_pose(options, loop.tick(JointCommand.hold(options.pose)))
    return delay


def _wait_for(button: str, loop: Ticks, command: JointCommand) -> None:
    while button not in loop.tick(command).buttons:
        pass


def _check_pose(options: Preparation, state: RobotState) -> None:
    error = state.joint_position - options.pose
    worst = int(np.abs(error).argmax())
    if abs(error[worst]) > options.tolerance:
        raise StoppedError(
            f"start pose: {JOINTS[worst]} is {error[worst]:+.2f} rad from it, tolerance {options.tolerance:g}. Free "
            "the robot, or ease --pose-tolerance"
        )
    if state.inclination > MAX_INCLINATION:
        raise StoppedError(
            f"start pose: the pelvis leans {math.degrees(state.inclination):.0f}°, at most "
            f"{math.degrees(MAX_INCLINATION):.0f}°. Set the robot upright"
        )


def measure_delay(pose: Array, loop: Ticks) -> Delay:
    """Step one joint's target to and fro and return when its measured torque has answered by half.

    A servo's torque follows its target at once, the joint only later; what passes in between is the way to the
    motor and back. The resolution is one period of the servos.

    Args:
        pose: Joint angles around which to step [rad], shape (23,).

    Raises:
        StoppedError: The motor does not answer.
    """
    times: list[float] = []
    targets = [pose, pose + PROBE_STEP * (np.arange(len(JOINTS)) == PROBE_JOINT)]
    for probe in range(PROBES):
        there, sign = (probe + 1) % 2, 1.0 - 2.0 * (probe % 2)
        before = loop.tick(JointCommand.hold(targets[1 - there])).joint_torque[PROBE_JOINT]
        loop.robot.send(JointCommand.hold(targets[there]))
        answer = np.empty(PROBE_STEPS)
        for i in range(PROBE_STEPS):
            loop.servo_step()
            answer[i] = sign * (loop.robot.read().joint_torque[PROBE_JOINT] - before)
        if answer.max() < 0.3 * PROBE_STEP * servos().stiffness[PROBE_JOINT]:
            raise StoppedError(
                f"delay: {JOINTS[PROBE_JOINT]} did not answer a step of {PROBE_STEP:g} rad within "
                f"{PROBE_STEPS * PD_PERIOD * 1e3:.0f} ms. Are the motors on?"
            )
        times.append((int(np.argmax(answer >= answer.max() / 2)) + 1) * PD_PERIOD)
    return Delay(tuple(times))
