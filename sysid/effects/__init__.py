"""The catalogue of physical effects: one file an effect.

A new effect is a new file in this folder that ends in `EFFECT = TorqueEffect(...)`, `SensorEffect(...)`,
`SupportEffect(...)` or `DriveEffect(...)`, and a test; the catalogue finds it.
"""

import importlib
import pkgutil
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from types import MappingProxyType

from sysid.effects import _own
from sysid.effects._base import (
    DriveEffect,
    Effect,
    MujocoSupport,
    Parameter,
    SensorEffect,
    State,
    SupportEffect,
    TorqueEffect,
)
from sysid.effects._template import effect_file
from sysid.effects.learned import AS_TABLE, as_table
from sysid.errors import SysidError, did_you_mean

__all__ = [
    "AS_TABLE",
    "DriveEffect",
    "MujocoSupport",
    "Parameter",
    "SensorEffect",
    "State",
    "SupportEffect",
    "TorqueEffect",
    "as_table",
    "catalogue",
    "drives",
    "effect",
    "effect_file",
    "origin",
    "parameters_from",
    "use_file",
]


@cache
def catalogue() -> Mapping[str, Effect]:
    """Return every effect of a joint by name, sorted: the files of this folder, installed ones, and the user's own."""
    every = {name: part for name, part in _shipped().items() if part.role != "drive"}
    every = {**every, **{name: part for name, (part, _) in _own.own_effects(every).items()}}
    return MappingProxyType(dict(sorted(every.items())))


@cache
def drives() -> Mapping[str, DriveEffect]:
    """Return every effect of an actuator by name, from the input to the joint."""
    every = (part for part in _shipped().values() if isinstance(part, DriveEffect))
    return MappingProxyType({part.name: part for part in sorted(every, key=lambda part: part.stage)})


def _shipped() -> Mapping[str, Effect]:
    modules = (name for _, name, _ in pkgutil.iter_modules(__path__) if name[0] != "_")
    return {part.name: part for part in (importlib.import_module(f"{__name__}.{m}").EFFECT for m in modules)}


def use_file(path: Path) -> str:
    """Add the effect of a user's file to the catalogue, for this process and those that it starts, and return its name.

    Raises:
        SysidError: There is no such file, or it makes no effect that runs.
    """
    part = _own.use(path)
    catalogue.cache_clear()
    catalogue()
    return part.name


def _meant(name: str, known: Mapping[str, Effect]) -> str:
    """Return ' Did you mean …?' with the effects of that everyday name, else with the closest name."""
    word = name.lower().replace("_", " ").replace("-", " ")
    called = [
        part for part in known.values() if any(word == other.replace("-", " ") for other in part.also_called)
    ]
    if called:
        return f" Did you mean {' or '.join(f'{part.name!r} ({part.title})' for part in called)}?"
    return did_you_mean(name, known)


def origin(name: str) -> str:
    """Return the file or the package that an effect comes from; '' for the catalogue's own."""
    return "" if name in _shipped() else _own.own_effects(_shipped())[name][1]


def effect(name: str) -> Effect:
    """Return the effect of that name.

    Raises:
        SysidError: There is none.
    """
    known = {**catalogue(), **drives()}
    if name not in known:
        raise SysidError(f"unknown effect '{name}'.{_meant(name, known)} Known effects: {', '.join(known)}.")
    return known[name]


def parameters_from(name: str, values: Sequence[float]) -> dict[str, float]:
    """Return an effect's parameters by name from values in their order; defaults complete them.

    Raises:
        SysidError: Too many or too few values.
    """
    found = effect(name)
    result = dict(zip(found.parameter_names, values, strict=False))
    for parameter in found.parameters[len(values) :]:
        if parameter.default is not None:
            result[parameter.name] = parameter.default
    if len(values) > len(found.parameters) or len(result) < len(found.parameters):
        wanted = ", ".join(f"{p.name} [{p.unit}]" for p in found.parameters)
        raise SysidError(f"effect '{name}' got {len(values)} value(s); it takes {wanted}, in that order.")
    return result
