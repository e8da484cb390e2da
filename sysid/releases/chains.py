"""Chains of shrinking legs: the skeletons of free decays, told from what a hand does.

A free decay is a chain of legs between turning points, each shorter than the one before, about one and
the same rest angle and at one and the same pace. A hand that lifts the deck moves away from that angle,
at another pace, or makes legs that grow.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from sysid.errors import HuskyError
from sysid.releases.extrema import Leg, Swing

SMALLEST_RELEASE = 0.08
"""Chains below this share of the largest one's first leg are not counted as releases."""
SMALLEST_OF_LOG = 0.12
"""Nor are they where the largest one's first leg is below this share of the log's whole range."""


@dataclass(frozen=True, slots=True)
class Chain:
    """Successive legs that shrink: the skeleton of one free decay."""

    legs: tuple[Leg, ...]
    rest: float
    settles: bool
    """Whether the deck stays, or moves less than can be told, after the last leg."""
    after: Leg | None
    """The leg that breaks the chain: a hand moves the deck again."""
    start: float | None = None
    """Time of the release [s] where the user gave it."""

    @property
    def pace(self) -> float:
        """10 to 90 % time of a leg [s]."""
        return float(np.median([leg.duration for leg in self.legs[:4]]))

    @property
    def sizes(self) -> list[float]:
        """Amplitudes about rest at the turning points [rad]."""
        return [abs(self.legs[0].origin - self.rest), *(abs(leg.target - self.rest) for leg in self.legs)]


def free_chains(swing: Swing, legs: list[Leg]) -> list[Chain]:
    """Return the chains that share one rest angle and one pace."""
    chains = _shrinking_chains(swing, legs)
    if not chains:
        return []
    largest = max(chain.legs[0].size for chain in chains)
    if largest < SMALLEST_OF_LOG * float(np.ptp(swing.roll)):
        return []
    chains = [chain for chain in chains if chain.legs[0].size > SMALLEST_RELEASE * largest]
    groups = [[other for other in chains if _same_board(chain, other, swing)] for chain in chains]
    return max(groups, key=lambda group: _evidence(group, swing))


def _evidence(group: list[Chain], swing: Swing) -> float:
    """How much chains look like free decays: quick legs, many that are not small, an angle often come to."""
    speed = sum(
        sum(leg.size**2 / leg.duration for leg in chain.legs[:8]) / chain.legs[0].size for chain in group
    )
    room = max(5.0 * swing.noise, 0.1 * group[0].sizes[0])
    at_rest = [abs(level - group[0].rest) < room for level in swing.levels]
    return speed * max(1, sum(now and not before for before, now in pairwise([False, *at_rest])))


def _same_board(one: Chain, other: Chain, swing: Swing) -> bool:
    """Whether two chains are about the same angle and move at the same pace."""
    room = max(5.0 * swing.noise, 0.35 * min(one.sizes[0], other.sizes[0]))
    return abs(one.rest - other.rest) < room and 0.6 < one.pace / other.pace < 1.6


def _shrinking_chains(swing: Swing, legs: list[Leg]) -> list[Chain]:
    """Split the legs into chains that shrink, each followed as far as it goes on about its own rest."""
    chains: list[Chain] = []
    legs = _without_hitches(swing, legs)
    begin = 0
    while begin < len(legs):
        finish = begin + 1
        while finish < len(legs) and _continues(swing, legs[finish - 1], legs[finish]):
            finish += 1
        chain = _chain(swing, legs, begin, finish)
        if chain is not None:
            chains.append(chain)
            finish = len(legs) if chain.after is None else legs.index(chain.after)
        begin = finish
    return chains


def _without_hitches(swing: Swing, legs: list[Leg]) -> list[Leg]:
    """Join two legs in one direction that together swing back from the one before: noise made the deck hesitate.

    A hand that catches a deck is felt for longer than a leg lasts, or holds it away from rest.
    """
    joined: list[Leg] = []
    for leg in legs:
        if len(joined) > 1 and joined[-1].way * leg.way > 0 and joined[-2].way * leg.way < 0:
            before, one = joined[-2:]
            pause = float(swing.time[leg.left] - swing.time[one.reached])
            whole = replace(
                one, finish=leg.finish, reached=leg.reached, target=leg.target, to_stay=leg.to_stay,
                duration=0.8 * float(swing.time[leg.reached] - swing.time[one.left]),
            )  # fmt: skip
            if pause < 0.5 * before.duration and _continues(swing, replace(before, to_stay=False), whole):
                joined[-1] = whole
                continue
        joined.append(leg)
    return joined


def _continues(swing: Swing, one: Leg, other: Leg) -> bool:
    """Whether the next leg is a shorter one back, of about the same pace, and follows without a stay."""
    shorter = other.size < one.size + 6.0 * swing.noise
    return shorter and _same_pace(swing, one.duration, other) and one.way * other.way < 0 and not one.to_stay


def _same_pace(swing: Swing, pace: float, leg: Leg) -> bool:
    """Whether a leg takes about as long as others; the time of a small one is not known."""
    return 0.5 * pace < leg.duration < 2.5 * pace or leg.size < 3.0 * swing.step


def _chain(swing: Swing, legs: list[Leg], begin: int, finish: int) -> Chain | None:
    """Build the chain of legs `begin` to `finish` - 1 and of what follows about the same rest angle.

    Returns None where that angle is not to be seen.
    """
    chosen = legs[begin:finish]
    if len(chosen) > 4 and not chosen[0].from_stay and _first_leg_is_odd(chosen):
        chosen = chosen[1:]
    if len(chosen) == 1 and not chosen[0].to_stay:
        return None
    rest = _rest_angle(chosen)
    # A slow turning point looks like a stay, and close to rest the noise makes a leg grow: neither ends it.
    while finish < len(legs):
        leg = legs[finish]
        homeward = (rest - leg.origin) * leg.way > 0.3 * leg.size**2
        shorter = leg.size < chosen[-1].size + 6.0 * swing.noise
        swings_on = homeward and shorter and _same_pace(swing, chosen[0].duration, leg)
        away = max(leg.size if homeward else 0.0, abs(leg.target - rest))
        if not swings_on and away > 2.0 * swing.step:
            break
        chosen += [leg] if swings_on else []
        finish += 1
    after = legs[finish] if finish < len(legs) else None
    pause = float(swing.time[-1 if after is None else after.left] - swing.time[chosen[-1].reached])
    settles = chosen[-1].to_stay or pause > 2.5 * max(leg.duration for leg in chosen[:3])
    settles = settles or (after is None and chosen[-1].size < 2.0 * swing.step)
    return Chain(tuple(chosen), rest, settles, after)


def _rest_angle(legs: list[Leg]) -> float:
    """Return the angle about which the turning points of a chain converge [rad].

    Three successive ones of a linear decay give it exactly, (a c - b²) / (a + c - 2 b) (Aitken); the
    widest count most. One or two legs that end at rest leave no choice but their last point.
    """
    turns = np.array([legs[0].origin, *(leg.target for leg in legs)])
    if len(turns) == 2 or (len(turns) == 3 and legs[-1].to_stay):
        return float(turns[-1])
    a, b, c = turns[:-2], turns[1:-1], turns[2:]
    bend = a + c - 2 * b
    return float(np.sum(bend * (a * c - b * b)) / np.sum(bend**2))


def _first_leg_is_odd(legs: list[Leg]) -> bool:
    """Whether the first leg loses far more than the next ones: a hand was still on the deck."""
    losses = [math.log(one.size / other.size) for one, other in pairwise(legs[:4])]
    return losses[0] > 0.12 + 2.0 * losses[1] - losses[2] and losses[0] > 1.8 * losses[1]


def given_chain(swing: Swing, legs: list[Leg], time: float, log: str) -> Chain:
    """Return the chain that begins at a given time."""
    later = [leg for leg in legs if swing.time[leg.reached] > time]
    if not later or time < swing.time[0]:
        raise HuskyError(
            f"{log}: nothing moves after a release at {time:.6g} s; the log runs from {swing.time[0]:.6g} s "
            f"to {swing.time[-1]:.6g} s."
        )
    index = int(np.searchsorted(swing.time, time))
    if later[0].left < index:
        later[0] = replace(later[0], begin=index, left=index, origin=float(swing.roll[index]))
    finish = 1
    while finish < len(later) and _continues(swing, later[finish - 1], later[finish]):
        finish += 1
    chain = _chain(swing, later, 0, finish)
    if chain is None:
        chain = Chain((later[0],), later[0].target, False, later[1] if len(later) > 1 else None)
    return replace(chain, start=time)
