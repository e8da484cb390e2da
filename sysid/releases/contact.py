"""Free stretches of a decay: a change point in the innovations of a Kalman filter.

The filter's law is `ẍ = -k (x - r) - d ẋ + torque noise`. A free joint needs little torque noise: its departure from the linear law. A hand or a motor needs as much as the joint's own torque.
The same filter runs with a ladder of noises. A stretch is free while a small noise is likelier than the large one. The change point
maximises the sum of log-likelihood ratios (Page, 1954). A change adds two parameters, with their BIC penalty.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.noise.floor import difference_std
from sysid.noise.sensor import quantisation_step
from sysid.roll import Array

FINE = 48
"""Samples per period; more are averaged in blocks."""
ERRORS = np.array([0.0003, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0])
"""Torque noise over a radian of the swing, as a share of the joint's own torque at its widest swing; the last one is a hand's."""
TREMOR = 0.01
"""Tremor of a hand that holds the joint, over a radian of the swing, as a share of the widest swing."""
ASIDE = 0.03
"""Largest distance from rest at which dry friction may hold a joint, as a share of its widest swing; farther off a hand holds it."""


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
    let_go: bool = False
    """Whether it was held still and then returned at once: the decay begins there, even if its law is nonlinear."""


def free_stretches(
    time: Array, roll: Array, spans: Sequence[Span], period: float
) -> list[list[tuple[float, float]]]:
    """Return the free stretches [s] of each decay, in order of time.

    Args:
        time: Of the whole log [s], shape (n,).
        roll: Of the whole log [rad], shape (n,).
        spans: Its decays, from their turning points.
        period: Of the joint [s], roughly.
    """
    found = [[(span.begin, span.end)] for span in spans]
    inside = [slice(*np.searchsorted(time, (span.begin, span.end))) for span in spans]
    std = difference_std([(roll[rows], time[rows]) for rows in inside])
    std, rounding = std if math.isfinite(std) else 0.0, quantisation_step(np.diff(roll)) / math.sqrt(12)
    for _ in range(3):  # each pass improves law and stretches
        when, where, noise = _blocks(time, roll, std, period)
        noise = max(noise, rounding)  # averaging does not reduce rounding
        law = _learned(when, where, noise, spans, found, period)
        if law is None:
            return found
        found = [_stretches(when, where, noise, span, law) for span in spans]
        period = 2 * math.pi / math.sqrt(law.stiffness)
    return found


def _blocks(time: Array, roll: Array, std: float, period: float) -> tuple[Array, Array, float]:
    """Return means over blocks of a log, shape (m,) each, and the noise of one."""
    every = max(1, int(period / (FINE * float(np.median(np.diff(time))))))
    count = len(time) // every * every
    when, where = (values[:count].reshape(-1, every).mean(axis=1) for values in (time, roll))
    return when, where, max(std / math.sqrt(every), 1e-9 * float(np.ptp(roll)))


def _learned(
    time: Array,
    roll: Array,
    noise: float,
    spans: Sequence[Span],
    free: Sequence[Sequence[tuple[float, float]]],
    period: float,
) -> Law | None:
    """Return the law of the free stretches by least squares, each with its own rest angle; None if they are too short.

    A linear decay at even times, and any moving average of it, obeys `x(t + s) = α x(t) + β x(t - s) + c` for any s.
    """
    step = float(np.median(np.diff(time)))
    lag = max(
        1, round(period / (4 * step))
    )  # at a quarter of a period the motion separates stiffness and damping
    kernel = np.bartlett(2 * lag + 1)[1:-1]
    rows: list[Array] = []
    for i, stretches in enumerate(free):
        for begin, end in stretches:
            first, last = (int(index) for index in np.searchsorted(time, (begin, end)))
            if last - first < 4 * lag + len(kernel):
                continue
            even = np.arange(time[first], time[last - 1], step)
            part = (np.interp(even, time[first:last], roll[first:last]) - spans[i].rest) / max(
                spans[i].size, 1e-12
            )
            mean = np.convolve(part, kernel / kernel.sum(), "valid")
            table = np.zeros((len(mean) - 2 * lag, 3 + len(spans)))
            table[:, 0], table[:, 1], table[:, 2] = mean[2 * lag :], mean[lag:-lag], mean[: -2 * lag]
            table[:, 3 + i] = 1.0
            # Rows without motion hold no information on the law.
            rows.append(table[np.ptp(table[:, :3], axis=1) > 3 * noise / spans[i].size])
    if sum(map(len, rows)) < 2 * (2 + len(spans)):
        return None
    whole = np.vstack(rows)
    target, table = whole[:, 0], whole[:, 1:][:, whole[:, 1:].any(axis=0)]
    weights = np.ones(len(target))
    solution = np.zeros(2)
    for _ in range(4):  # Cauchy weights: little for samples with a hand
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
            start = span.begin if begin == first or (span.let_go and not found) else float(time[begin])
            stop = span.end if last - end <= step / 4 else float(time[end - 1])
            if found and begin - since < step / 2:  # too quick for a hand: the law is nonlinear there
                start = found.pop()[0]
            found.append((start, stop))
            since = end
        begin = max(end, begin + 1) + step
    return found


def _free_for(time: Array, roll: Array, noise: float, span: Span, law: Law) -> int:
    """Return the number of samples, from the first on, in which the joint moves freely.

    A hand acts from one sample to another, or to the last. Each change has a BIC penalty.
    """
    likelihood = _log_likelihood_ratio(time, roll - span.rest, noise, span.size, law)
    gain = np.cumsum(likelihood, axis=0)
    count = len(gain)
    while count > 2:
        part, price = gain[:count], math.log(len(gain))
        highest = np.maximum.accumulate(part, axis=0)
        fall = highest - part
        touched = part[-1] + fall.max(axis=0) - 2 * price
        caught = highest[-1] - price
        scores = np.stack([part[-1], touched, caught])
        what, which = divmod(int(np.argmax(scores)), part.shape[1])
        if what == 0:
            break
        until = int(np.argmax(fall[:, which])) if what == 1 else count - 1
        count = int(np.argmax(part[: until + 1, which])) + 1
    return count


def _log_likelihood_ratio(time: Array, angle: Array, noise: float, size: float, law: Law) -> Array:
    """Return the log-likelihood ratio of a free joint to a hand for each sample and torque noise, given the samples before, shape (n, m).

    The filter's state is angle about rest and rate; its transition is exact for any step (matrix exponential). A hand moves the joint,
    with the last torque noise, or holds it; it changes once a period.
    """
    steps = np.abs(np.diff(time, prepend=time[0]))
    root = complex(0.25 * law.damping**2 - law.stiffness) ** 0.5 or 1e-9
    fade = np.exp(-0.5 * law.damping * steps)
    even, odd = fade * np.real(np.cosh(root * steps)), fade * np.real(np.sinh(root * steps) / root)
    xx, vx, vv = even + 0.5 * law.damping * odd, -law.stiffness * odd, even - 0.5 * law.damping * odd
    omega, count = math.sqrt(law.stiffness), len(ERRORS)
    power = (ERRORS * law.stiffness * size) ** 2 / omega
    x, v = np.full(count, angle[0]), np.zeros(count)
    p, r, q = np.full(count, 1e4 * noise**2), np.zeros(count), np.full(count, (3 * omega * size) ** 2)
    held, spread_held, moves = float(angle[0]), noise**2, 0.5
    found = np.zeros((len(time), count - 1))
    rows = zip(
        steps.tolist(), xx.tolist(), odd.tolist(), vx.tolist(), vv.tolist(), angle.tolist(), strict=True
    )
    for i, (h, a, b, c, d, seen) in enumerate(rows):
        x, v = a * x + b * v, c * x + d * v
        p, r, q = (
            a * a * p + 2 * a * b * r + b * b * q + power * (h**3 / 3),
            a * c * p + (a * d + b * c) * r + b * d * q + power * (h**2 / 2),
            c * c * p + 2 * c * d * r + d * d * q + power * h,
        )
        spread = p + noise**2
        off = seen - x
        density = np.exp(-0.5 * off * off / spread) / np.sqrt(spread)
        spread_held += (TREMOR * size) ** 2 * omega * h + noise**2
        away = seen - held
        still = math.exp(-0.5 * away * away / spread_held) / math.sqrt(spread_held)
        held += (1 - noise**2 / spread_held) * away
        spread_held = noise**2 * (1 - noise**2 / spread_held)
        if abs(held) < ASIDE * size:  # at rest within dry friction
            still = float(density[-1])
        hand = moves * float(density[-1]) + (1 - moves) * still
        found[i] = np.log(density[:-1] + 1e-300) - math.log(hand + 1e-300)
        moves = moves * float(density[-1]) / (hand + 1e-300)
        moves -= (0.5 - moves) * math.expm1(-h * omega / math.pi)
        gain = p / spread
        v, x = v + r / spread * off, x + gain * off
        p, q, r = p - p * gain, q - r * r / spread, r - r * gain
    return found
