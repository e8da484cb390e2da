"""Which signal of a release is fitted: its roll, its measured rate, or a roll with a zero of its own."""

from collections.abc import Sequence
from typing import Literal, TypedDict

from sysid.fitting.problem import Bias
from sysid.roll import Release

Signal = Literal["auto", "roll", "rate", "per-release"]
"""What is fitted or compared: the roll, with one zero for all releases; the measured rate; or the roll with a zero for
each release. 'auto' chooses by what the sensor measured and whether its zero drifts."""


class SignalOptions(TypedDict):
    """A choice of signal, as the fitting functions take it."""

    use_rate: bool
    bias: Bias


def signal_of(releases: Sequence[Release], signal: Signal = "auto") -> SignalOptions:
    """Return which signal of some releases to fit.

    A rate gyro's roll is only its integral, which drifts: there the rate itself. A roll that was fused from
    accelerometer and gyro has a zero that wanders from release to release.

    Args:
        releases: From one board.
        signal: 'auto', or what the caller wants.
    """
    if signal == "auto":
        drifting = any(release.zero == "drifting" for release in releases)
        integrals = all(release.measured == "rate" for release in releases)
        signal = "rate" if integrals else "per-release" if drifting else "roll"
    return {"use_rate": signal == "rate", "bias": "own" if signal == "per-release" else "shared"}
