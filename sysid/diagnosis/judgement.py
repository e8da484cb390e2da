"""One judgement: the simplest model that predicts held-out motion as well as the best does, if what it adds matters.

Every candidate is scored by how likely its errors on held-out motion are, under an error model that knows noise, jitter
and that no model is exact. Nothing else is asked: whiteness is no criterion, because no model of a real joint is exact.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.diagnosis.error_model import Blocks, Fitted, Rounding, blocks_of, fit_errors
from sysid.diagnosis.pendulum import zero
from sysid.diagnosis.search import INEXACT, Candidate
from sysid.diagnosis.surrogates import CHANGED, LAWS
from sysid.effects import effect
from sysid.fitting.records import measured_rest
from sysid.noise.floor import pooled_step
from sysid.roll import Array

EXPLAINED = 0.8
"""Share of the squared held-out error beyond the noise that must be taken away for an effect to be named."""
CLOSE = 0.05
"""Error beyond the noise over the motion, both RMS, up to which a model is a description of the motion, whatever share it explains."""
MATERIAL = 0.02
"""Error beyond the noise over the motion, both RMS, below which what is left does not matter."""
TIE = 6.0
"""Fall of the log-likelihood of held-out motion below which two models are not told apart. An effect that is not there
gains 1 to 3 by chance as the best of some fifteen."""
UNMET = 3.0
"""Of a law that nobody has met, in the log of the prior odds [nats]: one in twenty is such a law."""
LAWFUL = 12
"""Independent values in what a model that is not exact leaves of a log."""
NEGLIGIBLE = 0.01
"""Error over the motion that does not matter where no model is exact: what the best leaves, up to this; nor what the joint as it is leaves of few periods."""
GAIN = 1.0
"""Of a parameter that may move towards what it predicts, as of one that is fitted to it (Akaike 1974) [nats]; from eight
periods on it pays half the log of their number (Schwarz 1978)."""
STRAY = 5.0
"""Deviations of the noise up to which a reading is that of a joint at rest: one in a million strays farther by chance."""
TEMPERATURE = 2.0
"""By which differences of the log-likelihood are divided for a confidence: what the reliability diagram asks for."""
FEWEST_BLOCKS = 8
"""Periods from which a standard error can be taken."""
PRICE = 1.5
"""Of one effect more, and of each parameter of its law, in the log of the prior odds: of a law with one, one in twenty is
there."""
MOVED = 2
"""Choices that a number of the record which a model contradicts counts as: an effect and its parameter."""
RULED_OUT = 19.0
"""Odds against a candidate from which it is none any more: 95 %."""
CALIBRATION = {"none-missing": (0.85, 2.40), "missing": (0.64, 2.44), "unexplained": (1.21, -1.85)}
"""By which the log odds of each kind of verdict are multiplied, and what is added [nats]: fitted by `benchmarks/reliability.py` on one
half of the random suite, and shown on the other."""
CLIPPED = 0.02
"""Confidence [1] this near to 0 or 1 is not believed: what nobody thought of is more likely."""
DRAWS = 400
"""Bootstrap draws of the share that is explained."""


@dataclass(frozen=True, slots=True)
class Scored:
    """A candidate and how likely its errors are."""

    model: Candidate
    errors: Fitted
    """On held-out motion."""
    extra: int
    """Effects beyond the board's record, laws outside the catalogue included."""
    choices: int
    """Those, and the parameters of their laws: a bumper with three is no simpler than drag and a stiffening spring. Of a law
    that changed between the releases, what each of them has of its own, too."""
    score: float
    """Log-likelihood of held-out motion, less the price of the parameters and of internal states that were fitted [nats]."""


class Field:
    """Candidates of one log, scored on the same motion."""

    def __init__(
        self, models: Sequence[Candidate], base: tuple[str, ...], period: float, floor: float, known: "Field | None" = None,
    ) -> None:  # fmt: skip
        """Score all of them.

        Args:
            models: Predicted.
            base: Effects that every one of them has.
            period: Of the joint [s].
            floor: Noise of the sensor [rad or rad/s].
            known: Of some of the models: where the best is the same, their scores are.
        """
        self.base_effects = base
        self.floor = floor
        self.period = period
        linear = next(m for m in models if m.effects == base and not m.shape)
        self.base_parameters = len(linear.problem.names)
        self._nearest = min(models, key=lambda m: m.cost)
        self.blocks = held_blocks(self._nearest, period)
        self.gain = max(GAIN, 0.5 * float(np.log(len(self.blocks.cuts))))
        same = known.scored if known is not None and known._nearest is self._nearest else ()
        scores = {id(scored.model): scored for scored in same}
        self.scored = [scores.get(id(model)) or self.score(model) for model in models]
        self.base = next(s for s in self.scored if s.model.effects == base and not s.model.shape)
        self.best = max(self.scored, key=lambda s: s.score)
        self.noise = self._noise()
        # What is at an edge by the sensor's noise is not excused by a noise that it found itself.
        self.exact = INEXACT * (floor if self.best.model.at_edge else max(floor, self.noise))
        self.inexact = self.best.model.rmse > self.exact
        self.surely_missing = self.left(self.base) > MATERIAL and self._follows_motion()
        self.possible = self._possible()

    def score(self, model: Candidate) -> Scored:
        """Score one candidate."""
        assert model.heldout is not None
        extra = len(model.effects) - len(self.base_effects) + bool(model.shape)
        changed = model.shape and LAWS[model.shape].own in CHANGED
        own = model.size if changed else len(model.problem.names)
        choices = extra + own - self.base_parameters
        if np.isfinite(model.heldout_rmse):
            errors = fit_errors(self.blocks, model.heldout)
        else:
            errors = Fitted(-np.inf, 0.0, 0.0, 0.0, 0.0, np.full(len(self.blocks.frequency), -1e9))
        return Scored(model, errors, extra, choices, errors.log_likelihood - self.gain * model.size)

    def spread(self, scored: Scored) -> float:
        """Return the standard deviation of twice the log-likelihood that the best has more, from period to period."""
        difference = self.by_block(self.best.errors.each - scored.errors.each)
        return 2 * float(np.std(difference)) * float(np.sqrt(len(difference)))

    def by_block(self, each: Array) -> Array:
        """Return sums over the blocks in the same unit, shape (blocks,)."""
        starts = np.cumsum([0, *(b - a for _, a, b in self.blocks.cuts[:-1])])
        return np.add.reduceat(each, starts)

    def gap(self, one: Scored, other: Scored) -> float:
        """Return how much worse a candidate is than one, in nats; up to `TIE` they are not told apart.

        A difference that comes from few of the periods is no surer than they agree: one paired standard error counts `TIE`
        at most. Where neither is exact, what is left is a law of tilt and rate that comes back in each swing: however long
        the log, it counts as a dozen independent values, and two a period at most; and what even the best leaves does not
        matter, up to a hundredth of the motion.
        """
        gap = self._raw_gap(one, other)
        if not (self.inexact and np.isfinite(gap)):
            return gap
        small = min((NEGLIGIBLE * self.motion) ** 2, max(self.excess(self.best), 0.0))
        lawful = self._lawful(max(self.excess(one), 0.0), max(self.excess(other), 0.0), small)
        return min(gap, lawful + self.gain * (other.model.size - one.model.size))

    def _lawful(self, one: float, other: float, small: float) -> float:
        """Return how much likelier what no model has makes the smaller of two mean square errors [nats], where as much as `small` does not matter."""
        count = min(LAWFUL, 2 * len(self.blocks.cuts))
        return 0.5 * count * float(np.log(max((other + small + 1e-30) / (one + small + 1e-30), 1.0)))

    def _raw_gap(self, one: Scored, other: Scored) -> float:
        """Return how much worse a candidate is than one if each of them could be exact, in nats."""
        if not np.isfinite(other.score):
            return float("inf")
        by_block = self.by_block(other.errors.each - one.errors.each)
        count = len(by_block)
        error = float(np.std(by_block) * np.sqrt(count)) if count >= FEWEST_BLOCKS else 0.0
        return (one.score - other.score) * TIE / max(TIE, error)

    @property
    def is_stood_in_for(self) -> bool:
        """Return whether what predicts best reaches the noise as nothing of its own: it stands in for a law that nobody has."""
        return self.best.model.edged(self.exact) and self.best.model.rmse < self.exact

    def near(self, one: Scored) -> list[Scored]:
        """Return the candidates that may be true and are not told from one."""
        return [s for s in self.possible if self.gap(one, s) <= TIE]

    @property
    def slight(self) -> bool:
        """Return whether the joint as it is misses next to nothing of few periods, and no model all of that: it may be anybody's."""
        exact = self.best.model.rmse < INEXACT * self.floor
        return self.left(self.base) < NEGLIGIBLE and len(self.blocks.cuts) < FEWEST_BLOCKS and not exact

    def _follows_motion(self) -> bool:
        """Return whether the joint as it is errs as no sensor does: in proportion to the motion, or another model is likelier for sure."""
        return self._follows(self.base) or max(map(odds, self.scored)) - odds(self.base) > UNMET

    def _follows(self, scored: Scored) -> bool:
        """Return whether errors are in proportion to the motion, as no sensor's are."""
        assert scored.model.heldout is not None
        steady = replace(self.blocks, amplitude=np.ones_like(self.blocks.amplitude))
        return scored.errors.log_likelihood - fit_errors(steady, scored.model.heldout).log_likelihood > TIE

    def _noise(self) -> float:
        """Return what the best candidate's errors hold of the sensor's own, jitter included [rad]: all, where they are no larger in wide swings."""
        e = self.best.errors
        if len(self.blocks.cuts) >= FEWEST_BLOCKS and not self._follows(self.best):
            return self.best.model.heldout_rmse
        lasting = min(e.coloured, still_noise(self.best.model, self.period))
        return float(np.sqrt(e.white**2 + lasting**2 + np.mean((e.jitter * self.blocks.rate) ** 2)))

    def _possible(self) -> list[Scored]:
        """Return the candidates that may be true.

        Where something is missing for sure, what does not explain it is out, if anything does. What nobody has met, a law
        outside the catalogue, counts only where it leaves nothing; an effect at the edge of what it is, never. Nor does it where
        something beside it, which makes it no likelier, takes it off its edge.
        """
        edged = [s for s in self.scored if s.model.edged(self.exact)]

        def stands_in(scored: Scored) -> bool:
            return any(
                set(one.model.effects) <= set(scored.model.effects) and odds(scored) <= odds(one)
                for one in edged
                if one.model.shape == scored.model.shape
            )

        known = [
            s for s in self.scored
            if np.isfinite(s.score) and not (s.model.shape and self.inexact) and s not in edged and not stands_in(s)
        ] or self.scored  # fmt: skip
        if not self.surely_missing:
            return known
        return self._explaining(known)

    def _explaining(self, models: list[Scored]) -> list[Scored]:
        """Return those that explain what is missing; all, if none does."""
        return [s for s in models if self.explained(s) >= EXPLAINED] or models

    def behind(self, scored: Scored) -> float:
        """Return by how much the candidate that beats one most does so, in nats."""
        return max(self.gap(other, scored) for other in self.possible)

    def weight(self, scored: Scored) -> float:
        """Return the probability of a candidate, up to a constant of the log."""
        return float(np.exp(-self.behind(scored) / TEMPERATURE - PRICE * scored.choices))

    def adds_to(self, one: Scored, other: Scored) -> bool:
        """Return whether a candidate is another with something beside it: the same effects, or of the same families, and more."""
        more, less = (families_of(s.model, self.base_effects) for s in (one, other))
        return more > less or set(one.model.effects) > set(other.model.effects)

    def rivals(self, chosen: Scored) -> list[Scored]:
        """Return the effects of other families that are not ruled out at 95 % against what was chosen, the likeliest first."""
        own = families_of(chosen.model, self.base_effects)
        others = [
            s for s in self.possible
            if families_of(s.model, self.base_effects) != own and not s.model.shape and not self.adds_to(s, chosen)
            and self.weight(s) * RULED_OUT >= self.weight(chosen)
        ]  # fmt: skip
        return sorted(others, key=lambda s: -self.weight(s))

    def likely(self) -> dict[frozenset[str], float]:
        """Return the probability of each set of families that was tried, by its likeliest candidate."""
        weights: dict[frozenset[str], float] = {}
        for s in self.possible:
            key = families_of(s.model, self.base_effects)
            weights[key] = max(weights.get(key, 0.0), self.weight(s))
        whole = max(sum(weights.values()), 1e-300)
        return {key: weight / whole for key, weight in weights.items()}

    def confidence(self, families: frozenset[str], idle: frozenset[str] = frozenset()) -> float:
        """Return the probability of a set of families against all others that were tried.

        Args:
            families: What is named.
            idle: What is there or not, but does not matter.
        """
        return sum(p for key, p in self.likely().items() if families <= key <= families | idle)

    def unmet(self, scored: Scored) -> float:
        """Return the odds against a candidate of a law that nobody has met, of one parameter, that leaves nothing but noise [1].

        It takes away all that the candidate leaves of the motion, which counts as it does between two candidates; nothing where the
        best one is exact: then no more can be taken away.
        """
        if not self.inexact:
            return 0.0
        left = self._lawful(0.0, max(self.excess(scored), 0.0), (NEGLIGIBLE * self.motion) ** 2)
        return float(np.exp(left / TEMPERATURE - UNMET - PRICE * (2 - scored.choices)))

    def winner(self, moved: Callable[[Candidate], int] = lambda _: 0) -> Scored:
        """Return the simplest of the candidates that may be true and that none beats: by effects and parameters, then by score.

        What is less likely than the joint as it is cannot win against it. Where that one is beaten, something is missing, and what
        does not explain it is no answer, if anything does.

        Args:
            moved: How many effects more a model asks for because the board's record is another: they count with its own.
        """
        likely = [s for s in self.possible if odds(s) >= odds(self.base)] or self.possible
        near = [s for s in likely if self.behind(s) <= TIE] or likely
        if self.base not in near:
            near = self._explaining(near)
        found: list[tuple[tuple[float, ...], Scored]] = []
        for s in sorted(near, key=lambda s: s.choices):
            if not found or s.choices <= min(rank for rank, _ in found)[0]:
                found.append(((s.choices + MOVED * moved(s.model), s.choices, -s.score), s))
        return min(found, key=lambda one: one[0])[1]

    def left(self, scored: Scored) -> float:
        """Return the held-out error beyond the noise over the motion, both RMS."""
        return float(np.sqrt(max(self.excess(scored), 0.0))) / max(self.motion, 1e-300)

    def excess(self, scored: Scored) -> float:
        """Return the held-out mean square error beyond the sensor's noise [rad²]; inf where a prediction ran away."""
        return float(np.mean(self._excess_by_block(scored))) if np.isfinite(scored.score) else float("inf")

    def explained(self, scored: Scored) -> float:
        """Return the share of the base's excess that a candidate takes away."""
        before = self.excess(self.base)
        return float(np.clip(1 - max(self.excess(scored), 0.0) / before, 0.0, 1.0)) if before > 0 else 0.0

    def explains(self, scored: Scored) -> bool:
        """Return whether a candidate has something more than the joint as it is, which explains the log."""
        told_apart = self.gap(self.best, scored) > TIE
        stands_in = self.is_stood_in_for and scored.model.rmse > self.exact and told_apart
        enough = self.explained(scored) >= EXPLAINED and self.left(scored) <= CLOSE
        return scored.extra > 0 and enough and not stands_in

    def chance_explained(self, scored: Scored, share: float, close: float) -> float:
        """Return the probability that a candidate explains a log: bootstrap over its periods.

        Args:
            scored: The candidate.
            share: That it must take away, at least, of the base's excess.
            close: Error beyond the noise over the motion that it may leave at most.
        """
        rng = np.random.default_rng(0)
        before, after = self._excess_by_block(self.base), self._excess_by_block(scored)
        draws = rng.integers(0, len(before), (DRAWS, len(before)))
        left = after[draws].mean(1)
        enough = left <= (1 - share) * before[draws].mean(1)
        return float(np.mean(enough & (left <= (close * self.motion) ** 2)))

    def _excess_by_block(self, scored: Scored) -> Array:
        """Return mean squares less the sensor's noise, of blocks weighted by their lengths."""
        assert scored.model.heldout is not None
        squares = np.array([float(np.sum(scored.model.heldout[i][a:b] ** 2)) for i, a, b in self.blocks.cuts])
        lengths = np.array([b - a for _, a, b in self.blocks.cuts])
        return (squares - self.noise**2 * lengths) / lengths.mean()

    @property
    def motion(self) -> float:
        """RMS of the held-out motion about rest [rad]."""
        return float(np.sqrt(np.mean(self.blocks.signal_square)))


def odds(scored: Scored) -> float:
    """Return the log of the odds of a candidate, up to a constant of the log [nats]: its likelihood, and what is known before."""
    return scored.score / TEMPERATURE - PRICE * scored.choices - (UNMET if scored.model.shape else 0.0)


def log_odds(share: Array) -> Array:
    """Return the log odds of shares that are not believed to be nearer to 0 or 1 than `CLIPPED` [nats], shape (n,)."""
    clipped = np.clip(share, CLIPPED, 1 - CLIPPED)
    return np.log(clipped / (1 - clipped))


def calibrated(confidence: Array, slope: Array | float, offset: Array | float) -> Array:
    """Return the confidence that is deserved (Platt 1999), from what the likelihoods say and `CALIBRATION` knows: [1], shape (n,)."""
    return 1 / (1 + np.exp(-(slope * log_odds(confidence) + offset)))


def families_of(model: Candidate, base: Sequence[str]) -> frozenset[str]:
    """Return the families of what a model has beyond the record; a law outside the catalogue is its own."""
    names = {effect(n).family for n in model.effects if n not in base}
    return frozenset(names | ({model.shape} if model.shape else set()))


def rest_of(model: Candidate) -> float:
    """Return what the sensor reads at rest, as a model has it [rad]; 0 for a rate."""
    if model.problem.records[0].is_rate or model.problem.bias == "per-release":
        return measured_rest(model.problem.records)
    return model.parameters.get("rest_angle", 0.0) + model.parameters.get(zero(), 0.0)


def still_noise(model: Candidate, period: float) -> float:
    """Return how far readings stray while the joint rests at the ends of its releases [rad or rad/s]; inf where none does so for half a period, in which a swing would show.

    Noise of the sensor that lasts goes on there. What only a model misses does not: a friction's deck that sticks aside of where the model has it.
    """
    strays: list[Array] = []
    for record in model.problem.records:
        away = np.abs(record.signal - np.median(record.signal[-max(8, len(record.signal) // 10) :]))
        begin = int(np.flatnonzero(np.r_[True, away > STRAY * record.std])[-1])
        if begin < len(away) and record.time[-1] - record.time[begin] >= period / 2:
            strays.append(away[begin:])
    return float(np.sqrt(np.mean(np.concatenate(strays) ** 2))) if strays else float("inf")


def held_blocks(model: Candidate, period: float) -> Blocks:
    """Cut the motion that was held out into blocks of a period, as a fitted model knows it."""
    assert model.heldout is not None
    problem = model.problem
    rest = rest_of(model)
    signals: list[Array] = []
    rates: list[Array] = []
    steps: list[float] = []
    rounding: list[Rounding] = []
    quantum = pooled_step([record.release for record in problem.records], rate=problem.records[0].is_rate)
    for record, residual, held, measured in zip(
        problem.records, model.residuals, model.heldout, problem.observed, strict=True
    ):
        step = problem.average * float(np.median(np.diff(record.time)))
        signal = residual + measured - rest
        rate = np.gradient(signal, step)
        signals.append(signal[-len(held) :])
        rates.append(rate[-len(held) :])
        steps.append(step)
        readings = record.signal[: len(measured) * problem.average][-len(held) * problem.average :]
        rounding.append(Rounding(quantum, readings, problem.average))
    return blocks_of(signals, rates, steps, period, rounding)
