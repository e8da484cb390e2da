"""A pendulum has no spring: gravity takes its place, and the rest angle is where the sensor reads the vertical.

Stiffness, gravity's moment and rest angle of a joint that hangs are degenerate but for the bend of the sine, so a fit of all
three is lost. With the stiffness held at zero the rest angle has no meaning left; what is unknown is the sensor's zero.
"""

from collections.abc import Mapping, Sequence

VERTICAL = "sensor-bias"
"""The effect that holds the sensor's reading at the vertical."""


def hanging(
    effects: Sequence[str], fixed: Mapping[str, float], *, zero: bool
) -> tuple[tuple[str, ...], dict[str, float]]:
    """Return effects and fixed parameters of a joint with gravity that has no spring.

    Args:
        effects: With 'gravity' among them.
        fixed: Parameters that are held.
        zero: Whether the sensor's zero is to be fitted, one for all releases.
    """
    names = (*effects, VERTICAL) if zero and VERTICAL not in effects else tuple(effects)
    return tuple(sorted(names)), {**fixed, "stiffness": 0.0, "rest_angle": 0.0}


def hanging_start(parameters: Mapping[str, float]) -> dict[str, float]:
    """Return parameters of a joint that hangs from those of one on a spring: the same period and rest."""
    moment = parameters.get("stiffness", 0.0) + parameters.get("gravity.moment", 0.0)
    zero = parameters.get(f"{VERTICAL}.angle", parameters.get("rest_angle", 0.0))
    return {
        **parameters,
        "gravity.moment": moment,
        f"{VERTICAL}.angle": zero,
        "stiffness": 0.0,
        "rest_angle": 0.0,
    }
