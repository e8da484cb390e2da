"""Block bootstrap: intervals from the residuals themselves, without a noise model.

From ten releases on (the groups of a cross-validation), whole ones are drawn again. Differences between them, such as a bushing that
warms up, are then in the spread. The spread of fewer is too narrow by several percent. There blocks of residuals are added to the
fitted motion: they are longer than the memory of the noise.

Sources: Künsch (Annals of Statistics 1989) for moving blocks; Politis and White (Econometric Reviews 2004)
for their length; Efron and Tibshirani (1993), chapter 14, for the bias-corrected percentiles.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from sysid.board import Board
from sysid.errors import SysidError
from sysid.fitting.covariance import noise_behind, scale_shift, torque_like
from sysid.fitting.cross_validation import FOLDS
from sysid.fitting.problem import Problem
from sysid.fitting.result import JointFit
from sysid.noise.autoregression import ResidualNoise
from sysid.progress import steps
from sysid.quantity import Z95
from sysid.roll import Array

FEWEST_DRAWS = 100
"""The ends of a 95 % interval are the 2.5 % tails: two draws of a hundred."""


@dataclass(frozen=True, slots=True)
class Bootstrap:
    """Parameters fitted again and again."""

    drawn: Literal["releases", "blocks"]
    block: int
    """Length of the blocks [samples]; 0 where whole releases were drawn."""
    draws: Array
    """Fitted parameters in their units, shape (n, q)."""
    names: tuple[str, ...]
    intervals: dict[str, tuple[float, float]]
    """95 %, bias-corrected percentiles, with the uncertainty of the inertia and of the sensor's scale."""
    failed: int
    """Draws whose fit found no bounded motion; they are left out."""

    @property
    def how(self) -> str:
        """The kind of draws, in words."""
        if self.drawn == "releases":
            return f"{len(self.draws)} draws of whole releases"
        if self.block == 1:
            return f"{len(self.draws)} draws of single residuals (they are white)"
        return f"{len(self.draws)} draws of residuals in blocks of {self.block} samples"

    @property
    def roughness(self) -> float:
        """Relative standard deviation of an interval's half-width that the finite number of draws leaves."""
        return 1.36 / float(np.sqrt(len(self.draws)))

    def to_json(self) -> dict[str, object]:
        """Return the intervals for machines."""
        return {
            "how": self.how, "draws": len(self.draws), "failed": self.failed, "block_samples": self.block,
            "ci95": {name: list(ends) for name, ends in self.intervals.items()},
            "std": dict(zip(self.names, np.std(self.draws, axis=0).tolist(), strict=True)),
        }  # fmt: skip


def require_enough(draws: int) -> None:
    """Accept a number of draws that an interval can be read from.

    Raises:
        SysidError: They are too few.
    """
    if draws < FEWEST_DRAWS:
        raise SysidError(
            f"{draws} draws are too few for the ends of a 95 % interval. Expected are {FEWEST_DRAWS} or more: --bootstrap 400 is good "
            "to 7 % of the width."
        )


def bootstrap(fit: JointFit, board: Board, draws: int, *, seed: int = 0) -> Bootstrap:
    """Fit `draws` logs that could as well have been measured, each with an inertia and a scale of the sensor of its own.

    Raises:
        SysidError: Fewer draws than an interval needs, or most of them cannot be fitted.
    """
    require_enough(draws)
    rng = np.random.default_rng(seed)
    whole = len(fit.records) >= FOLDS
    noise = noise_behind(fit.problem, fit.minimum, fit.residuals)
    block = 0 if whole else block_length(noise, fit.problem.samples)
    count = len(fit.problem.names)
    found: list[Array] = []
    for _ in steps(range(draws)):
        if whole:
            drawn = rng.integers(0, len(fit.records), len(fit.records))
            again, start = fit.problem.of(drawn.tolist(), fit.minimum.point)
        else:
            again, start = _of_blocks(fit, noise, block, rng), fit.minimum.point
        minimum = again.fitted(start, 40, 1e-6)
        if np.isfinite(minimum.normal.cost):
            found.append(minimum.point[:count] * again.sizes()[:count])
    if len(found) < max(FEWEST_DRAWS, draws // 2):
        raise SysidError(
            f"only {len(found)} of {draws} drawn logs could be fitted: these logs hardly fix the model. "
            "Fit fewer effects."
        )
    names = fit.problem.names
    scale = scale_shift(fit.problem, fit.minimum)
    table = np.array(found) + (rng.standard_normal((len(found), 1)) * scale if scale.any() else 0.0)
    best = np.array([fit.quantities[name].value for name in names])
    inertia = 1 + board.inertia.std / board.inertia.value * rng.standard_normal(len(table))
    scaled = np.where([torque_like(fit.problem, name) for name in names], table * inertia[:, None], table)
    intervals = {name: corrected_percentiles(scaled[:, i], float(best[i])) for i, name in enumerate(names)}
    return Bootstrap("releases" if whole else "blocks", block, scaled, names, intervals, draws - len(found))


def block_length(noise: ResidualNoise, count: int) -> int:
    """Return the length of blocks that suits the memory of the noise [samples].

    Politis and White (2004) weigh the bias of short blocks against the scatter of few. Blocks have at least five times the memory of the
    noise: a shorter one narrows the interval by a twentieth.
    """
    covariances = noise.covariances(4096)
    lags = np.arange(len(covariances))
    total = float(covariances[0] + 2 * covariances[1:].sum())
    moment = float(2 * np.sum(lags * covariances))
    if total <= 0 or moment <= 0:
        return 1
    length = max((1.5 * (moment / total) ** 2 * count) ** (1 / 3), 5 * moment / total)
    return int(np.clip(np.ceil(length), 1, max(1, count // 4)))


def corrected_percentiles(draws: Array, best: float) -> tuple[float, float]:
    """Return the 95 % interval of draws, shape (n,), corrected where their median is not the best value, all in one unit.

    Like a profile it does not depend on how the parameter is written (k or its logarithm).
    """
    from scipy.stats import norm

    n = len(draws)
    below = (np.sum(draws < best) + 0.5 * np.sum(draws == best)) / n
    shift = float(norm.ppf(np.clip(below, 1 / n, 1 - 1 / n)))
    shares = norm.cdf([2 * shift - Z95, 2 * shift + Z95])
    low, high = np.quantile(draws, shares)
    return float(low), float(high)


def _of_blocks(fit: JointFit, noise: ResidualNoise, block: int, rng: np.random.Generator) -> Problem:
    """Return the problem on fitted motions with blocks of residuals laid over them."""
    pool = fit.residuals
    seen = float(np.sqrt(sum(float(r @ r) for r in pool) / fit.problem.samples))
    # Scale the residuals to the noise: the fit has made them smaller.
    larger = noise.std / max(seen, 1e-300)
    mean = float(np.mean(np.concatenate(pool)))
    records = [
        replace(record, signal=record.signal + own - larger * (blocks(pool, len(own), block, rng) - mean))
        for record, own in zip(fit.records, fit.residuals, strict=True)
    ]
    return fit.problem.with_(records=records)


def blocks(pool: Sequence[Array], count: int, length: int, rng: np.random.Generator) -> Array:
    """Return blocks of a pool of series one after another, shape (count,), in their unit."""
    length = min(length, *(len(series) for series in pool))
    places = np.array([len(series) - length + 1 for series in pool])
    ends = np.cumsum(places)
    picked: list[Array] = []
    for place in rng.integers(0, ends[-1], -(-count // length)):
        which = int(np.searchsorted(ends, place, side="right"))
        begin = int(place - ends[which] + places[which])
        picked.append(pool[which][begin : begin + length])
    return np.concatenate(picked)[:count]
