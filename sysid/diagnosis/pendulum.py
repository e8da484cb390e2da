"""A pendulum has no spring: its weight takes the spring's place, and the rest angle is where the sensor reads the vertical.

Stiffness, the weight's moment and rest angle of a joint that hangs are degenerate but for the bend of the sine, so a fit of all
three is lost. With the stiffness held at zero the rest angle has no meaning left; what is unknown is the sensor's zero.
"""

from collections.abc import Mapping, Sequence

from sysid.effects import catalogue, effect
from sysid.effects._base import TorqueEffect


def weight() -> str:
    """Return the effect that can take the spring's place."""
    return next(
        n for n, part in catalogue().items() if isinstance(part, TorqueEffect) and part.adds_stiffness
    )


def moment() -> str:
    """Return its parameter that adds to the stiffness, as 'effect.parameter'."""
    part = effect(weight())
    assert isinstance(part, TorqueEffect)
    return f"{part.name}.{part.adds_stiffness}"


def zero() -> str:
    """Return the parameter that is the sensor's constant error, as 'effect.parameter'."""
    parts = (p for p in catalogue().values() if p.role == "measurement" and "rest_angle" in p.same_as)
    return next(f"{p.name}.{p.parameter_names[0]}" for p in parts)


def hanging(
    effects: Sequence[str], fixed: Mapping[str, float], *, fit_zero: bool
) -> tuple[tuple[str, ...], dict[str, float]]:
    """Return effects and fixed parameters of a joint that hangs and has no spring.

    Args:
        effects: With `weight()` among them.
        fixed: Parameters that are held.
        fit_zero: Whether the sensor's zero is to be fitted, one for all releases.
    """
    names = {*effects, zero().split(".")[0]} if fit_zero else {*effects}
    return tuple(sorted(names)), {**fixed, "stiffness": 0.0, "rest_angle": 0.0}


def hanging_start(parameters: Mapping[str, float]) -> dict[str, float]:
    """Return parameters of a joint that hangs from those of one on a spring: the same period and rest."""
    return {
        **parameters,
        moment(): parameters.get("stiffness", 0.0) + parameters.get(moment(), 0.0),
        zero(): parameters.get(zero(), parameters.get("rest_angle", 0.0)),
        "stiffness": 0.0,
        "rest_angle": 0.0,
    }


def sprung_start(parameters: Mapping[str, float], stiffness: float) -> dict[str, float]:
    """Return parameters of a joint on a spring from those of one that hangs: the same period and rest.

    Args:
        parameters: Of the joint that hangs.
        stiffness: Of the spring, where its moment is not among them [N*m/rad].
    """
    kept = {name: value for name, value in parameters.items() if name != moment()}
    stiffness = parameters.get(moment(), stiffness)
    return {**kept, "stiffness": stiffness, "rest_angle": parameters.get(zero(), 0.0)}
