"""Releases that stand clear of their noise: only of those does a fit learn anything."""

from collections.abc import Sequence

import numpy as np

from sysid.errors import SysidError
from sysid.releases.extrema import smoothed
from sysid.roll import Release, shown
from sysid.text import display

CLEAR_AMPLITUDE = 5.0
"""Widest swing over the noise of a sample from which on a release is fitted: below, chance makes half its peaks."""


def clear_of_noise(releases: Sequence[Release]) -> tuple[list[Release], list[str]]:
    """Return the releases that stand clear of their noise, and what is said of the others.

    Raises:
        SysidError: None does.
    """
    clear: list[Release] = []
    weak: list[str] = []
    for release in releases:
        noise = float(np.median(release.std))
        show = display(is_rate=False, slides=release.slides)
        # Not its first sample: what was pushed may begin anywhere in a swing.
        widest = float(np.abs(smoothed(release).roll - release.rest).max())
        if widest >= CLEAR_AMPLITUDE * noise:
            clear.append(release)
            continue
        weak.append(
            f"{release.log}: the release at {shown(release.start)} has an amplitude of {show(widest, 2)} in noise of "
            f"{show(noise, 2)}: too little to fit"
        )
    if not clear:
        raise SysidError(f"{weak[0]}. Tip the deck further, or use a better sensor.")
    return clear, [f"{text}, so it is left out" for text in weak]
