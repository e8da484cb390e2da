# pyright: reportAttributeAccessIssue=false, reportUnknownParameterType=false
# (MuJoCo ships no type stubs.)
"""Disturbances of a ride in plain MuJoCo: delays, other masses and frictions, slopes, pushes."""

import math
from collections import deque
from dataclasses import replace

import mujoco
import numpy as np

from policy_runtime.evaluation.protocol import Protocol
from policy_runtime.robots import PD_PERIOD, JointCommand, RobotState
from policy_runtime.robots.simulated import SimulatedRobot
from sim.board.scene import WHEELS
from sim.skate import rotation
from sim.skate.mdp.actor_observation import PARTS
from sim.skate.world.scene import BOARD, ROBOT
from sysid.errors import SysidError
from sysid.roll import Array

PUSH_TIME = 0.1
"""How long a push lasts [s]."""
_NOISE = {name: noise for name, _, _, noise in PARTS}


def change(model: mujoco.MjModel, protocol: Protocol) -> None:
    """Change a compiled skating scene into the world of a protocol."""
    for i in range(model.nbody):
        if model.body(i).name.startswith(ROBOT):
            model.body_mass[i] *= protocol.mass
            model.body_inertia[i] *= protocol.mass
    for i in range(model.ngeom):
        name = model.geom(i).name
        if protocol.friction is not None and name.startswith(ROBOT) and "_foot" in name:
            model.geom_friction[i, 0] = protocol.friction
    for wheel in WHEELS:
        model.geom_friction[model.geom(f"{BOARD}{wheel}_wheel_collision").id, 2] *= protocol.rolling
    weight, slope = np.linalg.norm(model.opt.gravity), protocol.slope
    model.opt.gravity[:] = -weight * np.array([math.sin(slope), 0.0, math.cos(slope)])
    mujoco.mj_setConst(model, mujoco.MjData(model))


class StressedRobot(SimulatedRobot):
    """A simulated robot with delayed servos and noisy sensors, which can be pushed."""

    def __init__(self, model: mujoco.MjModel, protocol: Protocol, direct_rake: float | None = None) -> None:
        """Take over a scene that `change` has changed; the rest is as of `SimulatedRobot`."""
        self.rng = np.random.default_rng(0)
        """Draws the noise; give each ride its own."""
        self._noise = protocol.noise
        lag = protocol.delay / PD_PERIOD
        if not math.isclose(lag, round(lag), abs_tol=1e-6):
            raise SysidError(
                f"--delay {protocol.delay:g}: must be a multiple of the servos' {PD_PERIOD:g} s."
            )
        self._lag = round(lag)
        # The frame of the ground seen from one whose z axis is the vertical, as an IMU has it.
        self._ground = np.array([math.cos(protocol.slope / 2), 0.0, -math.sin(protocol.slope / 2), 0.0])
        super().__init__(model, direct_rake=direct_rake)

    def reset(self, qpos: Array, speed: float = 0.0) -> None:
        """See `SimulatedRobot.reset`; delayed commands and pushes are cleared."""
        self._steps, self._pushed_until = 0, 0
        self._coming: deque[tuple[int, JointCommand]] = deque()
        super().reset(qpos, speed)

    def send(self, command: JointCommand) -> None:
        """Let a command reach the servos after the delay."""
        self._coming.append((self._steps + self._lag, command))

    def step(self) -> None:
        """Advance by one period of the servos."""
        while self._coming and self._coming[0][0] <= self._steps:
            super().send(self._coming.popleft()[1])
        if self._steps >= self._pushed_until:
            self.data.xfrc_applied[self.ids.pelvis, :2] = 0.0
        super().step()
        self._steps += 1

    def push_with(self, force: Array) -> None:
        """Begin a push of the pelvis with a horizontal force [N], shape (2,)."""
        self.data.xfrc_applied[self.ids.pelvis, :2] = force
        self._pushed_until = self._steps + round(PUSH_TIME / PD_PERIOD)

    def read(self) -> RobotState:
        """Return the noisy sensors' readings; orientation from the vertical, not from the ground."""
        state = super().read()
        around = lambda name, size: self._noise * _NOISE[name] * self.rng.uniform(-1, 1, size)  # noqa: E731
        lean = np.append(around("gravity", 2), 0.0) / 2
        quaternion = rotation.multiply(
            rotation.multiply(self._ground, state.quaternion), np.append(1.0, lean)
        )
        return replace(
            state,
            quaternion=quaternion / np.linalg.norm(quaternion),
            angular_velocity=state.angular_velocity + around("angular_velocity", 3),
            joint_position=state.joint_position + around("joint_position", 23),
            joint_velocity=state.joint_velocity + around("joint_velocity", 23),
        )
