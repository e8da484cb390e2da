# pyright: reportAttributeAccessIssue=false, reportUnknownParameterType=false
# (MuJoCo ships no type stubs.)
"""The robot on its board in plain MuJoCo: the reports of a real robot, and the truth."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from policy_runtime.robots import PD_PERIOD, JointCommand, RobotState
from sim.board.learned import apply, left_out
from sim.board.scene import TILT_JOINT, TRUCK_JOINTS, WHEELS, set_trucks
from sim.skate import rotation
from sim.skate.arrays import wrap_angle
from sim.skate.robot.g1 import FOOT_BODIES, JOINTS, SOLE_CENTRE
from sim.skate.world.contacts import FORCE_THRESHOLD, WHEEL_FORCE_THRESHOLD
from sim.skate.world.scene import BOARD, ROBOT
from sysid.errors import SysidError
from sysid.roll import Array

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """Ground truth of a simulation."""

    board_position: Array
    """Origin of the board, on its tilt axis [m], shape (3,)."""
    board_heading: float
    """[rad]"""
    board_speed: float
    """Velocity of the board along its own x axis [m/s]."""
    board_drift: float
    """Velocity of the board along its own y axis [m/s]."""
    roll: float
    """Tilt joint [rad], right edge down positive."""
    trucks: Array
    """Front and rear truck angle [rad], shape (2,)."""
    pelvis_position: Array
    """[m], shape (3,)."""
    upright: float
    """Cosine of the pelvis' inclination."""
    foot_on_ground: Flags
    """Left, right, bool (2,)."""
    foot_on_deck: Flags
    """Left, right, bool (2,)."""
    ground_load: Array
    """Force of the ground on left and right foot over the robot's weight [1], shape (2,)."""
    left_slip: float
    """Speed of the middle of the left sole over the ground [m/s]."""
    left_place: float
    """Place of the middle of the left sole along the board [m]."""
    wheel_on_ground: Flags
    """Front left, front right, rear left, rear right, bool (4,)."""
    other_contacts: int
    """Contacts of ground or board with anything of the robot but its feet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gantry:
    """A trolley on the board that holds the pelvis upright, above its place on the board and turned as at the start.

    Its forces act back on the board, so only the robot's own push moves both. Up and down the robot is free.
    """

    turning: float = 600.0
    """Stiffness against leaning and turning [N*m/rad]."""
    turning_damping: float = 60.0
    """[N*m*s/rad]"""
    holding: float = 2000.0
    """Stiffness against leaving its place over the board [N/m]."""
    holding_damping: float = 250.0
    """[N*s/m]"""


class SimulatedRobot:
    """Steps a skating scene (`sim.skate.world.scene.skate_spec`) at the rate of the servos."""

    def __init__(
        self, model: mujoco.MjModel, *, direct_rake: float | None = None, gantry: Gantry | None = None
    ) -> None:
        """Take over a compiled scene.

        Args:
            direct_rake: λ [rad] of a scene with coupling='direct'. The trucks are then set after every step.
        """
        self.model, self.data = model, mujoco.MjData(model)
        self._rake, self._gantry, self._left = direct_rake, gantry, left_out(model)
        self.after_step: Callable[[], None] | None = None
        """Called after each servo period."""
        self._substeps = round(PD_PERIOD / model.opt.timestep)
        if not math.isclose(self._substeps * model.opt.timestep, PD_PERIOD, rel_tol=1e-6):
            raise SysidError(
                f"the scene's step of {model.opt.timestep * 1e3:g} ms does not divide the servo period of "
                f"{PD_PERIOD * 1e3:g} ms. Build it with a step of 2 or 1 ms."
            )
        try:
            joints = [model.joint(ROBOT + name) for name in JOINTS]
            self.actuators = np.array([model.actuator(ROBOT + name).id for name in JOINTS])
            base = model.joint(f"{ROBOT}floating_base_joint")
            board = model.joint(f"{BOARD}board_free_joint")
        except KeyError as error:
            raise SysidError(f"the scene is not one of skating: {error.args[0]}") from error
        self.ids = _Ids(model)
        self._q = np.array([joint.qposadr[0] for joint in joints])
        self._v = np.array([joint.dofadr[0] for joint in joints])
        self.base_q, self.base_v = int(base.qposadr[0]), int(base.dofadr[0])
        self.board_q, self.board_v = int(board.qposadr[0]), int(board.dofadr[0])
        self.reset(model.qpos0)

    def reset(self, qpos: Array, speed: float = 0.0) -> None:
        """Put everything at a configuration, robot and board rolling ahead together.

        Args:
            qpos: Configuration of the whole scene, shape (nq,).
            speed: Of board, wheels and robot along x [m/s].
        """
        self._truth: Truth | None = None
        self._began = qpos.copy()
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = qpos
        self.data.qvel[[self.base_v, self.board_v]] = speed
        for wheel in self.ids.wheel_joints:
            self.data.qvel[wheel] = speed / self.ids.wheel_radius
        if self._rake is not None:
            set_trucks(self.model, self.data, self._rake, BOARD)
        self.data.ctrl[self.actuators] = self.data.qpos[self._q]
        mujoco.mj_forward(self.model, self.data)
        self._held = self._in_board_frame()

    def hang(self) -> None:
        """Put pelvis and board back to their place at the last reset, at rest: the robot hangs on a hoist."""
        for q, v in ((self.base_q, self.base_v), (self.board_q, self.board_v)):
            self.data.qpos[q : q + 7] = self._began[q : q + 7]
            self.data.qvel[v : v + 6] = 0.0

    def read(self) -> RobotState:
        """Return the robot's own state, without noise."""
        data, base, velocity = self.data, self.base_q, self.base_v
        return RobotState(
            time=float(data.time),
            age=0.0,
            quaternion=data.qpos[base + 3 : base + 7].copy(),
            angular_velocity=data.qvel[velocity + 3 : velocity + 6].copy(),
            joint_position=data.qpos[self._q],
            joint_velocity=data.qvel[self._v],
            joint_torque=data.actuator_force[self.actuators],
        )

    def send(self, command: JointCommand) -> None:
        """Set targets and gains; MuJoCo's own servos follow them in every step, implicit in velocity."""
        model = self.model
        self.data.ctrl[self.actuators] = command.position
        model.actuator_gainprm[self.actuators, 0] = command.stiffness
        model.actuator_biasprm[self.actuators, 1] = -command.stiffness
        model.actuator_biasprm[self.actuators, 2] = -command.damping

    def step(self) -> None:
        """Advance the simulation by one period of the servos."""
        self._truth = None
        if self._gantry is not None:
            self._hold(self._gantry)
        if self._rake is None and not self._left:
            mujoco.mj_step(self.model, self.data, self._substeps)
        else:
            for _ in range(self._substeps):
                apply(self._left, self.data)
                mujoco.mj_step(self.model, self.data)
                if self._rake is not None:
                    set_trucks(self.model, self.data, self._rake, BOARD)
        if self.after_step is not None:
            self.after_step()

    def _in_board_frame(self) -> tuple[Array, float]:
        """Return where the pelvis is over the board, forward and left [m], and how it is turned [rad]."""
        data, pelvis, board = self.data, self.ids.pelvis, self.ids.board
        place = (data.xpos[pelvis] - data.xpos[board]) @ data.xmat[board].reshape(3, 3)[:, :2]
        ahead, along = data.xmat[pelvis], data.xmat[board]  # column 0 is the forward axis
        return place, math.atan2(ahead[3], ahead[0]) - math.atan2(along[3], along[0])

    def _hold(self, gantry: Gantry) -> None:
        data, pelvis, board = self.data, self.ids.pelvis, self.ids.board
        frame = data.xmat[pelvis].reshape(3, 3)
        place, turned = self._in_board_frame()
        plane = data.xmat[board].reshape(3, 3)[:, :2]
        relative = data.qvel[self.base_v : self.base_v + 3] - data.qvel[self.board_v : self.board_v + 3]
        pull = gantry.holding * (self._held[0] - place) - gantry.holding_damping * (relative @ plane)
        # Axis and sine of the lean, (frame's z) x (vertical), and how far to turn.
        towards = np.array([frame[1, 2], -frame[0, 2], wrap_angle(self._held[1] - turned)])
        spin = frame @ data.qvel[self.base_v + 3 : self.base_v + 6]
        spin[2] -= data.qvel[self.board_v + 5]
        data.xfrc_applied[pelvis, :3] = plane @ pull
        data.xfrc_applied[board, :3] = -plane @ pull
        torque = gantry.turning * towards - gantry.turning_damping * spin
        data.xfrc_applied[pelvis, 3:] = torque
        data.xfrc_applied[board, 5] = -torque[2]

    def truth(self) -> Truth:
        """Return the ground truth of the present moment."""
        if self._truth is None:
            self._truth = self._look()
        return self._truth

    def _look(self) -> Truth:
        model, data, ids = self.model, self.data, self.ids
        feet_ground, feet_deck, wheels, other = ids.contacts(model, data)
        q, v = self.board_q, self.board_v
        board = data.body(ids.board)
        forward = board.xmat.reshape(3, 3)[:, 0]
        sole, slip = ids.left_sole(model, data)
        return Truth(
            board_position=data.qpos[q : q + 3].copy(),
            board_heading=float(rotation.yaw(data.qpos[q + 3 : q + 7])),
            board_speed=float(data.qvel[v : v + 3] @ forward),
            board_drift=float(data.qvel[v : v + 3] @ board.xmat.reshape(3, 3)[:, 1]),
            roll=float(data.qpos[ids.tilt]),
            trucks=data.qpos[ids.trucks],
            pelvis_position=data.qpos[self.base_q : self.base_q + 3].copy(),
            upright=float(data.xmat[ids.pelvis, 8]),
            foot_on_ground=feet_ground > FORCE_THRESHOLD,
            foot_on_deck=feet_deck > FORCE_THRESHOLD,
            ground_load=feet_ground / ids.weight,
            left_slip=slip,
            left_place=float((sole - board.xpos) @ forward),
            wheel_on_ground=wheels > WHEEL_FORCE_THRESHOLD,
            other_contacts=other,
        )


class _Ids:
    """Indices of bodies, joints and geoms by their role."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.board = model.body(f"{BOARD}board").id
        self.pelvis = model.body(f"{ROBOT}pelvis").id
        self.tilt = int(model.joint(BOARD + TILT_JOINT).qposadr[0])
        self.trucks = np.array([int(model.joint(BOARD + name).qposadr[0]) for name in TRUCK_JOINTS])
        wheels = [model.joint(f"{BOARD}{wheel}_wheel_joint") for wheel in WHEELS]
        self.wheel_joints = [int(joint.dofadr[0]) for joint in wheels]
        self.wheel_radius = float(model.geom(f"{BOARD}{WHEELS[0]}_wheel_collision").size[0])
        self.weight = float(model.body_subtreemass[self.pelvis] * np.linalg.norm(model.opt.gravity))
        # Kinds of geoms: 0, 1 feet; 2 deck; 3 to 6 wheels; 7 other parts of the board; 8 ground;
        # 9 other parts of the robot.
        feet = [model.body(ROBOT + name).id for name in FOOT_BODIES]
        self.left_foot = feet[0]
        parts = [*feet, model.body(f"{BOARD}deck").id]
        parts += [model.body(f"{BOARD}{wheel}_wheel").id for wheel in WHEELS]

        def kind(body: int) -> int:
            if body in parts:
                return parts.index(body)
            return 7 if model.body_rootid[body] == self.board else 8 if model.body_weldid[body] == 0 else 9

        self.kind = np.array([kind(int(body)) for body in model.geom_bodyid])

    def left_sole(self, model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Array, float]:
        """Return the middle of the left sole in the world [m], shape (3,), and its speed over the ground [m/s]."""
        arm = data.xmat[self.left_foot].reshape(3, 3) @ SOLE_CENTRE
        velocity = np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, self.left_foot, velocity, 0)
        moves = velocity[3:] + np.cross(velocity[:3], arm)
        return data.xpos[self.left_foot] + arm, float(np.linalg.norm(moves[:2]))

    def contacts(self, model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Array, Array, Array, int]:
        """Return force of feet on the ground (2,), on the deck (2,), wheels (4,) [N], and other contacts."""
        ground, deck, wheels, other = np.zeros(2), np.zeros(2), np.zeros(4), 0
        force = np.zeros(6)
        for i, (first, second) in enumerate(self.kind[data.contact.geom].tolist()):
            if first > second:
                first, second = second, first
            if second == 9:
                other += 2 <= first <= 8
                continue
            mujoco.mj_contactForce(model, data, i, force)
            if first < 2 and second == 8:
                ground[first] += force[0]
            elif first < 2 and second == 2:
                deck[first] += force[0]
            elif 3 <= first <= 6 and second == 8:
                wheels[first - 3] += force[0]
        return ground, deck, wheels, other
