"""The residual of a linear decay beyond the sensor noise, as an uncertainty of stiffness and damping.

Noise differs from sample to sample, and many samples average it. What is left beyond it follows the
motion: a lens, a lag, a law that is not quite linear. Such a course has few independent values, however
many samples draw it, and the fit takes part of it up itself: what is seen is only the rest.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.decay.linear_fit import TraceFit, decay_basis
from sysid.noise.floor import NoiseFloor, noise_floor
from sysid.quantity import Z95
from sysid.roll import Release

PER_PERIOD = 4.0
"""Independent values in a period: what follows a motion holds its frequency and twice that."""
FADED_DECAY_TIMES = 3.0
"""Decay times after which hardly anything of the motion is left to follow."""
LEAST_INDEPENDENT = 1.5
"""Independent values that the fit leaves at least; it takes five up in a release alone."""


def inflate_covariance(trace: TraceFit, floor: NoiseFloor) -> tuple[TraceFit, float]:
    """Widen the covariance where the residual is surely more than noise.

    Args:
        floor: Noise of the sensor, with its own uncertainty. A film states its own, which lasts and which the fit
            knows of.

    Returns:
        The fit, and by which factor its standard deviations have grown; 1 where what is left while the deck
        moves may be noise.
    """
    decay = trace.omega_n * trace.damping_ratio
    power, noise, count, values = 0.0, 0.0, 0, 0.0
    for fitted in trace.releases:
        since = fitted.trace.time - fitted.trace.time[0]
        moving = fitted.residual[since <= FADED_DECAY_TIMES / decay]
        power, count = power + float(moving @ moving), count + len(moving)
        noise += len(moving) * max(floor.highest, fitted.trace.known_std) ** 2
        values += 1.0 + PER_PERIOD * min(float(since[-1]), FADED_DECAY_TIMES / decay) * trace.omega_n / (
            2 * math.pi
        )
    # Noise alone has no more than this: its square scatters by √(2/n) about a floor that is uncertain itself.
    noise *= 1.0 + Z95 * math.sqrt(2.0 / max(count, 1))
    if power <= noise:
        return trace, 1.0
    if all(fitted.trace.known_std for fitted in trace.releases):
        # How long a film's errors last is in the covariance already: they are only larger than stated.
        larger = math.sqrt(power / noise)
        return replace(trace, covariance=trace.covariance * larger**2), larger
    size = max(trace.noise**2, *(fitted.trace.known_std**2 for fitted in trace.releases))
    left = max(values - 2 - 3 * len(trace.releases), LEAST_INDEPENDENT)
    covariance = trace.white_covariance * (1.0 + (power - noise) / (left * size))
    growth = math.sqrt(float(np.mean(np.diag(covariance) / np.diag(trace.covariance))))
    return (replace(trace, covariance=covariance), growth) if growth > 1.0 else (trace, 1.0)


def stated_noise(trace: TraceFit, floor: NoiseFloor) -> float:
    """Return the noise of what was fitted, in its unit: the scatter, or what a film states of its own errors, which last and scatter little."""
    return max(floor.std, *(fitted.trace.known_std for fitted in trace.releases))


def over_noise(releases: Sequence[Release], trace: TraceFit, floor: NoiseFloor) -> float:
    """Return the residual of a linear decay over the noise of its sensor [1].

    A roll that was made from a gyro is off as the integral of the gyro's noise: smooth from sample to sample, and another each second. Its rate
    has that noise in each sample, so there the law is asked.

    Args:
        releases: That were fitted.
        trace: Their fit.
        floor: Noise of what was fitted.
    """
    if trace.signal == "rate" or any(r.rate is None or r.zero != "drifting" for r in releases):
        return trace.noise / noise if (noise := stated_noise(trace, floor)) > 0 else math.inf
    decay, left, free = trace.omega_n * trace.damping_ratio, 0.0, -2
    square = trace.omega_n**2 - decay**2
    for release, fitted in zip(releases, trace.releases, strict=True):
        assert release.rate is not None
        rate = release.rate[np.searchsorted(release.time, fitted.trace.time[0]) :]
        u, v = decay_basis(fitted.trace.time - fitted.trace.time[0], decay, square)
        slopes = np.column_stack([-decay * u - square * v, u - decay * v, np.ones_like(u)])
        residual = rate - slopes @ np.linalg.lstsq(slopes, rate, rcond=None)[0]
        left, free = left + float(residual @ residual), free + len(rate) - 3
    return math.sqrt(left / max(free, 1)) / max(noise_floor(releases, rate=True).std, 1e-300)
