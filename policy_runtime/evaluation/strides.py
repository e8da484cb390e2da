"""Pushing of a rider: strides, stance, travel and slip of the pushing foot, and the distance to the reference clips.

Each metric is a number per episode; NaN if undefined. `docs/runtime.md` defines them.
"""

from collections.abc import Iterator
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from policy_runtime.motion.motions import load_motions, windows
from sim.skate.cycle.clock import CONTROL_PERIOD
from sysid.roll import Array

if TYPE_CHECKING:
    from policy_runtime.evaluation.metrics import Flags, Rides

IMPACT_STEPS = round(0.1 / CONTROL_PERIOD)
"""Policy steps after a touchdown that belong to its impact."""
STRIDE_METRICS = {
    "strides": "1", "stride_period": "s", "stance_time": "s", "foot_travel": "m", "slip": "m/s", "impact": "1",
    "style_distance": "rad",
}  # fmt: skip
"""Every metric of this module, with its unit."""


def intervals(where: "Flags") -> list[tuple[int, int]]:
    """Return first step and the one after the last of every interval in which a flag is set, (t,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def stride_metrics(rides: "Rides") -> dict[str, Array]:
    """Return every metric of `STRIDE_METRICS` for every episode, shape (n,)."""
    rows = [_of_episode(rides, n) for n in range(rides.alive.shape[1])]
    return {name: np.array([row[name] for row in rows]) for name in STRIDE_METRICS}


def _of_episode(rides: "Rides", n: int) -> dict[str, float]:
    push = rides.pushing[:, n] & rides.alive[:, n]
    down = rides.foot_on_ground[:, n, 0]
    phases = intervals(push)
    times, stances, travels, impacts, counts = [], [], [], [], []
    for begin, end in phases:
        stands = intervals(down[begin:end])
        touchdowns = [begin + first for first, _ in stands if first > 0]
        counts.append(len(touchdowns))
        stances += [CONTROL_PERIOD * (b - a) for a, b in stands if a > 0 and b < end - begin]
        for a, b in pairwise(touchdowns):
            times.append(CONTROL_PERIOD * (b - a))
            travels.append(float(np.ptp(rides.left_place[a:b, n])))
        impacts += [float(rides.ground_load[a : min(a + IMPACT_STEPS, end), n].max()) for a in touchdowns]
    load = rides.ground_load[push, n]
    weight = float(load.sum())
    return {
        "strides": float(np.mean(counts)) if counts else np.nan,
        "stride_period": _median(times),
        "stance_time": _median(stances),
        "foot_travel": _median(travels),
        "slip": float((load * rides.left_slip[push, n]).sum()) / weight if weight > 0 else np.nan,
        "impact": _median(impacts),
        "style_distance": _style_distance(rides.joint_position[:, n], phases),
    }


def _median(values: list[float]) -> float:
    return float(np.median(values)) if values else np.nan


def _style_distance(joints: Array, phases: list[tuple[int, int]]) -> float:
    """Return the mean distance of windows of joint angles, (t, 23), in some phases [rad]."""
    seen = [windows(joints[a:b]) for a, b in phases]
    if not sum(map(len, seen)):
        return np.nan
    return float(nearest(np.concatenate(seen), _reference()).mean())


def nearest(windows: Array, reference: Array) -> Array:
    """Return the RMS distance of flat windows, (m, k), to the nearest of a reference, (r, k) [rad], shape (m,)."""
    square = (windows**2).sum(1)[:, None] + (reference**2).sum(1) - 2 * windows @ reference.T
    return np.sqrt(np.maximum(square.min(axis=1), 0.0) / windows.shape[1])


@lru_cache(maxsize=1)
def _reference() -> Array:
    return np.concatenate([windows(motion.joints) for motion in load_motions()])


@lru_cache(maxsize=1)
def clip_ranges() -> dict[str, tuple[float, float]]:
    """Return the range of those metrics that the reference clips have too."""
    from policy_runtime.motion.motion_check import motion_facts
    from sim.skate.robot.g1 import g1_spec

    model = g1_spec(visuals=False).compile()
    facts = [motion_facts(clip, model) for clip in load_motions()]
    values = {
        "stride_period": [fact.period for fact in facts],
        "stance_time": [fact.period * fact.stance for fact in facts],
        "foot_travel": [fact.travel for fact in facts],
        "slip": [fact.slide for fact in facts],
        "style_distance": [distance for _, distance in clip_distances()],
    }
    return {name: (min(found), max(found)) for name, found in values.items()}


def clip_distances() -> Iterator[tuple[str, float]]:
    """Yield each reference clip's name and its distance to the others [rad]: how far apart good strides are."""
    clips = load_motions()
    for clip in clips:
        others = np.concatenate([windows(other.joints) for other in clips if other is not clip])
        yield clip.name, float(nearest(windows(clip.joints), others).mean())
