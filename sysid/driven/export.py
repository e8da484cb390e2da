"""Driven joints handed over to training: mjlab's actuator configurations and ranges of domain randomisation, from a fit's JSON."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sysid.effects import drives
from sysid.errors import SysidError

EVENTS = {"damping": "joint_damping", "armature": "joint_armature", "friction": "joint_friction"}
"""mjlab's randomisation of each parameter of a joint."""


def handed_over(path: Path) -> dict[str, dict[str, Any]]:
    """Return what training needs of each joint of a fit's JSON, in SI: values, and `ranges` with 95 % intervals.

    Raises:
        SysidError: `fit --input` did not write the file.
    """
    try:
        joints: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))["joints"]
        return {name: _joint(one["values"], one["parameters"]) for name, one in joints.items()}
    except OSError as error:
        raise SysidError(f"{path}: cannot read it ({error.strerror}).") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise SysidError(
            f"{path}: holds no fit of driven joints. Give the fit.json that `fit --input` writes."
        ) from error


def _joint(values: Mapping[str, float], fitted: Mapping[str, Any]) -> dict[str, Any]:
    """Return friction, gains, limit and delay of one joint, and their ranges."""
    names = {"armature": "armature", "damping": "damping"}
    for part in drives().values():
        key = {"delay": "delay", "saturation": "limit"}.get(part.family)
        if key or part.sources:
            names |= {key or p.name: f"{part.name}.{p.name}" for p in part.parameters}
    rubs = (n for n in values if n.endswith(".torque") and n.split(".")[0] not in drives())
    names["friction"] = next(rubs, "")
    found = {key: float(values[name]) for key, name in names.items() if name in values}
    ranges = {
        key: [low if found[key] < 0 else max(0.0, low), high]
        for key, name in names.items()
        if name in fitted and None not in (ends := fitted[name]["ci95"])
        for low, high in [ends]
    }
    return {**found, "ranges": ranges}


def mjlab_module(joints: Mapping[str, Mapping[str, Any]], *, timestep: float, source: str) -> str:
    """Return a Python module with `ACTUATORS`, a tuple of mjlab's actuator configurations, and `EVENTS`, terms by name.

    Args:
        joints: As `handed_over` returns them.
        timestep: Of the physics [s]: mjlab counts delays in its steps.
        source: The fit's file, for the head of the module.
    """
    import mujoco

    lines = [
        f'"""Actuators and domain randomisation identified by husky-sysid: {source}; SI, delays in steps of {timestep:g} s."""', "",
        "from mjlab.actuator import BuiltinMotorActuatorCfg, BuiltinPositionActuatorCfg", "from mjlab.envs.mdp import dr",
        "from mjlab.managers import EventTermCfg, SceneEntityCfg", "", "ACTUATORS = (",
    ]  # fmt: skip
    for name, one in joints.items():
        servo = "kp" in one
        fields = {
            "target_names_expr": (name,),
            "armature": one["armature"],
            "viscous_damping": one["damping"],
            "frictionloss": one.get("friction", 0.0),
        }
        fields |= {"stiffness": one["kp"], "damping": one.get("kd", 0.0)} if servo else {}
        fields["effort_limit"] = one.get("limit", None if servo else mujoco.mjMAXVAL)  # mjlab needs a number
        low, high = one["ranges"].get("delay", [one.get("delay", 0.0)] * 2)
        fields |= {
            "delay_min_lag": max(0, round(low / timestep)),
            "delay_max_lag": max(0, math.ceil(high / timestep - 1e-6)),
        }
        text = ", ".join(f"{key}={value!r}" for key, value in fields.items())
        lines.append(f"    {'BuiltinPositionActuatorCfg' if servo else 'BuiltinMotorActuatorCfg'}({text}),")
    lines += [")", '"""One for each joint."""', "EVENTS = {"]
    for name, one in joints.items():
        for key, function in EVENTS.items():
            if key in one["ranges"]:
                low, high = one["ranges"][key]
                asset = f'SceneEntityCfg("robot", joint_names=({name!r},))'
                lines.append(
                    f'    {f"{name} {key}"!r}: EventTermCfg(mode="startup", func=dr.{function}, '
                    f'params={{"ranges": ({low!r}, {high!r}), "operation": "abs", "asset_cfg": {asset}}}),'
                )
    return "\n".join([*lines, "}", '"""Draws within the 95 % intervals."""', ""])
