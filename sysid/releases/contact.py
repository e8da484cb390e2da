"""Free stretches of a decay: a change point in the innovations of a Kalman filter.

The filter's law is `ẍ = -k (x - r) - d ẋ + torque noise`. A free joint needs little torque noise: its departure from the linear law. A hand or a motor needs as much as the joint's own torque.
The same filter runs with a ladder of noises. A stretch is free while a small noise is likelier than the large one. The change point
maximises the sum of log-likelihood ratios (Page, 1954). A change adds two parameters, with their BIC penalty.
"""

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

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


@dataclass(frozen=True, slots=True)
class _Run:
    """Samples of a decay in a row, forwards or backwards in time."""

    time: Array
    """[s], shape (n,)"""
    angle: Array
    """[rad], shape (n,)"""
    span: Span
    law: Law
    """Backwards in time, with a damping that drives."""
    levels: slice
    """Torque noises that a free joint may have."""
    swing: Array
    """Widest angle about rest in the period before, over the widest of all, shape (n,). Infinite where a slow hand is not looked for, as
    in the first period."""


_Walk = Generator[_Run, tuple[int, int], list[tuple[float, float]]]
"""Search for the stretches of one decay. It yields runs, is sent their free samples and the number of their torque noise, and
returns the stretches [s]."""


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
        found = _together([_stretches(when, where, span, law) for span in spans], noise)
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
    owner: list[npt.NDArray[np.intp]] = []
    for i, stretches in enumerate(free):
        for begin, end in stretches:
            first, last = (int(index) for index in np.searchsorted(time, (begin, end)))
            if last - first < 4 * lag + len(kernel):
                continue
            even = np.arange(time[first], time[last - 1], step)
            part = (np.interp(even, time[first:last], roll[first:last]) - spans[i].rest) / max(
                spans[i].size, 1e-12
            )
            mean: Array = np.asarray(np.convolve(part, kernel / kernel.sum(), "valid"), dtype=np.float64)
            table = np.column_stack((mean[2 * lag :], mean[lag:-lag], mean[: -2 * lag]))
            # Rows without motion hold no information on the law.
            rows.append(table[np.ptp(table, axis=1) > 3 * noise / spans[i].size])
            owner.append(np.full(len(rows[-1]), i))
    if sum(map(len, rows)) < 2 * (2 + len(spans)):
        return None
    whole, own = np.vstack(rows), np.concatenate(owner)
    weights = np.ones(len(own))
    solution = np.zeros(2)
    for _ in range(4):  # Cauchy weights: little for samples with a hand
        squares = np.bincount(own, weights**2) + 1e-300
        # Each decay has a rest of its own: its weighted mean is subtracted before the least squares.
        means = [np.bincount(own, weights**2 * column) / squares for column in whole.T]
        target, *table = (column - mean[own] for column, mean in zip(whole.T, means, strict=True))
        known = np.column_stack(table)
        solution = np.linalg.lstsq(known * weights[:, None], target * weights, rcond=None)[0]
        left = target - known @ solution
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


def _together(decays: Sequence[_Walk], noise: float) -> list[list[tuple[float, float]]]:
    """Return the free stretches of decays [s]: the filter runs over the next run of each of them at once."""
    found: dict[int, list[tuple[float, float]]] = {}
    said: dict[int, tuple[int, int] | None] = dict.fromkeys(range(len(decays)))
    while said:
        asked: dict[int, _Run] = {}
        for index, answer in said.items():
            try:
                asked[index] = next(decays[index]) if answer is None else decays[index].send(answer)
            except StopIteration as end:
                found[index] = end.value
        gains = _log_likelihood_ratios(list(asked.values()), noise)
        said = {
            index: _free_for(gain[:, run.levels], run.swing)
            for (index, run), gain in zip(asked.items(), gains, strict=True)
        }
    return [found[index] for index in range(len(decays))]


def _stretches(time: Array, roll: Array, span: Span, law: Law) -> _Walk:
    """Return the free stretches of one decay [s]; yields runs of samples and is sent for how many the joint moves freely.

    A later stretch needs no more torque noise than one of a period before it. If it does, a hand acts.
    """
    quarter = 0.5 * math.pi / math.sqrt(law.stiffness)
    first, last = (int(i) for i in np.searchsorted(time, (span.begin, span.end)))
    step = max(1, int(quarter / float(np.median(np.diff(time)))))
    found: list[tuple[float, float]] = []
    since, begin, most = first, first, len(ERRORS) - 1
    widest = np.abs(roll[first:last] - span.rest) / max(span.size, 1e-300)
    while begin < last - 2:
        swing = np.full(last - begin, np.inf)
        if len(swing) > 4 * step:
            swing[4 * step :] = sliding_window_view(widest[begin - first :], 4 * step + 1).max(axis=1)
        count, level = yield _Run(time[begin:last], roll[begin:last], span, law, slice(most), swing)
        end = begin + count
        if end - begin > 2 * step or end >= last:
            back = slice(end - 1, since - 1 if since else None, -1)
            backwards = Law(law.stiffness, -law.damping)
            same = slice(level - 1, level)
            none = np.full(len(time[back]), np.inf)
            begin = end - (yield _Run(-time[back], roll[back], span, backwards, same, none))[0]
            most = level if count > 4 * step else most
            start = span.begin if begin == first or (span.let_go and not found) else float(time[begin])
            stop = span.end if last - end <= step / 4 else float(time[end - 1])
            if found and begin - since < step / 2:  # too quick for a hand: the law is nonlinear there
                start = found.pop()[0]
            found.append((start, stop))
            since = end
        begin = max(end, begin + 1) + step
    return found


def _free_for(likelihood: Array, swing: Array) -> tuple[int, int]:
    """Return the number of samples, from the first on, in which the joint moves freely, and the number of its torque noise.

    Their log-likelihood ratios are of shape (n, m), for m torque noises.

    A hand acts from one sample to another, or to the last. Each change has a BIC penalty.
    """
    gain = np.pad(np.cumsum(likelihood, axis=0), ((0, 0), (0, 1)))  # the last column: the largest noise
    count, price, hand = len(gain), math.log(len(gain)), gain.shape[1] - 1
    # A slow hand needs as much as the joint's own torque at its swing then, and ten times its torque noise: two steps of the ladder.
    pairs = [
        (one, other) for one, other in combinations(range(hand + 1), 2) if other - one > 1 or other == hand
    ]
    while count > 2:
        part = gain[:count]
        best, until = float(part[-1, :-1].max()), 0
        for one, other in pairs:
            lead = part[:, one] - part[:, other]
            if other < hand:
                lead[swing[:count] > ERRORS[other]] = -1e300
            highest = np.maximum.accumulate(lead)
            fall = highest - lead
            caught, touched = highest[-1] + part[-1, other] - price, part[-1, one] + fall.max() - 2 * price
            if max(caught, touched) > best:
                best = max(caught, touched)
                until = int(np.argmax(lead[: int(np.argmax(fall)) + 1 if touched > caught else count])) + 1
        if until == 0:
            break
        count = until
    return count, 1 + int(np.argmax(gain[count - 1, :-1]))


def _log_likelihood_ratios(runs: Sequence[_Run], noise: float) -> list[Array]:
    """Return the log-likelihood ratio of a free joint to a hand for each sample and torque noise, given the samples before, shape (n, m) a run.

    The filter's state is angle about rest and rate; its transition is exact for any step (matrix exponential). A hand moves the joint,
    with the last torque noise, or holds it; it changes once a period. The filter takes one sample of every run at a time, the
    longest run first: those that have ended are the last ones.
    """
    order = sorted(range(len(runs)), key=lambda index: -len(runs[index].time))
    counts = np.array([len(runs[index].time) for index in order], dtype=int)
    running = np.searchsorted(-counts, -np.arange(counts.max(initial=0)))
    starts = np.cumsum(running) - running
    places = [starts[:count] + row for row, count in enumerate(counts)]
    table, found = np.zeros((counts.sum(), 7, 1)), np.zeros((counts.sum(), len(ERRORS) - 1))
    for index, place in zip(order, places, strict=True):
        table[place, :, 0] = _transition(runs[index])
    size, stiffness = (
        np.array([[value(runs[index])] for index in order]).reshape(-1, 1)
        for value in (lambda run: run.span.size, lambda run: run.law.stiffness)
    )
    omega, white, tremor = np.sqrt(stiffness), noise**2, (TREMOR * size) ** 2 * np.sqrt(stiffness)
    power, aside = (ERRORS * stiffness * size) ** 2 / omega, ASIDE * size
    x, v = np.tile(table[: len(order), 5], len(ERRORS)), np.zeros_like(power)
    p, r, q = (
        np.full_like(power, 1e4 * white),
        np.zeros_like(power),
        np.zeros_like(power) + (3 * omega * size) ** 2,
    )
    held, spread_held, moves = x[:, :1], np.full_like(size, white), np.full_like(size, 0.5)
    for start, count in zip(starts.tolist(), running.tolist(), strict=True):
        if count < len(x):
            x, v, p, r, q, held, spread_held, moves, power, tremor, aside = (
                one[:count] for one in (x, v, p, r, q, held, spread_held, moves, power, tremor, aside)
            )
        a, b, c, d, h, seen, turn = table[start : start + count].swapaxes(0, 1)
        x, v = a * x + b * v, c * x + d * v
        ar, bq, push = a * r, b * q, power * h
        p, r, q = (
            a * (a * p + 2 * b * r) + b * bq + push * (h * h / 3),
            c * (a * p + b * r) + d * (ar + bq) + push * (h / 2),
            c * (c * p + 2 * d * r) + d * d * q + push,
        )
        spread = p + white
        off = seen - x
        density = np.exp(-0.5 * off * off / spread) / np.sqrt(spread)
        by_hand = density[:, -1:]
        spread_held = spread_held + (tremor * h + white)
        away = seen - held
        still = np.exp(-0.5 * away * away / spread_held) / np.sqrt(spread_held)
        kept = white / spread_held
        held = held + (1 - kept) * away
        spread_held = white * (1 - kept)
        still = np.where(np.abs(held) < aside, by_hand, still)  # at rest within dry friction
        hand = still + moves * (by_hand - still) + 1e-300
        found[start : start + count] = np.log((density[:, :-1] + 1e-300) / hand)
        moves = moves * by_hand / hand
        moves = moves + (moves - 0.5) * turn
        gain = p / spread
        v, x = v + r / spread * off, x + gain * off
        p, q, r = p - p * gain, q - r * r / spread, r - r * gain
    ordered = [found[place] for place in places]
    return [ordered[row] for row in np.argsort(order)]


def _transition(run: _Run) -> Array:
    """Return what the filter needs of each sample of a run, shape (n, 7).

    First the transition of angle and rate from the sample before, row by row. Then the step [s] and the angle about rest [rad]. The last
    one is the share of a hand's choice between moving and holding that is kept, less one.
    """
    law = run.law
    steps = np.abs(np.diff(run.time, prepend=run.time[:1]))
    root = complex(0.25 * law.damping**2 - law.stiffness) ** 0.5 or 1e-9
    fade = np.exp(-0.5 * law.damping * steps)
    even, odd = fade * np.real(np.cosh(root * steps)), fade * np.real(np.sinh(root * steps) / root)
    forgotten = np.expm1(-steps * math.sqrt(law.stiffness) / math.pi)
    columns = (even + 0.5 * law.damping * odd, odd, -law.stiffness * odd, even - 0.5 * law.damping * odd)
    return np.column_stack((*columns, steps, run.angle - run.span.rest, forgotten))
