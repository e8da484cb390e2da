"""What a diagnosis says, and everything that the judgement needs: the models that were tried, scored and noisy."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from sysid.board import Board
from sysid.diagnosis.residual_tests import Kind, kind_of
from sysid.diagnosis.scores import Yardstick
from sysid.diagnosis.search import Model, Searcher
from sysid.noise.floor import NoiseFloor

TIE = 8.0
"""Difference of score below which two models are not told apart (odds of e⁴ at most)."""
Status = Literal["none-missing", "missing", "unexplained"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What is missing, and how sure that is."""

    status: Status
    effects: tuple[str, ...]
    confidence: float
    indistinguishable_from: tuple[tuple[str, ...], ...]
    error_before: float
    error_after: float
    next_experiment: str
    explanation: str


@dataclass(frozen=True, slots=True)
class Case:
    """Everything that the judgement needs."""

    board: Board
    searcher: Searcher
    """That found the models; alone by now."""
    base: Model
    models: Sequence[Model]
    """Polished and predicted, best score first, base included."""
    scores: Mapping[tuple[str, ...], float]
    rule: Yardstick
    """That the scores were made with."""
    noise: NoiseFloor
    period: float
    kinds: dict[tuple[str, ...], Kind] = field(default_factory=dict[tuple[str, ...], Kind])
    """What each model leaves, as far as it was asked."""

    def missing(self, model: Model) -> tuple[str, ...]:
        """Return the effects of a model that the record does not have."""
        return self.missing_of(model.effects)

    def missing_of(self, effects: Sequence[str]) -> tuple[str, ...]:
        """Return those of some effects that the record does not have."""
        return tuple(name for name in effects if name not in self.base.effects)

    def is_noise(self, model: Model) -> bool:
        """Whether a model leaves nothing but noise: white, or coloured and no other model explains its colour."""
        if model.effects not in self.kinds:
            self.kinds[model.effects] = kind_of(model, self.period)
        kind = self.kinds[model.effects]
        return kind == "white" or (kind == "coloured" and self.scores[model.effects] < TIE)

    def excess(self, model: Model) -> float:
        """Held-out mean square error beyond the noise."""
        return max(model.heldout_rmse**2 - self.noise.std**2, 0.0)


Judgement = tuple[Verdict, Model, Mapping[str, float]]
"""The verdict, the model that it rests on, and the share of peak torque of each effect that it names."""


def verdict_on(
    case: Case,
    model: Model,
    status: Status,
    effects: tuple[str, ...],
    confidence: float,
    alike: Sequence[tuple[str, ...]],
    experiment: str,
    text: str,
) -> Verdict:
    """Return a verdict that rests on a model, with the errors before and after it."""
    unique = dict.fromkeys(tuple(s) for s in alike if set(s) != set(effects))
    return Verdict(
        status=status, effects=effects, confidence=min(max(confidence, 0.0), 0.999),
        indistinguishable_from=tuple(unique), error_before=case.base.rmse, error_after=model.rmse,
        next_experiment=experiment, explanation=text,
    )  # fmt: skip


def heldout_nrmse(model: Model) -> tuple[float, ...]:
    """Return the error of prediction over the RMS of the motion about rest, for each release that was left out.

    Of one release alone it is that of its second half, predicted from the first.
    """
    rest = model.parameters.get("rest_angle", 0.0)
    errors: list[float] = []
    for missed, record in zip(model.heldout or (), model.problem.records, strict=False):
        motion = record.signal[-len(missed) :] - (0.0 if record.is_rate else rest)
        errors.append(float(np.sqrt(np.mean(missed**2) / max(float(np.mean(motion**2)), 1e-300))))
    return tuple(errors)


def motion_rms(model: Model) -> float:
    """Return the RMS of the measured motion about rest, of all releases [rad or rad/s]."""
    rest = model.parameters.get("rest_angle", 0.0)
    signals = [r.signal - (0.0 if r.is_rate else rest) for r in model.problem.records]
    return float(np.sqrt(np.mean(np.concatenate(signals) ** 2)))
