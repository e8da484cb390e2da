"""The functions that a law may use, so that it runs on CasADi expressions and on plain numpy."""

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

Value = Any
"""A CasADi expression or a numpy array: laws are written once for both."""
Values = Mapping[str, Value]
"""An effect's parameters by name."""


class Algebra(Protocol):
    """The functions that a torque law may use beyond + - * / **."""

    def sin(self, x: Value) -> Value:
        """Sine."""
        ...

    def exp(self, x: Value) -> Value:
        """Exponential."""
        ...

    def abs(self, x: Value) -> Value:
        """Absolute value."""
        ...

    def minimum(self, a: Value, b: Value) -> Value:
        """The smaller."""
        ...

    def maximum(self, a: Value, b: Value) -> Value:
        """The larger."""
        ...

    def where(self, condition: Value, yes: Value, no: Value) -> Value:
        """`yes` where the condition holds, else `no`."""
        ...


class NumpyAlgebra:
    """Torque laws on plain numbers and arrays."""

    def sin(self, x: Value) -> Value:
        """Sine."""
        return np.sin(x)

    def exp(self, x: Value) -> Value:
        """Exponential."""
        return np.exp(x)

    def abs(self, x: Value) -> Value:
        """Absolute value."""
        return np.abs(x)

    def minimum(self, a: Value, b: Value) -> Value:
        """The smaller."""
        return np.minimum(a, b)

    def maximum(self, a: Value, b: Value) -> Value:
        """The larger."""
        return np.maximum(a, b)

    def where(self, condition: Value, yes: Value, no: Value) -> Value:
        """`yes` where the condition holds, else `no`."""
        return np.where(condition, yes, no)


class CasadiAlgebra:
    """Torque laws on CasADi expressions."""

    def __init__(self) -> None:
        """Import CasADi only when a law is built."""
        import casadi

        self._casadi: Any = casadi

    def sin(self, x: Value) -> Value:
        """Sine."""
        return self._casadi.sin(x)

    def exp(self, x: Value) -> Value:
        """Exponential."""
        return self._casadi.exp(x)

    def abs(self, x: Value) -> Value:
        """Absolute value."""
        return self._casadi.fabs(x)

    def minimum(self, a: Value, b: Value) -> Value:
        """The smaller."""
        return self._casadi.fmin(a, b)

    def maximum(self, a: Value, b: Value) -> Value:
        """The larger."""
        return self._casadi.fmax(a, b)

    def where(self, condition: Value, yes: Value, no: Value) -> Value:
        """`yes` where the condition holds, else `no`."""
        return self._casadi.if_else(condition, yes, no)
