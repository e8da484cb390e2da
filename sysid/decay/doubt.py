"""Test of the linear law, and whether the log could have shown a deviation from it.

A second law adds a torque to the fitted one. Its response to the fitted motion is one more column of the fit. The score test (Rao, 1948)
gives the size of that torque, its significance, and its shift of frequency and damping. The shift times the torque's standard deviation
stays unknown: one swing cannot distinguish dry friction from damping.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from sysid.decay.linear_fit import (
    FittedTrace,
    TraceFit,
    columns_of,
    motion,
    project,
    response,
)
from sysid.noise.floor import NoiseFloor, local_noise
from sysid.noise.lasting import PER_PERIOD
from sysid.noise.sensor import BEST_SENSOR
from sysid.noise.whiteness import lag_one
from sysid.quantity import SURE, Z95, Quantity
from sysid.roll import Array, Release
from sysid.text import display

MATTERS = np.array([0.01, 0.05])
"""Relative shift of ω_n and of ζ from which a second law matters: a tenth of the usual randomisation of a policy."""
OPEN = np.array([0.1, 0.3])
"""Relative shift of ω_n and of ζ that a log must be able to exclude: the usual randomisation of a policy."""
USUAL = 0.1
"""Prior of a second law, over the spring's torque: joints of public logs have 3 to 30 %."""
ABOVE_NOISE = 1.15
"""Residual over noise from which the residual is more than noise; the noise itself is known to 5 %."""
LEVELS_APART = 0.01
"""Least difference of rest levels, over the first amplitude: sensors wander by less between releases."""

Status = Literal["linear", "not linear", "cannot tell"]
TORQUES: dict[str, Callable[[Array, Array], Array]] = {
    "dry friction": lambda x, v: v / np.hypot(v, 0.02),
    "drag": lambda x, v: v * np.abs(v),
    "hardening": lambda x, v: x * x * x,
    "softening": lambda x, v: -x * x * x,
    "asymmetry": lambda x, v: x * x,
}
"""Torques of angle and rate, both over their widest [1]."""
CHANGES: dict[str, Callable[[Array, Array], Array]] = {
    "a stiffness that changes": lambda x, v: x,
    "a damping that changes": lambda x, v: v,
}
"""Torques of the late half alone: without one, the early half predicts the late one."""
SIGNED = ("asymmetry", *CHANGES)
"""Torques that may have either sign."""


@dataclass(frozen=True, slots=True)
class SecondLaw:
    """A torque beside the linear one, as estimated from the decays."""

    name: str
    share: float
    """Of the spring's torque at the widest swing [1]."""
    std: float
    shift: Array
    """Shift of ln ω_n and ln ζ for a share of 1, shape (2,)."""

    def seen(self, which: slice) -> bool:
        """Whether it is significant and matters for some of the numbers."""
        matters = bool((np.abs(self.share * self.shift) > MATTERS)[which].any())
        return self.share > SURE * self.std and matters

    def hides(self, which: slice) -> bool:
        """Whether it may move some of the numbers by too much, within its 95 % interval."""
        return bool((Z95 * self.std * np.abs(self.shift) > OPEN)[which].any())

    @property
    def left_open(self) -> Array:
        """Standard deviations of ln ω_n and ln ζ (dimensionless) under the prior `USUAL` of its size, shape (2,)."""
        return np.abs(self.shift) / math.hypot(1 / max(self.std, 1e-12), 1 / USUAL)


@dataclass(frozen=True, slots=True)
class Judgement:
    """Whether a linear law holds, and the reason."""

    status: Status
    reason: str
    """One clause; '' if the law holds."""
    over_noise: float
    """Residual over the sensor's noise [1]."""
    wider: float
    """Factor on the intervals for a residual beyond the noise."""
    second_laws: tuple[SecondLaw, ...]
    """Significant ones, the most significant first."""


def sensor_noise(fit: TraceFit) -> NoiseFloor:
    """Return the noise of the fitted signal: its scatter about a law that may change from swing to swing."""
    stated = max(max(one.trace.known_std, BEST_SENSOR * np.ptp(one.trace.measured)) for one in fit.releases)
    floor = local_noise([(one.trace.time, one.residual) for one in fit.releases], fit.poles)
    timed = [0.0]
    for one in fit.releases:
        interval, step = one.trace.passages
        if interval:  # a passage is known to a sample's time, or to a step if the signal is faster
            way = interval * np.gradient(one.modelled, one.trace.time)
            timed.append(float(np.mean(np.minimum(way**2, step**2 / 2) / 12)))
    return replace(floor, std=max(stated, floor.std, math.sqrt(max(timed))))


def judged(
    fit: TraceFit, floor: NoiseFloor, releases: Sequence[Release], rests: Sequence[Quantity]
) -> tuple[TraceFit, Judgement]:
    """Judge a fit, and widen its covariance for a residual beyond the noise.

    Args:
        fit: Of the releases.
        floor: Noise of its signal.
        rests: Rest level of each release [rad]; empty for a gyro.
    """
    fit, wider = _widened(fit, floor)
    ratio = fit.noise / floor.std if floor.std > 0 else math.inf
    others = second_laws(fit)
    if fit.law == "pendulum":
        fit = _with_scale(fit, releases, next(one for one in others if one.name == "hardening"))
    which = slice(None) if fit.damping_ratio < 1 else slice(1, None)  # an overdamped return fixes d/k alone
    seen = sorted((one for one in others if one.seen(which)), key=lambda one: -one.share / one.std)
    half_width = Z95 * np.sqrt(np.diag(to_logs(fit) @ fit.covariance @ to_logs(fit).T))
    hidden = [one.name for one in others if one.name in TORQUES and one.hides(which)]
    status: Status = "not linear"
    if scattered(releases, rests, wander(fit)):
        show = display(is_rate=False, slides=releases[0].slides)
        levels = ", ".join(f"{show.scale * rest.value:+.2f}{show.unit}" for rest in rests[:6])
        reason = f"the releases come to rest at {levels}, where a spring returns to one angle"
    elif seen:
        moves = seen[0].share * seen[0].shift
        reason = (
            f"{' or '.join(one.name for one in seen)} is significant, and moves ω_n by {100 * moves[0]:+.2g} %, "
            f"ζ by {100 * moves[1]:+.2g} %"
        )
    elif ratio > ABOVE_NOISE and (hidden or bool((half_width > OPEN)[which].any())):
        reason = "the residual has a shape, see the picture"
    elif hidden:
        status = "cannot tell"
        reason = f"as much {' or '.join(hidden)} as moves k by 20 % or d by 30 % would look the same"
    elif bool((half_width > 2 * OPEN).any()) and fit.damping_ratio < 1:
        status, reason = "cannot tell", "the intervals are as wide as the numbers"
    else:
        status, reason = "linear", ""
    if fit.damping_ratio >= 1:  # without a swing, friction and a nonlinear law look like another rest angle
        open_ones = sum((one.left_open**2 for one in others if one.name in TORQUES), np.zeros(2))
        fit = replace(fit, covariance=fit.covariance + np.diag(open_ones * [4.0, float(fit.poles[1]) ** 2]))
    return fit, Judgement(status, reason, ratio, wider, tuple(seen))


def _with_scale(fit: TraceFit, releases: Sequence[Release], cubic: SecondLaw) -> TraceFit:
    """Add the scale of the angle to a pendulum's covariance: of an angle a share s too large, the sine lacks a torque s x³/3."""
    widest = max(releases, key=lambda release: release.amplitude)
    moved = np.linalg.solve(to_logs(fit), cubic.shift * (widest.scale_std * widest.amplitude**2 / 3))
    return replace(fit, covariance=fit.covariance + np.outer(moved, moved))


def to_logs(fit: TraceFit) -> Array:
    """Return the derivatives of (ln ω_n, ln ζ) by (ln m [1], τ [s]), shape (2, 2); beyond critical damping of (ln ω_n, ln d/k)."""
    tau = float(fit.poles[1]) or 1e-12
    return np.array([[-0.5, 0.0], [-0.5 if fit.damping_ratio < 1 else 0.0, 1 / tau]])


def second_laws(fit: TraceFit) -> list[SecondLaw]:
    """Return the size of each second torque, alone beside the linear law."""
    rate = fit.signal == "rate"
    moves = [motion(one, fit.poles, rate=rate) for one in fit.releases]
    widest = max(float(np.abs(x).max()) for _, x, _ in moves) or 1.0
    fastest = max(float(np.abs(v).max()) for _, _, v in moves) or 1.0
    parts = [project(one.trace, fit.poles, one.swing, fit.signal) for one in fit.releases]
    jacobian = np.concatenate([part[2] for part in parts])
    residuals = [part[1] for part in parts]
    residual = np.concatenate(residuals)
    left, values, right = np.linalg.svd(jacobian, full_matrices=False)
    inverse = (right.T / np.maximum(values, 1e-9 * values[0])) @ left.T
    cuts = np.cumsum([len(one) for one in residuals])[:-1]
    found: list[SecondLaw] = []
    lates = [t > t[0] + _half(one, fit) for one, (t, _, _) in zip(fit.releases, moves, strict=True)]
    for name, torque in (TORQUES | CHANGES).items():
        torques = [
            widest * torque(x / widest, v / fastest) * (late if name in CHANGES else 1)
            for (_, x, v), late in zip(moves, lates, strict=True)
        ]
        column = np.concatenate(
            [
                _felt(one, fit, t, pull)
                for one, (t, *_), pull in zip(fit.releases, moves, torques, strict=True)
            ]
        )
        beside = inverse @ column
        own = column - jacobian @ beside
        power = max(float(own @ own), 1e-300)
        share = float(own @ residual) / power
        # The noise is the residual of the law with this torque.
        rest = residual - share * own
        rho = lag_one(np.split(rest, cuts))
        variance = float(rest @ rest) / max(len(rest) - 3 - 3 * len(parts), 1) * (1 + rho) / (1 - rho)
        size = abs(share) if name in SIGNED else share
        found.append(SecondLaw(name, size, math.sqrt(variance / power), to_logs(fit) @ beside))
    return found


def _felt(one: FittedTrace, fit: TraceFit, grid: Array, torque: Array) -> Array:
    """Return the whitened response to a torque over k [rad] on a grid [s], orthogonal to amplitude, phase and rest angle, shape (n,)."""
    respond = one.swing.response if one.swing else partial(response, fit.poles, grid)
    basis = one.trace.whiten(columns_of(one.trace, fit.poles, one.swing, fit.signal)[1])
    orthogonal, _ = np.linalg.qr(basis / (np.linalg.norm(basis, axis=0) + 1e-300))
    answer = respond(-torque, rate=fit.signal == "rate")
    column = one.trace.whiten(np.interp(one.trace.time, grid, answer))
    return column - orthogonal @ (orthogonal.T @ column)


def _half(one: FittedTrace, fit: TraceFit) -> float:
    """Return the time after the release that halves the log of the amplitude above the noise [s]."""
    size = float(np.abs(one.modelled - one.level).max())
    heard = math.log(max(size / max(fit.noise, 1e-300), math.e)) / max(fit.decay_rate, 1e-9)
    return min(heard, float(one.trace.time[-1] - one.trace.time[0])) / 2


def wander(fit: TraceFit) -> float:
    """Return the variance that a random walk of the sensor gains [rad²/s], from the mean residuals of eighths of the releases.

    The squared difference of neighbouring means over a time T is two thirds of the walk's gain in T, plus noise. T is a period at least:
    within one, a torque that the law misses differs too.
    """
    gains = [0.0]
    for one in fit.releases:
        span = float(one.trace.time[-1] - one.trace.time[0])
        parts = np.array_split(one.residual, min(8, max(1, int(span * fit.omega_n / (2 * math.pi)))))
        if len(parts) < 3:
            continue
        span /= len(parts)
        noise = 2 * float(np.var(one.residual)) / len(parts[-1])
        steps = np.diff([part.mean() for part in parts])
        gains.append(1.5 * (float(np.mean(steps**2)) - noise) / span)
    return max(float(np.mean(gains[1:] or gains)), 0.0)


def scattered(releases: Sequence[Release], rests: Sequence[Quantity], walk: float) -> bool:
    """Whether the releases come to rest at different angles, beyond a drift or a random walk [rad²/s] of the sensor.

    Dry friction F holds a joint anywhere within F/k of its rest. A linear decay with a level for each release then gives a stiffness
    that is wrong by tens of percent, with hardly a larger residual.
    """
    if len(rests) < 2:
        return False
    time = np.array([release.start for release in releases])
    value = np.array([rest.value for rest in rests])
    std = np.sqrt([rest.std**2 + walk * float(np.ptp(time)) / len(rests) for rest in rests])
    line = int(len(set(time)) > 2)
    left = value - np.polyval(np.polyfit(time - time[0], value, line, w=1 / std), time - time[0])
    deviations = float(np.linalg.norm(left / std)) / math.sqrt(len(left) - 1 - line)
    return deviations > SURE and bool(np.ptp(left) > LEVELS_APART * min(one.amplitude for one in releases))


def _widened(fit: TraceFit, floor: NoiseFloor) -> tuple[TraceFit, float]:
    """Widen the covariance if the residual is significantly larger than the noise, and return the factor.

    Such a residual follows the motion. It has few independent values, and the fit absorbs some of them.
    """
    power, noise, count, values = 0.0, 0.0, 0, 0.0
    for one in fit.releases:
        since = one.trace.time - one.trace.time[0]
        span = min(float(since[-1]), 3.0 / max(fit.decay_rate, 1e-9))
        moving = one.residual[since <= span]
        power, count = power + float(moving @ moving), count + len(moving)
        noise += len(moving) * max(floor.highest, one.trace.known_std) ** 2
        values += 1.0 + PER_PERIOD * span * fit.omega_n / (2 * math.pi)
    noise *= 1.0 + Z95 * math.sqrt(2.0 / max(count, 1))
    if power <= noise:
        return fit, 1.0
    if all(one.trace.known_std for one in fit.releases):  # the covariance includes the correlation
        return replace(fit, covariance=fit.covariance * power / noise), math.sqrt(power / noise)
    left = max(values - 2 - 3 * len(fit.releases), 1.5)
    covariance = fit.white_covariance * (1.0 + (power - noise) / (left * fit.noise**2))
    growth = math.sqrt(float(np.mean(np.diag(covariance) / np.diag(fit.covariance))))
    return (replace(fit, covariance=covariance), growth) if growth > 1.0 else (fit, 1.0)
