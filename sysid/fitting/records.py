"""What of a release is fitted."""

from collections.abc import Sequence
from typing import Literal, TypedDict

from sysid.roll import Release


class FittedSignal(TypedDict):
    """Which signal of some releases is fitted, and how many zeros it has."""

    use_rate: bool
    """Whether the measured rate is fitted instead of the roll."""
    bias: Literal["shared", "own"]
    """One zero for all releases, or one for each."""


def signal_of(releases: Sequence[Release]) -> FittedSignal:
    """Return what to fit: the rate where every roll is only its integral, own zeros where a zero drifts."""
    if all(release.measured == "rate" for release in releases):
        return {"use_rate": True, "bias": "shared"}
    drifting = any(release.zero == "drifting" for release in releases)
    return {"use_rate": False, "bias": "own" if drifting else "shared"}
