# pyright: reportAttributeAccessIssue=false, reportUnknownParameterType=false
# (MuJoCo ships no type stubs.)
"""The skating world in plain MuJoCo, ready to run a policy: scene, robot, limits, start."""

from dataclasses import dataclass

import mujoco
import numpy as np

from policy_runtime.loop.safety import Limits
from policy_runtime.robots import PD_PERIOD
from policy_runtime.robots.simulated import Gantry, SimulatedRobot
from sim.board.scene import Coupling
from sim.skate.cycle.start import Start
from sim.skate.robot.g1 import JOINTS
from sim.skate.robot.poses import load_poses
from sim.skate.world.scene import ROBOT, SceneOptions, skate_spec, standing_state
from sim.skate.world.terrain import Terrain
from sysid.board import Board
from sysid.errors import SysidError
from sysid.roll import Array

STARTS = ("stand", "push", "steer")
"""Starts of a ride: one foot on the ground, or a canonical pose on the rolling board."""


@dataclass(frozen=True, slots=True)
class World:
    """A robot on a board on the ground."""

    robot: SimulatedRobot
    start: Array
    """Configuration at the start, shape (nq,)."""

    @property
    def start_joints(self) -> Array:
        """Joint angles of the start [rad], shape (23,)."""
        joints = self.robot.base_q + 7
        return self.start[joints : joints + len(JOINTS)]

    def reset(self, *, speed: float = 0.0, rng: np.random.Generator | None = None) -> None:
        """Put robot and board back to the start, all rolling at a speed [m/s]; `rng` draws the joints' deviations, as in training."""
        qpos = self.start.copy()
        if rng is not None:
            joints = slice(self.robot.base_q + 7, self.robot.base_q + 7 + len(JOINTS))
            most = Start().joint_noise
            qpos[joints] += rng.uniform(-most, most, len(JOINTS))
        self.robot.reset(qpos, speed)


def make_world(
    board: Board,
    *,
    coupling: Coupling = "equality",
    steered: bool = True,
    terrain: Terrain = "flat",
    start: str = "stand",
    gantry: Gantry | None = None,
    visuals: bool = False,
) -> World:
    """Build the world for a board from the installed G1 model."""
    options = SceneOptions(coupling=coupling, steered=steered, terrain=terrain, timestep=PD_PERIOD)
    model = skate_spec(board, options, visuals=visuals).compile()
    return world_of(model, start=start, direct_rake=direct_rake(board, coupling), gantry=gantry)


def direct_rake(board: Board, coupling: Coupling) -> float | None:
    """Return the rake λ [rad] by which trucks are set after every step; None where a constraint does it."""
    return board.geometry["rake"].value if coupling == "direct" else None


def world_of(
    model: mujoco.MjModel,
    *,
    start: str = "stand",
    direct_rake: float | None = None,
    gantry: Gantry | None = None,
    standing: Array | None = None,
) -> World:
    """Return the world of a compiled scene.

    Args:
        standing: Configuration of 'stand', shape (nq,), instead of one from the installed G1 model.
        direct_rake: λ [rad] where the scene's trucks are set directly.
    """
    robot = SimulatedRobot(model, direct_rake=direct_rake, gantry=gantry)
    if start not in STARTS:
        raise SysidError(f"unknown start '{start}'. Known: {', '.join(STARTS)}.")
    if start == "stand":
        qpos = standing_state(model) if standing is None else standing
    else:
        qpos = model.qpos0.copy()
        board_height = float(model.qpos0[robot.board_q + 2])
        qpos[robot.base_q : robot.base_q + 7 + len(JOINTS)] = load_poses()[start]
        qpos[robot.base_q + 2] += board_height
    return World(robot, qpos)


def joint_limits(model: mujoco.MjModel, **limits: float) -> Limits:
    """Return the safety limits of a scene's robot; keywords replace the defaults of `Limits`."""
    low, high = np.array([model.joint(ROBOT + name).range for name in JOINTS]).T
    return Limits(joint_low=low, joint_high=high, **limits)
