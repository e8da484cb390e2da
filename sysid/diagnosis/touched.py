"""What of the releases is no free decay: without it a law holds, and with it none does.

A hand is told from a decay by the motion (`sysid.releases`), but what looks like one may be a hand's: at the beginnings, where
it pushed, at the ends, where it caught a deck that hardly swung any more, or in a whole release. Then no law whatever reaches
the noise, and one does without that. What the catalogue lacks acts in every swing: without the ends of the releases it is no nearer.
A board that changed before a release is no hand's: that is a decay by numbers of its own.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import ceil

import numpy as np

from sysid.diagnosis.judgement import TIE, Field, odds, rest_of
from sysid.diagnosis.search import Candidate, Search, promise
from sysid.diagnosis.workers import WorkerPool
from sysid.fitting.records import Record, make_records
from sysid.fitting.search import first_swings
from sysid.roll import Release

FEWEST = 3
"""Releases from which two agree against one."""
ASKED = 3
"""Single effects that are asked: a choice."""
REACHED, SHARE = 1.15, 0.1
"""Error up to which a law holds: over the noise, which may be more than is known of it, or over what all releases leave."""
BROKEN = 1.5
"""Error over that, or over the noise, from which no law holds."""
PUSHED = 0.35
"""Periods after its beginning in which a release may have been pushed: a push lasts for a third of one."""
CUTS = ((0.0, 1.0), (PUSHED / 2, 0.0), (PUSHED, 0.0), (PUSHED, 1.0))
"""Periods that are left out of each release after its beginning, and before the end of what moves.
Where equally simple models hold, the first counts. Of a deck that stops within two swings a long push leaves nothing: a short one is asked first."""
OF_A_PUSH = 2
"""Numbers that a hand has of its own in each release, at least: how hard it pushes, and until when."""
QUICK = 0.07
"""For which a push lasts at least, whatever the joint's period [s]: no arm is quicker."""
STILL = 0.1
"""Share of the largest swing below which a deck may be held still."""
FIRST = 1.25
"""Periods of each release to which a model is fitted first, and then to twice as many: in those no start is out of step yet."""
LEFT = 0.2
"""Share of the squared error beyond the noise that may be left without ends that held hands: of fourteen random logs, those with
hands kept at most 0.14, those whose law the catalogue lacks, and which were not at the noise, 0.4 or more."""
BEGUN = 12
"""Iterations after which a fit is left where it is if it does not promise enough: with six a gap that was fitted to a push was not back in step."""
TOLD = 2.0
"""Independent values that a law of tilt and rate shows in a period: a law with more numbers than those explains whatever is left of the releases."""
NEARLY = 1.05
"""Error of a model that is as good as the best, over that one's."""
DEGREE = 3
"""Of laws, at most: what is the evidence for one falls with so much a power of the motion's energy."""
SHORTEST, SAMPLES = 0.6, 24
"""Periods and samples of a release that is too short for a verdict."""


def untouched(
    models: Sequence[Candidate], base: Sequence[str], pool: WorkerPool, noise: float
) -> tuple[list[Release], str] | None:
    """Return the releases without what a hand has touched, and what was left out of them; None where a hand is nowhere.

    Args:
        models: Fitted to all releases; the best, the record's own and the best with one law more are asked. What holds for all
            by a law outside the catalogue was touched by no hand.
        base: Effects of the record.
        pool: Which fits them to what is left of the releases.
        noise: That a sensor may have, as it shows while a deck is held still, over the noise of the fits [1]: noise that lasts is more
            than shows from sample to sample.
    """
    reached = REACHED * noise
    releases = [record.release for record in models[0].problem.records]
    simple = sorted((m for m in models if _laws(m) == len(base) + 1), key=lambda m: m.cost)[:ASKED]
    simple += [m for m in models if _laws(m) == len(base)]
    best = min(models, key=_error)
    asked = list({id(model): model for model in [*simple, best]}.values())
    beyond = _error(best) ** 2 - 1
    if beyond > reached**2 - 1:
        found: list[tuple[bool, float, int, int, list[Release]]] = []
        parts = [[_middle(record, best, *cut) for record in best.problem.records] for cut in CUTS]
        middles = [[part for part in cut if part is not None] for cut in parts]
        enough = 1 + LEFT * beyond
        told = [[m for m in asked if len(m.problem.names) <= TOLD * _periods(kept, best)] for kept in middles]
        errors = [
            [_begun(pool, _error_on, m, kept, enough) for m in some]
            for some, kept in zip(told, middles, strict=True)
        ]
        for index, (kept, some, results) in enumerate(zip(middles, told, errors, strict=True)):
            if some:
                laws, error = _simplest([(_laws(m), e()) for m, e in zip(some, results, strict=True)])
                holds = error < reached
                # A release too short to be cut goes for a law only.
                if (holds or len(kept) == len(releases)) and error**2 - 1 < LEFT * beyond:
                    found.append(
                        (not holds, laws if holds else error, len(releases) - len(kept), index, kept)
                    )
        if found:
            # Fewest laws first: where a push is left in, one more may follow it; then what leaves no release out. Where none holds, the
            # first that is nearly the best.
            fails, least, short, *_ = min(found, key=lambda one: one[:4])
            index, kept = next(
                one[3:] for one in found
                if one[0] == fails and one[1] <= (NEARLY if fails else 1) * least and one[2] == short
            )  # fmt: skip
            where = " and ".join(
                name for name, length in zip(("beginnings", "ends"), CUTS[index], strict=True) if length
            )
            return (
                kept,
                f"the {where} of the releases are left out: no law holds there, as if a hand was on the deck",
            )
    odd = touched_release(simple, _error(best), pool, reached)
    if odd is None:
        return None
    return (
        [release for i, release in enumerate(releases) if i != odd],
        f"release {releases[odd].number} is left out: the others are by one law, and it is by none, as if a hand was on the deck",
    )


def seen_by_hands(
    search: Search, asked: Sequence[Candidate], tried: Field
) -> tuple[list[Release], str] | None:
    """Return the releases without their beginnings or ends, and why, if what is said to be missing shows there only; else None.

    What the joint has acts in every swing, a hand before the first and after the last. So what is missing must be told from what is
    simpler by the motion between, too, where enough of that is left: of a deck that stops within a swing nothing is.

    Args:
        search: That found the models.
        asked: What is said to be missing, then models that have less, the record's own among them.
        tried: In which they were judged.
    """
    if not asked:
        return None
    records = search.records
    # A law is doubted at the beginnings only if its state at each release is free by as many numbers as a push has, as a hanging body's is:
    # it follows any push. What was held still for a period was let go, not pushed.
    follows = asked[0].size - len(asked[0].problem.names) >= OF_A_PUSH * len(records)
    if follows and any(r.release.hold <= tried.period for r in records):
        middles = [_middle(record, asked[0], PUSHED, 0.0) for record in records]
        kept = _explained_by_less(search, asked, tried, middles, DEGREE)
        if kept is not None:
            text = "the beginnings of the releases are left out: what seems to be missing shows nowhere else, as if a hand was on the deck"
            if len({release.log for release in kept}) == 1:
                free = " ".join(f"--release {ceil(1e3 * release.start) / 1e3:g}" for release in kept)
                text += f". `fit` finds the spring and the damper of what is free with {free}"
            return kept, text
    # Friction stops a deck, and so does a hand. Who has caught it in motion once may have done so when it hardly swung any more.
    stops = [r.release.end == "rest" for r in records]
    if (
        asked[0].problem.structure.has_dry_friction
        and any(r.release.end == "caught" for r in records)
        and any(stops)
    ):
        middles = [
            _middle(record, asked[0], 0.0, 1.0) if stop else record.release
            for record, stop in zip(records, stops, strict=True)
        ]
        kept = _explained_by_less(search, asked, tried, middles, 0)
        if kept is not None:
            text = "where the deck came to rest is left out: what seems to be missing shows nowhere else, as if a hand had caught it"
            return kept, text
    return None


def _explained_by_less(
    search: Search, asked: Sequence[Candidate], tried: Field, middles: Sequence[Release | None], degree: int
) -> list[Release] | None:
    """Return the middles of the releases if less explains them, though what is missing would show there, too; else None.

    Args:
        search: That found the models.
        asked: What is said to be missing, then models that have less, the record's own among them.
        tried: In which they were judged.
        middles: Of each release; None where too little is left.
        degree: With which power of the motion's energy the evidence falls.
    """
    kept = [middle for middle in middles if middle is not None]
    if len(kept) < len(middles):
        return None
    records = make_records(kept, search.records[0].std, rate=search.records[0].is_rate)
    later = replace(search, records=records)
    after = Field(
        [later.finalist(_refitted_to(m, kept, np.inf)) for m in asked], search.base, tried.period, tried.floor
    )
    winner = after.winner()
    if _laws(winner.model) >= _laws(asked[0]) or (after.surely_missing and not after.explains(winner)):
        return None
    if odds(after.scored[0]) > odds(winner):  # what is missing is likelier by what is left, too
        return None
    said, less = (
        next(s for s in tried.scored if s.model.effects == m.effects and s.model.shape == m.shape)
        for m in (asked[0], winner.model)
    )
    left = _energy(records, asked[0]) / _energy(search.records, asked[0])
    return kept if (said.score - less.score) * left**degree >= TIE else None


def _energy(records: Sequence[Record], model: Candidate) -> float:
    """Return the sum of squares of a motion about its rest, without the noise, in units of the noise."""
    rest, std = rest_of(model), records[0].std
    return sum(float(np.sum(((record.signal - rest) / std) ** 2 - 1)) for record in records)


def _periods(releases: Sequence[Release], model: Candidate) -> float:
    """Return how many periods of a model some releases last, all together."""
    return sum(float(np.ptp(r.time)) for r in releases) * model.problem.scales.frequency / (2 * np.pi)


def _begun(
    pool: WorkerPool, function: Callable[..., float], model: Candidate, *more: object
) -> Callable[[], float]:
    """Begin a job on a model. A law outside the catalogue stays in this process: pickle takes what is no module's nowhere."""
    return (partial if model.shape else pool.begin)(function, model, *more)


def _simplest(models: Sequence[tuple[int, float]]) -> tuple[int, float]:
    """Return laws and error of the simplest model that is nearly as good as the best, of how many laws and what error each has."""
    least = min(error for _, error in models)
    return min(model for model in models if model[1] < NEARLY * least)


def _error_on(model: Candidate, releases: Sequence[Release], enough: float) -> float:
    """Return the error over the noise of a model that is fitted to parts of its releases, to the end if it promises less than `enough`, squared."""
    return _error(_refitted_to(model, releases, enough))


def _middle(record: Record, model: Candidate, begin: float, end: float) -> Release | None:
    """Return a release without some periods after its beginning and before the end of what moves; None if too little is left of it."""
    release, period = record.release, 2 * np.pi / model.problem.scales.frequency
    swing = np.abs(record.signal - np.median(record.signal[-max(8, len(record.signal) // 10) :]))
    wide = np.flatnonzero(swing > max(STILL * float(swing.max()), 5 * record.std))
    last = record.time[wide[-1]] - end * period if end and len(wide) else record.time[-1]
    time = release.time - release.time[0]
    first = max(begin * period, QUICK) if begin else 0.0
    inside = (time >= first) & (time <= last)
    if np.count_nonzero(inside) < SAMPLES or last - first < SHORTEST * period:
        return None
    return replace(release[inside], hold=0.0 if begin else release.hold, end="log" if end else release.end)


def _refitted_to(model: Candidate, releases: Sequence[Release], enough: float) -> Candidate:
    """Return a model fitted to parts of its releases.

    Args:
        model: Fitted to all of them.
        releases: The parts.
        enough: Squared error over the noise from which nobody asks how large it is: what does not promise less is left where it is.
    """
    problem = model.problem
    free = bool(problem.structure.internal_states) and any(release.hold <= 0 for release in releases)
    record = problem.records[0]
    part = problem.with_(
        records=make_records(releases, record.std, rate=record.is_rate),
        free_states=problem.free_states or free,
    )
    # What was fitted to a hand too is off, and soon out of step: the first swings bring it nearer.
    start = near = part.start(model.parameters)
    for periods in (FIRST, 2 * FIRST):
        early = part.with_(records=[first_swings(record, part.scales, periods) for record in part.records])
        near = early.fitted(near, 12, 1e-4).point
    begun = [part.fitted(one, BEGUN) for one in (start, near)]
    hopeful = [m for m in begun if 2 * promise(m) < enough * part.samples]
    ends = [part.fitted(m.point, 25 - BEGUN, known=m.normal) for m in hopeful] or begun
    return replace(model, problem=part, minimum=min(ends, key=lambda m: m.normal.cost))


def touched_release(
    simple: Sequence[Candidate], whole: float, pool: WorkerPool, reached: float
) -> int | None:
    """Return the index of the one release that is not by the law of all others, if there is one.

    Args:
        simple: Models that are asked.
        whole: Error over the noise of the best of all models.
        pool: Which fits them.
        reached: Error over the noise up to which a law holds.
    """
    count = len(simple[0].problem.records)
    if count < FEWEST or whole < BROKEN:
        return None
    results = [
        _begun(pool, _refitted, m, [i for i in range(count) if i != odd])
        for m in simple
        for odd in range(count)
    ]
    errors = np.array([result() for result in results]).reshape(len(simple), count)
    best, odd = (int(i) for i in np.unravel_index(np.argmin(errors), errors.shape))
    reached = max(reached, SHARE * whole)
    if errors[best, odd] > reached or _refitted(simple[best], [odd]) < BROKEN * reached:
        return None
    return odd


def _laws(model: Candidate) -> int:
    """Return how many laws a model has beside the linear joint's."""
    return len(model.effects) + bool(model.shape)


def _error(model: Candidate) -> float:
    """Return the error of a model over the noise."""
    return float(np.sqrt(model.cost / model.problem.samples))


def _refitted(model: Candidate, kept: Sequence[int]) -> float:
    """Return the error over the noise of a model that is fitted to some of its releases."""
    problem, start = model.problem.of(kept, model.minimum.point)
    return _error(replace(model, problem=problem, minimum=problem.fitted(start, 20)))
