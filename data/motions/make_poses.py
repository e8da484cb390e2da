"""Solve the canonical push and steer poses by inverse kinematics and write poses.toml beside this file.

Run `python data/motions/make_poses.py` (needs mjlab for the G1's model).
"""

from pathlib import Path

import mujoco
import numpy as np
import tomlkit
from inverse_kinematics import BalanceTask, FrameTask, PostureTask, Task, rotation_matrix, solve

from sim.skate.robot.g1 import FOOT_BODIES, JOINTS, SOLE_HEIGHT, g1_spec, pose_vector
from sysid.files import write_atomically

# The board of the poses, as both shipped records have it; origin on the tilt axis.
DECK_TOP = 0.01
GROUND = -0.10
MARKER = 0.20
SOLE_CENTRE = 0.04
"""Middle of the sole ahead of the ankle [m]."""
LEFT, RIGHT = FOOT_BODIES

RECIPES = {
    "push": (
        "right foot on the deck facing forward, 13 cm ahead of its middle, so that the front marker lies under "
        "the front half of the sole, which is centred across the deck; left sole level, 2 cm above the ground, "
        "22 cm to the left and 4 cm behind the right; pelvis 0.66 m above the tilt axis, turned 8° to the left, "
        "leaning 6° forward; trunk 12° forward; centre of mass over the right sole, 3 cm towards the left; "
        "right arm forward, left arm back"
    ),
    "steer": (
        "both feet flat on the deck across it, ankles 20 cm behind (left) and ahead (right) of its middle, on the "
        "markers, toes 8° apart, soles centred across the deck; pelvis 0.745 m above the tilt axis, turned 80° to "
        "the left, leaning 4° forward; waist turned 20° towards the way ahead; centre of mass over the tilt "
        "axis, in the middle between the feet; arms out at 35°"
    ),
}


def _flat(yaw: float) -> np.ndarray:
    return rotation_matrix(yaw=yaw)


def push_tasks() -> list[Task]:
    """Return the constraints of the push pose."""
    posture = pose_vector(
        {
            "left_hip_pitch": -0.6,
            "left_knee": 0.8,
            "right_hip_pitch": -1.0,
            "right_knee": 1.2,
            "waist_pitch": np.radians(6.0),
            "left_shoulder_pitch": 0.3,
            "left_shoulder_roll": 0.35,
            "left_elbow": 0.6,
            "right_shoulder_pitch": -0.4,
            "right_shoulder_roll": -0.35,
            "right_elbow": 0.6,
        }
    )
    return [
        FrameTask(body=RIGHT, position=np.array([0.13, 0.0, DECK_TOP + SOLE_HEIGHT]), rotation=_flat(0.0)),
        FrameTask(
            body=LEFT, position=np.array([0.09, 0.22, GROUND + SOLE_HEIGHT + 0.02]), rotation=_flat(0.0)
        ),
        FrameTask(
            body="pelvis",
            position=np.array([0.0, 0.0, 0.66]),
            weight=(0.0, 0.0, 1.0),
            rotation=rotation_matrix(yaw=np.radians(8.0), pitch=np.radians(6.0)),
        ),
        BalanceTask(position=np.array([0.13 + SOLE_CENTRE, 0.03])),
        PostureTask(joints=posture, weight=_posture_weight()),
    ]


def steer_tasks() -> list[Task]:
    """Return the constraints of the steer pose."""
    posture = pose_vector(
        {
            "left_hip_pitch": -0.5,
            "left_knee": 0.8,
            "right_hip_pitch": -0.5,
            "right_knee": 0.8,
            "waist_yaw": np.radians(-20.0),
            "waist_pitch": np.radians(6.0),
            "left_shoulder_roll": np.radians(35.0),
            "left_elbow": 0.7,
            "right_shoulder_roll": np.radians(-35.0),
            "right_elbow": 0.7,
        }
    )
    height, apart = DECK_TOP + SOLE_HEIGHT, np.radians(8.0)
    return [
        FrameTask(
            body=LEFT, position=np.array([-MARKER, -SOLE_CENTRE, height]), rotation=_flat(np.pi / 2 + apart)
        ),
        FrameTask(
            body=RIGHT, position=np.array([MARKER, -SOLE_CENTRE, height]), rotation=_flat(np.pi / 2 - apart)
        ),
        FrameTask(
            body="pelvis",
            position=np.array([0.0, 0.0, 0.745]),
            weight=(0.0, 0.0, 1.0),
            rotation=rotation_matrix(yaw=np.radians(80.0), pitch=np.radians(4.0)),
        ),
        BalanceTask(position=np.zeros(2)),
        PostureTask(joints=posture, weight=_posture_weight()),
    ]


def _posture_weight() -> np.ndarray:
    """Legs follow the feet; waist and arms have nothing else to follow."""
    return np.where(np.arange(len(JOINTS)) < 12, 0.003, 0.05)


def main() -> None:
    """Solve both poses and write the file."""
    model = g1_spec(visuals=False).compile()
    document = tomlkit.document()
    document.add(
        tomlkit.comment("Canonical poses on the board, made by make_poses.py; see sim/skate/robot/poses.py.")
    )
    for name, tasks, yaw in (("push", push_tasks(), 0.0), ("steer", steer_tasks(), np.pi / 2)):
        quaternion = np.zeros(4)
        mujoco.mju_axisAngle2Quat(quaternion, np.array([0.0, 0.0, 1.0]), yaw)
        posture = next(task.joints for task in tasks if isinstance(task, PostureTask))
        qpos = solve(model, np.concatenate([[0.0, 0.0, 0.7], quaternion, posture]), tasks)
        document[name] = {
            "recipe": RECIPES[name],
            "position": [round(float(x), 6) for x in qpos[:3]],
            "quaternion": [round(float(x), 7) for x in qpos[3:7]],
            "joints": {
                joint.removesuffix("_joint"): round(float(angle), 6)
                for joint, angle in zip(JOINTS, qpos[7:], strict=True)
            },
        }
    write_atomically(Path(__file__).with_name("poses.toml"), tomlkit.dumps(document))


if __name__ == "__main__":
    main()
