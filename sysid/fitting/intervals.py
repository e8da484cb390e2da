"""Three intervals of one parameter, side by side: do they agree, and if not, which to trust and why."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sysid.fitting.bootstrap import Bootstrap
from sysid.fitting.profile import Profile
from sysid.quantity import Quantity

_BENT = 1.2
"""Ratio of two widths from which they differ [1]. A bootstrap of 400 draws knows a half-width to 7 %, and the ratio of two to 1 + 2 √2 ·
0.07."""

Trusted = Literal["Jacobian", "profile", "bootstrap"]


@dataclass(frozen=True, slots=True)
class Agreement:
    """Agreement of the intervals of one parameter."""

    name: str
    trust: Trusted
    interval: tuple[float, float]
    """The one to trust."""
    text: str
    """Why, in words."""


def agreements(
    quantities: Mapping[str, Quantity], profiles: Sequence[Profile], bootstrap: Bootstrap | None
) -> list[Agreement]:
    """Compare the intervals of all parameters that were profiled or drawn again."""
    shapes = {shape.name: shape for shape in profiles}
    names = list(shapes) or list(bootstrap.names if bootstrap else ())
    return [_agreement(name, quantities[name], shapes.get(name), bootstrap) for name in names]


def _agreement(
    name: str, quantity: Quantity, shape: Profile | None, bootstrap: Bootstrap | None
) -> Agreement:
    trust: Trusted = "Jacobian"
    interval, notes = quantity.ci95, list[str]()
    if shape is not None and (bend := _bend(quantity, shape)):
        trust, interval, notes = "profile", shape.interval, [bend]
    if bootstrap is None or name not in bootstrap.intervals:
        return Agreement(
            name, trust, interval, "; ".join(notes) or "the cost is a parabola there: both are the same"
        )
    drawn = bootstrap.intervals[name]
    ratio = (drawn[1] - drawn[0]) / (interval[1] - interval[0])
    limit = max(_BENT, 1 + 3 * bootstrap.roughness)
    if ratio > limit:
        others = "the others" if shape is not None else "the Jacobian"
        cause = (
            "releases differ from one another by more than the noise within them"
            if bootstrap.drawn == "releases"
            else f"the residuals are not the steady noise that {others} take them for; ask diagnose what the model lacks"
        )
        trust, interval = "bootstrap", drawn
        notes.append(f"the bootstrap scatters {ratio:.1f} times as far: {cause}")
    elif ratio < 1 / limit:
        few = "it sees few independent stretches of residual"
        notes.append(f"the bootstrap is narrower (by {1 / ratio:.1f}): {few}")
    else:
        good = f"good to {100 * bootstrap.roughness:.0f} %"
        notes.append(f"the bootstrap agrees (width {ratio:.2f} of it, {good})")
    return Agreement(name, trust, interval, "; ".join(notes))


def _bend(quantity: Quantity, shape: Profile) -> str:
    """Say how a profile differs from the Jacobian's parabola; nothing where it does not."""
    low, high = shape.interval
    below, above = quantity.value - low, high - quantity.value
    half = (quantity.ci95[1] - quantity.ci95[0]) / 2
    if shape.deeper > 0.5:
        return (
            f"a lower cost lies at {shape.best:.4g} {quantity.unit} (deviance {shape.deeper:.1f} below): the fit "
            "ended in a side valley; fit again, with more releases if it persists"
        )
    if not (np.isfinite(low) and np.isfinite(high)):
        side = "above" if np.isfinite(low) else "below" if np.isfinite(high) else "on either side"
        return f"the logs do not bound it {side}"
    if any(shape.at_bound):
        end = low if shape.at_bound[0] else high
        return (
            f"it reaches its own bound of {end:.3g} within the interval: the logs give a limit, not a value"
        )
    if max(below / above, above / below) > _BENT:
        return f"the cost bends: {-below:+.2g} to one side, {above:+.2g} to the other"
    if max((below + above) / 2 / half, 2 * half / (below + above)) > _BENT:
        return f"the cost is no parabola: the profile is {(below + above) / 2 / half:.2f} times as wide"
    return ""
