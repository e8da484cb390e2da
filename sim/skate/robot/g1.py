# pyright: reportAttributeAccessIssue=false, reportUnknownParameterType=false
# (MuJoCo ships no type stubs.)
"""The Unitree G1 with 23 joints: the model of the installed mjlab package, its wrists fixed.

Pure MuJoCo and numbers: finding the model imports neither mjlab nor torch, so that a machine that only
runs policies needs `pip install --no-deps mjlab` and no more.
"""

import math
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np

from sysid.errors import SysidError
from sysid.roll import Array

LEG_JOINTS = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
ARM_JOINTS = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")
WRIST_JOINTS = ("wrist_roll", "wrist_pitch", "wrist_yaw")
MOTORS: tuple[str, ...] = (
    *(f"{side}_{joint}_joint" for side in ("left", "right") for joint in LEG_JOINTS),
    *(f"waist_{axis}_joint" for axis in ("yaw", "roll", "pitch")),
    *(f"{side}_{joint}_joint" for side in ("left", "right") for joint in (*ARM_JOINTS, *WRIST_JOINTS)),
)
"""All 29 joints in the order of the robot's messages and of stored motions."""
JOINTS = tuple(joint for joint in MOTORS if "wrist" not in joint)
"""The 23 joints in the order of policies, observations and the model's qpos."""

FOOT_BODIES = ("left_ankle_roll_link", "right_ankle_roll_link")
SOLE_HEIGHT = 0.035
"""Height of the ankle roll frame above the lowest points of the sole [m]: capsules of 1 cm radius at -2.5 cm."""
SOLE_CENTRE = (0.039, 0.0, -SOLE_HEIGHT)
"""Middle of the sole in the ankle roll frame [m]; the capsules reach from x = -0.054 to 0.132."""
SOLE_FRICTION = 1.0
"""Sliding friction of the soles [1]; the stock model's 0.6 slips on a deck."""

NATURAL_FREQUENCY = 10 * math.tau
"""Natural frequency that mjlab gives every joint servo on its own armature [rad/s]."""
DAMPING_RATIO = 2.0
"""ζ of every joint servo on its own armature [1], as in mjlab: twice critical, for the links weigh more than the armature."""


@dataclass(frozen=True, slots=True)
class Motor:
    """One motor (or a parallel pair) as a position servo: kp = armature ω², kd = 2 ζ armature ω."""

    armature: float
    """Rotor and gear inertia seen at the joint [kg*m^2]."""
    effort: float
    """Torque limit [N*m]."""

    @property
    def stiffness(self) -> float:
        """Servo gain kp [N*m/rad]."""
        return self.armature * NATURAL_FREQUENCY**2

    @property
    def damping(self) -> float:
        """Servo gain kd [N*m*s/rad]."""
        return 2 * DAMPING_RATIO * self.armature * NATURAL_FREQUENCY

    @property
    def action_scale(self) -> float:
        """Joint angle per unit of action [rad]: a quarter of the torque limit over kp."""
        return 0.25 * self.effort / self.stiffness


def _planetary(rotors: tuple[float, float, float], stages: tuple[float, float]) -> float:
    """Return the inertia at the output of a two-stage planetary gear [kg*m^2]."""
    first, second = stages
    return rotors[0] * (first * second) ** 2 + rotors[1] * second**2 + rotors[2]


# Rotor inertias [kg*m^2] and gear stages as mjlab (Apache-2.0) gives them, from Unitree.
_SMALL = Motor(_planetary((0.139e-4, 0.017e-4, 0.169e-4), (1 + 46 / 18, 1 + 56 / 16)), 25.0)
_MEDIUM = Motor(_planetary((0.489e-4, 0.098e-4, 0.533e-4), (4.5, 1 + 48 / 22)), 88.0)
_LARGE = Motor(_planetary((0.489e-4, 0.109e-4, 0.738e-4), (4.5, 5.0)), 139.0)
_PAIR = Motor(2 * _SMALL.armature, 2 * _SMALL.effort)

_MOTOR_OF = {
    **dict.fromkeys(("hip_pitch", "hip_yaw", "waist_yaw"), _MEDIUM),
    **dict.fromkeys(("hip_roll", "knee"), _LARGE),
    **dict.fromkeys(("ankle_pitch", "ankle_roll", "waist_roll", "waist_pitch"), _PAIR),
    **dict.fromkeys(ARM_JOINTS, _SMALL),
}


def motor_of(joint: str) -> Motor:
    """Return the motor behind one of `JOINTS`."""
    return _MOTOR_OF[joint.removeprefix("left_").removeprefix("right_").removesuffix("_joint")]


@dataclass(frozen=True, slots=True)
class Servos:
    """The servo numbers of all joints, each of shape (23,), in the order of `JOINTS`."""

    stiffness: Array
    """kp [N*m/rad]."""
    damping: Array
    """kd [N*m*s/rad]."""
    effort: Array
    """Torque limit [N*m]."""
    armature: Array
    """[kg*m^2]."""
    action_scale: Array
    """Joint angle per unit of action [rad]."""


@cache
def servos() -> Servos:
    """Return the servo numbers of all joints."""
    motors = [motor_of(joint) for joint in JOINTS]
    return Servos(*(np.array([getattr(motor, name) for motor in motors]) for name in Servos.__slots__))


def sole_points(model: mujoco.MjModel, data: mujoco.MjData, side: str) -> Array:
    """Return the lowest point of either end of each capsule of a sole, 'left' or 'right', in the world [m], shape (14, 3)."""
    points: list[Array] = []
    for i in range(model.ngeom):
        if model.geom(i).name.startswith(f"{side}_foot"):
            axis = data.geom_xmat[i].reshape(3, 3)[:, 2] * model.geom_size[i, 1]
            down = np.array([0.0, 0.0, model.geom_size[i, 0]])
            points += [data.geom_xpos[i] + axis - down, data.geom_xpos[i] - axis - down]
    return np.array(points)


def g1_xml() -> Path:
    """Return the path of the 29-joint model inside the installed mjlab package."""
    package = find_spec("mjlab")
    if package is None or not package.submodule_search_locations:
        raise SysidError(
            "the G1 model is not here: it comes with mjlab, which is not installed. "
            "Run `pip install mjlab` (or `pip install --no-deps mjlab` to run policies only), "
            "or use a folder made by `husky-sysid export`, which carries its own model."
        )
    path = Path(package.submodule_search_locations[0]) / "asset_zoo/robots/unitree_g1/xmls/g1.xml"
    if not path.is_file():
        raise SysidError(f"{path}: the installed mjlab has no G1 model there. Install mjlab 1.6.")
    return path


def g1_spec(*, visuals: bool = True) -> mujoco.MjSpec:
    """Return the 23-joint G1: wrist joints removed, sole contacts set, no actuators yet.

    Args:
        visuals: Keep the meshes; without them the model compiles in a tenth of the time.
    """
    spec = mujoco.MjSpec.from_file(str(g1_xml()))
    for joint in list(spec.joints):
        if "wrist" in joint.name:
            spec.delete(joint)
    for geom in list(spec.geoms):
        if geom.type == mujoco.mjtGeom.mjGEOM_MESH and not visuals:
            spec.delete(geom)
        elif "_foot" in geom.name:
            geom.condim, geom.priority = 3, 1
            geom.friction[0] = SOLE_FRICTION
        elif geom.name.endswith("_collision"):
            geom.condim = 1
    if not visuals:
        for mesh in list(spec.meshes):
            spec.delete(mesh)
    return spec


def add_servos(spec: mujoco.MjSpec) -> None:
    """Give the 23 joints their armature and a position servo each, in the order of `JOINTS`.

    The servos are MuJoCo's own, so implicit integrators treat kd implicitly, as mjlab's do.
    """
    for name in JOINTS:
        motor = motor_of(name)
        spec.joint(name).armature = motor.armature
        actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_position(kp=motor.stiffness, kv=motor.damping)
        actuator.forcerange = [-motor.effort, motor.effort]
        actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE


def pose_vector(angles: dict[str, float]) -> Array:
    """Return joint angles [rad] of shape (23,) from `{joint name without '_joint': angle}`; the rest are 0."""
    known = [joint.removesuffix("_joint") for joint in JOINTS]
    pose = np.zeros(len(JOINTS))
    for name, angle in angles.items():
        pose[known.index(name)] = angle
    return pose


def default_pose() -> Array:
    """Return the pose of actions at zero [rad], shape (23,): one foot on the ground, one on the deck."""
    return pose_vector(
        {
            "left_knee": 0.23,
            "left_ankle_pitch": -0.20,
            "right_hip_pitch": -0.70,
            "right_knee": 1.17,
            "right_ankle_pitch": -0.45,
            "left_shoulder_pitch": -0.03,
            "left_shoulder_roll": 0.45,
            "left_shoulder_yaw": -0.21,
            "left_elbow": 1.32,
            "right_shoulder_pitch": -0.70,
            "right_shoulder_roll": -0.845,
            "right_shoulder_yaw": 0.83,
            "right_elbow": 1.19,
        }
    )
