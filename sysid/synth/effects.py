"""The place of each effect of the catalogue in the true law."""

import math
from collections.abc import Mapping, Sequence

from sysid.board import Board
from sysid.effects import effect, parameters_from
from sysid.effects._base import Effect, LinearJoint, SensorEffect, TorqueEffect
from sysid.errors import SysidError
from sysid.synth.law import CatalogueLaw, TrueLaw, catalogue_law

_LAW_FIELDS: Mapping[str, tuple[str, ...]] = {
    "coulomb": ("friction static_friction",),
    "stribeck": ("friction", "static_friction", "stribeck_velocity"),
    "load-friction": ("friction static_friction", "friction_growth"),
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
"""The fields of `TrueLaw` that each parameter adds to."""
SENSOR_FIELDS = {"sensor-bias": "bias", "sensor-drift": "drift", "clock": "clock", "lowpass": "time_constant"}
"""Effects that act on the measurement, and the field of `Sensor` that each sets."""
_ELSEWHERE = {"discretisation", *SENSOR_FIELDS}
"""Effects of the steps or the sensor, not of the torque."""


def parse_effect(text: str) -> tuple[str, tuple[float, ...]]:
    """Return name and parameters of 'NAME=V[,V...]'.

    Raises:
        SysidError: The text is not of that form, or the effect is unknown.
    """
    name, equals, values = text.partition("=")
    known = effect(name)
    if not equals or not values:
        wanted = ",".join(parameter.upper() for parameter in known.parameter_names)
        raise SysidError(f"effect '{name}' has no value; write {name}={wanted}{_units(known)}.")
    try:
        return name, tuple(float(value) for value in values.split(","))
    except ValueError:
        raise SysidError(f"effect '{text}': '{values}' is not a list of numbers{_units(known)}.") from None


def _units(known: Effect) -> str:
    return " (" + ", ".join(f"{p.name} in {p.unit or '1'}" for p in known.parameters) + ")"


def complete_effects(effects: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, ...]]:
    """Return the effects with their optional parameters filled in.

    Raises:
        SysidError: An effect is unknown, or a parameter is missing, superfluous or out of range.
    """
    complete: dict[str, tuple[float, ...]] = {}
    for name, values in effects.items():
        filled = parameters_from(name, [*map(float, values)])
        for parameter in effect(name).parameters:
            value, low = filled[parameter.name], parameter.low
            if not math.isfinite(value) or (low > 0 >= value) or (low == 0 > value):
                kind = "a positive number" if low > 0 else "0 or more" if low == 0 else "a finite number"
                raise SysidError(f"effect '{name}': {parameter.name} is {value:g}; expected {kind}.")
        complete[name] = tuple(filled.values())
    if "stribeck" in complete and complete["stribeck"][1] < complete["stribeck"][0]:
        raise SysidError(
            "effect 'stribeck': static_torque is below torque; static friction is the larger one."
        )
    return complete


def steps(name: str) -> bool:
    """Return whether an effect may go with a simulator's step: no kinks, no memory."""
    part = effect(name)
    if isinstance(part, TorqueEffect):
        return not (part.nonsmooth or part.friction or part.states)
    return isinstance(part, SensorEffect)


def true_law(board: Board, effects: Mapping[str, Sequence[float]]) -> TrueLaw:
    """Return the true joint of a board with effects.

    An effect without a formula in `TrueLaw` acts by that of the catalogue.

    Raises:
        SysidError: An effect is unknown or its parameters are wrong, or nothing here can move it.
    """
    effects = complete_effects(effects)
    fields: dict[str, float] = {}
    laws: list[CatalogueLaw] = []
    joint = LinearJoint(board.inertia.value, board.stiffness, board.damping, board.rest_angle)
    for name, values in effects.items():
        part = effect(name)
        if name in _LAW_FIELDS:
            for added, value in zip(_LAW_FIELDS[name], values, strict=True):
                fields |= {key: fields.get(key, 0.0) + value for key in added.split()}
        elif isinstance(part, TorqueEffect) and part.modifies is not None:
            joint = part.modifies(joint, part.named(values))
        elif name not in _ELSEWHERE:
            laws.append(catalogue_law(part, values, board.stiffness))
    if not fields.get("slider_torque"):
        fields.pop("slider_stiffness", None)  # it slips at once
    return TrueLaw(
        inertia=joint.inertia, stiffness=joint.stiffness, damping=joint.damping, rest=joint.rest_angle,
        laws=tuple(laws), **fields,
    )  # fmt: skip
