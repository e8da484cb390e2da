# pyright: reportAttributeAccessIssue=false, reportUnknownParameterType=false
# (MuJoCo ships no type stubs.)
"""Disturbances of a ride in plain MuJoCo: delays, other masses and frictions, slopes, pushes."""

import math
from collections import deque
from dataclasses import dataclass, replace

import mujoco
import numpy as np

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Stress:
    """How a world differs from the nominal one."""

    delay: float = 0.0
    """From the policy's answer to the servos [s]."""
    noise: float = 0.0
    """Noise of the sensors, as a multiple of the training's."""
    mass: float = 1.0
    """Factor of masses and inertias of the robot."""
    friction: float | None = None
    """Sliding friction of the soles [1]; the scene's if None."""
    rolling: float = 1.0
    """Factor of the wheels' rolling friction."""
    slope: float = 0.0
    """Gradient of the ground along the start's direction [rad], uphill positive."""
    push: float = 0.0
    """Horizontal force on the pelvis for 0.1 s, in a drawn direction, every 5 to 10 s [N]."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        lag = self.delay / PD_PERIOD
        for name, fine, wanted in (
            ("delay", 0 <= self.delay <= 1, "from 0 to 1 s, in seconds; 20 ms is 0.02"),
            ("delay", abs(lag - np.rint(lag)) < 1e-6, f"must be a multiple of the servos' {PD_PERIOD:g} s"),
            ("mass", self.mass > 0, "a factor, must be larger than 0"),
            ("rolling", self.rolling > 0, "a factor, must be larger than 0"),
            ("noise", self.noise >= 0, "must not be negative"),
            ("push", self.push >= 0, "must not be negative"),
            ("friction", self.friction is None or self.friction > 0, "must be larger than 0"),
            ("slope", abs(self.slope) < math.radians(30), "must be within ±30 degrees"),
        ):
            if not fine:
                value = math.degrees(self.slope) if name == "slope" else getattr(self, name)
                raise SysidError(f"--{name} {value:g}: {wanted}.")

    def change(self, model: mujoco.MjModel) -> None:
        """Change a compiled skating scene into that world."""
        for i in range(model.nbody):
            if model.body(i).name.startswith(ROBOT):
                model.body_mass[i] *= self.mass
                model.body_inertia[i] *= self.mass
        for i in range(model.ngeom):
            name = model.geom(i).name
            if self.friction is not None and name.startswith(ROBOT) and "_foot" in name:
                model.geom_friction[i, 0] = self.friction
        for wheel in WHEELS:
            model.geom_friction[model.geom(f"{BOARD}{wheel}_wheel_collision").id, 2] *= self.rolling
        weight = np.linalg.norm(model.opt.gravity)
        model.opt.gravity[:] = -weight * np.array([math.sin(self.slope), 0.0, math.cos(self.slope)])
        mujoco.mj_setConst(model, mujoco.MjData(model))


class StressedRobot(SimulatedRobot):
    """A simulated robot with delayed servos and noisy sensors, which can be pushed."""

    def __init__(self, model: mujoco.MjModel, stress: Stress, direct_rake: float | None = None) -> None:
        """Take over a scene that `Stress.change` has changed; the rest is as of `SimulatedRobot`."""
        self.rng = np.random.default_rng(0)
        """Draws the noise; give each ride its own."""
        self._stress = stress
        self._lag = round(stress.delay / PD_PERIOD)
        # The frame of the ground seen from one whose z axis is the vertical, as an IMU has it.
        self._ground = np.array([math.cos(stress.slope / 2), 0.0, -math.sin(stress.slope / 2), 0.0])
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
        around = lambda name, size: self._stress.noise * _NOISE[name] * self.rng.uniform(-1, 1, size)  # noqa: E731
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


CALM = Stress()
