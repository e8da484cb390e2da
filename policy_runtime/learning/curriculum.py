"""An adaptive curriculum: the difficulty of the task follows the skill of the learner.

It is driven by the early ends: episodes that end before their time limit, per minute of riding. With few early ends the task
gets harder, with many it gets easier. A step is proportional to the logarithm of the early ends over their set point, so the
task always changes.

First comes the patience with a wrong stance (policy steps). If 0.4 s of wrong stance end an episode, a beginner never learns
to ride. If they never do, it learns to ride on one leg. So the patience starts at its longest and shrinks to the task's own.
The idle patience shrinks in proportion, and the weight of `push/left_foot` grows in inverse proportion.

Then comes the strength by which worlds differ (`sim.skate.mdp.worlds`), from 0 to 1. Up to a strength of a quarter the weights
of some rewards grow, which a rider needs and a beginner does not (`Reward.beginner`).

The weight of the actions' entropy falls geometrically with the early ends, between the two set points. So a learner that
falls explores.

The longest patience is shorter than any phase in which the stance counts, else one leg never ends an episode.
Riding on one leg ends 15 to 19 episodes a minute of riding; the set point is above that.
"""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

from sim.skate.cycle.clock import Clock

if TYPE_CHECKING:
    from policy_runtime.learning.amp import AmpPPO
    from sim.skate.mdp.rewards import Reward

LONGEST = 5 / 6 * min(Clock().push, Clock().steer)
"""Patience of a beginner [policy steps]: a phase in the wrong stance ends an episode."""
PATIENCE_ENDS = 24.0
"""Ends a minute of riding at which the patience stays: more than riding on one leg causes."""
STRENGTH_ENDS = 4.5
"""Ends a minute of riding at which the strength stays."""
GAIN = 0.03
"""Step for ends that are off by a factor of e."""
HARDER, EASIER = 0.03, 0.01
"""Largest steps, relative for the patience, absolute for the strength."""


def step(ends: float, set_point: float) -> float:
    """Return the step towards a harder task, negative towards an easier one."""
    return min(max(GAIN * math.log(set_point / max(ends, 1e-6)), -EASIER), HARDER)


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """How hard the task is."""

    patience: float
    """Policy steps of wrong stance that end an episode."""
    strength: float = 0.0
    """Share of the variation by which worlds differ, 0 to 1."""
    ends: float = 0.0
    """Episodes that ended early in the iteration before, a minute of riding."""

    def after(self, ends: float, own: float) -> Self:
        """Return the level after an iteration."""
        if self.patience <= own:
            strength = min(self.strength + step(ends, STRENGTH_ENDS), 1.0)
            if strength >= 0:
                return replace(self, strength=strength, ends=ends)
        patience = self.patience * math.exp(-step(ends, PATIENCE_ENDS))
        return replace(self, patience=min(max(patience, own), LONGEST), strength=0.0, ends=ends)

    def entropy(self, first: float, last: float) -> float:
        """Return the weight of the actions' entropy.

        Args:
            first: The weight of who falls so often that the patience does not shrink.
            last: The weight of who falls so seldom that the strength does not.
        """
        way = math.log(max(self.ends, STRENGTH_ENDS) / STRENGTH_ENDS) / math.log(
            PATIENCE_ENDS / STRENGTH_ENDS
        )
        return last * (first / last) ** min(way, 1.0)


class Curriculum:
    """Holds worlds and learner at a level."""

    def __init__(
        self, env: Any, algorithm: "AmpPPO", last_entropy: float, level: Level | None = None
    ) -> None:
        """Read the task's own numbers."""
        import torch

        from sim.skate.mdp.worlds import worlds

        self._env, self._algorithm, self._worlds = env, algorithm, worlds(env)
        ends = env.termination_manager
        self._patience: dict[str, tuple[float, Any]] = {}
        for name in ("wrong_stance", "idle_foot"):
            if name in ends.active_terms:
                params = ends.get_term_cfg(name).params
                own = float(params["patience"])
                params["patience"] = torch.tensor(own, device=env.device)
                self._patience[name] = own, params["patience"]
        self.own = self._patience["wrong_stance"][0]
        self._entropy = algorithm.entropy_coef, last_entropy
        rewards = env.reward_manager
        self._left_foot = rewards.get_term_cfg("push/left_foot").weight
        paid = [rewards.get_term_cfg(name).params["reward"] for name in rewards.active_terms]
        self._led: list[Reward] = [reward for reward in paid if reward.beginner is not None]
        self.set(Level(patience=LONGEST, ends=math.inf) if level is None else level)

    def set(self, level: Level) -> None:
        """Set the difficulty of the task to a level."""
        self.level = level
        share = level.patience / self.own
        for own, kept in self._patience.values():
            kept.fill_(own * share)
        self._env.reward_manager.set_weight("push/left_foot", self._left_foot / share)
        for reward in self._led:
            self._env.reward_manager.set_weight(reward.name, reward.weight_at(level.strength))
        self._algorithm.entropy_coef = level.entropy(*self._entropy)
        if self._worlds.strength != level.strength:
            self._worlds.set_strength(level.strength)

    def follow(self, ends: float) -> None:
        """Go on to the level after an iteration with so many early ends a minute of riding."""
        self.set(self.level.after(ends, self.own))

    def numbers(self) -> dict[str, float]:
        """Return its numbers for the learning curves."""
        return {
            "patience": self.level.patience,
            "strength": self.level.strength,
            "entropy_weight": self._algorithm.entropy_coef,
        }
