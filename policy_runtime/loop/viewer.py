# pyright: reportAttributeAccessIssue=false, reportUnknownParameterType=false
# (MuJoCo ships no type stubs.)
"""MuJoCo's own viewer beside a simulated robot."""

import os
import sys
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

from policy_runtime.robots import PD_PERIOD, JointCommand, Robot, RobotState
from policy_runtime.robots.simulated import SimulatedRobot
from sim.skate.cycle.clock import CONTROL_PERIOD
from sysid.errors import SysidError

FRAME_STEPS = round(CONTROL_PERIOD / PD_PERIOD)
"""Servo steps between two pictures: one a policy step."""


class _Viewed:
    """A simulated robot that is drawn while it moves."""

    def __init__(self, robot: SimulatedRobot, viewer: Any) -> None:
        self._robot, self._viewer, self._steps = robot, viewer, 0

    def read(self) -> RobotState:
        return self._robot.read()

    def send(self, command: JointCommand) -> None:
        self._robot.send(command)

    def step(self) -> None:
        self._robot.step()
        self._steps += 1
        if self._steps % FRAME_STEPS == 0 and self._viewer.is_running():
            self._viewer.sync()

    def close(self) -> None:
        self._robot.close()


@contextmanager
def viewed(robot: SimulatedRobot, wanted: bool) -> Generator[Robot]:
    """Yield the robot, drawn in MuJoCo's viewer if wanted."""
    if not wanted:
        yield robot
        return
    import mujoco.viewer

    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        # MuJoCo would end the whole program.
        raise SysidError("the MuJoCo viewer needs a display. Run without --viewer.")
    try:
        viewer = mujoco.viewer.launch_passive(robot.model, robot.data)
    except Exception as error:
        raise SysidError(
            f"the MuJoCo viewer cannot open a window here ({error}). Run without --viewer."
        ) from error
    with viewer:
        yield _Viewed(robot, viewer)
