"""The functions that a law may use, so that it runs on CasADi expressions and on plain numpy."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

Value = Any
"""A CasADi expression or a numpy array: laws are written once for both."""
Values = Mapping[str, Value]
"""An effect's parameters by name."""
States = Sequence[Value]
"""An effect's internal states, in their order."""
Numbers = Mapping[str, float]
"""The same as plain numbers."""


@dataclass(frozen=True, slots=True)
class Algebra:
    """The functions that a torque law may use beyond + - * / **."""

    sin: Callable[[Value], Value]
    cos: Callable[[Value], Value]
    exp: Callable[[Value], Value]
    abs: Callable[[Value], Value]
    floor: Callable[[Value], Value]
    minimum: Callable[[Value, Value], Value]
    maximum: Callable[[Value, Value], Value]
    where: Callable[[Value, Value, Value], Value]
    """`where(condition, yes, no)`."""


NUMPY = Algebra(np.sin, np.cos, np.exp, np.abs, np.floor, np.minimum, np.maximum, np.where)
"""Torque laws on plain numbers and arrays."""


@cache
def casadi_algebra() -> Algebra:
    """Return torque laws on CasADi expressions; CasADi is imported only when a law is built."""
    import casadi

    functions: Any = casadi
    return Algebra(
        functions.sin,
        functions.cos,
        functions.exp,
        functions.fabs,
        functions.floor,
        functions.fmin,
        functions.fmax,
        functions.if_else,
    )
