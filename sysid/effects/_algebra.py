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
