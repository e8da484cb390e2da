"""One record against one joint: from parameters and start to what the sensor would have read, with slopes."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sysid.joint.integrator import Stepper, rollout
from sysid.roll import Array


@dataclass(slots=True)
class Shooting:
    """Integrates one record's motion and reads it off at the record's samples.

    The functions are called through buffers that live as long as this does: a call then costs what it
    computes, without a copy in or out. Not for two threads at once.
    """

    stepper: Stepper
    steps: int
    at: Sequence[Any]
    """Sparse matrices from grid values and slopes to what is wanted at the samples, shape (n, 2 steps) each."""
    hold: float
    """For how long the deck was held before [s]."""
    _begin: "_Buffered" = field(init=False)
    _path: "_Buffered" = field(init=False)

    def __post_init__(self) -> None:
        """Allocate the buffers."""
        self._begin = _Buffered(self.stepper.initial)
        self._path = _Buffered(rollout(self.stepper, self.steps))

    def read(self, vector: Array, own: Array, step: float) -> Array:
        """Return values and sensitivities, shape (n, 1 + columns of the stepper) for each of `at`, one below another.

        Args:
            vector: The structure's parameters, shape (p,).
            own: Roll, rate and free internal states at release, shape (u,).
            step: Integration step [s].
        """
        parameters, unknowns, hold = self._begin.inputs
        parameters[:], unknowns[:], hold[:] = vector, own, self.hold
        start, given = self._path.inputs
        start[:] = self._begin.run()
        given[:-1], given[-1] = vector, step
        grid = self._path.run().reshape(2 * self.steps, -1)
        with np.errstate(all="ignore"):
            return np.concatenate([np.asarray(at @ grid) for at in self.at])


class _Buffered:
    """A CasADi function with its inputs and its one output in numpy memory."""

    def __init__(self, function: Any) -> None:
        self.inputs = [np.zeros(function.numel_in(i)) for i in range(function.n_in())]
        self.output = np.zeros(function.numel_out(0))
        self._buffer, self._trigger = function.buffer()
        for index, values in enumerate(self.inputs):
            self._buffer.set_arg(index, values.data)
        self._buffer.set_res(0, self.output.data)

    def run(self) -> Array:
        """Return the output, shape (m,), column by column; the next run overwrites it."""
        self._trigger()
        return self.output
