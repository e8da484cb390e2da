"""Where a hand is on the deck at either end of a decay: there the deck does not move by the joint's law.

At the beginning: what nobody holds is pulled home in proportion to the way that it has to go, or harder where it is let go. So
a hand has left where that ratio has set in. What opens leaves the deck where it held it; a push has moved it on by then.

At the end: the law is learned from swings that are surely free, with time reversed, and the decay is followed from there to
the hand that catches it: a torque beyond that law, about as large as the joint's own, as it holds against it.

No rate and no acceleration is taken from the samples. The law ẍ = f(x, ẋ) is held against the motion in weak form, with
φ(t) = t (1 - t/w)³ over a width w from each sample on:

    ∫ φ ẍ dt = x(0) + ∫ φ̈ x dt,  ∫ φ ẋ dt = -∫ φ̇ x dt

A torque that ends δ after that sample counts with δ², as far as it has moved the deck, against the noise of about one sample.
Where the pull sets in, φ is a bump instead, which vanishes smoothly at both ends.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from sysid.releases.extrema import SmoothedSignal
from sysid.roll import Array

FINE = 48
"""Samples a period that are looked at, of more: the signal is smooth over that many."""
FEWEST_UNDER_BUMP = 8
"""Samples under φ."""
WIDTHS = (0.75, 1.5)
"""Of φ, in periods: the narrow one sees a hand to its last touch, the wide one a hand on a deck that hardly swings any more."""
BUMPS = (0.25, 0.35, 0.5)
"""Widths of the bump, in periods: the first under which the median noise is below `DIM` of the largest pull."""
DIM = 0.12
TREMOR = 0.03
"""Share of its way to rest up to which a hand that holds a deck moves it: a choice."""
NEARLY = 0.7
"""Share of its way to rest after which nobody pushes a deck."""
RISEN = 0.7
"""Share of the largest ratio of pull and way at which it has set in: under a hand it is less."""
LATE, SCATTER = 0.02, 1.0
"""Periods after the deck left its hold at which its pull sets in, from which on it was pushed, and how much more for each share of
its way that the noise is, or that it was off its hold before: its joint pulls a deck that is let go at once. Measured on 456 random logs:
99 % of those let go from rest are below, 99 % of those pushed above. A push that is missed is taken for another effect; one that was
none costs a tenth of a period."""
HELD = 0.3
"""Share of its way to rest within which a deck stays that is held."""
PUSH = 0.75
"""A hand has left this many periods after the deck left its hold: what follows is free."""
LEARNED = (2.0, 5.0, np.inf)
"""Periods from then on from which the law is learned, in turn, each as far as no hand was seen before."""
BEFORE_NEXT = 0.3
"""Periods after the end of a decay that are looked at too: a hand is seen by what it does next."""
KNOWN = 0.1
"""Share of the torque that a law may leave: what was learned where hardly anything moved says nothing of a wide swing."""
STOPPED = 0.5
"""Share of its swing in the period before a hand up to which a deck moves in the period after it, where that has stopped it."""
CERTAIN, GONE = 4.5, 1.5
"""Standard deviations over which a torque is none of the law's, and under which it is gone."""
ROUGH = 0.02
"""Share of the swing by which a law that few swings have taught may be off in others, however little noise there is: what it
leaves there must not hide a hand that comes later."""
CATCHING = 4.0
"""Periods before the end of a decay in which such a hand is looked for: so long does a hand take at most to catch a deck. What is
as far from the law for longer is a joint that is not linear: it sticks, or is loose, near its rest. Of 1,200 random logs those whose
hand had been missed had it 0.5 to 3.4 periods before the end, those that had none would have been cut 5 to 16 before, one 2."""
SWINGS_ON = 4
"""Swings that follow on what no hand has stopped."""
HALTED, DRIVEN = 0.4, 1.5
"""How many times as long as the swing before it the next one is where a hand has stopped the deck, at most, and where it drives it, at least.
Of 1,400 random logs in three with a hand the next one was 0.16 to 0.27 times as long, in twelve without 0.6 to 1.2 times."""
STEADY = (0.5, 2.0)
"""What is left of a swing after the period that follows on what may be a hand, over what was left after the one before it, between which the deck
decays on: a hand brakes it, or drives it. Of 643 that were seen in 243 random logs, and had as many swings behind them, eight in free
decays had 1.0 to 1.5 and three others 0.1 to 0.3."""
FLOOR = 0.01
"""Share of the largest swing below which no torque is told from the wandering of a sensor's zero."""
CATCH = 0.25
"""Share of the joint's torque that a hand has at least which catches the deck, or holds it off its rest."""
NONLINEAR = 0.75
"""Share of what a linear law leaves below which a nonlinear one is taken."""
MARGIN = 0.04
"""Periods that are left out beside a hand, as its last touch is below the noise."""


@dataclass(frozen=True, slots=True)
class Span:
    """A free decay, from when until when."""

    begin: float
    """[s]"""
    end: float
    """[s]"""
    rest: float
    """[rad]"""
    level: float
    """Where it was held [rad]."""
    swings: tuple[tuple[float, float], ...] = ()
    """When each of its swings ends [s], and how long its way was [rad]."""


@dataclass(frozen=True, slots=True)
class _Windows:
    """One decay under φ from each of its samples on; torques in units of the joint's stiffness [rad]."""

    time: Array
    """First sample of each [s], shape (m,)."""
    width: float
    """[s]"""
    period: int
    """In samples."""
    table: Array
    """Roll, rate, and what a nonlinear law adds, shape (m, 6)."""
    acceleration: Array
    """Shape (m,)."""

    def inside(self, begin: float, end: float) -> npt.NDArray[np.bool_]:
        """Return which lie wholly in a stretch [s], shape (m,)."""
        return (self.time >= begin) & (self.time + self.width <= end)

    def breaks(self, torque: Array, end: float) -> Array:
        """Return by how much a torque is off its mean in the period after it, up to an end [s], shape (m,).

        A zero that wanders is no hand.
        """
        total = np.concatenate([[0.0], np.cumsum(torque)])
        last = max(1, int(np.searchsorted(self.time, end - self.width, "right")))
        stop = np.minimum(np.arange(len(torque)) + self.period, min(last, len(torque)))
        begin = np.maximum(stop - self.period, 0)
        return torque - (total[stop] - total[begin]) / (stop - begin)


@dataclass(frozen=True, slots=True)
class _Law:
    """What moves the joint: coefficients of a decay's table, and a level for each decay."""

    coefficients: Array
    spread: Array
    """Square root of their covariance over that of the noise."""
    shapes: int
    """How many columns of the table it has."""
    ends: Sequence[float]
    """Until when each decay is known to be free [s]."""
    noise: float = 0.0
    """Standard deviation of what it leaves [rad]."""
    still: float = 0.0
    """The same where the deck hardly swings [rad]; the rest of it follows the swing."""
    swing: float = 1.0
    """RMS swing of what it was learned from [rad]."""

    def about(self, windows: _Windows, number: int) -> Array:
        """Return how wide a decay swings about its own level [rad], shape (m,)."""
        level = self.coefficients[self.shapes + number] / (self.coefficients[0] or -1.0)
        return np.hypot(windows.table[:, 0] + level, windows.table[:, 1])

    def beyond(self, windows: _Windows, number: int) -> tuple[Array, Array]:
        """Return the torque beyond the law of one decay, and its standard deviation [rad], shape (m,) each."""
        table = _table(windows, number, self.shapes, len(self.coefficients))
        follows = (
            np.maximum(self.noise**2 - self.still**2, 0.0) * (self.about(windows, number) / self.swing) ** 2
        )
        unsure = self.noise**2 * np.sum((table @ self.spread) ** 2, axis=1)
        torque = windows.breaks(windows.acceleration - table @ self.coefficients, self.ends[number])
        return torque, np.sqrt(self.still**2 + follows + unsure)


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
    begins = _let_go(signal, spans, period)
    starts = [span.begin + PUSH * period for span in spans]
    found = [span.end for span in spans]
    for width in WIDTHS:
        ends = found
        backward = [
            _windows(-time[c][::-1], roll[c][::-1] - s.rest, period, width)
            for c, s in zip(cuts, spans, strict=True)
        ]
        for reach in LEARNED:
            known = [(a, min(b, a + reach * period)) for a, b in zip(starts, ends, strict=True)]
            law = _learned(backward, [(-b, -a) for a, b in known])
            if law is None:
                # Nothing follows the whole: what a law of the widest swings has seen was a hand if the deck then stands.
                ends = [
                    end if _stands(time, roll, end, period) else b for end, b in zip(ends, found, strict=True)
                ]
                continue
            hands = [
                _hand(w, law, i, w.width - b, s.swings)
                for i, (w, (_, b), s) in enumerate(zip(backward, known, spans, strict=True))
            ]
            ends = [b if t is None else min(b, -t) for b, t in zip(found, hands, strict=True)]
        found = ends
    return [Span(a, max(a, b), s.rest, s.level) for s, a, b in zip(spans, begins, found, strict=True)]


def _stands(time: Array, roll: Array, end: float, period: float) -> bool:
    """Whether a deck that swung in the period before a time [s] hardly moves in the one after it."""
    before, now, after = (int(i) for i in np.searchsorted(time, end + period * np.array([-1, 0.5, 1.5])))
    middle = int(np.searchsorted(time, end))
    return bool(after - now > 1 and np.ptp(roll[now:after]) < STOPPED * np.ptp(roll[before:middle]))


def _let_go(signal: SmoothedSignal, spans: Sequence[Span], period: float) -> list[float]:
    """Return when each deck was let go [s]: where a hand pushed it on its way, when that had left.

    Who pushes one deck has pushed the others, and about as long: where a joint that is loose or sticks pulls less than the hand does,
    the hand's push looks like its pull.
    """
    seen = [_pull_sets_in(signal, span, period) for span in spans]
    late = [
        (one[0] - one[1] - span.begin) / period
        - SCATTER * (signal.noise / abs(span.level - span.rest) + one[2])
        for one, span in zip(seen, spans, strict=True)
        if one
    ]
    if not late or np.mean(late) < LATE:
        return [span.begin for span in spans]
    moves = [_moves(signal, span) for span in spans]
    longest = max(one[0] - begin for one, begin in zip(seen, moves, strict=True) if one)
    # Between the last sample that a hand moved and the next one, it may still have been there.
    margin = MARGIN * period + float(signal.time[1] - signal.time[0])
    return [begin + longest + margin for begin in moves]


def _moves(signal: SmoothedSignal, span: Span) -> float:
    """Return when a deck is last seen where it was held [s]."""
    way = (signal.roll - span.level) / (span.rest - span.level)
    gone = int(np.argmax((signal.time > span.begin) & (way > NEARLY)))
    there = np.flatnonzero(np.abs(way[:gone]) <= max(TREMOR, 3 * signal.noise / abs(span.rest - span.level)))
    return float(signal.time[there[-1]]) if len(there) else span.begin


def _pull_sets_in(signal: SmoothedSignal, span: Span, period: float) -> tuple[float, float, float] | None:
    """Return when a deck is surely pulled home by its joint alone, how long that takes to be seen [s], and how far off its hold it was before.

    The latter as a share of its way to rest. None where nothing is seen of a hold, or too much noise.
    """
    time, step = signal.time, float(signal.time[1] - signal.time[0])
    times = span.begin + PUSH * period * np.array([-2, -1, 0, 1])
    first, held, onset, last = (int(i) for i in np.searchsorted(time, times))
    if held - first < 2:
        return None
    way = (signal.roll - span.level) / (span.rest - span.level)
    last = int(onset + np.flatnonzero(np.append(way[onset:last], 1.0) > NEARLY)[0])
    for width in BUMPS:
        count = max(FEWEST_UNDER_BUMP // 2, round(width * period / step))
        share = np.arange(1, count + 1) / (count + 1)
        bump = (share * (1 - share)) ** 3
        bump /= bump.sum()
        bend: Array = np.diff(np.pad(bump, 2), 2)
        part = way[first : last + count]
        pull = np.convolve(part, bend, "valid")
        left = 1 - np.convolve(part[1:-1], bump, "valid")
        ratio = pull / np.maximum(left, 1 - NEARLY)
        peak = int(np.argmax(np.append(np.zeros(held - first), ratio[held - first :])))
        if peak and np.median(np.abs(pull[: held - first])) < DIM * pull[peak]:
            break
    else:
        return None
    low = np.flatnonzero(ratio[:peak] < RISEN * ratio[peak])
    off = abs(float(np.median(way[first:held])))
    if not len(low) or off > HELD:
        return None
    i = int(low[-1])
    rise = (RISEN * ratio[peak] - ratio[i]) / (ratio[i + 1] - ratio[i])
    gone = float(time[first]) + (i + rise + (count + 1) / 2) * step
    # It has risen so far a tenth of the bump's width later, or between two samples.
    return gone, 0.1 * (count + 1) * step + 0.5 * step, off


def _windows(time: Array, roll: Array, period: float, width: float) -> _Windows:
    """Put φ over a decay [s], [rad], from each sample on; none where it is shorter than φ."""
    step = float(time[1] - time[0]) if len(time) > 1 else period
    count = max(FEWEST_UNDER_BUMP, round(width * period / step))
    share, unit = (np.arange(count) + 0.5) / count, period / (2 * np.pi)
    weight = share * (1 - share) ** 3
    slope = (1 - share) ** 2 * (1 - 4 * share) * unit / (count * step)
    bend = 6 * (1 - share) * (2 * share - 1) * (unit / (count * step)) ** 2
    bend[0] -= bend.sum()
    if len(roll) < count:
        none = np.zeros(0)
        return _Windows(none, count * step, round(period / step), np.zeros((0, 6)), none)

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
        table=np.column_stack(table), acceleration=under(roll, bend),
    )  # fmt: skip


def _learned(windows: Sequence[_Windows], known: Sequence[tuple[float, float]]) -> _Law | None:
    """Return the law of the stretches [s] that are known to be free: linear, or nonlinear where that leaves much less."""
    inside = [one.inside(*stretch) for one, stretch in zip(windows, known, strict=True)]
    ends = [end for _, end in known]
    straight, bent = (_fit(windows, inside, ends, shapes) for shapes in (2, 6))
    if straight is None or (bent is not None and bent.noise < NONLINEAR * straight.noise):
        return bent
    return straight


def _fit(
    windows: Sequence[_Windows], inside: Sequence[npt.NDArray[np.bool_]], ends: Sequence[float], shapes: int
) -> _Law | None:
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
    law = _Law(spread @ (left[:, kept].T @ target), spread, shapes, ends)
    each = list(enumerate(zip(windows, inside, strict=True)))
    rest = np.concatenate([law.beyond(one, i)[0][rows] for i, (one, rows) in each])
    swing = np.concatenate([law.about(one, i)[rows] for i, (one, rows) in each])
    noise = float(np.sqrt(np.sum(rest**2) / (len(target) - used)))
    still = min(noise, float(np.sqrt(np.mean(rest[swing <= np.quantile(swing, 0.3)] ** 2))))
    if noise > KNOWN * np.sqrt(np.mean(target**2)):
        return None
    return replace(law, noise=noise, still=still, swing=float(np.sqrt(np.mean(swing**2))))


def _table(windows: _Windows, number: int, shapes: int, count: int) -> Array:
    """Return what a law of all decays makes of one of them, shape (m, count)."""
    table = np.zeros((len(windows.time), count))
    table[:, :shapes] = windows.table[:, :shapes]
    table[:, shapes + number] = 1.0
    return table


def _hand(
    windows: _Windows, law: _Law | None, number: int, free: float, swings: Sequence[tuple[float, float]]
) -> float | None:
    """Return from when on a decay is free of a hand [s], followed back from when it surely is; None if none is seen.

    Args:
        windows: Of the decay, with time reversed.
        law: Of the joint.
        number: Of the decay.
        free: When no hand is on the deck [s].
        swings: When each of its swings ends, in the log's time [s], and how long it was [rad].
    """
    last = int(np.searchsorted(windows.time, free))
    if last < 2 or law is None:
        return None
    torque, std = (values[:last] for values in law.beyond(windows, number))
    swing = law.about(windows, number)
    beside = sliding_window_view(np.pad(swing, (0, windows.period - 1)), windows.period).max(axis=1)[:last]
    size = np.abs(torque)
    step = windows.time[1] - windows.time[0]
    for rough in (0.0, ROUGH):
        off = np.hypot(std, rough * swing[:last])
        hand = np.flatnonzero((size > CERTAIN * off) & (size > FLOOR * swing[:last].max()))
        gone = np.flatnonzero(size < GONE * off)
        gone = gone[gone > hand[-1]] if len(hand) else hand
        if len(gone):
            edge = int(gone[0])
            hand = hand[hand >= edge - windows.period]
            late = edge <= CATCHING * windows.period
            share = np.max(size[hand] / beside[hand], initial=0.0)
            when = -windows.time[edge]
            kept_on = _decays_on(swings, when) or (not late and (rough or _swings_on(swings, when)))
            if share >= CATCH and not kept_on:
                return float(windows.time[edge] + MARGIN * windows.period * step)
    return None


def _decays_on(swings: Sequence[tuple[float, float]], time: float) -> bool:
    """Whether a deck loses as much in the period after some time as in the one before it, and swings on.

    Args:
        swings: When each ends [s], and how long it was [rad].
        time: Of what may be a hand [s].
    """
    before, after = ([size for end, size in swings if (end > time) == later] for later in (False, True))
    if len(before) < 3 or len(after) < SWINGS_ON:
        return False
    return STEADY[0] < (after[1] / before[-1]) / (before[-1] / before[-3]) < STEADY[1]


def _swings_on(swings: Sequence[tuple[float, float]], time: float) -> bool:
    """Whether a deck swings on after some time [s] as if no hand had stopped or driven it then.

    Args:
        swings: When each ends [s], and how long it was [rad].
        time: Of what may be a hand [s].
    """
    before, after = ([size for end, size in swings if (end > time) == later] for later in (False, True))
    last = (before or after or [0.0])[-1]
    return len(after) >= SWINGS_ON and after[0] > HALTED * last and max(after) < DRIVEN * last
