"""Which release is no free decay: a law that holds for all the others cannot make it, and alone it cannot either.

A hand is told from a decay by the motion (`sysid.releases`), but what looks like one may be a hand's: then no law whatever
reaches the noise of all releases together. A board that changed before a release is none of it: that is a decay by numbers of its own.
"""

from collections.abc import Sequence

import numpy as np

from sysid.diagnosis.search import Candidate
from sysid.least_squares import minimise

FEWEST = 3
"""Releases from which two agree against one."""
REACHED = 1.15
"""Error over the noise up to which a law holds."""
BROKEN = 1.5
"""Error over the noise from which none does."""


def touched_release(models: Sequence[Candidate], base: Sequence[str]) -> int | None:
    """Return the index of the one release that is not by the law of all others, if there is one.

    Args:
        models: Fitted to all releases; those with one effect beyond the record, at most, are asked.
        base: Effects of the record.
    """
    simple = sorted((m for m in models if len(m.effects) <= len(base) + 1), key=lambda m: m.cost)
    count = len(simple[0].problem.records)
    if count < FEWEST or min(map(_error, models)) < BROKEN:
        return None
    errors = [[_refitted(m, [i for i in range(count) if i != odd]) for odd in range(count)] for m in simple]
    best, odd = np.unravel_index(int(np.argmin(errors)), (len(simple), count))
    if errors[best][odd] > REACHED or _refitted(simple[best], [int(odd)]) < BROKEN:
        return None
    return int(odd)


def _error(model: Candidate) -> float:
    """Return the error of a model over the noise."""
    return float(np.sqrt(model.cost / model.problem.samples))


def _refitted(model: Candidate, kept: Sequence[int]) -> float:
    """Return the error over the noise of a model that is fitted to some of its releases."""
    problem = model.problem.with_(records=[model.problem.records[i] for i in kept])
    start = np.r_[
        model.minimum.point[: len(problem.names)], model.problem.own(model.minimum.point)[kept].ravel()
    ]
    found = minimise(problem.normal, start, *problem.bounds(), iterations=20, tolerance=problem.unnoticed)
    return float(np.sqrt(2 * found.normal.cost / problem.samples))
