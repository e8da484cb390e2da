# pyright: reportMissingImports=false, reportUnknownParameterType=false
"""Reads the task's quantities out of mjlab's simulation, always for all environments.

Positions and velocities of the two free bodies are of this instant. Poses of links are of MuJoCo's last
kinematics, one simulation step late when rewards are computed.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from sim.board.scene import TILT_JOINT, TRUCK_JOINTS
from sim.skate import rotation
from sim.skate.cycle.transitions import KEY_BODIES
from sim.skate.robot.g1 import FOOT_BODIES, JOINTS, SOLE_CENTRE
from sim.skate.world import contacts

if TYPE_CHECKING:
    from mjlab.envs import ManagerBasedRlEnv

BALL = (0.075, 0.0, 0.0)
"""Ball of the foot in the ankle roll frame [m]: what stays in place when the foot turns between the poses."""
ZONE = (0.15, 0.10)
"""Half length and half width of the zone about a marker in which a foot counts as placed [m]."""
SOLE_POINTS = tuple(
    tuple(sign * half * (axis == other) for other in range(3))
    for axis, half in enumerate(ZONE)
    for sign in (1, -1)
)
"""Four points in the plane of the sole, as far from its middle [m], by which it is judged flat."""


class FreeBody:
    """A body that moves freely: its pose and velocities."""

    def __init__(self, env: "ManagerBasedRlEnv", joint: str) -> None:
        """Find its free joint."""
        self._sim, found = env.sim, env.sim.mj_model.joint(joint)
        self.q, self.v = int(found.qposadr[0]), int(found.dofadr[0])
        """First column in qpos and in qvel."""

    def position(self) -> torch.Tensor:
        """Origin in the world [m], (n, 3)."""
        return self._sim.data.qpos[:, self.q : self.q + 3]

    def quaternion(self) -> torch.Tensor:
        """Orientation, (n, 4)."""
        return self._sim.data.qpos[:, self.q + 3 : self.q + 7]

    def velocity(self) -> torch.Tensor:
        """Velocity of the origin in the world [m/s], (n, 3)."""
        return self._sim.data.qvel[:, self.v : self.v + 3]

    def angular_velocity(self) -> torch.Tensor:
        """Angular velocity in its own frame [rad/s], (n, 3)."""
        return self._sim.data.qvel[:, self.v + 3 : self.v + 6]


class Reading:
    """Indices into the simulation's arrays, found once, and the quantities read with them."""

    def __init__(self, env: "ManagerBasedRlEnv") -> None:
        """Find the indices."""
        self._env, self._sim = env, env.sim
        model, joint = env.sim.mj_model, env.sim.mj_model.joint

        def indices(values: list[Any]) -> torch.Tensor:
            return torch.tensor(values, device=env.device, dtype=torch.long)

        def place(values: Any) -> torch.Tensor:
            return torch.tensor(values, device=env.device, dtype=torch.float)

        self.robot, self.board = (
            FreeBody(env, name) for name in ("robot/floating_base_joint", "board/board_free_joint")
        )
        self.joint_q = indices([joint(f"robot/{name}").qposadr[0] for name in JOINTS])
        self.joint_v = indices([joint(f"robot/{name}").dofadr[0] for name in JOINTS])
        self._tilt_q = joint(f"board/{TILT_JOINT}").qposadr[0]
        self._tilt_v = joint(f"board/{TILT_JOINT}").dofadr[0]
        self._truck_q = indices([joint(f"board/{name}").qposadr[0] for name in TRUCK_JOINTS])
        self._key_bodies = indices([model.body(f"robot/{name}").id for name in KEY_BODIES])
        self._feet = indices([model.body(f"robot/{name}").id for name in FOOT_BODIES])
        front, rear = (model.site(f"board/{end}_marker").pos for end in ("front", "rear"))
        half = (front[0] - rear[0]) / 2
        self._markers = place([[-half, 0.0, front[2]], [half, 0.0, front[2]]])
        pelvis = model.body("robot/pelvis")
        self._root = int(pelvis.id)
        self.weight = float(pelvis.subtreemass[0]) * float(np.linalg.norm(model.opt.gravity))
        """Of the robot [N]."""
        self.axis_height = float(model.body("board/board").pos[2])
        """Height of the tilt axis over level ground [m]."""
        self.wheel_radius = float(model.geom("board/front_left_wheel_collision").size[0])
        """[m]."""
        self._sole_centre, self._sole_points, self._ball = map(place, (SOLE_CENTRE, SOLE_POINTS, BALL))

    def imu(self, name: str) -> torch.Tensor:
        """Angular velocity [rad/s] or velocity [m/s] at the pelvis' IMU in its frame, 'ang_vel' or 'lin_vel', (n, 3)."""
        return self._env.scene[f"robot/imu_{name}"].data

    def joint_position(self) -> torch.Tensor:
        """[rad], (n, 23)."""
        return self._sim.data.qpos[:, self.joint_q]

    def joint_velocity(self) -> torch.Tensor:
        """[rad/s], (n, 23)."""
        return self._sim.data.qvel[:, self.joint_v]

    def tilt(self) -> torch.Tensor:
        """Tilt γ of the deck [rad]: left edge down positive, so minus the roll joint, (n,)."""
        return -self._sim.data.qpos[:, self._tilt_q]

    def tilt_rate(self) -> torch.Tensor:
        """[rad/s], (n,)."""
        return -self._sim.data.qvel[:, self._tilt_v]

    def trucks(self) -> torch.Tensor:
        """Steering angles of front and rear truck [rad], left turn positive, (n, 2)."""
        return -self._sim.data.qpos[:, self._truck_q]

    def key_bodies_on_board(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Positions (n, 14, 3) [m] and orientations (n, 14, 4) of the key bodies in the board frame."""
        board = self.board.quaternion()[:, None]
        positions = self._sim.data.xpos[:, self._key_bodies] - self.board.position()[:, None]
        return (
            rotation.rotate_back(board, positions),
            rotation.multiply(rotation.conjugate(board), self._sim.data.xquat[:, self._key_bodies]),
        )

    def _points(self, feet: torch.Tensor, point: torch.Tensor) -> torch.Tensor:
        """Return a point of some feet in the world [m], (n, feet, 3)."""
        return self._sim.data.xpos[:, feet] + rotation.rotate(self._sim.data.xquat[:, feet], point)

    def _on_board(self, points: torch.Tensor) -> torch.Tensor:
        """Return points of the world, (n, k, 3), in the board frame [m]."""
        return rotation.rotate_back(self.board.quaternion()[:, None], points - self.board.position()[:, None])

    def marker_offset(self) -> torch.Tensor:
        """From the rear and front marker to the middle of the left and right sole, board frame [m], (n, 2, 3)."""
        return self._on_board(self._points(self._feet, self._sole_centre)) - self._markers

    def foot_place(self) -> torch.Tensor:
        """Ball of the right foot along the deck, from the front marker [m], (n,)."""
        return self._on_board(self._points(self._feet[1:], self._ball))[:, 0, 0] - self._markers[1, 0]

    def left_sole_velocity(self) -> torch.Tensor:
        """Velocity of the middle of the left sole in the world [m/s], (n, 3)."""
        data, foot = self._sim.data, self._feet[:1]
        # MuJoCo's cvel is angular, then linear, at the centre of mass of the whole tree.
        turning, moving = data.cvel[:, foot].split(3, dim=-1)
        arm = self._points(foot, self._sole_centre) - data.subtree_com[:, self._root, None]
        return (moving + torch.cross(turning, arm, dim=-1))[:, 0]

    def left_sole_heights(self) -> torch.Tensor:
        """Heights of `SOLE_POINTS` of the left foot about its middle [m], (n, 4)."""
        return rotation.rotate(self._sim.data.xquat[:, self._feet[:1]], self._sole_points)[..., 2]

    def forces(self, sensor: str) -> torch.Tensor:
        """Net force on left and right foot, or on the four wheels [N], world frame, (n, 2 or 4, 3)."""
        return self._env.scene[sensor].data.force

    def load(self, sensor: str) -> torch.Tensor:
        """Vertical force on left and right foot over the robot's nominal weight [1], (n, 2)."""
        return self.forces(sensor)[..., 2].abs() / self.weight

    def loaded(self, sensor: str, threshold: float = contacts.FORCE_THRESHOLD) -> torch.Tensor:
        """Whether feet or wheels press on what the sensor is about with more than `threshold` [N], bool (n, 2 or 4)."""
        return self.forces(sensor).norm(dim=-1) > threshold

    def wheels_loaded(self) -> torch.Tensor:
        """Whether each wheel presses on the ground, bool (n, 4)."""
        return self.loaded(contacts.WHEELS_GROUND, contacts.WHEEL_FORCE_THRESHOLD)

    def count(self, sensor: str) -> torch.Tensor:
        """Number of contacts, (n,)."""
        return self._env.scene[sensor].data.found.sum(dim=-1)

    def other_contacts(self) -> torch.Tensor:
        """Contacts of ground or board with anything of the robot but its feet, (n,)."""
        everything = self.count(contacts.ROBOT_GROUND) + self.count(contacts.ROBOT_BOARD)
        return everything - self.count(contacts.FEET_GROUND) - self.count(contacts.FEET_DECK)
