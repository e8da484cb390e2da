"""Which stretches of long recordings are judged: fifty periods hold what a thousand do, and take a twentieth of the time."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.roll import Release

MOST = 50.0
"""Periods that are judged: ten decays of five."""
PIECES = 3
"""Stretches of one release that lasts longer: where it is wide, in the middle, and where it is small."""


def judged_stretches(releases: Sequence[Release], period: float) -> tuple[list[Release], str]:
    """Return releases that last `MOST` periods together at most, and a sentence where something was left out; '' where not.

    Args:
        releases: Free decays.
        period: Of the joint [s].
    """
    room = MOST * period
    lengths = [float(r.time[-1] - r.time[0]) for r in releases]
    if sum(lengths) <= room:
        return list(releases), ""
    if len(releases) <= PIECES:
        pieces = [piece for r in releases for piece in _pieces(r, room / len(releases))]
        chosen = [replace(piece, number=number) for number, piece in enumerate(pieces, start=1)]
        return (
            chosen,
            f"the decays last {sum(lengths) / period:.0f} periods: their first, middle and last {MOST:.0f} were judged",
        )
    # Evenly over the amplitudes, the widest and the smallest first; who was pushed is nearer to rest when it is let go.
    order = sorted(range(len(releases)), key=lambda i: np.abs(releases[i].roll - releases[i].rest).max())
    count = max(PIECES, int(room / float(np.mean(lengths))))
    picked = sorted({order[round(i)] for i in np.linspace(0, len(order) - 1, count)})
    whole = [r for i in picked for r in _pieces(releases[i], room / len(picked))]
    text = f"{len(picked)} of {len(releases)} releases were judged, evenly over their amplitudes"
    return [replace(r, number=number) for number, r in enumerate(whole, start=1)], text


def _pieces(release: Release, room: float) -> list[Release]:
    """Return a release, or its first, middle and last stretches if it lasts longer than that [s]."""
    begin, end = float(release.time[0]), float(release.time[-1])
    if end - begin <= 1.2 * room:
        return [release]
    length = room / PIECES
    starts = np.linspace(begin, end - length, PIECES)
    cuts = [(release.time >= start) & (release.time <= start + length) for start in starts]
    first, *later = [release[inside] for inside in cuts]
    return [replace(first, end="log"), *(replace(r, hold=0.0, end="log") for r in later)]
