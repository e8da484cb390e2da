"""Make the pushing clips: key frames of one push, contact phases, inverse kinematics; *.npy beside this file.

Run `python data/motions/make_motions.py` (needs mjlab for the G1's model; about a minute). Each clip is
four pushes that follow each other without a seam, so it can be repeated. The right foot rides on the
deck of a board that rolls along +x; the left foot is planted on the ground while it pushes, then swings
forward. World frame, ground at z = 0.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from inverse_kinematics import BalanceTask, FrameTask, PostureTask, Task, rotation_matrix, solve

from policy_runtime.motion.motions import Motion, save_motion
from sim.skate.cycle.clock import CONTROL_PERIOD
from sim.skate.robot.g1 import FOOT_BODIES, JOINTS, SOLE_HEIGHT, g1_spec, pose_vector

FRAME_RATE = 1 / CONTROL_PERIOD
AXIS_HEIGHT = 0.10
DECK_TOP = 0.11
PUSHES = 4
LEFT, RIGHT = FOOT_BODIES
RIGHT_ANKLE = 0.10
"""Right ankle ahead of the deck's middle [m]."""
SOLE_CENTRE = 0.04
SOLE_ENDS = (-0.064, 0.142)
"""Heel and toe ahead of the ankle [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Style:
    """The key numbers of one clip; angles in degrees where the name says so."""

    name: str
    speed: float
    """Mean speed of the board [m/s]."""
    frames: int
    """Frames of one push at 50 Hz: 40 to 50 for a period of 0.8 to 1.0 s."""
    stance: float
    """Share of the period with the left foot on the ground."""
    height: float
    """Pelvis height in mid-swing [m]."""
    dip: float
    """How far the pelvis sinks while the left foot pushes [m]."""
    lean_deg: float
    """Trunk lean forward, half at the pelvis and half at the waist."""
    swing_height: float
    """Greatest clearance under the left sole [m]."""
    arms_deg: float
    """Half-width of the swing of the shoulders."""
    elbow_deg: float
    lift_deg: float
    """Heel lift in early swing (toe down)."""


STYLES = (
    Style(
        name="upright-slow", speed=0.6, frames=48, stance=0.38, height=0.762, dip=0.012, lean_deg=14.0,
        swing_height=0.045, arms_deg=14.0, elbow_deg=32.0, lift_deg=20.0,
    ),
    Style(
        name="upright-fast", speed=1.0, frames=43, stance=0.34, height=0.745, dip=0.012, lean_deg=17.0,
        swing_height=0.05, arms_deg=20.0, elbow_deg=40.0, lift_deg=24.0,
    ),
    Style(
        name="low-slow", speed=0.7, frames=46, stance=0.40, height=0.742, dip=0.016, lean_deg=22.0,
        swing_height=0.045, arms_deg=20.0, elbow_deg=45.0, lift_deg=18.0,
    ),
    Style(
        name="low-fast", speed=1.1, frames=41, stance=0.36, height=0.73, dip=0.016, lean_deg=26.0,
        swing_height=0.05, arms_deg=26.0, elbow_deg=52.0, lift_deg=22.0,
    ),
)  # fmt: skip


def smooth(fraction: np.ndarray | float) -> np.ndarray:
    """Return the minimum-jerk rise from 0 to 1: velocity and acceleration vanish at both ends."""
    s = np.clip(fraction, 0.0, 1.0)
    return s**3 * (10 - 15 * s + 6 * s * s)


def bump(fraction: np.ndarray | float) -> np.ndarray:
    """Return a hump from 0 to 1 and back over [0, 1], smooth at both ends."""
    s = np.clip(fraction, 0.0, 1.0)
    return 64 * s**3 * (1 - s) ** 3


def board_path(style: Style, time: np.ndarray) -> np.ndarray:
    """Return the board's position [m] at times [s]: it gains 8 % of its speed in each push and loses it coasting."""
    period = style.frames / FRAME_RATE
    fine = np.linspace(0.0, period, 2001)
    phase = fine / period
    gain = smooth(phase / style.stance) - smooth((phase - style.stance) / (1 - style.stance))
    speed = style.speed * (1 + 0.08 * (gain - gain.mean()))
    path = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(fine))])
    cycles, rest = np.divmod(time, period)
    return cycles * path[-1] + np.interp(rest, fine, path)


def footprint(style: Style, push: int) -> np.ndarray:
    """Return where the left ankle is planted in push number `push`, world x and y [m].

    The foot lands ahead of and lifts off behind the right one, by equal distances from a point a little
    behind it; its distance to the side varies from push to push and repeats with the clip.
    """
    period = style.frames / FRAME_RATE
    middle = board_path(style, np.array([(push + style.stance / 2) * period]))[0]
    sideways = 0.215 + 0.008 * np.sin(2 * np.pi * push / PUSHES)
    return np.array([middle + RIGHT_ANKLE - 0.06, sideways])


def left_foot(style: Style, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return position [m] and rotation of the left ankle: planted, then swinging to the next footprint."""
    push, phase = divmod(time * FRAME_RATE / style.frames, 1.0)
    here, there = footprint(style, int(push)), footprint(style, int(push) + 1)
    swing = (phase - style.stance) / (1 - style.stance)
    lift = style.swing_height * (1 + 0.06 * np.sin(2 * np.pi * push / PUSHES + 1.0))
    plane = here + (there - here) * smooth((swing - 0.06) / 0.88)  # up before forward: no scuffing
    # Heel up first, toes up before landing; both ends are level.
    pitch = float(np.radians(style.lift_deg) * (bump(swing / 0.75) - 0.35 * bump((swing - 0.5) / 0.5)))
    ankle = lift * bump(swing) + max(x * np.sin(pitch) for x in SOLE_ENDS) + SOLE_HEIGHT * np.cos(pitch)
    return np.array([*plane, ankle]), rotation_matrix(pitch=pitch)


def posture(style: Style, phase: float) -> np.ndarray:
    """Return waist and arms [rad], shape (23,), and the legs' preference; arms swing against the left leg."""
    # +1 when the left foot is farthest ahead (landing), -1 when it is farthest behind (lift-off).
    stride = np.cos(2 * np.pi * (phase - 0.98 + (0.5 - style.stance) / 2 * np.sin(np.pi * phase)))
    swing, elbow = np.radians(style.arms_deg), np.radians(style.elbow_deg)
    return pose_vector(
        {
            "left_hip_pitch": -0.3,
            "left_knee": 0.6,
            "right_hip_pitch": -1.0,
            "right_knee": 1.2,
            "waist_yaw": -0.12 + 0.09 * stride,
            "waist_pitch": np.radians(style.lean_deg / 2),
            "left_shoulder_pitch": -0.1 + swing * stride,
            "left_shoulder_roll": 0.5 + 0.08 * stride,
            "left_shoulder_yaw": -0.1,
            "left_elbow": elbow - 0.35 * swing * stride,
            "right_shoulder_pitch": -0.15 - 0.8 * swing * stride,
            "right_shoulder_roll": -0.45,
            "right_shoulder_yaw": 0.1,
            "right_elbow": elbow + 0.35 * swing * stride,
        }
    )


def tasks(style: Style, time: float) -> list[Task]:
    """Return all constraints at one time [s]."""
    phase = (time * FRAME_RATE / style.frames) % 1.0
    board = float(board_path(style, np.array([time]))[0])
    planted = bump(np.clip(phase / style.stance, 0, 1)) if phase < style.stance else 0.0
    slow = np.sin(2 * np.pi * time * FRAME_RATE / (style.frames * PUSHES))
    left, left_rotation = left_foot(style, time)
    stride = np.clip((left[0] - board - RIGHT_ANKLE) / 0.2, -1, 1)
    balance = np.array([board + RIGHT_ANKLE + SOLE_CENTRE - 0.02, 0.026 + 0.03 * planted + 0.002 * slow])
    lean = np.radians(style.lean_deg) / 2
    return [
        FrameTask(
            body=RIGHT,
            position=np.array([board + RIGHT_ANKLE, 0.0, DECK_TOP + SOLE_HEIGHT]),
            rotation=rotation_matrix(yaw=np.radians(-6.0)),
        ),
        FrameTask(body=LEFT, position=left, rotation=left_rotation),
        FrameTask(
            body="pelvis",
            position=np.array([0.0, 0.0, style.height - style.dip * planted + 0.003 * slow]),
            weight=(0.0, 0.0, 0.3),
            rotation=rotation_matrix(yaw=0.12 - 0.08 * float(stride), pitch=lean),
            rotation_weight=0.03,
        ),
        BalanceTask(position=balance, weight=0.5),
        PostureTask(joints=posture(style, phase), weight=np.where(np.arange(len(JOINTS)) < 12, 0.003, 0.1)),
    ]


def make(style: Style) -> Motion:
    """Solve one clip frame by frame, each from the one before; the first twice, to settle on the cycle."""
    model = g1_spec(visuals=False).compile()
    start = np.concatenate([[RIGHT_ANKLE, 0.0, style.height], [1.0, 0.0, 0.0, 0.0], posture(style, 0.0)])
    qpos = solve(model, start, tasks(style, 0.0))
    frames: list[np.ndarray] = []
    for frame in range(PUSHES * style.frames):
        qpos = solve(model, qpos, tasks(style, frame / FRAME_RATE))
        frames.append(qpos)
    table = np.array(frames)
    return Motion(name=style.name, position=table[:, :3], quaternion=table[:, 3:7], joints=table[:, 7:])


def main() -> None:
    """Make and write all clips."""
    for style in STYLES:
        save_motion(make(style), Path(__file__).with_name(f"push-{style.name}.npy"))


if __name__ == "__main__":
    main()
