"""Which release is no free decay: a law that holds for all the others cannot make it, and alone it cannot either.

A hand is told from a decay by the motion (`sysid.releases`), but what looks like one may be a hand's: then no law whatever
reaches the noise of all releases together. A board that changed before a release is none of it: that is a decay by numbers of its own.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.diagnosis.search import Candidate

FEWEST = 3
"""Releases from which two agree against one."""
ASKED = 3
"""Single effects that are asked: a choice."""
REACHED, SHARE = 1.15, 0.1
"""Error up to which a law holds: over the noise, which may be more than is known of it, or over what all releases leave."""
BROKEN = 1.5
"""Error over that, or over the noise, from which no law holds."""


def touched_release(models: Sequence[Candidate], base: Sequence[str]) -> int | None:
    """Return the index of the one release that is not by the law of all others, if there is one.

    Args:
        models: Fitted to all releases; the record's own and the best with one effect more are asked.
        base: Effects of the record.
    """
    simple = sorted((m for m in models if len(m.effects) == len(base) + 1), key=lambda m: m.cost)[:ASKED]
    simple += [m for m in models if m.effects == tuple(base)]
    count = len(simple[0].problem.records)
    whole = min(map(_error, models))
    if count < FEWEST or whole < BROKEN:
        return None
    errors = [[_refitted(m, [i for i in range(count) if i != odd]) for odd in range(count)] for m in simple]
    best, odd = np.unravel_index(int(np.argmin(errors)), (len(simple), count))
    reached = max(REACHED, SHARE * whole)
    if errors[best][odd] > reached or _refitted(simple[best], [int(odd)]) < BROKEN * reached:
        return None
    return int(odd)


def _error(model: Candidate) -> float:
    """Return the error of a model over the noise."""
    return float(np.sqrt(model.cost / model.problem.samples))


def _refitted(model: Candidate, kept: Sequence[int]) -> float:
    """Return the error over the noise of a model that is fitted to some of its releases."""
    problem, start = model.problem.of(kept, model.minimum.point)
    return _error(replace(model, problem=problem, minimum=problem.fitted(start, 20)))
