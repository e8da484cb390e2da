# pyright: reportMissingImports=false, reportUnknownParameterType=false
"""Reads the task's quantities out of mjlab's simulation, always for all environments.

Positions and velocities of the two free bodies are of this instant. Poses of links are of MuJoCo's last
kinematics, one simulation step late when rewards are computed.
"""

from typing import TYPE_CHECKING

import numpy as np
import torch

from sim.board.scene import TILT_JOINT, TRUCK_JOINTS
from sim.skate import rotation
from sim.skate.cycle.transitions import KEY_BODIES
from sim.skate.robot.g1 import FOOT_BODIES, JOINTS, SOLE_CENTRE
from sim.skate.world import contacts

if TYPE_CHECKING:
    from mjlab.envs import ManagerBasedRlEnv

SOLE_POINTS = ((0.15, 0.0, 0.0), (-0.15, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, -0.1, 0.0))
"""Four points in the plane of the sole about its middle [m], by which it is judged flat."""
BALL = (0.075, 0.0, 0.0)
"""Ball of the foot in the ankle roll frame [m]: what stays in place when the foot turns between the poses."""
ZONE = (0.15, 0.10)
"""Half length and half width of the zone about a marker in which a foot counts as placed [m]."""


class Reading:
    """Indices into the simulation's arrays, found once, and the quantities read with them."""

    def __init__(self, env: "ManagerBasedRlEnv") -> None:
        """Find the indices."""
        self._env = env
        self._sim = env.sim
        model = env.sim.mj_model
        tensor = lambda values: torch.tensor(values, device=env.device, dtype=torch.long)  # noqa: E731
        joint = model.joint
        self.robot_q = joint("robot/floating_base_joint").qposadr[0]
        self.robot_v = joint("robot/floating_base_joint").dofadr[0]
        self.board_q = joint("board/board_free_joint").qposadr[0]
        self.board_v = joint("board/board_free_joint").dofadr[0]
        self.joint_q = tensor([joint(f"robot/{name}").qposadr[0] for name in JOINTS])
        self.joint_v = tensor([joint(f"robot/{name}").dofadr[0] for name in JOINTS])
        self._tilt_q = joint(f"board/{TILT_JOINT}").qposadr[0]
        self._tilt_v = joint(f"board/{TILT_JOINT}").dofadr[0]
        self._truck_q = tensor([joint(f"board/{name}").qposadr[0] for name in TRUCK_JOINTS])
        self._key_bodies = tensor([model.body(f"robot/{name}").id for name in KEY_BODIES])
        self._feet = tensor([model.body(f"robot/{name}").id for name in FOOT_BODIES])
        wheelbase = model.site("board/front_marker").pos[0] - model.site("board/rear_marker").pos[0]
        top = model.site("board/front_marker").pos[2]
        self._markers = torch.tensor(
            [[-wheelbase / 2, 0.0, top], [wheelbase / 2, 0.0, top]], device=env.device, dtype=torch.float
        )
        self.weight = float(model.body("robot/pelvis").subtreemass[0]) * float(
            np.linalg.norm(model.opt.gravity)
        )
        """Of the robot [N]."""
        self._root = int(model.body("robot/pelvis").id)
        self.axis_height = float(model.body("board/board").pos[2])
        """Height of the tilt axis over level ground [m]."""
        self.wheel_radius = float(model.geom("board/front_left_wheel_collision").size[0])
        """[m]."""
        self._sole_centre = torch.tensor(SOLE_CENTRE, device=env.device)
        self._sole_points = torch.tensor(SOLE_POINTS, device=env.device)
        self._ball = torch.tensor(BALL, device=env.device)
        self._gyro = env.scene["robot/imu_ang_vel"]
        self._velocimeter = env.scene["robot/imu_lin_vel"]

    # The two free bodies

    def board_position(self) -> torch.Tensor:
        """Origin of the board [m], (n, 3)."""
        return self._sim.data.qpos[:, self.board_q : self.board_q + 3]

    def board_quaternion(self) -> torch.Tensor:
        """Orientation of the board, (n, 4)."""
        return self._sim.data.qpos[:, self.board_q + 3 : self.board_q + 7]

    def board_heading(self) -> torch.Tensor:
        """Heading of the board [rad], (n,)."""
        return rotation.yaw(self.board_quaternion())

    def board_velocity(self) -> torch.Tensor:
        """Velocity of the board's origin in the world [m/s], (n, 3)."""
        return self._sim.data.qvel[:, self.board_v : self.board_v + 3]

    def board_angular_velocity(self) -> torch.Tensor:
        """Angular velocity of the board in its own frame [rad/s], (n, 3)."""
        return self._sim.data.qvel[:, self.board_v + 3 : self.board_v + 6]

    def robot_position(self) -> torch.Tensor:
        """Origin of the pelvis [m], (n, 3)."""
        return self._sim.data.qpos[:, self.robot_q : self.robot_q + 3]

    def robot_quaternion(self) -> torch.Tensor:
        """Orientation of the pelvis, (n, 4)."""
        return self._sim.data.qpos[:, self.robot_q + 3 : self.robot_q + 7]

    def gyro(self) -> torch.Tensor:
        """Angular velocity at the pelvis' IMU [rad/s], (n, 3)."""
        return self._gyro.data

    def velocimeter(self) -> torch.Tensor:
        """Velocity at the pelvis' IMU in its frame [m/s], (n, 3)."""
        return self._velocimeter.data

    # Joints

    def joint_position(self) -> torch.Tensor:
        """[rad], (n, 23)."""
        return self._sim.data.qpos[:, self.joint_q]

    def joint_velocity(self) -> torch.Tensor:
        """[rad/s], (n, 23)."""
        return self._sim.data.qvel[:, self.joint_v]

    def joint_acceleration(self) -> torch.Tensor:
        """[rad/s^2], (n, 23)."""
        return self._sim.data.qacc[:, self.joint_v]

    def joint_torque(self) -> torch.Tensor:
        """[N*m], (n, 23)."""
        return self._sim.data.qfrc_actuator[:, self.joint_v]

    def tilt(self) -> torch.Tensor:
        """Tilt γ of the deck [rad]: left edge down positive, so minus the roll joint, (n,)."""
        return -self._sim.data.qpos[:, self._tilt_q]

    def tilt_rate(self) -> torch.Tensor:
        """[rad/s], (n,)."""
        return -self._sim.data.qvel[:, self._tilt_v]

    def trucks(self) -> torch.Tensor:
        """Steering angles of front and rear truck [rad], left turn positive, (n, 2)."""
        return -self._sim.data.qpos[:, self._truck_q]

    # Links

    def key_bodies_on_board(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Positions (n, 14, 3) [m] and orientations (n, 14, 4) of the key bodies in the board frame."""
        board = self.board_quaternion()[:, None]
        positions = self._sim.data.xpos[:, self._key_bodies] - self.board_position()[:, None]
        return (
            rotation.rotate_back(board, positions),
            rotation.multiply(rotation.conjugate(board), self._sim.data.xquat[:, self._key_bodies]),
        )

    def soles_on_board(self) -> torch.Tensor:
        """Middle of left and right sole in the board frame [m], (n, 2, 3)."""
        soles = self._sim.data.xpos[:, self._feet] + rotation.rotate(
            self._sim.data.xquat[:, self._feet], self._sole_centre
        )
        board = self.board_quaternion()[:, None]
        return rotation.rotate_back(board, soles - self.board_position()[:, None])

    def marker_offset(self) -> torch.Tensor:
        """From the rear and front marker to the left and right sole, board frame [m], (n, 2, 3)."""
        return self.soles_on_board() - self._markers

    def foot_place(self) -> torch.Tensor:
        """Ball of the right foot along the deck, from the front marker [m], (n,)."""
        right = self._feet[1:]
        ball = self._sim.data.xpos[:, right] + rotation.rotate(self._sim.data.xquat[:, right], self._ball)
        board = self.board_quaternion()[:, None]
        place = rotation.rotate_back(board, ball - self.board_position()[:, None])
        return place[:, 0, 0] - self._markers[1, 0]

    def left_sole_velocity(self) -> torch.Tensor:
        """Velocity of the middle of the left sole in the world [m/s], (n, 3)."""
        data, foot = self._sim.data, self._feet[:1]
        sole = data.xpos[:, foot] + rotation.rotate(data.xquat[:, foot], self._sole_centre)
        # MuJoCo's cvel is angular, then linear, at the centre of mass of the whole tree.
        turning, moving = data.cvel[:, foot].split(3, dim=-1)
        arm = sole - data.subtree_com[:, self._root, None]
        return (moving + torch.cross(turning, arm, dim=-1))[:, 0]

    def left_sole_heights(self) -> torch.Tensor:
        """Heights of `SOLE_POINTS` of the left foot about its middle [m], (n, 4)."""
        foot = self._sim.data.xquat[:, self._feet[:1]]
        return rotation.rotate(foot, self._sole_points)[..., 2]

    # Contacts

    def foot_forces(self, sensor: str) -> torch.Tensor:
        """Net force on left and right foot [N], world frame, (n, 2, 3)."""
        return self._env.scene[sensor].data.force

    def load(self, sensor: str) -> torch.Tensor:
        """Vertical force on left and right foot over the robot's nominal weight [1], (n, 2)."""
        return self.foot_forces(sensor)[..., 2].abs() / self.weight

    def loaded(self, sensor: str) -> torch.Tensor:
        """Whether left and right foot are loaded, bool (n, 2)."""
        return self.foot_forces(sensor).norm(dim=-1) > contacts.FORCE_THRESHOLD

    def wheels_loaded(self) -> torch.Tensor:
        """Whether each wheel presses on the ground, bool (n, 4)."""
        return (
            self._env.scene[contacts.WHEELS_GROUND].data.force.norm(dim=-1) > contacts.WHEEL_FORCE_THRESHOLD
        )

    def other_contacts(self) -> torch.Tensor:
        """Contacts of ground or board with anything of the robot but its feet, (n,)."""
        found = lambda sensor: self._env.scene[sensor].data.found.sum(dim=-1)  # noqa: E731
        everything = found(contacts.ROBOT_GROUND) + found(contacts.ROBOT_BOARD)
        return everything - found(contacts.FEET_GROUND) - found(contacts.FEET_DECK)

    def self_contacts(self) -> torch.Tensor:
        """Contacts of the robot with itself, (n,)."""
        return self._env.scene[contacts.SELF].data.found.sum(dim=-1)
