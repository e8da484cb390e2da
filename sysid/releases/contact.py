"""Free stretches of a decay: a change point in the innovations of a Kalman filter.

    ẍ = -k (x - r) - d ẋ + torque noise

A free joint needs little torque noise, as much as its law is not linear; a hand or a motor needs as much as the joint's own torque. The
same filter runs with a ladder of noises. A stretch is free as long as a small noise is likelier than the large one; the change point
is where the sum of log-likelihood ratios is largest (Page, 1954). Its price is that of the two numbers that a change adds (BIC).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.releases.extrema import SmoothedSignal
from sysid.roll import Array

FINE = 48
"""Samples a period that are looked at, of more: means over a block, so that no noise is lost."""
ERRORS = np.array([0.0003, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0])
"""Torque noise as a share of the joint's own torque at its widest swing, over a radian of its swing; the last one is a hand's."""
LAG = 0.2
"""Periods between the samples that the law is learned from: near a quarter, where the motion tells stiffness and damping apart."""


@dataclass(frozen=True, slots=True)
class Law:
    """A linear law, good enough to follow a decay for a part of a period."""

    stiffness: float
    """k/I [1/s²]."""
    damping: float
    """d/I [1/s]."""


@dataclass(frozen=True, slots=True)
class Span:
    """A decay between two times [s]."""

    begin: float
    end: float
    rest: float
    """[rad]"""
    size: float
    """Widest swing [rad]."""


def free_stretches(signal: SmoothedSignal, spans: Sequence[Span], period: float) -> list[list[tuple[float, float]]]:
    """Return the free stretches [s] of each decay, in order of time.

    Args:
        signal: The whole log.
        spans: Its decays, as their turning points tell them.
        period: Of the joint [s], roughly.
    """
    time, roll, noise = _blocks(signal, period)
    found = [[(span.begin, span.end)] for span in spans]
    for _ in range(2):  # the law of the free stretches tells them better
        law = _learned(time, roll, spans, found, period)
        if law is None:
            return found
        found = [_stretches(time, roll, noise, span, law) for span in spans]
    return found


def _blocks(signal: SmoothedSignal, period: float) -> tuple[Array, Array, float]:
    """Return means over blocks of a log, shape (m,) each, and the noise of one."""
    every = max(1, int(period / (FINE * float(np.median(np.diff(signal.time))))))
    count = len(signal.time) // every * every
    time, roll = (values[:count].reshape(-1, every).mean(axis=1) for values in (signal.time, signal.raw))
    return time, roll, max(signal.std / math.sqrt(every), 1e-9 * float(np.ptp(roll)))


def _learned(
    time: Array, roll: Array, spans: Sequence[Span], free: Sequence[Sequence[tuple[float, float]]], period: float
) -> Law | None:
    """Return the law of the free stretches by least squares, each with its own rest; None where they tell none.

    A linear decay at even times obeys x(t + s) = α x(t) + β x(t - s) + c, whatever s is, and so does any moving average of it.
    """
    step = float(np.median(np.diff(time)))
    lag = max(1, round(LAG * period / step))
    kernel = np.bartlett(2 * lag + 1)[1:-1]
    rows: list[Array] = []
    for i, stretches in enumerate(free):
        for begin, end in stretches:
            first, last = (int(index) for index in np.searchsorted(time, (begin, end)))
            part = (roll[first:last] - spans[i].rest) / max(spans[i].size, 1e-12)
            if len(part) < 4 * lag + len(kernel):
                continue
            mean = np.convolve(part, kernel / kernel.sum(), "valid")
            table = np.zeros((len(mean) - 2 * lag, 3 + len(spans)))
            table[:, 0], table[:, 1], table[:, 2] = mean[2 * lag :], mean[lag:-lag], mean[: -2 * lag]
            table[:, 3 + i] = 1.0
            rows.append(table)
    if not rows:
        return None
    whole = np.vstack(rows)
    target, table = whole[:, 0], whole[:, 1:][:, whole[:, 1:].any(axis=0)]
    weights = np.ones(len(target))
    solution = np.zeros(2)
    for _ in range(4):  # a hand in the stretch weighs little (Cauchy)
        solution = np.linalg.lstsq(table * weights[:, None], target * weights, rcond=None)[0]
        left = target - table @ solution
        scale = 4.5 * float(np.median(np.abs(left))) or 1e-300  # three deviations
        weights = 1 / np.hypot(1, left / scale)
    alpha, beta = float(solution[0]), -float(solution[1])
    if beta <= 0:
        return None
    decay = -0.5 * math.log(min(beta, 1.0)) / (lag * step)
    turn = 0.5 * alpha / math.sqrt(beta)
    square = (math.acos(turn) if abs(turn) <= 1 else math.acosh(abs(turn))) / (lag * step)
    stiffness = decay**2 + math.copysign(square**2, 1 - abs(turn))
    return Law(stiffness, 2 * decay) if stiffness > 0 else None


def _stretches(time: Array, roll: Array, noise: float, span: Span, law: Law) -> list[tuple[float, float]]:
    """Return the free stretches of one decay [s]."""
    quarter = 0.5 * math.pi / math.sqrt(law.stiffness)
    first, last = (int(i) for i in np.searchsorted(time, (span.begin, span.end)))
    step = max(1, int(quarter / float(np.median(np.diff(time)))))
    found: list[tuple[float, float]] = []
    since, begin = first, first
    while begin < last - 2:
        end = begin + _free_for(time[begin:last], roll[begin:last], noise, span, law)
        if end - begin > 2 * step or end >= last:
            back = slice(end - 1, since - 1 if since else None, -1)
            begin = end - _free_for(-time[back], roll[back], noise, span, Law(law.stiffness, -law.damping))
            start = span.begin if begin - first <= step / 4 else float(time[begin])
            found.append((start, span.end if last - end <= step / 4 else float(time[end - 1])))
            since = end
        begin = max(end, begin + 1) + step
    return found


def _free_for(time: Array, roll: Array, noise: float, span: Span, law: Law) -> int:
    """Return for how many samples from the first on the joint moves freely."""
    likelihood = _log_likelihood(time, roll - span.rest, noise, span.size, law)
    gain = np.cumsum(likelihood[:, :-1] - likelihood[:, -1:], axis=0)
    best = gain.argmax(axis=0)
    chosen = int(np.argmax(gain.max(axis=0)))
    whole = int(np.argmax(gain[-1]))
    if gain[-1, whole] > gain[best[chosen], chosen] - math.log(len(time)):
        return len(time)
    return int(best[chosen]) + 1


def _log_likelihood(time: Array, angle: Array, noise: float, size: float, law: Law) -> Array:
    """Return the log-likelihood of each sample given those before it, for each torque noise, shape (n, m).

    The filter's state is angle about rest and rate; its transition is exact for any step (matrix exponential).
    """
    steps = np.diff(time, prepend=time[0])
    root = complex(0.25 * law.damping**2 - law.stiffness) ** 0.5 or 1e-9
    fade = np.exp(-0.5 * law.damping * steps)
    even, odd = fade * np.cosh(root * steps).real, fade * (np.sinh(root * steps) / root).real
    xx, xv = even + 0.5 * law.damping * odd, odd
    vx, vv = -law.stiffness * odd, even - 0.5 * law.damping * odd
    omega = math.sqrt(law.stiffness)
    power = (ERRORS * law.stiffness * size) ** 2 / omega
    x, v = np.full(len(ERRORS), angle[0]), np.zeros(len(ERRORS))
    p, r, q = np.full(len(ERRORS), 1e4 * noise**2), np.zeros(len(ERRORS)), np.full(len(ERRORS), (3 * omega * size) ** 2)
    found = np.zeros((len(time), len(ERRORS)))
    for i in range(len(time)):
        h, a, b, c, d = steps[i], xx[i], xv[i], vx[i], vv[i]
        x, v = a * x + b * v, c * x + d * v
        p, r, q = (
            a * a * p + 2 * a * b * r + b * b * q + power * h**3 / 3,
            a * c * p + (a * d + b * c) * r + b * d * q + power * h**2 / 2,
            c * c * p + 2 * c * d * r + d * d * q + power * h,
        )
        spread = p + noise**2
        off = angle[i] - x
        found[i] = -0.5 * (off * off / spread + np.log(spread))
        x, v = x + p / spread * off, v + r / spread * off
        p, r, q = p - p * p / spread, r - p * r / spread, q - r * r / spread
    return found
