"""Where a hand is on the deck at either end of a decay: there the deck does not move by the joint's law.

The law is learned from swings that are surely free. From there each decay is followed outwards, to its beginning and to its
end. A hand that pushes the deck on its way instead of opening, or that catches it, is a torque beyond that law, about as
large as the joint's own, as it holds against it. One rule serves both ends: an end is a beginning with time reversed.

No rate and no acceleration is taken from the samples. The law ẍ = f(x, ẋ) is held against the motion in weak form, with
φ(t) = t (1 - t/w)³ over a width w from each sample on:

    ∫ φ ẍ dt = x(0) + ∫ φ̈ x dt,  ∫ φ ẋ dt = -∫ φ̇ x dt

A torque that ends δ after that sample counts with δ², as far as it has moved the deck, against the noise of about one sample.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from sysid.releases.extrema import SmoothedSignal
from sysid.roll import Array

FINE = 48
"""Samples a period that are looked at, of more: the signal is smooth over that many."""
FEWEST = 8
"""Samples under φ."""
WIDTHS = (0.75, 1.5)
"""Of φ, in periods: the wider one where the noise is over `CLEAR` of the torque under the other."""
CLEAR = 0.02
"""A choice: a hand that acts for a tenth of a period then stands ten times above the noise."""
PUSH = 0.75
"""A hand has left this many periods after the deck left its hold: what follows is free."""
LEARNED = (2.0, 5.0, np.inf)
"""Periods from then on from which the law is learned, in turn, each as far as no hand was seen before."""
BEFORE_NEXT = 0.3
"""Periods after the end of a decay that are looked at too: a hand is seen by what it does next."""
KNOWN = 0.2
"""Share of the torque that a law may leave: what was learned where hardly anything moved says nothing of a wide swing."""
CERTAIN, GONE = 6.0, 1.5
"""Standard deviations over which a torque is none of the law's, and under which it is gone."""
FLOOR = 0.01
"""Share of the largest swing below which no torque is told from the wandering of a sensor's zero."""
CATCH = 0.25
"""Share of the joint's torque that a hand has at least which catches the deck, or holds it off its rest."""
PUSH_SHARE = 0.38, 4.0
"""Shares of one that lets the deck go, at least and at most: it bears the whole joint until it gives way. What a memory or a
filter holds back is less, or it fades so slowly that the joint could not bear it."""
NONLINEAR = 0.75
"""Share of what a linear law leaves below which a nonlinear one is taken."""
NO_BETTER = 0.97
"""The same over which it is not looked at: it would bend where it was not learned."""
MARGIN, UNSURE = 0.04, 0.1
"""Periods that are left out beside a hand, as its last touch is below the noise; and for which it may have acted longer."""


@dataclass(frozen=True, slots=True)
class Span:
    """A free decay, from when until when."""

    begin: float
    """[s]"""
    end: float
    """[s]"""
    rest: float
    """[rad]"""


@dataclass(frozen=True, slots=True)
class _Windows:
    """One decay under φ from each of its samples on; torques in units of the joint's stiffness [rad]."""

    time: Array
    """First sample of each [s], shape (m,)."""
    width: float
    """[s]"""
    period: int
    """In samples."""
    weight: Array
    """φ, its sum 1."""
    table: Array
    """Roll, rate, and what a nonlinear law adds, shape (m, 6)."""
    acceleration: Array
    """Shape (m,)."""

    def inside(self, begin: float, end: float) -> npt.NDArray[np.bool_]:
        """Return which lie wholly in a stretch [s], shape (m,)."""
        return (self.time >= begin) & (self.time + self.width <= end)

    def breaks(self, torque: Array) -> Array:
        """Return by how much a torque is off its mean in the period after it, shape (m,): a zero that wanders is no hand."""
        total = np.concatenate([[0.0], np.cumsum(torque)])
        end = np.minimum(np.arange(len(torque)) + self.period, len(torque))
        begin = np.maximum(end - self.period, 0)
        return torque - (total[end] - total[begin]) / self.period


@dataclass(frozen=True, slots=True)
class _Law:
    """What moves the joint: coefficients of a decay's table, and a level for each decay."""

    coefficients: Array
    spread: Array
    """Square root of their covariance over that of the noise."""
    shapes: int
    """How many columns of the table it has."""
    noise: float = 0.0
    """Standard deviation of what it leaves [rad]."""

    def beyond(self, windows: _Windows, number: int) -> tuple[Array, Array]:
        """Return the torque beyond the law of one decay, and its standard deviation [rad], shape (m,) each."""
        table = _table(windows, number, self.shapes, len(self.coefficients))
        std = self.noise * np.sqrt(1 + np.sum((table @ self.spread) ** 2, axis=1))
        return windows.breaks(windows.acceleration - table @ self.coefficients), std


def free_spans(signal: SmoothedSignal, spans: Sequence[Span], period: float) -> list[Span]:
    """Return each decay without the stretches at its ends in which a hand acts.

    Args:
        signal: The whole log.
        spans: Its decays, from when the deck left its hold.
        period: Of the joint [s], roughly.
    """
    every = max(1, int(period / (FINE * float(signal.time[1] - signal.time[0]))))
    time, roll = signal.time[::every], signal.roll[::every]
    cuts = [slice(*np.searchsorted(time, (s.begin, s.end + BEFORE_NEXT * period))) for s in spans]
    starts = [span.begin + PUSH * period for span in spans]
    begins, ends = [span.begin for span in spans], [span.end for span in spans]
    for width in WIDTHS:
        onward = [
            _windows(time[c], roll[c] - s.rest, period, width) for c, s in zip(cuts, spans, strict=True)
        ]
        backward = [
            _windows(-time[c][::-1], roll[c][::-1] - s.rest, period, width)
            for c, s in zip(cuts, spans, strict=True)
        ]
        laws: list[_Law] = []
        for reach in LEARNED:
            known = [(a, min(b, a + reach * period)) for a, b in zip(starts, ends, strict=True)]
            laws = _learned(backward, [(-b, -a) for a, b in known])
            seen = [
                _edge(w, laws[:1], i, w.width - b)
                for i, (w, (_, b)) in enumerate(zip(backward, known, strict=True))
            ]
            ends = [s.end if t is None else min(s.end, -t) for s, t in zip(spans, seen, strict=True)]
        known = list(zip(starts, ends, strict=True))
        laws = _learned(onward, known)
        # Beyond the amplitudes that it is learned from, a law may bend: what either law gives is no hand's.
        pushed = [
            _edge(w, laws, i, a, pushing=True) for i, (w, a) in enumerate(zip(onward, starts, strict=True))
        ]
        begins = [s.begin if t is None else t for s, t in zip(spans, pushed, strict=True)]
        torque = max(float(np.abs(w.acceleration).max(initial=0.0)) for w in onward)
        if laws and laws[0].noise < CLEAR * torque:
            break
    pushes = [begin - span.begin for begin, span in zip(begins, spans, strict=True) if begin > span.begin]
    usual = (
        float(np.median(pushes)) if pushes else 0.0
    )  # who pushes one deck has pushed the others, seen or not
    begins = [max(begin, span.begin + usual) for begin, span in zip(begins, spans, strict=True)]
    return [Span(a, max(a, b), s.rest) for s, a, b in zip(spans, begins, ends, strict=True)]


def _windows(time: Array, roll: Array, period: float, width: float) -> _Windows:
    """Put φ over a decay [s], [rad], from each sample on; none where it is shorter than φ."""
    step = float(time[1] - time[0]) if len(time) > 1 else period
    count = max(FEWEST, round(width * period / step))
    share, unit = (np.arange(count) + 0.5) / count, period / (2 * np.pi)
    weight = share * (1 - share) ** 3
    slope = (1 - share) ** 2 * (1 - 4 * share) * unit / (count * step)
    bend = 6 * (1 - share) * (2 * share - 1) * (unit / (count * step)) ** 2
    bend[0] -= bend.sum()
    if len(roll) < count:
        none = np.zeros(0)
        return _Windows(none, count * step, round(period / step), weight, np.zeros((0, 6)), none)

    def under(values: Array, kernel: Array) -> Array:
        return np.asarray(np.convolve(values, kernel[::-1] / weight.sum(), "valid"), dtype=np.float64)

    size = float(np.abs(roll).max()) or 1.0
    rate = np.gradient(roll, step) * unit
    shapes = (
        size * np.tanh(20 * rate / size),
        roll * abs(roll) / size,
        roll**3 / size**2,
        rate * abs(rate) / size,
    )
    table = [under(roll, weight), -under(roll, slope), *(under(shape, weight) for shape in shapes)]
    return _Windows(
        time=time[: len(roll) - count + 1], width=count * step, period=max(1, round(period / step)),
        weight=weight / weight.sum(), table=np.column_stack(table), acceleration=under(roll, bend),
    )  # fmt: skip


def _learned(windows: Sequence[_Windows], known: Sequence[tuple[float, float]]) -> list[_Law]:
    """Return a linear and a nonlinear law of the stretches [s] that are known to be free, the better one first.

    The nonlinear one alone where it leaves much less; none where there is too little to learn from.
    """
    inside = [one.inside(*stretch) for one, stretch in zip(windows, known, strict=True)]
    laws = [law for shapes in (2, 6) if (law := _fit(windows, inside, shapes)) is not None]
    if len(laws) == 2 and laws[1].noise < NONLINEAR * laws[0].noise:
        return laws[1:]
    return laws[:1] if len(laws) == 2 and laws[1].noise > NO_BETTER * laws[0].noise else laws


def _fit(windows: Sequence[_Windows], inside: Sequence[npt.NDArray[np.bool_]], shapes: int) -> _Law | None:
    """Fit a law to what lies inside, shape (m,) for each decay; None where that is too little, or says too little."""
    count = shapes + len(windows)
    tables = [_table(one, i, shapes, count) for i, one in enumerate(windows)]
    table = np.vstack([part[rows] for part, rows in zip(tables, inside, strict=True)])
    target = np.concatenate([one.acceleration[rows] for one, rows in zip(windows, inside, strict=True)])
    used = int(table.any(axis=0).sum())
    if len(target) < 2 * used + 4:
        return None
    scale = np.sqrt(np.mean(table**2, axis=0))
    scale[scale == 0] = np.inf
    left, values, right = np.linalg.svd(table / scale, full_matrices=False)
    kept = values > 1e-6 * values[0]
    spread = right[kept].T / values[kept] / scale[:, None]
    law = _Law(spread @ (left[:, kept].T @ target), spread, shapes)
    rest = [law.beyond(one, i)[0][rows] for i, (one, rows) in enumerate(zip(windows, inside, strict=True))]
    noise = float(np.sqrt(np.sum(np.concatenate(rest) ** 2) / (len(target) - used)))
    if noise > KNOWN * np.sqrt(np.mean(target**2)):
        return None
    return _Law(law.coefficients, spread, shapes, noise)


def _table(windows: _Windows, number: int, shapes: int, count: int) -> Array:
    """Return what a law of all decays makes of one of them, shape (m, count)."""
    table = np.zeros((len(windows.time), count))
    table[:, :shapes] = windows.table[:, :shapes]
    table[:, shapes + number] = 1.0
    return table


def _edge(
    windows: _Windows, laws: Sequence[_Law], number: int, free: float, *, pushing: bool = False
) -> float | None:
    """Return from when on a decay is free of a hand [s], followed back from when it surely is; None if none is seen.

    Args:
        windows: Of the decay.
        laws: Of the joint; what any of them gives is no hand's.
        number: Of the decay.
        free: When no hand is on the deck [s].
        pushing: Only a hand that holds the deck back is looked for: a stop only drives it faster.
    """
    last = int(np.searchsorted(windows.time, free))
    if last < 2 or not laws:
        return None
    beyond, std = np.array([law.beyond(windows, number) for law in laws])[:, :, :last].swapaxes(0, 1)
    least = np.argmin(np.abs(beyond) / std, axis=0), np.arange(last)
    torque, std = beyond[least], std[least]
    against = torque * np.sign(windows.table[0, 0]) if pushing else np.abs(torque)
    swing = np.hypot(windows.table[:, 0], windows.table[:, 1])
    beside = sliding_window_view(np.pad(swing, (0, windows.period - 1)), windows.period).max(axis=1)[:last]
    hand = np.flatnonzero((against > CERTAIN * std) & (against > FLOOR * swing[:last].max()))
    gone = np.flatnonzero(np.abs(torque) < GONE * std)
    gone = gone[gone > hand[-1]] if len(hand) else hand
    if not len(gone) or (pushing and hand[0] > 0):  # who holds a deck back has had it in hand from the first
        return None
    edge = int(gone[0])
    hand = hand[hand >= edge - windows.period]
    share = against[hand] / beside[hand]
    if pushing:  # φ feels it for as long as it acts: a short touch counts for little
        acted = edge - hand
        total = np.concatenate(([0.0], np.cumsum(windows.weight)))
        part, more = (
            total[np.minimum(acted + late, len(windows.weight))]
            for late in (0, round(UNSURE * windows.period))
        )
        share = (share / np.sqrt(part * more))[part >= part.max(initial=0.0) / 2]
    least, most = PUSH_SHARE if pushing else (CATCH, np.inf)
    if not least < np.max(share, initial=0.0) < most:
        return None
    return float(windows.time[edge] + MARGIN * windows.period * (windows.time[1] - windows.time[0]))
