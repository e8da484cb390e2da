"""The paper's five metrics of a policy, and three of our own, from recorded rides.

| name | here | the paper |
|---|---|---|
| E_succ | share of episodes that reach their time limit | success rate, criteria not given |
| E_vel | mean of abs(v_cmd - v) over the pushing steps, v along the board [m/s] | "velocity tracking error" |
| E_yaw | mean of abs(ψ_target - ψ) over the steering steps, ψ of the board [rad] | "heading error" |
| E_smth | mean of abs(Δq) over joints and steps [rad] | "smoothness", formula not given |
| E_contact | share of pushing and steering steps with the wrong feet down | "contact error" |

Where the paper leaves a choice, the other readings are reported beside: the error of the mean speed of
each pushing phase, the heading error at the last step of each steering phase, the length and the
root mean square of Δq, and the share of wrong contacts in pushing and in steering alone. An episode
that ends early counts with the steps it had. E_course is no error of the paper's: how far the heading at the end of each
steering phase is from the start's and all turns asked for since, which is what a ride straight on drifts by. Nor is E_tilt: the largest
tilt against the turn in a steering phase, which is a corner's and not an arc's; nor E_still: the mean of abs(v) where the robot
is told to stand, which counts as no ride. Wrong feet: in pushing, the right foot off the deck or
the left foot on it; in steering, a foot off the deck or on the ground.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from sim.skate.arrays import wrap_angle
from sim.skate.cycle.clock import STILL_SPEED
from sysid.errors import SysidError
from sysid.roll import Array

Flags = npt.NDArray[np.bool_]

METRICS = {
    "E_vel": "m/s", "E_yaw": "rad", "E_smth": "rad", "E_contact": "1",
    "E_vel_mean_speed": "m/s", "E_yaw_final": "rad", "E_smth_norm": "rad", "E_smth_rms": "rad",
    "E_contact_push": "1", "E_contact_steer": "1", "E_course": "rad", "E_tilt": "rad", "E_still": "m/s",
}  # fmt: skip
"""Every error besides E_succ, with its unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rides:
    """Recorded episodes side by side: first axis policy steps (t), second episodes (n)."""

    alive: Flags
    """The episode still ran at this step, (t, n)."""
    pushing: Flags
    """In the pushing phase and told to move, (t, n)."""
    steering: Flags
    """In the steering phase and told to move, (t, n)."""
    commanded_speed: Array
    """[m/s], (t, n)."""
    target_heading: Array
    """[rad], (t, n); read in steering only."""
    course: Array
    """Sum of the turns asked for since the start [rad], (t, n)."""
    speed: Array
    """Of the board along its own x axis [m/s], (t, n)."""
    heading: Array
    """Of the board [rad], (t, n)."""
    tilt: Array
    """Of the deck, left edge down positive [rad], (t, n)."""
    joints: Array
    """[rad], (t, n, 23)."""
    foot_on_ground: Flags
    """Left, right, (t, n, 2)."""
    foot_on_deck: Flags
    """Left, right, (t, n, 2)."""
    succeeded: Flags
    """The episode reached its time limit, (n,)."""

    def __post_init__(self) -> None:
        """Check that the shapes agree.

        Raises:
            SysidError: They do not.
        """
        steps, episodes = self.alive.shape
        tails = {"joints": (23,), "foot_on_ground": (2,), "foot_on_deck": (2,)}
        for field in fields(self):
            shape = np.shape(getattr(self, field.name))
            if field.name == "succeeded":
                wanted: tuple[int, ...] = (episodes,)
            else:
                wanted = (steps, episodes, *tails.get(field.name, ()))
            if shape != wanted:
                raise SysidError(f"rides: '{field.name}' has shape {shape}; expected {wanted}.")

    @classmethod
    def join(cls, rides: "list[Self]") -> Self:
        """Put rides of different lengths side by side; the shorter ones are no longer alive at the end."""
        steps = max(len(ride.alive) for ride in rides)

        def stack(name: str) -> Any:
            if name == "succeeded":
                return np.concatenate([ride.succeeded for ride in rides])
            arrays: list[Any] = [getattr(ride, name) for ride in rides]
            padded = [np.pad(a, [(0, steps - len(a)), *[(0, 0)] * (a.ndim - 1)]) for a in arrays]
            return np.concatenate(padded, axis=1)

        return cls(**{field.name: stack(field.name) for field in fields(cls)})


def episode_errors(rides: Rides) -> dict[str, Array]:
    """Return every error of `METRICS` for every episode, shape (n,); NaN where a phase never came."""
    push, steer = rides.pushing & rides.alive, rides.steering & rides.alive
    slowness = rides.commanded_speed - rides.speed
    yaw_error = np.abs(wrap_angle(rides.target_heading - rides.heading))
    course_error = np.abs(wrap_angle(rides.heading - rides.heading[0] - rides.course))
    change = np.diff(rides.joints, axis=0)
    pairs = rides.alive[1:] & rides.alive[:-1]
    wrong_push, wrong_steer = wrong_in_pushing(rides), wrong_in_steering(rides)
    wrong = np.where(rides.pushing, wrong_push, wrong_steer)
    return {
        "E_vel": _mean(np.abs(slowness), push),
        "E_yaw": _mean(yaw_error, steer),
        "E_smth": _mean(np.abs(change).mean(axis=-1), pairs),
        "E_contact": _mean(wrong.astype(float), push | steer),
        "E_vel_mean_speed": _over_phases(push, lambda n, a, b: abs(float(slowness[a:b, n].mean()))),
        "E_yaw_final": _mean(yaw_error, _last(steer)),
        "E_smth_norm": _mean(np.linalg.norm(change, axis=-1), pairs),
        "E_smth_rms": np.sqrt(_mean((change**2).mean(axis=-1), pairs)),
        "E_contact_push": _mean(wrong_push.astype(float), push),
        "E_contact_steer": _mean(wrong_steer.astype(float), steer),
        "E_course": _mean(course_error, _last(steer)),
        "E_tilt": _over_phases(steer, lambda n, a, b: _wrong_tilt(rides, n, a, b)),
        "E_still": _mean(np.abs(rides.speed), rides.alive & (rides.commanded_speed < STILL_SPEED)),
    }


def wrong_in_pushing(rides: Rides) -> Flags:
    """Return where the right foot is off the deck or the left foot on it, (t, n)."""
    return np.logical_or(~rides.foot_on_deck[..., 1], rides.foot_on_deck[..., 0])


def wrong_in_steering(rides: Rides) -> Flags:
    """Return where a foot is off the deck or on the ground, (t, n)."""
    return np.logical_or(~rides.foot_on_deck.all(axis=-1), rides.foot_on_ground.any(axis=-1))


def _mean(values: Array, where: Flags) -> Array:
    """Return the mean over steps where a flag is set, shape (n,); NaN where it never is."""
    count = where.sum(axis=0)
    total = np.where(where, values, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _last(flags: Flags) -> Flags:
    """Return the last step of every phase that came to its end."""
    last = np.zeros_like(flags)
    last[:-1] = flags[:-1] & ~flags[1:]
    return last


def _phases(where: Flags) -> list[tuple[int, int]]:
    """Return first step and the one after the last of every interval in which a flag is set, (t,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _over_phases(where: Flags, value: Callable[[int, int, int], float]) -> Array:
    """Return the mean over an episode's phases of what an episode's number and two ends give, shape (n,)."""
    means = [[value(n, a, b) for a, b in _phases(where[:, n])] for n in range(where.shape[1])]
    return np.array([np.mean(one) if one else np.nan for one in means])


def _wrong_tilt(rides: Rides, n: int, begin: int, end: int) -> float:
    """Return the largest tilt against the turn in a steering phase [rad]."""
    turn = wrap_angle(rides.target_heading[begin, n] - rides.heading[begin, n])
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
        for begin, end in _phases(steer[:, n]):
            if end < len(steer) and rides.alive[end, n]:
                start = rides.heading[begin, n]
                asked = wrap_angle(rides.target_heading[begin, n] - start)
                done = float(np.unwrap(rides.heading[begin:end, n])[-1] - start)
                rows.append((float(asked), done, float(rides.speed[begin, n])))
    return np.array(rows).reshape(-1, 3)
