"""The far end of the deck: the near one again, smaller, and turning about another point of the picture.

All of the board turns about one axis. In the picture, the points of it that the deck's two ends turn about lie on a line that leads to
where the axis vanishes; the middle of the picture would be there if the camera looked along the axis.
"""

from dataclasses import dataclass, replace

import numpy as np

from sysid.roll import Array
from sysid.video.trackers.edge.brightness_steps import ATTITUDE_STEP, MAX_SLOPE, Steps, turned
from sysid.video.types import Mask, Rows


@dataclass(frozen=True, slots=True)
class DeckEnd:
    """Edges of the deck's end when its lines are level."""

    pivot: Array
    """What each turns about [px], shape (E, 2): edges at another depth turn about another point of the picture."""
    pivot_std: Array
    """Standard deviation of that [px], shape (E,)."""
    ends: Array
    """Left and right end of each [px], from its pivot, shape (E, 2, 2)."""
    ways: Rows
    """1 for edges above which it is brighter, -1 for the others, shape (E,)."""
    bends: Array
    """How far below the line between its ends each piece of an edge is [px], shape (E, PIECES)."""
    turns: Array
    """Slope of the lines in each picture [rad]."""

    def only(self, kept: Mask) -> "DeckEnd":
        """Return some of the edges: `kept` [1], shape (E,)."""
        return replace(
            self,
            **{name: getattr(self, name)[kept] for name in ("pivot", "pivot_std", "ends", "ways", "bends")},
        )


LENGTH, LENGTH_SPREAD = 4.5, 0.15
"""Length of a deck in those of its edge as far as that is followed (0.8 to 0.97 of it), and the spread of its logarithm: decks
are 3.7 (cruisers) to 4.6 (longboards) times as long as wide [1]."""
SMALLER = (0.45, 0.55, 0.65, 0.75)
"""Sizes of the far end in the near one's that are looked for [1]."""
FARTHEST, NEAREST, STEPS_ACROSS = 0.8, 0.12, 33
"""How far and how near to the near end's pivot the far end's is looked for, in lengths of the near edge, and tries across [1]."""
SAMPLES, AVERAGED = 16, 4
"""Points of the far edge whose steps of brightness are looked at, and how many neighbours must step alike."""
ALIKE = 2
"""Pictures of one attitude that are looked at."""
MOST_ATTITUDES, CLEAR_STEP = 0.35, 5.0
"""Quantile of the attitudes, as a share of them, and the step of brightness [grey levels/px] that an edge must show in it."""
OWN = 5.0
"""What is nearer than this to an edge that is known, in half of the attitudes, is that edge [px of the small pictures]."""
APART = 4.0
"""Standard deviations by which two pivots must differ to be of two ends."""


def with_far_end(end: DeckEnd, every: list[Steps], shifts: Array) -> DeckEnd:
    """Add the far end's edge, if it shows away from the edges that are known.

    Args:
        end: The known edges.
        every: Steps of brightness in n pictures.
        shifts: How far each is shifted by a camera that shakes [px], shape (n, 2).
    """
    near = int(np.argmax(np.ptp(end.ends[..., 0], axis=1)))
    length = float(np.ptp(end.ends[near, :, 0]))
    side = FARTHEST * length * np.linspace(-1, 1, STEPS_ACROSS)
    away = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
    away = away[np.hypot(*away.T) > NEAREST * length]
    attitude = np.round(end.turns / ATTITUDE_STEP).astype(int)
    some = np.concatenate([np.flatnonzero(attitude == one)[:ALIKE] for one in np.unique(attitude)])
    share = (np.arange(SAMPLES)[:, None] + 0.5) / SAMPLES
    line = end.ends[near, 0] + share * (end.ends[near, 1] - end.ends[near, 0])
    best, found = CLEAR_STEP, end
    for size in SMALLER:
        across = turned(away[:, None], -end.turns[some])[..., 1] + size * end.ends[near, 0, 1]
        known = (end.pivot[:, 1] - end.pivot[near, 1]) + end.ends[:, 0, 1]
        own = (np.abs(across[..., None] - known) * every[0].scale < OWN).any(axis=-1).mean(axis=1) > 0.5
        free = away[~own]
        step = (
            np.array(
                [
                    every[row].across(
                        end.pivot[near] + shifts[row] + free[:, None] + turned(size * line, end.turns[row]),
                        end.turns[row],
                    )
                    for row in some
                ]
            )
            .reshape(len(some), len(free), -1, AVERAGED)
            .mean(axis=-1)
        )
        for way in (1, -1):
            shown = np.clip(-way * step, 0, MAX_SLOPE).mean(axis=-1)
            usual = np.quantile(
                [shown[attitude[some] == one].mean(axis=0) for one in np.unique(attitude[some])],
                MOST_ATTITUDES,
                axis=0,
            )
            if usual.max() > best:
                best, place = float(usual.max()), end.pivot[near] + free[int(np.argmax(usual))]
                found = DeckEnd(
                    np.vstack([end.pivot, place]), np.append(end.pivot_std, np.inf),
                    np.vstack([end.ends, size * end.ends[near][None]]), np.append(end.ways, way),
                    np.vstack([end.bends, size * end.bends[near]]), end.turns,
                )  # fmt: skip
    return found


def axis_vanishes_at(end: DeckEnd, focal: float) -> tuple[Array, float] | None:
    """Return where the axis vanishes in the picture, shape (2,), and its standard deviation, both in px; None where no far end shows it.

    Edges that turn about one point are of one end; of both, the near one shows more of them. How much farther away the other one is
    follows from the near one's size, since decks are about four times as long as wide.

    Args:
        end: The edges.
        focal: Focal length [px].
    """
    length = np.ptp(end.ends[..., 0], axis=1)
    apart = np.linalg.norm(end.pivot[:, None] - end.pivot, axis=2)
    doubt = np.hypot(end.pivot_std[:, None], end.pivot_std)
    near = (apart < APART * doubt)[int(np.argmax((apart < APART * doubt) @ length))]
    if near.all():
        return None
    (here, here_std), (there, there_std) = (_mean_pivot(end.only(one)) for one in (near, ~near))
    farther = focal / (LENGTH * float(length[near].max()))
    spread = LENGTH_SPREAD * farther * float(np.linalg.norm(there - here))
    return there + farther * (there - here), float(
        np.hypot(spread, (1 + farther) * np.hypot(here_std, there_std))
    )


def _mean_pivot(end: DeckEnd) -> tuple[Array, float]:
    """Return the mean of what edges turn about, shape (2,), and its standard deviation [px]."""
    weight = end.pivot_std**-2.0
    return weight @ end.pivot / weight.sum(), float(weight.sum() ** -0.5)
