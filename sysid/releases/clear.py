"""Releases with an amplitude well above their noise; the others are not fitted."""

from collections.abc import Sequence

import numpy as np

from sysid.errors import SysidError
from sysid.releases.extrema import smoothed
from sysid.roll import Release, shown
from sysid.text import display

CLEAR_AMPLITUDE = 5.0
"""Smallest amplitude of a fitted release, over the noise of a sample: below it, half of the peaks are noise."""


def clear_of_noise(releases: Sequence[Release]) -> tuple[list[Release], list[str]]:
    """Return the releases well above their noise, and a warning for each of the others.

    Raises:
        SysidError: All releases are too small.
    """
    clear: list[Release] = []
    weak: list[str] = []
    for release in releases:
        noise = float(np.median(release.std))
        show = display(is_rate=False, slides=release.slides)
        # Not the first sample: a pushed release may begin anywhere in a swing.
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
