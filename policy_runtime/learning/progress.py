# pyright: reportMissingImports=false, reportUnknownParameterType=false, reportPrivateUsage=false
# (mjlab keeps the reward of each term of a step in a private table.)
"""The training report of every iteration: sums kept on the device, read once.

| name | meaning |
|---|---|
| survival | share of the rides that ended in this iteration by time, not by a fall |
| falls_per_minute | rides ended early per minute of riding |
| patience, strength, entropy_weight | how hard the task is, see `policy_runtime.learning.curriculum` |
| speed_error | mean |v - v_cmd| while pushing [m/s] |
| heading_error | mean |heading - target| while steering [rad] |
| tilt_error, tilt | mean |γ - γ_ref| and |γ| while steering [rad] |
| both_feet | share of the steering steps with both feet on the deck |
| foot_down | share of the pushing steps with the pushing foot on the ground |
| stride_period | pushing time over touchdowns [s] |
| stance_time | time of the pushing foot on the ground over touchdowns [s] |
| foot_travel | mean way of the pushing foot along the board between two touchdowns [m] |
| slip | speed of the pushing foot over the ground, weighted by its load [m/s] |
| stops | share of the waiting steps in which the board rolls slower than 0.1 m/s |
| foot_place | mean distance of the right foot from where it stood at the start [m] |
| wrong_tilt | share of the steering steps with the deck tilted more than 3° the wrong way |
| wrong_push | share of the pushing steps with the right foot off the deck or the left one on it |
| wrong_steer | share of the steering steps with a foot off the deck or on the ground |
| reward/… | mean weighted reward of each term per second |
| end/… | rides ended by each cause per minute of riding |

A robot that stands does not ride: it seldom falls, and would dilute the early ends that lead the curriculum.
"""

import math
from typing import TYPE_CHECKING, Any

import torch

from sim.skate.arrays import wrap_angle
from sim.skate.cycle.clock import STILL_SPEED
from sim.skate.mdp.measuring import measure
from sim.skate.mdp.rewards.tilt_guidance import wrong_tilt

if TYPE_CHECKING:
    from mjlab.envs import ManagerBasedRlEnv

WRONG_TILT = math.radians(3)
"""Tilt the wrong way that is counted [rad]."""
PHASES = {
    "speed_error": "pushing", "heading_error": "steering", "tilt_error": "steering", "tilt": "steering",
    "foot_place": "all", "wrong_tilt": "steering", "both_feet": "steering", "foot_down": "pushing",
    "wrong_push": "pushing", "wrong_steer": "steering", "stops": "still", "stride_period": "touchdowns",
    "stance_time": "touchdowns", "foot_travel": "touchdowns", "slip": "load",
}  # fmt: skip
"""The count or weight that each of these is divided by."""


class Progress:
    """Sums over the steps of one iteration."""

    def __init__(self, env: "ManagerBasedRlEnv") -> None:
        """Allocate the sums."""
        self._env = env
        self._terms = env.reward_manager.active_terms
        self._ends = env.termination_manager.active_terms
        self._blameless = {name for name in self._ends if env.termination_manager.get_term_cfg(name).time_out}
        self._sums: dict[str, torch.Tensor] = {}
        self._steps = 0
        self._broken = torch.zeros(env.num_envs, dtype=torch.bool, device=env.device)

    def add(self, style: torch.Tensor) -> None:
        """Take the environments' last step into account; call before the next one."""
        env = self._env
        state = measure(env)  # as it was before ended episodes began anew
        broken = env.termination_manager.get_term("not_finite")
        self._broken |= broken
        steers, pushes, rides = state.steering & ~broken, state.pushing & ~broken, ~state.still
        steering, pushing = steers.float(), pushes.float()
        speed = (state.board_velocity[:, 0] - state.commanded_speed).abs()
        heading = wrap_angle(state.board_heading - state.target_heading).abs()
        left, right = state.foot_on_deck[:, 0], state.foot_on_deck[:, 1]
        touchdown = (state.left_touchdown & pushes).float()
        # Chosen, not multiplied: zero times NaN is NaN in a broken world.
        sums = {
            "all": torch.ones_like(steering).sum(),
            "riding": rides.float().sum(),
            "steering": steering.sum(),
            "still": state.still.float().sum(),
            "touchdowns": touchdown.sum(),
            "load": torch.where(pushes, state.ground_load[:, 0], 0.0).sum(),
            "pushing": pushing.sum(),
            "speed_error": torch.where(pushes, speed, 0.0).sum(),
            "heading_error": torch.where(steers, heading, 0.0).sum(),
            "tilt_error": torch.where(steers, (state.tilt - state.tilt_reference).abs(), 0.0).sum(),
            "tilt": torch.where(steers, state.tilt.abs(), 0.0).sum(),
            "foot_place": torch.where(broken, 0.0, state.foot_place_error.abs()).sum(),
            "wrong_tilt": ((wrong_tilt(state) > WRONG_TILT) * steering).sum(),
            "both_feet": (state.foot_on_deck.all(dim=-1) * steering).sum(),
            "foot_down": (state.foot_on_ground[:, 0] * pushing).sum(),
            "stops": (state.still & (state.board_velocity[:, 0].abs() < STILL_SPEED)).float().sum(),
            "stride_period": env.step_dt * pushing.sum(),
            "stance_time": env.step_dt * (state.foot_on_ground[:, 0] * pushing).sum(),
            "foot_travel": torch.where(touchdown > 0, state.left_travel, 0.0).sum(),
            "slip": torch.where(pushes, state.ground_load[:, 0] * state.left_slip, 0.0).sum(),
            "wrong_push": ((left | ~right) * pushing).sum(),
            "wrong_steer": ((~(left & right) | state.foot_on_ground.any(dim=-1)) * steering).sum(),
            "style": style,
            "reward": env.reward_manager._step_reward.mean(dim=0),
            "end": torch.stack(
                [(env.termination_manager.get_term(name) & rides).sum() for name in self._ends]
            ).float(),
        }
        for name, value in sums.items():
            kept = self._sums.get(name)
            self._sums[name] = value.clone() if kept is None else kept + value
        self._steps += 1

    def broken(self) -> list[int]:
        """Return the worlds of this process whose simulation has broken down since the last call."""
        worlds = torch.nonzero(self._broken).flatten().tolist()
        self._broken.zero_()
        return worlds

    def read(self) -> dict[str, float]:
        """Return the means since the last reading, pooled over processes, and start anew."""
        names = list(self._sums)
        flat = torch.cat([self._sums[name].flatten().double() for name in names])
        steps = float(self._steps)
        if torch.distributed.is_initialized():
            torch.distributed.all_reduce(flat)
            steps *= torch.distributed.get_world_size()
        values = dict(zip(names, flat.split([self._sums[name].numel() for name in names]), strict=True))
        self._sums, self._steps = {}, 0
        return self._means(values, steps)

    def _means(self, values: dict[str, torch.Tensor], steps: float) -> dict[str, float]:
        get = lambda name: float(values[name])  # noqa: E731
        minutes = max(get("riding"), 1.0) * self._env.step_dt / 60
        ends = dict(zip(self._ends, values["end"].tolist(), strict=True))
        falls = sum(count for name, count in ends.items() if name not in self._blameless)
        result: dict[str, Any] = {
            "survival": ends["time_out"] / max(ends["time_out"] + falls, 1.0),
            "falls_per_minute": falls / minutes,
            "style": get("style") / steps,
        }
        for name, phase in PHASES.items():
            result[name] = get(name) / max(get(phase), 1.0)
        terms = (values["reward"] / steps).tolist()
        result["reward"] = sum(terms)
        result |= {f"reward/{name}": value for name, value in zip(self._terms, terms, strict=True)}
        return result | {f"end/{name}": count / minutes for name, count in ends.items()}
