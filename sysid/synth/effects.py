"""The effects that a synthetic board can have: their parameters, their place in the true law."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from sysid.board import Board
from sysid.errors import SysidError, did_you_mean
from sysid.synth.law import TrueLaw


class Parameter(NamedTuple):
    """One number of an effect."""

    name: str
    unit: str
    positive: bool
    default: float | None = None


PARAMETERS: Mapping[str, tuple[Parameter, ...]] = {
    "coulomb": (Parameter("torque", "N*m", True),),
    "stribeck": (
        Parameter("torque", "N*m", True),
        Parameter("static_torque", "N*m", True),
        Parameter("velocity", "rad/s", True),
    ),
    "quadratic-damping": (Parameter("coefficient", "N*m*s^2/rad^2", False),),
    "cubic-damping": (Parameter("coefficient", "N*m*s^3/rad^3", False),),
    "cubic-stiffness": (Parameter("coefficient", "N*m/rad^3", False),),
    "asymmetric-stiffness": (Parameter("coefficient", "N*m/rad^2", False),),
    "gravity": (Parameter("moment", "N*m", False),),
    "end-stop": (
        Parameter("angle", "rad", True),
        Parameter("stiffness", "N*m/rad", True),
        Parameter("damping", "N*m*s/rad", False, 0.0),
    ),
    "freeplay": (Parameter("half_width", "rad", True),),
    "preload": (Parameter("torque", "N*m", False),),
    "offset": (Parameter("angle", "rad", False),),
    "viscoelastic": (Parameter("stiffness", "N*m/rad", True), Parameter("time_constant", "s", True)),
    "hysteresis": (Parameter("stiffness", "N*m/rad", True), Parameter("torque", "N*m", True)),
    "second-mode": (
        Parameter("inertia", "kg*m^2", True),
        Parameter("stiffness", "N*m/rad", True),
        Parameter("damping", "N*m*s/rad", False),
    ),
    "inertia": (Parameter("ratio", "1", True),),
    "discretisation": (Parameter("timestep", "s", True),),
    "sensor-bias": (Parameter("angle", "rad", False),),
    "sensor-drift": (Parameter("rate", "rad/s", False),),
    "clock": (Parameter("ratio", "1", True),),
    "lowpass": (Parameter("time_constant", "s", True),),
}
"""Effects that a synthetic board can have, and their parameters in order."""

_LAW_FIELDS: Mapping[str, tuple[str, ...]] = {
    "quadratic-damping": ("quadratic_damping",),
    "cubic-damping": ("cubic_damping",),
    "cubic-stiffness": ("cubic_stiffness",),
    "asymmetric-stiffness": ("even_stiffness",),
    "gravity": ("gravity",),
    "end-stop": ("stop_angle", "stop_stiffness", "stop_damping"),
    "freeplay": ("half_gap",),
    "preload": ("preload",),
    "viscoelastic": ("arm_stiffness", "arm_time"),
    "hysteresis": ("slider_stiffness", "slider_torque"),
    "second-mode": ("support_inertia", "support_stiffness", "support_damping"),
}
SENSOR_FIELDS = {
    "sensor-bias": "bias",
    "sensor-drift": "drift",
    "clock": "clock",
    "lowpass": "time_constant",
}
"""Effects that act on the measurement, and the field of `Sensor` that each sets."""
STEPPED = {"quadratic-damping", "cubic-damping", "cubic-stiffness", "asymmetric-stiffness", "gravity"} | {
    "preload", "offset", "inertia", "discretisation", *SENSOR_FIELDS,
}  # fmt: skip
"""What may go together with 'discretisation': laws without kinks and without memory."""


def parse_effect(text: str) -> tuple[str, tuple[float, ...]]:
    """Return name and parameters of 'NAME=V[,V...]'.

    Raises:
        SysidError: The text is not of that form, or the effect is unknown.
    """
    name, equals, values = text.partition("=")
    check_effect_name(name)
    if not equals or not values:
        wanted = ",".join(f"{p.name.upper()}" for p in PARAMETERS[name])
        raise SysidError(f"effect '{name}' has no value; write {name}={wanted}{_units(name)}.")
    try:
        return name, tuple(float(value) for value in values.split(","))
    except ValueError:
        raise SysidError(f"effect '{text}': '{values}' is not a list of numbers{_units(name)}.") from None


def check_effect_name(name: str) -> None:
    """Accept the name of an effect.

    Raises:
        SysidError: There is none of that name.
    """
    if name not in PARAMETERS:
        raise SysidError(
            f"unknown effect '{name}'.{did_you_mean(name, PARAMETERS)} Known: {', '.join(PARAMETERS)}."
        )


def _units(name: str) -> str:
    return " (" + ", ".join(f"{p.name} in {p.unit}" for p in PARAMETERS[name]) + ")"


def complete_effects(effects: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, ...]]:
    """Return the effects with their optional parameters filled in.

    Raises:
        SysidError: An effect is unknown, or a parameter is missing, superfluous or out of range.
    """
    complete: dict[str, tuple[float, ...]] = {}
    for name, values in effects.items():
        check_effect_name(name)
        parameters = PARAMETERS[name]
        needed = sum(parameter.default is None for parameter in parameters)
        if not needed <= len(values) <= len(parameters):
            raise SysidError(
                f"effect '{name}' has {len(values)} parameters; expected {needed}{_units(name)}."
            )
        filled = [*map(float, values), *(p.default or 0.0 for p in parameters[len(values) :])]
        for parameter, value in zip(parameters, filled, strict=True):
            if not math.isfinite(value) or (parameter.positive and value <= 0):
                kind = "a positive" if parameter.positive else "a finite"
                raise SysidError(f"effect '{name}': {parameter.name} is {value:g}; expected {kind} number.")
        complete[name] = tuple(filled)
    if "stribeck" in complete and complete["stribeck"][1] < complete["stribeck"][0]:
        raise SysidError(
            "effect 'stribeck': static_torque is below torque; static friction is the larger one."
        )
    return complete


def true_law(board: Board, effects: Mapping[str, Sequence[float]]) -> TrueLaw:
    """Return the true joint of a board with effects.

    Raises:
        SysidError: An effect is unknown or its parameters are wrong.
    """
    effects = complete_effects(effects)
    fields = {
        field: value
        for name, names in _LAW_FIELDS.items()
        if name in effects
        for field, value in zip(names, effects[name], strict=True)
    }
    if "stribeck" in effects:
        sliding, static, fields["stribeck_velocity"] = effects["stribeck"]
        fields["friction"], fields["static_friction"] = sliding, static
    for key in ("friction", "static_friction") if "coulomb" in effects else ():
        fields[key] = fields.get(key, 0.0) + effects["coulomb"][0]
    return TrueLaw(
        inertia=board.inertia.value * effects.get("inertia", (1.0,))[0],
        stiffness=board.stiffness,
        damping=board.damping,
        rest=board.rest_angle + effects.get("offset", (0.0,))[0],
        **fields,
    )
