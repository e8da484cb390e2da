# pyright: reportAttributeAccessIssue=false, reportUnknownParameterType=false
# (MuJoCo ships no type stubs.)
"""What can be measured of a clip of mounting or dismounting: whether a robot could do it on a board.

The board stands level at the origin, its axis `AXIS_HEIGHT` over the ground z = 0.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial import ConvexHull

from policy_runtime.motion.motions import Motion
from sim.skate.cycle.clock import CONTROL_PERIOD
from sim.skate.robot.g1 import JOINTS, sole_points
from sysid.roll import Array

AXIS_HEIGHT, DECK_TOP, RADIUS = 0.10, 0.11, 0.01
"""Of tilt axis, deck and the capsules of a sole [m]."""
HALF_LENGTH, HALF_WIDTH = 0.40, 0.10
STANDING = 0.003
"""A sole that is closer than this to the deck everywhere stands on it [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TransitionFacts:
    """Measured numbers of one clip."""

    duration: float
    """[s]"""
    left_stands: Array
    """Frames in which the left sole stands on the deck, shape (frames,), bool."""
    slide: float
    """Greatest speed of the left sole over the deck while it stands there [m/s]."""
    right_height: float
    """Greatest distance of the right sole from the deck [m]: it carries throughout."""
    clearance: float
    """Least height of the left sole over what is under it while it swings [m]; negative inside."""
    support_margin: float
    """Least distance of the centre of mass inside what stands [m], seen from above; negative outside."""
    self_contacts: int
    """Frames in which limbs touch each other."""
    limit_margin: float
    """Least distance from a joint limit [rad]."""
    peak_speed: float
    """Greatest joint speed [rad/s]."""
    peak_speed_joint: str
    first: Array
    """Joint angles of the first frame [rad], shape (23,)."""
    last: Array
    """Joint angles of the last frame [rad], shape (23,)."""


def transition_facts(motion: Motion, model: mujoco.MjModel) -> TransitionFacts:
    """Measure a clip.

    Args:
        motion: The clip.
        model: The G1 without a board (`sim.skate.robot.g1.g1_spec`).
    """
    data = mujoco.MjData(model)
    soles: list[list[Array]] = []
    margins: list[float] = []
    touching = 0
    for qpos in motion.qpos:
        data.qpos[:] = qpos
        mujoco.mj_forward(model, data)
        left, right = (sole_points(model, data, side) for side in ("left", "right"))
        standing = [right, left] if _stands(left) else [right]
        margins.append(_inside(data.subtree_com[1, :2], np.vstack(standing)[:, :2]))
        touching += data.ncon > 0
        soles.append([left, right])
    points = np.array(soles)
    left, right = points[:, 0], points[:, 1]
    stands = np.array([_stands(sole) for sole in left])
    speeds = np.abs(np.diff(motion.joints, axis=0)) / CONTROL_PERIOD
    worst = np.unravel_index(np.argmax(speeds), speeds.shape)
    moved = np.linalg.norm(np.diff(left[..., :2], axis=0), axis=-1).max(axis=-1) / CONTROL_PERIOD
    low, high = model.jnt_range[1:].T
    return TransitionFacts(
        duration=motion.duration,
        left_stands=stands,
        slide=float(moved[stands[1:] & stands[:-1]].max(initial=0.0)),
        right_height=float(np.abs(right[..., 2] - DECK_TOP).max()),
        clearance=float((left[..., 2] - _under(left)).min()),
        support_margin=min(margins),
        self_contacts=touching,
        limit_margin=float(np.minimum(motion.joints - low, high - motion.joints).min()),
        peak_speed=float(speeds[worst]),
        peak_speed_joint=JOINTS[worst[1]].removesuffix("_joint"),
        first=motion.joints[0],
        last=motion.joints[-1],
    )


def _stands(sole: Array) -> bool:
    over = np.abs(sole[:, 1]).max() < HALF_WIDTH
    return bool(over and np.abs(sole[:, 2] - DECK_TOP).max() < STANDING)


def _under(sole: Array) -> Array:
    """Return the height of deck or ground below points, shape (..., points)."""
    over = (np.abs(sole[..., 0]) < HALF_LENGTH + RADIUS) & (np.abs(sole[..., 1]) < HALF_WIDTH + RADIUS)
    return np.where(over, DECK_TOP, 0.0)


def _inside(point: Array, outline: Array) -> float:
    """Return how far inside the convex hull of soles a point is [m], the capsules' radius included."""
    hull = ConvexHull(outline)
    return float(-(hull.equations[:, :2] @ point + hull.equations[:, 2]).max()) + RADIUS
