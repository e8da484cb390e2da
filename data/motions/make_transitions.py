"""Make the clips of mounting and dismounting from the canonical poses; transitions/*.npy beside this file.

Run `python data/motions/make_transitions.py` (needs mjlab for the G1's model; seconds). A clip goes from
one canonical pose to the other in the time that the cycle gives it. World frame: the board stands at the
origin, ground at z = 0. One foot carries while the other moves: mounting, the left foot swings to its
place on the deck over the edge, then both carry and the right one turns on its sole; dismounting, the
right one turns first and the left one swings out. The swing is the task's own transition path.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from inverse_kinematics import BalanceTask, FrameTask, PostureTask, Task, rotation_matrix, solve

from policy_runtime.motion.motions import Motion, save_motion
from sim.skate.cycle.clock import Clock
from sim.skate.cycle.transitions import TransitionPath
from sim.skate.robot.g1 import FOOT_BODIES, JOINTS, g1_spec
from sim.skate.robot.poses import load_poses

AXIS_HEIGHT = 0.10
LEFT, RIGHT = FOOT_BODIES
SOLE_CENTRE = np.array([0.04, 0.0, 0.0])
"""Middle of the sole in the frame of the ankle [m], but for its height."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Foot:
    """Where an ankle is in both poses, level."""

    position: np.ndarray
    """In the push and in the steer pose, board frame [m], (2, 3)."""
    yaw: tuple[float, float]
    """[rad]."""


FEET = {
    LEFT: Foot(position=np.array([[0.09, 0.22, -0.045], [-0.20, -0.04, 0.045]]), yaw=(0.0, np.radians(98.0))),
    RIGHT: Foot(position=np.array([[0.13, 0.0, 0.045], [0.20, -0.04, 0.045]]), yaw=(0.0, np.radians(82.0))),
}
PELVIS_YAW = tuple(np.radians([8.0, 80.0]))
PELVIS_PITCH = tuple(np.radians([6.0, 4.0]))
BALANCE = np.array([[0.17, 0.03], [0.0, 0.0]])
"""Centre of mass over the deck in both poses [m]."""
FIRM = (4.0, 4.0, 4.0)
"""Weight of the feet's places: where a leg is at full stretch the balance gives way, not the deck [1/m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Style:
    """The key numbers of one clip; times are shares of the transition from push to steer."""

    name: str
    lift: float
    """Lift of the swing's control point [m]; it peaks at half of it."""
    swing: tuple[float, float]
    """Begin and end of the left foot's swing."""
    pivot: tuple[float, float]
    """Begin and end of the right foot's turning."""
    shift: tuple[float, float]
    """Begin and end of the shift of the centre of mass."""
    sink: float = 0.0
    """How far the pelvis sinks on the way [m]."""
    arms: float = 0.0
    """How far the arms spread on the way [rad]."""


MOUNT = Style(name="mount", lift=0.16, swing=(0.0, 0.62), pivot=(0.40, 1.0), shift=(0.15, 1.0))
DISMOUNT = Style(name="dismount", lift=0.16, swing=(0.0, 0.60), pivot=(0.40, 1.0), shift=(0.10, 1.0))
STYLES = (
    replace(MOUNT, name="mount-plain"),
    replace(MOUNT, name="mount-high", lift=0.20, arms=0.2),
    replace(MOUNT, name="mount-low", sink=0.03, arms=0.1),
    replace(MOUNT, name="mount-quick", swing=(0.0, 0.56), pivot=(0.40, 0.94), shift=(0.15, 1.0)),
    replace(DISMOUNT, name="dismount-plain"),
    replace(DISMOUNT, name="dismount-high", lift=0.20, arms=0.2),
    replace(DISMOUNT, name="dismount-low", sink=0.03, arms=0.1),
    replace(DISMOUNT, name="dismount-early", swing=(0.0, 0.64), pivot=(0.44, 1.0), shift=(0.12, 1.0)),
)


def smooth(fraction: float) -> float:
    """Return the minimum-jerk rise from 0 to 1: velocity and acceleration vanish at both ends."""
    s = float(np.clip(fraction, 0.0, 1.0))
    return s**3 * (10 - 15 * s + 6 * s * s)


def within(fraction: float, span: tuple[float, float]) -> float:
    """Return the smooth rise of a movement between two shares of the transition."""
    return smooth((fraction - span[0]) / (span[1] - span[0]))


def ankle(foot: Foot, turned: float, moved: float, lift: float) -> tuple[np.ndarray, np.ndarray]:
    """Return position [m, world] and rotation of an ankle, turned and moved by shares of the whole way.

    The middle of the sole moves, and the foot turns about it.
    """
    yaw = foot.yaw[0] + turned * (foot.yaw[1] - foot.yaw[0])
    start, end = (
        position + rotation_matrix(yaw=angle) @ SOLE_CENTRE
        for position, angle in zip(foot.position, foot.yaw, strict=True)
    )
    path = TransitionPath(order=2, lift=lift)
    sole = path.positions(start[None], end[None], np.array(moved), np.ones(1))[0]
    rotation = rotation_matrix(yaw=yaw)
    return sole - rotation @ SOLE_CENTRE + np.array([0.0, 0.0, AXIS_HEIGHT]), rotation


def tasks(style: Style, fraction: float) -> list[Task]:
    """Return all constraints at a share of the way from push to steer."""
    push, steer = load_poses().values()
    hump = 4 * smooth(fraction) * (1 - smooth(fraction))
    mix = lambda ends, share: ends[0] + share * (ends[1] - ends[0])  # noqa: E731
    swing, pivot = within(fraction, style.swing), within(fraction, style.pivot)
    left, left_rotation = ankle(FEET[LEFT], swing, swing, style.lift)
    right, right_rotation = ankle(FEET[RIGHT], pivot, pivot, 0.0)
    posture = mix((push[7:], steer[7:]), smooth(fraction)).copy()
    for side, sign in (("left", 1.0), ("right", -1.0)):
        posture[JOINTS.index(f"{side}_shoulder_roll_joint")] += sign * style.arms * hump
    pelvis = float(mix((push[2], steer[2]), smooth(fraction))) - style.sink * hump
    return [
        FrameTask(body=RIGHT, position=right, rotation=right_rotation, weight=FIRM),
        FrameTask(body=LEFT, position=left, rotation=left_rotation, weight=FIRM),
        FrameTask(
            body="pelvis",
            position=np.array([0.0, 0.0, pelvis + AXIS_HEIGHT]),
            weight=(0.0, 0.0, 1.0),
            rotation=rotation_matrix(
                yaw=mix(PELVIS_YAW, smooth(fraction)), pitch=mix(PELVIS_PITCH, smooth(fraction))
            ),
        ),
        BalanceTask(position=mix(BALANCE, within(fraction, style.shift)), weight=0.5),
        PostureTask(joints=posture, weight=np.where(np.arange(len(JOINTS)) < 12, 0.003, 0.05)),
    ]


def make(style: Style) -> Motion:
    """Solve one clip frame by frame from the push pose on; dismounting is then turned round in time."""
    model = g1_spec(visuals=False).compile()
    mounts = style.name.startswith("mount")
    steps = Clock().mount if mounts else Clock().dismount
    qpos = load_poses()["push"].copy()
    qpos[2] += AXIS_HEIGHT
    frames: list[np.ndarray] = []
    for frame in range(steps + 1):
        qpos = solve(model, qpos, tasks(style, frame / steps))
        frames.append(qpos)
    table = np.array(frames if mounts else frames[::-1])
    return Motion(name=style.name, position=table[:, :3], quaternion=table[:, 3:7], joints=table[:, 7:])


def main() -> None:
    """Make and write all clips."""
    folder = Path(__file__).with_name("transitions")
    folder.mkdir(exist_ok=True)
    for style in STYLES:
        save_motion(make(style), folder / f"{style.name}.npy")


if __name__ == "__main__":
    main()
