"""The paper's five metrics of a policy, and the project's own, from recorded rides. `docs/runtime.md` defines them.

The paper gives no formulas: E_succ, E_vel, E_yaw, E_smth and E_contact are one reading. Other readings are E_vel_mean_speed,
of each pushing phase's mean speed, and E_yaw_final, at the last step of each steering phase. E_contact is also given for
pushing and for steering alone. An episode that ends early counts with its steps.

Pushing is measured by strides, stance, travel and slip of the pushing foot, and the distance to the reference clips.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from functools import lru_cache
from itertools import pairwise
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from policy_runtime.motion.motions import load_motions, windows
from sim.skate.arrays import wrap_angle
from sim.skate.cycle.clock import CONTROL_PERIOD, STILL_SPEED
from sysid.roll import Array

Flags = npt.NDArray[np.bool_]

IMPACT_STEPS = round(0.1 / CONTROL_PERIOD)
"""Policy steps after a touchdown that belong to its impact."""
STRIDE_METRICS = {
    "strides": "1", "stride_period": "s", "stance_time": "s", "foot_travel": "m", "slip": "m/s", "impact": "1",
    "style_distance": "rad",
}  # fmt: skip
"""Every metric of pushing, with its unit."""
METRICS = {
    "E_vel": "m/s", "E_yaw": "rad", "E_smth": "rad", "E_contact": "1",
    "E_vel_mean_speed": "m/s", "E_yaw_final": "rad",
    "E_contact_push": "1", "E_contact_steer": "1", "E_course": "rad", "E_tilt": "rad", "E_still": "m/s", "E_stop": "1",
    "side_slip": "m/s", "transport": "1", **STRIDE_METRICS,
}  # fmt: skip
"""Every metric besides E_succ, with its unit."""
STOP_STEPS = round(8.0 / CONTROL_PERIOD)
"""Policy steps within which a rider shall come to rest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rides:
    """Recorded episodes side by side: first axis policy steps (t), second episodes (n)."""

    alive: Flags
    """The episode still ran at this step, (t, n)."""
    pushing: Flags
    """In the pushing phase with a command to move, (t, n)."""
    steering: Flags
    """In the steering phase, (t, n)."""
    still: Flags
    """Told to stand, and the cycle waits, (t, n)."""
    commanded_speed: Array
    """[m/s], (t, n)."""
    target_heading: Array
    """[rad], (t, n); read in steering only."""
    course: Array
    """Sum of the turns asked for since the start [rad], (t, n)."""
    board_speed: Array
    """Of the board along its own x axis [m/s], (t, n)."""
    board_drift: Array
    """Speed of the board's middle along its own y axis [m/s], (t, n)."""
    board_heading: Array
    """Of the board [rad], (t, n)."""
    tilt: Array
    """Of the deck, left edge down positive [rad], (t, n)."""
    joint_position: Array
    """[rad], (t, n, 23)."""
    power: Array
    """Sum of abs(torque · rate) of the motors over the robot's weight [m/s], (t, n)."""
    ground_load: Array
    """Force of the ground on the left foot over the robot's weight [1], (t, n)."""
    left_slip: Array
    """Speed of the left sole over the ground [m/s], (t, n)."""
    left_place: Array
    """Place of the left sole along the board [m], (t, n)."""
    foot_on_ground: Flags
    """Left, right, (t, n, 2)."""
    foot_on_deck: Flags
    """Left, right, (t, n, 2)."""
    succeeded: Flags
    """The episode reached its time limit, (n,)."""

    @classmethod
    def join(cls, rides: "list[Self]") -> Self:
        """Put rides of different lengths side by side; the shorter ones are no longer alive at the end."""
        steps = max(len(ride.alive) for ride in rides)

        def stack(name: str) -> Any:
            arrays: list[Any] = [getattr(ride, name) for ride in rides]
            if name == "succeeded":
                return np.concatenate(arrays)
            padded = [np.pad(a, [(0, steps - len(a)), *[(0, 0)] * (a.ndim - 1)]) for a in arrays]
            return np.concatenate(padded, axis=1)

        return cls(**{field.name: stack(field.name) for field in fields(cls)})


def episode_errors(rides: Rides) -> dict[str, Array]:
    """Return every error of `METRICS` for every episode, shape (n,); NaN where a phase never came."""
    push, steer = rides.pushing & rides.alive, rides.steering & rides.alive
    slowness = rides.commanded_speed - rides.board_speed
    yaw_error = np.abs(wrap_angle(rides.target_heading - rides.board_heading))
    course_error = np.abs(wrap_angle(rides.board_heading - rides.board_heading[0] - rides.course))
    change = np.diff(rides.joint_position, axis=0)
    pairs = rides.alive[1:] & rides.alive[:-1]
    # Pushing: the right foot off the deck or the left foot on it. Steering: a foot off the deck or on the ground.
    wrong_push = ~rides.foot_on_deck[..., 1] | rides.foot_on_deck[..., 0]
    wrong_steer = ~rides.foot_on_deck.all(axis=-1) | rides.foot_on_ground.any(axis=-1)
    wrong = np.where(rides.pushing, wrong_push, wrong_steer)
    return {
        "E_vel": _mean(np.abs(slowness), push),
        "E_yaw": _mean(yaw_error, steer),
        "E_smth": _mean(np.abs(change).mean(axis=-1), pairs),
        "E_contact": _mean(wrong.astype(float), push | steer),
        "E_vel_mean_speed": _over_phases(push, lambda n, a, b: abs(float(slowness[a:b, n].mean()))),
        "E_yaw_final": _mean(yaw_error, _last(steer)),
        "E_contact_push": _mean(wrong_push.astype(float), push),
        "E_contact_steer": _mean(wrong_steer.astype(float), steer),
        "E_course": _mean(course_error, _last(steer)),
        "E_tilt": _over_phases(steer, lambda n, a, b: _wrong_tilt(rides, n, a, b)),
        "E_still": _mean(np.abs(rides.board_speed), rides.alive & rides.still),
        "E_stop": np.array([_failed_stops(rides, n) for n in range(rides.alive.shape[1])]),
        "side_slip": _mean(np.abs(rides.board_drift), rides.alive),
        "transport": _over_all(rides.power, rides.alive) / _over_all(np.abs(rides.board_speed), rides.alive),
        **stride_metrics(rides),
    }


def _over_all(values: Array, where: Flags) -> Array:
    """Return the sum over steps with a flag, shape (n,); NaN if it is 0."""
    total = np.where(where, values, 0.0).sum(axis=0)
    return np.where(total > 0, total, np.nan)


def _failed_stops(rides: Rides, n: int) -> float:
    """Return the share of an episode's stops that failed; NaN without a stop that was given its time."""
    alive, speed = rides.alive[:, n], rides.board_speed[:, n]
    told = rides.commanded_speed[:, n] < STILL_SPEED
    failed: list[bool] = []
    for begin, end in intervals(told & alive):
        if begin == 0:
            continue
        last = begin + STOP_STEPS
        if last < end:
            failed.append(abs(float(speed[last])) >= STILL_SPEED)
        elif end < len(alive) and told[end] and not alive[end] and not rides.succeeded[n]:
            failed.append(True)
    return float(np.mean(failed)) if failed else np.nan


def _mean(values: Array, where: Flags) -> Array:
    """Return the mean over steps with a flag, shape (n,); NaN without one."""
    count = where.sum(axis=0)
    total = np.where(where, values, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _last(flags: Flags) -> Flags:
    """Return the last step of every phase that came to its end."""
    last = np.zeros_like(flags)
    last[:-1] = flags[:-1] & ~flags[1:]
    return last


def _over_phases(where: Flags, value: Callable[[int, int, int], float]) -> Array:
    """Return the mean of `value(episode, begin, end)` over an episode's phases, shape (n,)."""
    means = [[value(n, a, b) for a, b in intervals(where[:, n])] for n in range(where.shape[1])]
    return np.array([np.mean(one) if one else np.nan for one in means])


def _wrong_tilt(rides: Rides, n: int, begin: int, end: int) -> float:
    """Return the largest tilt against the turn in a steering phase [rad]."""
    turn = wrap_angle(rides.target_heading[begin, n] - rides.board_heading[begin, n])
    return max(0.0, float(np.max(-np.sign(turn) * rides.tilt[begin:end, n])))


def asked_course(steering: Flags, target_heading: Array, heading: Array) -> Array:
    """Return the sum of the turns asked for since the start [rad], (t, n), where each was told as it was asked for.

    Args:
        steering: In the steering phase, (t, n).
        target_heading: [rad], (t, n).
        heading: Of the board [rad], (t, n).
    """
    begins = steering & ~np.vstack([np.zeros_like(steering[:1]), steering[:-1]])
    return np.cumsum(np.where(begins, wrap_angle(target_heading - heading), 0.0), axis=0)


def reachable_headings(rides: Rides) -> Array:
    """Return every steering phase as (turn asked for, turn achieved, speed at its start), shape (m, 3).

    Returns:
        [rad], [rad], [m/s], one row for each phase that came to its end.
    """
    rows: list[tuple[float, float, float]] = []
    steer = rides.steering & rides.alive
    for n in range(steer.shape[1]):
        for begin, end in intervals(steer[:, n]):
            if end < len(steer) and rides.alive[end, n]:
                start = rides.board_heading[begin, n]
                asked = wrap_angle(rides.target_heading[begin, n] - start)
                done = float(np.unwrap(rides.board_heading[begin:end, n])[-1] - start)
                rows.append((float(asked), done, float(rides.board_speed[begin, n])))
    return np.array(rows).reshape(-1, 3)


def intervals(where: Flags) -> list[tuple[int, int]]:
    """Return first step and the one after the last of every interval in which a flag is set, (t,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def stride_metrics(rides: Rides) -> dict[str, Array]:
    """Return every metric of `STRIDE_METRICS` for every episode, shape (n,)."""
    rows = [_of_episode(rides, n) for n in range(rides.alive.shape[1])]
    return {name: np.array([row[name] for row in rows]) for name in STRIDE_METRICS}


def _of_episode(rides: Rides, n: int) -> dict[str, float]:
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
