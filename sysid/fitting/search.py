"""The parameter search: starting values, scales, and a search that is robust to rough costs."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sysid.board import Board
from sysid.effects._base import Scales
from sysid.errors import SysidError
from sysid.fitting.problem import Problem
from sysid.fitting.records import Record, measured_rest
from sysid.joint.structure import Structure
from sysid.least_squares import Minimum, minimise
from sysid.progress import stage, steps
from sysid.roll import Array

_PERIODS = 4.0
"""Periods of each release that are searched before the whole. Each search before looks at half as many, down to half a swing. A stop that
is hit in each swing decides when the next one begins, so the cost of all swings at once has many local minima."""
_MET = 0.001
"""Cost of going from one search's end to another's, over the cost there, up to which they have met: a choice."""
_BEHIND = 2.0
"""Ratio of the cost of first swings to the least one above which a start is given up [1]. In 377 searches of foreign and real logs the
best start was below it, except for three laws at thirty times the noise."""
_SCOUTS = 3
"""Releases from which the sizes of a problem are found, and in whose first swings starts are ranked: a choice of time."""


def scales_of(records: Sequence[Record], board: Board) -> Scales:
    """Return the sizes of the problem: stiffness and damping are those of the linear joint that fits the widest releases best.

    Each release has a zero of its own, so a sensor that drifts from one to the next does not change the stiffness.
    """
    spans = [float(np.ptp(r.release.roll)) for r in records]
    known = Scales(
        inertia=board.inertia.value, stiffness=board.stiffness, damping=board.damping,
        amplitude=max(max(spans) / 1.6, 1e-4), duration=max(float(r.time[-1]) for r in records),
    )  # fmt: skip
    records = [records[i] for i in sorted(np.argsort(spans)[-_SCOUTS:])]
    fixed = {"rest_angle": measured_rest(records)}
    guesses = (
        [(known.stiffness / known.inertia, known.damping / known.inertia)] if known.stiffness > 0 else []
    )
    guesses += [guess for record in records if (guess := linear_guess(record)) is not None]
    pitch = _pitch(max(records, key=lambda record: len(record.time)))
    guesses += [(pitch**2, 2 * ratio * pitch) for ratio in (0.03, 0.15)]
    best: tuple[float, Scales] | None = None
    for square, decay in guesses:
        rough = replace(known, stiffness=known.inertia * square, damping=known.inertia * decay)
        problem = Problem(Structure(), records, rough, bias="per-release", fixed=fixed, steps_per_period=30)
        start = problem.start({"stiffness": rough.stiffness, "damping": rough.damping})
        minimum = problem.fitted(start, 25, 1e-7)
        found = problem.parameters(minimum.point)
        if found["stiffness"] <= 0:
            continue
        if best is None or minimum.normal.cost < best[0]:
            scale = replace(rough, stiffness=found["stiffness"], damping=found["damping"])
            best = minimum.normal.cost, scale
    if best is None:
        raise SysidError(
            "the releases do not swing about a rest angle, so no stiffness can be found. "
            "Check the column and the sign of the roll."
        )
    return best[1]


def _pitch(record: Record) -> float:
    """Return the frequency at which a record has the most power [rad/s]: a start where integrals of it mislead."""
    signal = record.signal - np.mean(record.signal)
    size = 8 * len(signal)
    step = float(np.median(np.diff(record.time)))
    power = np.abs(np.fft.rfft(signal * np.hanning(2 * len(signal))[len(signal) :], size))
    return float(2 * np.pi * max(1, int(np.argmax(power))) / (size * step))


def linear_guess(record: Record) -> tuple[float, float] | None:
    """Return (k/I, d/I) of a release by regression on its running integrals, or None if k is negative.

    The equation φ(t) = φ₀ + v₀ t +
    (k/I) x₀ t²/2 - (k/I) ∬φ - (d/I) (∫φ - φ₀ t) is linear in its unknowns. Noise in the regressors biases it: it is a start only.
    """
    t, y = record.time, record.signal
    step = np.diff(t, prepend=t[0])
    once = np.cumsum(step * y)
    twice = np.cumsum(step * once)
    if record.is_rate:
        # The same equation, differentiated once.
        table = np.column_stack([np.ones_like(t), t, once, twice])
    else:
        table = np.column_stack([np.ones_like(t), t, t**2, once, twice])
    scale = np.maximum(np.abs(table).max(axis=0), 1e-300)
    solution = np.linalg.lstsq(table / scale, y, rcond=None)[0] / scale
    decay, square = -float(solution[-2]), -float(solution[-1])
    return (square, max(decay, 0.0)) if square > 0 else None


def starting_points(
    structure: Structure, scales: Scales, fixed: Mapping[str, float] | None = None, *, most: int = 12
) -> list[dict[str, float]]:
    """Return the starts from which a structure is searched: all combinations of its parameters' starts."""
    held = fixed or {}
    linear = {"stiffness": scales.stiffness, "damping": max(scales.damping, 0.0), "rest_angle": 0.0}
    starts = [
        [(f"{part.name}.{p.name}", start * p.size(scales)) for start in p.starts]
        for part in structure.parts
        for p in part.parameters
    ]
    points: list[dict[str, float]] = []
    for choice in itertools.islice(itertools.product(*starts), most):
        point = {**linear, **dict(choice)}
        # The spring makes up for the stiffness of the other parts.
        for part in structure.supports:
            point["stiffness"] *= 1.0 / (
                1.0 - linear["stiffness"] / point[f"{part.name}.{part.series_stiffness}"]
            )
        at, pulling, dragged = held.get("rest_angle", 0.0), held.get("stiffness", 0.0), 0.0
        for part in structure.torques:
            own = {p: held.get(f"{part.name}.{p}", point[f"{part.name}.{p}"]) for p in part.parameter_names}
            added = part.stiffness_at(at, own)
            pulling += added
            dragged += part.dragged_stiffness(scales.amplitude, linear["stiffness"], own)
            point["stiffness"] -= min(added, 0.98 * linear["stiffness"])
            if "stiffness" in held and part.adds_stiffness:  # a spring that is held leaves it the rest
                point[f"{part.name}.{part.adds_stiffness}"] = linear["stiffness"] - held["stiffness"]
        for part in structure.torques:  # what pulls is known, so the frequency says the inertia
            if part.adds_inertia and "stiffness" in held and pulling > 0:
                more = max(pulling / scales.frequency**2 - scales.inertia, -0.9 * scales.inertia)
                point[f"{part.name}.{part.adds_inertia}"] = more
        points.append(point)
        if dragged > 0:  # wide swings may be carried by it, or let it yield soon
            points.append(
                {**point, "stiffness": max(point["stiffness"] - dragged, 0.02 * linear["stiffness"])}
            )
    if structure.has_dry_friction:
        # The linear fit gave the damper all of the loss; dry friction takes more than half of that, or less.
        points = [
            {**point, "damping": share * point["damping"]} for share in (3 / 4, 1 / 4) for point in points
        ]
    return points


def search(fine: Problem, starts: Sequence[Mapping[str, float]]) -> tuple[Minimum, int]:
    """Find the best parameters: many short searches on a coarse grid, the best ones finely.

    Dry friction makes the cost rough, because it decides in which half swing the joint stops. So the search begins with the first
    swings, and the rest follows when the parameters are nearly right.

    Returns:
        The minimum, and the number of evaluations.
    """
    structure, records = fine.structure, fine.records
    kept = scouts(records) if structure.effects else range(len(records))
    coarse_steps = min(60 if structure.nonsmooth else 24, fine.steps_per_period)
    coarse = fine
    if coarse_steps < fine.steps_per_period or len(kept) < len(records):
        coarse = fine.with_(records=[records[i] for i in kept], steps_per_period=coarse_steps)
    rest = measured_rest(records)
    points = [coarse.start({**start, "rest_angle": start.get("rest_angle") or rest}) for start in starts]
    with stage(0.0, 0.3):
        points, evaluations = _of_first_swings(coarse, points)
    with stage(0.3, 0.5):
        whole = [coarse.fitted(point, 15, 1e-5) for point in steps(points)]
    evaluations += sum(minimum.evaluations for minimum in whole)
    found = sorted(((m.normal.cost, m.point) for m in whole), key=lambda item: item[0])
    with stage(0.5, 0.7):
        found[0] = scan_rough_parameters(coarse, _restarted(coarse, found[0]))
    # On the coarse grid a kink falls between two points, so its costs rank neighbours only roughly.
    most, near = (4, 3.0) if structure.nonsmooth else (2, 1.2)

    def expanded(point: Array) -> Array:
        """Return the unknowns of all records, with those of the searched ones in their place."""
        shared = len(fine.names)
        start = np.r_[point[:shared], fine.start(coarse.parameters(point))[shared:]]
        fine.own(start)[kept] = coarse.own(point)
        return start

    with stage(0.7, 1.0):
        ends = [
            fine.fitted(expanded(point), tolerance=1e-7)
            for cost, point in steps(found[:most])
            if cost <= near * found[0][0] or cost == found[0][0]
        ]
    best = min(ends, key=lambda minimum: minimum.normal.cost)
    return best, evaluations + sum(end.evaluations for end in ends)


def _of_first_swings(coarse: Problem, points: list[Array]) -> tuple[list[Array], int]:
    """Return the points that searches of the first swings reach, the best first, and the number of evaluations."""
    structure, evaluations = coarse.structure, 0
    halvings = () if not structure.effects else (3, 2, 1, 0) if structure.nonsmooth else (1, 0)
    acting = [place for place, name in enumerate(coarse.names) if "." in name]
    for number, halving in enumerate(steps(halvings)):
        periods = _PERIODS / 2**halving
        problem = coarse.with_(records=[first_swings(one, coarse.scales, periods) for one in coarse.records])
        ends: list[Minimum] = []
        for point in points:
            tried = [point]
            if structure.nonsmooth and number == 0:
                # No descent leads back from where a slider never slips or a stop is never met: let the joint come first.
                joint = _pinned(problem, point, acting)
                evaluations += joint.evaluations
                tried.append(joint.point)
            firsts = [problem.fitted(one, 12, 1e-4) for one in tried]
            evaluations += sum(first.evaluations for first in firsts)
            ends.append(min(firsts, key=lambda m: m.normal.cost))
        apart = _apart(ends)
        enough = _BEHIND * apart[0].normal.cost if number == len(halvings) - 1 else np.inf
        points = [end.point for end in apart if end.normal.cost <= enough]
    return points, evaluations


def _apart(ends: Sequence[Minimum]) -> list[Minimum]:
    """Return where searches ended, the best first, without those that the cost does not tell from a better one: from there all goes the same way."""
    kept: list[Minimum] = []
    for end in sorted(ends, key=lambda m: m.normal.cost):
        away = [(end.point - other.point, other.normal) for other in kept]
        if not any(0.5 * float(off @ there.hessian @ off) <= _MET * there.cost for off, there in away):
            kept.append(end)
    return kept


_STRIDE = 1.2
"""Ratio of two places at which a rough parameter is held on the way out of a false valley, three to each side: a choice."""


def scan_rough_parameters(problem: Problem, found: tuple[float, Array]) -> tuple[float, Array]:
    """Walk along rough parameters out of a false valley: hold one elsewhere, let the rest follow, then free it.

    The cost is rough along a friction, because it decides in which half swing each release stops. A descent ends in a local minimum; a
    walk that fits all other parameters again does not. At the noise there is nothing to gain.

    Args:
        found: Cost [1] and unknowns in units of their sizes, shape (p,).

    Returns:
        The best cost and unknowns met, likewise.
    """
    low, high = problem.bounds()
    for index in [problem.names.index(name) for name in problem.structure.rough if name in problem.names]:
        for _ in range(4):
            if found[0] < 0.55 * problem.samples:
                return found
            best = found
            for strides in (-3, -2, -1, 1, 2, 3):
                aside = found[1].copy()
                aside[index] = np.clip(aside[index] * _STRIDE**strides, low[index], high[index])
                held = _pinned(problem, aside, [index])
                if held.normal.cost < found[0]:
                    freed = problem.fitted(held.point, 12, 1e-4)
                    best = min(best, (freed.normal.cost, freed.point), key=lambda item: item[0])
            if best[0] > 0.98 * found[0]:
                break
            found = best
    return found


def _pinned(problem: Problem, point: Array, places: Sequence[int]) -> Minimum:
    """Return where a short search ends that leaves some of the unknowns where they are."""
    low, high = problem.bounds()
    low[places] = high[places] = point[places]
    return minimise(problem.normal, point, low, high, iterations=8, tolerance=1e-3, abandons=True)


def _restarted(problem: Problem, found: tuple[float, Array]) -> tuple[float, Array]:
    """Search again from where effects say that a search which ended there has to."""
    best = found
    for part in problem.structure.torques:
        names = [f"{part.name}.{name}" for name in part.parameter_names]
        if part.restarts is None or any(name not in problem.names for name in names):
            continue
        where = [problem.names.index(name) for name in names]
        for start in part.restarts(part.named([float(value) for value in found[1][where]])):
            point = found[1].copy()
            point[where] = [start[name] for name in part.parameter_names]
            again = problem.fitted(point, 15, 1e-5)
            best = min(best, (again.normal.cost, again.point), key=lambda item: item[0])
    return best


def lengthened(problem: Problem, point: Array) -> Array:
    """Return where searches of ever longer beginnings of all records lead, each twice as long, short of the whole.

    The cost of a long motion has local minima and steep sides; that of its first swings is smooth (Ribeiro et al., Automatica 121, 2020).

    Args:
        problem: All records.
        point: Its unknowns, in units of their sizes, shape (p,).
    """
    whole = max(float(record.time[-1]) for record in problem.records) * problem.scales.frequency / (2 * np.pi)
    periods, held = 1.0, range(len(problem.names))
    while periods < whole:
        part = problem.with_(records=[first_swings(one, problem.scales, periods) for one in problem.records])
        point = _pinned(part, point, held).point if periods < _PERIODS else part.fitted(point, 12, 1e-4).point
        periods *= 2
    return point


def scouts(records: Sequence[Record]) -> list[int]:
    """Return which records starts are ranked by: of many the widest, the smallest and what lies between, in their order."""
    order = np.argsort([-float(np.ptp(record.signal)) for record in records], kind="stable")
    picked = np.linspace(0, len(records) - 1, min(_SCOUTS, len(records))).astype(int)
    return sorted(int(i) for i in order[picked])


def first_swings(record: Record, scales: Scales, periods: float) -> Record:
    """Return the beginning of a record."""
    end = int(np.searchsorted(record.time, periods * 2 * np.pi / scales.frequency))
    end = max(end, min(30, len(record.time)))
    return replace(record, time=record.time[:end], signal=record.signal[:end])
