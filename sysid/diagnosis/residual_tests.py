"""What a model leaves of the measurement: the sensor's noise, or a motion that it does not know.

Sensor noise knows nothing of the motion. It is as large when the deck hardly swings any more as it was at the
release, it has no line in its spectrum, and no torque of tilt and rate makes it smaller.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from sysid.diagnosis.score_statistic import score_test
from sysid.diagnosis.search import Model
from sysid.noise.autoregression import ResidualNoise, residual_noise
from sysid.noise.floor import FROM_SCATTER, NoiseFloor
from sysid.noise.whiteness import autocorrelation, band_excess, correlation_length
from sysid.roll import Array

WHITE = 1e-3
"""Probability below which a residual is not white."""
LEFT = 1e-5
"""Probability below which the residual holds a torque of tilt and rate."""
BAND = 4.0
"""Upper end of the band in which the joint moves, in natural frequencies."""
LINE = 0.3
"""Share of a residual's power in one line of its spectrum from which it is no noise, if that is no chance."""
CHANCES = 200
"""Draws of noise with one memory, none of which may have such a line."""
FADES = 0.5
"""Ratio of power, late over early in the releases, from which a residual fades as the motion does."""

Kind = Literal["white", "coloured", "motion"]


def kind_of(model: Model, period: float) -> Kind:
    """Return what a model leaves: white noise, coloured noise, or a motion that it does not know.

    Args:
        model: Fitted to single samples, not to averages.
        period: Of the joint [s].
    """
    problem, point = model.problem, model.minimum.point
    if whiteness(model, period) > WHITE:
        return "white" if score_test(problem, point).probability > LEFT else "motion"
    if not _is_steady(model):
        return "motion"
    noise = residual_noise(model.residuals)
    if has_line(model.residuals, noise):
        return "motion"
    return "coloured" if score_test(problem, point, noise).probability > LEFT else "motion"


def whiteness(model: Model, period: float) -> float:
    """Return the probability that the residual of a model is white, by its power in the joint's band."""
    average = model.problem.average
    steps = [average * float(np.median(np.diff(r.time))) for r in model.problem.records]
    return band_excess(model.residuals, steps, BAND / period)[1]


def _is_steady(model: Model) -> bool:
    """Whether a residual is as large late in the releases as early, though the motion has faded."""
    from scipy.special import fdtr, fdtrc

    residuals = model.residuals
    thirds = [np.array_split(r, 3) for r in residuals]
    early, late = (float(np.mean(np.concatenate([t[i] for t in thirds]) ** 2)) for i in (0, 2))
    rest = model.parameters.get("rest_angle", 0.0)
    swings = [np.array_split(r.signal - (0.0 if r.is_rate else rest), 3) for r in model.problem.records]
    before, after = (float(np.mean(np.concatenate([s[i] for s in swings]) ** 2)) for i in (0, 2))
    if after > 0.25 * before or early == 0:
        return False  # the motion has not faded: it and the noise cannot be told apart
    rho = autocorrelation(residuals, min(2000, min(len(r) for r in residuals) // 4))[1:]
    freedom = sum(len(t[0]) for t in thirds) / float(1 + 2 * np.sum(rho**2))
    ratio = late / early
    outer = min(float(fdtrc(freedom, freedom, ratio)), float(fdtr(freedom, freedom, ratio)))
    return ratio > FADES and freedom >= 8 and outer >= 1e-3


def has_line(residuals: Sequence[Array], noise: ResidualNoise) -> bool:
    """Whether one frequency has more of the power than noise has by chance.

    Noise that is correlated over a tenth of the record has so few frequencies that one of them often stands
    out. Where its memory is a single exponential, how often is drawn; any other may have a line of its own.

    Args:
        residuals: Of each release, evenly sampled.
        noise: The autoregression that was fitted to them.
    """
    share = _largest_line(residuals)
    if share < LINE or len(noise.coefficients) > 1:
        return share >= LINE
    rng = np.random.default_rng(0)
    return all(_largest_line([noise.drawn(len(r), rng) for r in residuals]) < share for _ in range(CHANCES))


def _largest_line(residuals: Sequence[Array]) -> float:
    """Return the share of power in one line of the spectrum of all releases: noise peaks elsewhere in each."""
    size = max(len(r) for r in residuals)
    power = np.sum([np.abs(np.fft.rfft(r * np.hanning(len(r)), size)) ** 2 for r in residuals], axis=0)
    near = np.convolve(power, np.ones(3), mode="same")
    return float(near.max() / max(np.sum(power), 1e-300))


def noise_left(model: Model, floor: NoiseFloor, period: float) -> NoiseFloor:
    """Take the noise from a white residual, above the band of the joint: more of the samples count there.

    Only where differences agree; a sensor that smooths or has steps keeps its own estimate.
    """
    if not floor.how.startswith(FROM_SCATTER):
        return floor
    if kind_of(model, period) == "coloured":
        length = (
            1e3
            * correlation_length(model.residuals)
            * float(np.median(np.diff(model.problem.records[0].time)))
        )
        how = (
            f"from what the best model leaves: coloured noise, correlated over {length:.2g} ms, as large when the "
            "motion has faded as before"
        )
        return NoiseFloor(model.rmse, how)
    if whiteness(model, period) <= WHITE:
        return floor
    power, bins = 0.0, 0
    for residual, record in zip(model.residuals, model.problem.records, strict=True):
        step = float(np.median(np.diff(record.time)))
        above = np.fft.rfftfreq(len(residual), step) > BAND / period
        power += float(np.sum((np.abs(np.fft.rfft(residual)) ** 2 / len(residual))[above]))
        bins += int(above.sum())
    std = float(np.sqrt(power / max(bins, 1)))
    if bins < 20 or abs(std / floor.std - 1) > 4.0 / np.sqrt(model.samples):
        return floor
    return NoiseFloor(std, "from what the best model leaves above the band of the joint; differences agree")
