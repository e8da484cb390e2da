# pyright: reportAttributeAccessIssue=false, reportUnknownParameterType=false
# (MuJoCo ships no type stubs.)
"""Properties of a motion, measured on the robot's model: cadence, ranges, contacts, balance.

It serves any clip of the stored layout. Heights are relative to the clip's own standing left sole, so clips
need not agree on the ground.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt
from scipy.signal import find_peaks, savgol_filter

from policy_runtime.motion.motions import Motion
from sim.skate.cycle.clock import CONTROL_PERIOD
from sim.skate.robot.g1 import JOINTS, sole_points
from sysid.roll import Array

LEFT_LEG = slice(0, 6)
WINDOW = 11
"""Frames of a second-order Savitzky-Golay filter. With 5 mm of noise a frame, 98.6 % of the frames of a shipped clip are found as
without noise. A filter of 7 frames finds 92.7 % (noise of `tests/policy_runtime/test_motions.py`, 24 clips)."""
STANDING_SHARE = 0.05
"""Speed of the slowest point of a standing sole, over the 95th percentile of the sole's speed [1]."""


@dataclass(frozen=True, slots=True)
class Stance:
    """When one foot stands, and where the ground is."""

    planted: npt.NDArray[np.bool_]
    """Shape (frames,)."""
    ground: float
    """Median height of the standing sole [m]."""
    slide: float
    """Greatest speed of the slowest point of the standing sole over the ground, away from landing and lifting [m/s]."""

    @property
    def touchdowns(self) -> npt.NDArray[np.intp]:
        """Frames in which the foot comes to stand, without the first frame."""
        return np.flatnonzero(self.planted[1:] & ~self.planted[:-1]) + 1


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionFacts:
    """Measured numbers of one clip."""

    frames: int
    duration: float
    """[s]"""
    speed: float
    """Mean speed of the pelvis in the plane [m/s]."""
    period: float
    """Time between two pushes, from the autocorrelation of the left leg [s]; NaN without a repetition."""
    planted: npt.NDArray[np.bool_]
    """Frames in which the left foot stands on the ground, shape (frames,), bool."""
    travel: float
    """Range of the left foot along the right one's axis of motion [m]."""
    slide: float
    """Greatest speed of the planted left foot over the ground [m/s]."""
    penetration: float
    """Greatest depth of the left sole below the ground [m]."""
    bobbing: float
    """Range of the right sole's height [m]: zero while it stands on a level deck."""
    right_foot_tilt: float
    """Greatest angle of the right sole against the horizontal [rad]."""
    support_margin: float
    """Least distance of the centre of mass inside the right sole while the left foot is in the air [m];
    negative outside."""
    joint_low: Array
    """Least angle of each joint [rad], shape (23,)."""
    joint_high: Array
    """Greatest angle of each joint [rad], shape (23,)."""
    limit_margin: float
    """Least distance from a joint limit [rad]; negative beyond."""
    peak_speed: float
    """Greatest joint speed [rad/s]."""
    peak_speed_joint: str
    self_contacts: int
    """Frames in which limbs touch each other."""

    @property
    def stance(self) -> float:
        """Share of the time with the left foot on the ground."""
        return float(np.mean(self.planted))


def motion_facts(motion: Motion, model: mujoco.MjModel) -> MotionFacts:
    """Measure a clip on the G1 without a board (`sim.skate.robot.g1.g1_spec`)."""
    soles, com, touching = _forward(model, motion)
    left, right = soles[:, 0], soles[:, 1]
    stance = find_stance(left)
    speeds = np.abs(np.diff(motion.joints, axis=0)) / CONTROL_PERIOD
    worst = np.unravel_index(np.argmax(speeds), speeds.shape)
    low, high = model.jnt_range[1:].T
    tilt = np.arcsin(np.clip(np.ptp(right[..., 2], axis=1) / _length(right), -1, 1))
    margin = _inside(com, right) + float(model.geom("right_foot1_collision").size[0])  # the capsules' radius
    return MotionFacts(
        frames=len(motion.joints),
        duration=motion.duration,
        speed=motion.speed,
        period=_period(motion.joints[:, LEFT_LEG]),
        planted=stance.planted,
        travel=float(np.ptp((left.mean(axis=1) - right.mean(axis=1)) @ _ahead(motion))),
        slide=stance.slide,
        penetration=float(max(0.0, stance.ground - left[..., 2].min())),
        bobbing=float(np.ptp(right[..., 2].mean(axis=1))),
        right_foot_tilt=float(tilt.max()),
        support_margin=float(margin[~stance.planted].min(initial=np.inf)),
        joint_low=motion.joints.min(axis=0),
        joint_high=motion.joints.max(axis=0),
        limit_margin=float(np.minimum(motion.joints - low, high - motion.joints).min()),
        peak_speed=float(speeds[worst]),
        peak_speed_joint=JOINTS[worst[1]].removesuffix("_joint"),
        self_contacts=int(touching.sum()),
    )


def left_stance(motion: Motion, model: mujoco.MjModel) -> Stance:
    """Return when the left foot of a clip stands on the ground; arguments as in `motion_facts`."""
    return find_stance(_forward(model, motion)[0][:, 0])


def find_stance(sole: Array) -> Stance:
    """Find when a foot stands on the ground, also in noisy recorded clips.

    A planted foot is the slow one: the slowest point of its sole hardly moves over the ground, while a swinging foot overtakes
    the robot. So the limit is a share of the clip's own fastest swing.

    Args:
        sole: Lowest points of the sole in the world [m], shape (frames, points, 3), a frame a policy step; at least five.
    """
    window = min(WINDOW, (len(sole) - 1) // 2 * 2 + 1)
    velocity = np.asarray(savgol_filter(sole[..., :2], window, 2, deriv=1, delta=CONTROL_PERIOD, axis=0))
    slowest = np.linalg.norm(velocity, axis=-1).min(axis=1)
    fastest = np.quantile(np.linalg.norm(velocity.mean(axis=1), axis=-1), 0.95)
    planted = slowest < STANDING_SHARE * fastest
    around = np.convolve(planted, np.ones(window), "same") == window
    lowest = sole[..., 2].min(axis=1)
    ground = float(np.median(lowest[planted])) if planted.any() else float(lowest.min())
    return Stance(planted, ground, float(slowest[around].max(initial=0.0)))


def _forward(model: mujoco.MjModel, motion: Motion) -> tuple[Array, Array, Array]:
    """Return the soles' lowest points (frames, 2, points, 3), centre of mass (frames, 3), self-contact (frames,)."""
    data = mujoco.MjData(model)
    soles, com, touching = [], [], []
    for qpos in motion.qpos:
        data.qpos[:] = qpos
        mujoco.mj_forward(model, data)
        soles.append([sole_points(model, data, side) for side in ("left", "right")])
        com.append(data.subtree_com[1].copy())
        touching.append(data.ncon > 0)
    return np.array(soles), np.array(com), np.array(touching)


def _ahead(motion: Motion) -> Array:
    """Return the unit vector along which the pelvis moves, shape (3,)."""
    way = (motion.position[-1] - motion.position[0]) * [1.0, 1.0, 0.0]
    return way / max(float(np.linalg.norm(way)), 1e-9)


def _length(points: Array) -> Array:
    """Return the largest extent of a sole in each frame [m]."""
    return np.linalg.norm(points.max(axis=1) - points.min(axis=1), axis=1)


def _inside(com: Array, sole: Array) -> Array:
    """Return how far inside the bounding box of a sole's points (seen from above) the centre of mass is [m]."""
    low, high = sole[..., :2].min(axis=1), sole[..., :2].max(axis=1)
    return np.minimum(com[:, :2] - low, high - com[:, :2]).min(axis=1)


def _period(joints: Array) -> float:
    """Return the lag of the highest peak of the legs' autocorrelation [s], refined by a parabola."""
    centred = joints - joints.mean(axis=0)
    count = len(centred)
    lags = np.arange(1, count // 2)
    power = float(np.sum(centred**2)) / count
    values = np.array([np.sum(centred[:-lag] * centred[lag:]) / (count - lag) for lag in lags])
    peaks, found = find_peaks(values, height=0.5 * power)
    if not len(peaks):
        return float("nan")
    heights = found["peak_heights"]  # the first of equals: one period, not two
    i = int(peaks[heights > heights.max() - 0.05 * power][0])
    before, here, after = values[i - 1 : i + 2]
    return float((lags[i] + 0.5 * (before - after) / (before - 2 * here + after)) * CONTROL_PERIOD)
