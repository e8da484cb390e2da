"""Free stretches of a decay: where the torque that a law with a cubic spring and drag misses stays small.

A linear decay obeys `x(t + s) = α x(t) - β x(t - s) + c` for any s, and so does any moving average of it. With s a quarter of a period,
the misfit over `1 - α + β` is a weighted mean of the missing torque, as a shift of the rest angle. A stiffness that changes with the
square of the swing adds `γ A² x(t)`; drag, a damping that grows with the swing, adds `κ A x(t - s)`. A is the root of the sum of both
squares. A free joint misses a torque for the rest of its law, of one size for the whole decay. A hand or a motor acts with as much torque
as the joint's own at its swing then.
The likeliest sequence of the two states counts (Viterbi, 1967). A change adds a parameter, with its BIC penalty.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from sysid.noise.floor import difference_std
from sysid.noise.sensor import quantisation_step, runs
from sysid.releases.chains import Segment
from sysid.roll import Array

QUARTER = 12
"""Points of the even grid in a quarter of a period, at most."""
ERRORS = np.geomspace(3e-4, 0.3, 7)
"""Torques that the law may miss of a free joint, over that of its spring at the widest swing."""


@dataclass(frozen=True, slots=True)
class Span:
    """A decay between two times [s]."""

    begin: float
    end: float
    segment: Segment
    hold: float = 0.0
    """Duration of the hold before [s]."""
    let_go: bool = False
    """Whether it was held still and then returned at once: the decay begins there, even if its law is nonlinear."""
    caught: bool = False
    """Whether a hand ends it."""


_Law = tuple[Array, float]
"""A law between three angles a quarter of a period apart, in units of the widest swing. First its α, -β, γ and κ, shape (4,). Then the
noise of the missing torque, as a shift of the rest angle."""


def _causes(angles: Array) -> Array:
    """Return x(t), x(t - s), A² x(t) and A x(t - s) of three angles a quarter of a period apart, shape (n, 4)."""
    _, here, back = angles.T
    swing = np.hypot(here, back)
    return np.column_stack((here, back, swing**2 * here, swing * back))


def free_stretches(
    time: Array, roll: Array, spans: Sequence[Span], period: float
) -> list[list[tuple[float, float]]]:
    """Return the free stretches [s] of each decay of a log, in order of time.

    Args:
        time: [s], shape (n,).
        roll: [rad], shape (n,).
        spans: Decays, from their turning points.
        period: Rough period of the joint [s].
    """
    widest = max((span.segment.size for span in spans), default=1.0)
    roll, sizes = roll / widest, [span.segment.size / widest for span in spans]
    interval = float(np.median(np.diff(time)))
    step = max(interval, period / (4 * QUARTER))
    lag = max(1, round(period / (4 * step)))
    inside = [slice(*np.searchsorted(time, (span.begin, span.end))) for span in spans]
    std = difference_std([(roll[rows], time[rows]) for rows in inside])
    std = std * math.sqrt(interval / (lag * step)) if math.isfinite(std) else 0.0
    noise = max(std, quantisation_step(np.diff(roll)) / math.sqrt(12))  # averaging does not reduce rounding
    tables = {
        i: _table(time, roll - span.segment.rest / widest, span, step, lag) for i, span in enumerate(spans)
    }
    tables = {i: table for i, table in tables.items() if len(table) > lag}
    free = {i: np.ones(len(table), dtype=bool) for i, table in tables.items()}
    late: dict[int, Array] = {}
    for _ in range(3):  # each pass improves law and stretches
        law = _learned([(table, free[i], sizes[i]) for i, table in tables.items()], noise, lag)
        if law is None:
            return [[(span.begin, span.end)] for span in spans]
        for i, table in tables.items():
            free[i], late[i] = _free(table, free[i], law, sizes[i], lag, let_go=spans[i].let_go)
    return [
        _stretches(span, free[i], late[i], step, lag) if i in free else [(span.begin, span.end)]
        for i, span in enumerate(spans)
    ]


def _table(time: Array, roll: Array, span: Span, step: float, lag: int) -> Array:
    """Return the mean of an angle about rest over a quarter of a period, a quarter ahead, there and a quarter back, shape (n, 3)."""
    whole = np.concatenate(([0.0], np.cumsum(0.5 * np.diff(time) * (roll[1:] + roll[:-1]))))
    way = np.interp(np.arange(span.begin, span.end, step), time, whole)
    mean = (way[lag:] - way[:-lag]) / (lag * step)
    return np.column_stack((mean[2 * lag :], mean[lag : -lag or None], mean[: -2 * lag]))


def _learned(
    decays: Sequence[tuple[Array, npt.NDArray[np.bool_], float]], noise: float, lag: int
) -> _Law | None:
    """Return the law of the free samples of all decays by least squares; None if they are too few, or show no restoring torque."""
    known: list[Array] = []
    for table, free, size in decays:
        moves = table[free & (np.ptp(table, axis=1) > 3 * noise)]  # noise alone would bias α and β
        rows = np.column_stack((moves[:, 0], _causes(moves))) / size
        known += [rows - rows.mean(axis=0)] if len(rows) > 3 else []  # each decay has a rest of its own
    if sum(map(len, known)) < 2 * (2 + len(known)):
        return None
    rows = np.vstack(known)
    count = len(rows) / lag  # neighbouring means share most of their noise
    laws: list[tuple[float, Array]] = []
    for causes in range(2, rows.shape[1]):
        weights, gains, middle = np.ones(len(rows)), np.zeros(rows.shape[1] - 1), 0.0
        for _ in range(4):  # Cauchy weights: little for samples with a hand
            weighted = rows * weights[:, None]
            gains[:causes] = np.linalg.lstsq(weighted[:, 1 : 1 + causes], weighted[:, 0])[0]
            left = np.abs(rows[:, 0] - rows[:, 1:] @ gains)
            middle = float(np.median(left)) or 1e-300
            weights = 1 / np.hypot(1, left / (4.5 * middle))
        laws.append((2 * count * math.log(middle) + causes * math.log(max(count, 2.0)), gains))
    gains = min(laws, key=itemgetter(0))[1]  # by BIC
    alpha, minus = gains[:2].tolist()
    spring = 1 - alpha - minus
    return (gains, noise * math.hypot(1, alpha, minus) / spring) if minus < 0 < spring else None


def _free(
    table: Array, free: npt.NDArray[np.bool_], law: _Law, size: float, lag: int, *, let_go: bool
) -> tuple[npt.NDArray[np.bool_], Array]:
    """Return in which samples the joint moves freely, and how long a hand there acts before it shows [rad], shape (n,) each.

    Neighbouring means share most of their torque: a quarter of a period counts as one. If the decay begins with the joint alone, its law
    misses no more of a small swing than of a wide one before. A torque p for the phase φ adds p φ³ / 6π to the mean.
    """
    gains, noise = law
    shift = (table[:, 0] - _causes(table) @ gains) / (1 - gains[0] - gains[1])
    # The rest is the median of the shift, with the square of the motion as weights. A long hold has hardly any weight.
    order = np.argsort(shift)
    moving = np.cumsum((np.ptp(table, axis=1) ** 2 * free)[order])
    rest = float(shift[order][min(int(np.searchsorted(moving, 0.5 * moving[-1])), len(shift) - 1)])
    wide = np.pad(np.abs(table - rest).max(axis=1), (2 * lag, 0), mode="edge")
    swing, shift = sliding_window_view(wide, 2 * lag + 1).max(axis=1)[:, None], shift - rest
    known = (ERRORS * size) ** 2
    if let_go:
        power = np.convolve(shift**2, np.ones(lag) / lag, "same") - noise**2
        before = np.concatenate((np.zeros(4 * lag), np.maximum.accumulate(power)))[: len(power)]
        known = np.maximum(known, before[:, None])
    small, large = noise**2 + np.minimum(known, swing**2) + 1e-300, noise**2 + swing**2 + 1e-300
    own, hand = (-0.5 * shift[:, None] ** 2 / power - 0.5 * np.log(power) for power in (small, large))
    odds, price = (own - hand) / lag, math.log(max(len(shift) / lag, 2.0))
    lead, best = np.full(len(ERRORS), price), np.full(len(ERRORS), hand.sum() / lag)
    leads = np.empty_like(odds)
    for i, gain in enumerate(odds):
        best += np.maximum(lead - price, 0)
        lead = np.minimum(np.maximum(lead, -price), price) + gain
        leads[i] = lead
    level = int(np.argmax(best + np.maximum(lead, 0)))
    walk, share = leads[:, level], small[:, level] / large[:, 0]
    walk[-1] = math.copysign(2 * price, walk[-1])
    decided = np.where(np.abs(walk) > price, np.arange(len(walk)), len(walk))
    found = walk[np.minimum.accumulate(decided[::-1])[::-1]] > 0
    return found, np.minimum(np.cbrt(6 * math.pi * np.sqrt(-share * np.log(share))), math.pi / 2)


def _stretches(
    span: Span, free: npt.NDArray[np.bool_], late: Array, step: float, lag: int
) -> list[tuple[float, float]]:
    """Return the free stretches of one decay [s]; a hand acts for `late` [rad] before it shows, shape (n,)."""
    radian = 2 * lag * step / math.pi
    found: list[tuple[float, float]] = []
    for first, last in runs(free).tolist():
        whole = first == 0 or (span.let_go and not found)
        begin = span.begin if whole else span.begin + first * step + late[first] * radian
        end = span.begin + (last + 3 * lag) * step - late[last - 1] * radian
        if last == len(free):
            end = span.end - span.caught * late[-1] * radian
        if found and begin < found[-1][1]:  # too quick for a hand: the law is nonlinear there
            begin = found.pop()[0]
        found.append((begin, end))
    return found
