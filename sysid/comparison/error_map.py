"""Location of the error in time, amplitude, velocity, side and phase, and in words."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sysid.board import Board
from sysid.comparison.release import ComparedRelease, smoothed
from sysid.joint.law import JointLaw
from sysid.noise.floor import NoiseFloor
from sysid.roll import Array
from sysid.text import display

Axis = Literal["time", "amplitude", "velocity", "side", "phase"]

SIDES = (
    ("with the right edge down", "with the left edge down"),
    ("at positions beyond the rest", "at positions below the rest"),
)
"""Names of both sides of a board, and of a joint without a deck."""


@dataclass(frozen=True, slots=True)
class Place:
    """A range of time, amplitude, rate or side, and its share of the error."""

    axis: Axis
    range: tuple[float, float]
    """In the axis' unit: s, rad, rad/s; for side and phase -1 or +1."""
    share: float
    """Share of the squared error beyond the noise."""
    text: str


def locate_error(
    compared: Sequence[ComparedRelease], law: JointLaw, noise: NoiseFloor, board: Board
) -> tuple[Place, ...]:
    """Divide the squared error beyond the noise along five axes and return the parts, largest first."""
    error = np.concatenate([c.residual**2 - noise.std**2 for c in compared])
    total = float(error.sum())
    if total <= (noise.highest**2 - noise.std**2) * len(error):
        return ()  # the noise may be all of it
    # The measured motion, not that of a wrong model.
    tilt, rate = (np.concatenate(parts) for parts in zip(*(_motion(c, law) for c in compared), strict=True))
    time = np.concatenate([c.time for c in compared])
    pulls_back = law.stiffness + law.stiffness_of_effects > 0
    swing = np.hypot(tilt, rate / law.frequency) if pulls_back else np.abs(tilt)
    places: list[Place] = []
    axes: tuple[tuple[Axis, Array], ...] = (("time", time), ("amplitude", swing), ("velocity", np.abs(rate)))
    for axis, values in axes:
        top = float(values.max())
        for low, high in ((0.0, 0.25), (0.25, 0.5), (0.5, 1.0)):
            inside = (values >= low * top) & (values < high * top if high < 1 else values <= top)
            text = _range_text(axis, low * top, high * top, last=high == 1.0, slides=board.slides)
            places.append(Place(axis, (low * top, high * top), float(error[inside].sum()) / total, text))
    right, left = SIDES[not board.geometry]
    for sign, text in ((1.0, right), (-1.0, left)):
        places.append(Place("side", (sign, sign), float(error[tilt * sign > 0].sum()) / total, text))
    for sign, text in ((1.0, "while slowing down"), (-1.0, "while speeding up")):
        share = float(error[tilt * rate * sign > 0].sum()) / total
        places.append(Place("phase", (sign, sign), share, text))
    return tuple(sorted(places, key=lambda p: -p.share))


def _motion(release: ComparedRelease, law: JointLaw) -> tuple[Array, Array]:
    """Return tilt about rest [rad] and rate [rad/s]: as measured, or as simulated where a rate or few samples were measured."""
    if release.record.is_rate or release.window is None:
        return release.roll - law.rest_angle, release.rate
    roll, rate = smoothed(release.time, release.measured, release.window)
    return roll - law.rest_angle, rate


def _range_text(axis: str, low: float, high: float, *, last: bool, slides: bool) -> str:
    if axis == "time":
        return (
            f"after {low:.2g} s"
            if last
            else f"between {low:.2g} and {high:.2g} s"
            if low
            else f"before {high:.2g} s"
        )
    show = display(is_rate=axis != "amplitude", slides=slides)
    what, unit = "at amplitudes" if axis == "amplitude" else "at rates", show.unit
    low, high = show.scale * low, show.scale * high
    if last:
        return f"{what} above {low:.2g}{unit}"
    return f"{what} between {low:.2g} and {high:.2g}{unit}" if low else f"{what} below {high:.2g}{unit}"


def describe_error(where: Sequence[Place], rmse: float, noise: float) -> str:
    """Return the location of the error, e.g. '67 % of the error is at amplitudes below 3°, while slowing down'."""
    if not where:
        return f"The error is the sensor's noise ({rmse / noise:.2f} times the floor): there is nothing to locate."
    best: dict[str, Place] = {}
    for place in where:
        best.setdefault(place.axis, place)
    main = max((best["amplitude"], best["time"]), key=lambda p: p.share)
    words = [main.text]
    for axis in ("velocity", "phase", "side"):
        if best[axis].share > 0.65:
            words.append(best[axis].text)
    if best["side"].share <= 0.65:
        words.append("on both sides")
    return f"{100 * main.share:.0f} % of the error is {', '.join(words)}."
