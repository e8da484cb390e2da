"""Result of an evaluation: success rate, errors with their intervals, and terminations."""

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from policy_runtime.evaluation.metrics import METRICS, Flags, Rides, episode_errors, reachable_headings
from policy_runtime.evaluation.statistics import mean_over, proportion
from sim.skate.cycle.clock import CONTROL_PERIOD, STILL_SPEED
from sysid.quantity import Quantity
from sysid.roll import Array

TIME_LIMIT = "time limit"
"""How an episode ends that succeeds."""
PATHS = 20
"""Paths kept for the picture."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """Result of some episodes of one seed; small, whatever their length."""

    seed: int
    errors: dict[str, Array]
    """Every metric of `METRICS`, shape (n,)."""
    durations: Array
    """[s], shape (n,)."""
    endings: list[str]
    """How each episode ended."""
    stood: Flags
    """Whether it was commanded to stand all the time, shape (n,)."""
    headings: Array
    """See `metrics.reachable_headings`."""
    paths: list[Array]
    """Paths of the board in some of the episodes: x, y, heading, each (t, 3)."""


def part_of(seed: int, rides: Rides, endings: list[str], paths: list[Array]) -> Part:
    """Return the result of recorded episodes of one seed."""
    return Part(
        seed=seed,
        errors=episode_errors(rides),
        durations=rides.alive.sum(axis=0) * CONTROL_PERIOD,
        endings=endings,
        stood=np.atleast_1d((rides.commanded_speed * rides.alive < STILL_SPEED).all(axis=0)),
        headings=reachable_headings(rides),
        paths=paths,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """Result of an evaluation."""

    policy: str
    board: str
    episodes: int
    """Episodes of each seed."""
    seeds: tuple[int, ...]
    success: Quantity
    """Share of the rides that last to the time limit, without commanded standing."""
    standing: Quantity
    """The same of the episodes of commanded standing."""
    errors: dict[str, Quantity]
    """Every metric of `METRICS`."""
    endings: dict[str, int]
    """How many episodes ended in which way."""
    duration: Quantity
    """Time until the end of an episode [s]."""
    median_duration: float
    """Of the rides, without commanded standing [s]."""
    headings: Array
    """See `metrics.reachable_headings`."""
    paths: tuple[Array, ...]
    """Paths of the board in the first episodes: x, y, heading, each (t, 3)."""

    def to_json(self) -> dict[str, Any]:
        """Return the evaluation for machines."""
        return {
            "policy": self.policy,
            "board": self.board,
            "episodes": self.episodes,
            "seeds": list(self.seeds),
            "E_succ": self.success.to_json(),
            "standing": self.standing.to_json(),
            **{name: quantity.to_json() for name, quantity in self.errors.items()},
            "duration": self.duration.to_json(),
            "median_duration": None if math.isnan(self.median_duration) else self.median_duration,
            "endings": self.endings,
            "headings": [
                {"asked_rad": asked, "achieved_rad": done, "speed": speed}
                for asked, done, speed in self.headings.tolist()
            ],
        }


def summarise(parts: list[Part], policy: str, board: str) -> Evaluation:
    """Combine the results of all parts; at least one part."""
    seeds = tuple(sorted({part.seed for part in parts}))

    def by_seed(values: Callable[[Part], Array]) -> list[Array]:
        return [np.concatenate([values(part) for part in parts if part.seed == seed]) for seed in seeds]

    endings = [ending for part in parts for ending in part.endings]
    stood = np.concatenate([part.stood for part in parts])
    lasted = np.array([ending == TIME_LIMIT for ending in endings], dtype=bool)
    rode = np.concatenate([part.durations for part in parts])[~stood]
    return Evaluation(
        policy=policy,
        board=board,
        episodes=round(len(endings) / len(seeds)),
        seeds=seeds,
        success=proportion(int(lasted[~stood].sum()), int((~stood).sum())),
        standing=proportion(int(lasted[stood].sum()), int(stood.sum())),
        errors={
            key: mean_over(by_seed(lambda part, key=key: part.errors[key]), unit)
            for key, unit in METRICS.items()
        },
        endings=dict(sorted(Counter(endings).items())),
        duration=mean_over(by_seed(lambda part: part.durations), "s"),
        median_duration=float(np.median(rode)) if len(rode) else math.nan,
        headings=np.concatenate([part.headings for part in parts]),
        paths=tuple(path for part in parts for path in part.paths)[:PATHS],
    )
