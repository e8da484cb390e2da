# pyright: reportAttributeAccessIssue=false, reportUnknownParameterType=false
# (MuJoCo ships no type stubs.)
"""MuJoCo's own viewer beside a simulated robot."""

import os
import sys
from collections.abc import Generator
from contextlib import contextmanager
from itertools import count

from policy_runtime.robots import SERVO_STEPS
from policy_runtime.robots.simulated import SimulatedRobot
from sysid.errors import SysidError


@contextmanager
def viewed(robot: SimulatedRobot, wanted: bool) -> Generator[None]:
    """Draw the robot in MuJoCo's viewer once a policy step, if wanted."""
    if not wanted:
        yield
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
    steps = count(1)

    def draw() -> None:
        if next(steps) % SERVO_STEPS == 0 and viewer.is_running():
            viewer.sync()

    robot.after_step = draw
    with viewer:
        yield
