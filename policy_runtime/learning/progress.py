# pyright: reportMissingImports=false, reportUnknownParameterType=false, reportPrivateUsage=false
# (mjlab keeps the reward of each term of a step in a private table.)
"""The training report of every iteration: sums kept on the device, read once.

`survival`: Share of the rides that ended in this iteration by time, not by a fall.
`falls_per_minute`, `end/…`: Rides ended early per minute of riding, in all and by each cause.
`reward/…`, `reward`: Mean weighted reward of each term per second, and their sum.
`patience`, `strength`, `entropy_weight`: The task's difficulty (`policy_runtime.learning.curriculum`).

`_ratios` defines the others. A robot that stands does not ride: it seldom falls, and would dilute the early ends that lead the
curriculum.
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

    from sim.skate.mdp.state import SkateState

WRONG_TILT = math.radians(3)
"""Tilt the wrong way that is counted [rad]."""


class Progress:
    """Sums over the steps of one iteration."""

    def __init__(self, env: "ManagerBasedRlEnv") -> None:
        """Allocate the sums."""
        self._env = env
        self._terms = env.reward_manager.active_terms
        self._ends = env.termination_manager.active_terms
        self._blameless = {name for name in self._ends if env.termination_manager.get_term_cfg(name).time_out}
        self._sums: dict[str, torch.Tensor] = {}
        self._steps, self._ratios = 0, list[str]()
        self._broken = torch.zeros(env.num_envs, dtype=torch.bool, device=env.device)

    def add(self, style: torch.Tensor) -> None:
        """Take the environments' last step into account; call before the next one."""
        env = self._env
        state = measure(env)  # as it was before ended episodes began anew
        broken, rides = env.termination_manager.get_term("not_finite"), ~state.still
        self._broken |= broken
        ratios = _ratios(state, broken, env.step_dt)
        self._ratios = list(ratios)
        sums = {
            "ratios": torch.stack([part.float() for pair in ratios.values() for part in pair]).sum(dim=1),
            "riding": rides.float().sum(),
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
        pairs = values["ratios"].view(-1, 2).tolist()
        result |= {
            name: top / max(bottom, 1.0) for name, (top, bottom) in zip(self._ratios, pairs, strict=True)
        }
        terms = (values["reward"] / steps).tolist()
        result["reward"] = sum(terms)
        result |= {f"reward/{name}": value for name, value in zip(self._terms, terms, strict=True)}
        return result | {f"end/{name}": count / minutes for name, count in ends.items()}


def _ratios(
    state: "SkateState", broken: torch.Tensor, step: float
) -> dict[str, tuple[torch.Tensor, torch.Tensor]]:
    """Return numerator and denominator of each mean over worlds and policy steps, (n,) each.

    Args:
        broken: The worlds to leave out, bool (n,).
        step: Length of a policy step [s].
    """
    steers, pushes = state.steering & ~broken, state.pushing & ~broken
    left, right = state.foot_on_deck.unbind(-1)
    down, touchdown = state.foot_on_ground[:, 0] & pushes, state.left_touchdown & pushes
    speed, load = state.board_velocity[:, 0], state.ground_load[:, 0]
    # Chosen, not multiplied: zero times NaN is NaN in a broken world.
    mean = lambda value, where: (torch.where(where, value, 0.0), where)  # noqa: E731
    return {
        "speed_error": mean((speed - state.commanded_speed).abs(), pushes),  # [m/s]
        "heading_error": mean(wrap_angle(state.board_heading - state.target_heading).abs(), steers),  # [rad]
        "tilt_error": mean((state.tilt - state.tilt_reference).abs(), steers),  # [rad]
        "tilt": mean(state.tilt.abs(), steers),  # [rad]
        "foot_place": mean(state.foot_place_error.abs(), ~broken),  # [m]
        "wrong_tilt": mean(wrong_tilt(state) > WRONG_TILT, steers),
        "both_feet": mean(left & right, steers),
        "foot_down": mean(down, pushes),
        "wrong_push": mean(left | ~right, pushes),
        "wrong_steer": mean(~(left & right) | state.foot_on_ground.any(dim=-1), steers),
        "stops": mean(speed.abs() < STILL_SPEED, state.still),
        "stride_period": (step * pushes, touchdown),  # [s]
        "stance_time": (step * down, touchdown),  # [s]
        "foot_travel": mean(state.left_travel, touchdown),  # [m]
        "slip": (torch.where(pushes, load * state.left_slip, 0.0), torch.where(pushes, load, 0.0)),  # [m/s]
    }
