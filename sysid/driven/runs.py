"""Several logs of one joint: agreement, differences, and the log that helps most."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.driven.fit import DrivenFit
from sysid.quantity import Z95, Quantity

CERTAIN = 0.01
"""Probability of chance below which logs disagree."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Agreement:
    """One parameter set from several logs."""

    fits: Sequence[DrivenFit]
    combined: DrivenFit
    """The first fit with the weighted means."""
    differs: Mapping[str, float]
    """Probability that a parameter differs as much by chance, for those that disagree."""
    causes: Mapping[str, str]
    """Cause of a disagreement: speed, load, direction or order."""
    loose: tuple[str, ...]
    """Parameters whose 95 % interval holds zero in every log."""
    helps: int
    """The log with the most information, counted from 0."""

    def to_json(self) -> dict[str, object]:
        """Return the combined fit, and how the logs agree."""
        return {
            **self.combined.to_json(), "logs": [one.to_json() for one in self.fits], "differs": dict(self.differs),
            "goes_with": dict(self.causes), "not_fixed": list(self.loose),
        }  # fmt: skip


def agreement(fits: Sequence[DrivenFit]) -> Agreement:
    """Return what fits of one structure to several logs agree on."""
    from scipy.stats import chi2

    first = fits[0]
    merged, differs, causes = dict(first.quantities), dict[str, float](), dict[str, str]()
    loose: list[str] = []
    for name in first.quantities:
        values = np.array([one.quantities[name].value for one in fits])
        stds = np.array([one.quantities[name].std for one in fits])
        sure = np.isfinite(stds) & (stds > 0)
        if not sure.any() or Z95 * stds[sure].min() > np.abs(values[sure]).max():
            loose.append(name)
        if sure.sum() < 2:
            continue
        weights = 1 / stds[sure] ** 2
        mean = float(np.sum(weights * values[sure]) / weights.sum())
        square = float(np.sum(weights * (values[sure] - mean) ** 2))
        chance, count = float(chi2.sf(square, sure.sum() - 1)), int(sure.sum())
        factor = max(1.0, math.sqrt(square / (count - 1)))
        merged[name] = Quantity(
            mean, factor / math.sqrt(weights.sum()), merged[name].unit, f"weighted mean of {count} logs"
        )
        if chance < CERTAIN:
            differs[name] = chance
            causes[name] = _goes_with(fits, values)
    sharp = [
        sum(
            math.log(max(one.quantities[n].std, 1e-300))
            for n in one.quantities
            if math.isfinite(one.quantities[n].std)
        )
        for one in fits
    ]
    combined = replace(
        first, quantities=merged, values={**first.values, **{n: q.value for n, q in merged.items()}}
    )
    return Agreement(
        fits=fits,
        combined=combined,
        differs=differs,
        causes=causes,
        loose=tuple(loose),
        helps=int(np.argmin(sharp)),
    )


def _goes_with(fits: Sequence[DrivenFit], values: np.ndarray) -> str:
    """Return what of the logs a parameter goes with: speed, load, direction, or their order (warming up)."""
    if len(fits) < 3:
        return ""
    of = {
        "speed": [float(np.std(np.gradient(one.log.angle, one.log.time))) for one in fits],
        "load": [float(np.abs(one.log.load.torque).mean()) for one in fits],
        "direction": [float(np.mean(np.sign(np.gradient(one.log.angle, one.log.time)))) for one in fits],
        "the order of the logs, as when it warms up": list(range(len(fits))),
    }
    scores = {name: abs(float(np.corrcoef(x, values)[0, 1])) for name, x in of.items() if np.ptp(x) > 1e-9}
    best = max(scores, key=lambda name: scores[name], default="")
    return best if scores.get(best, 0.0) > 0.9 else ""
