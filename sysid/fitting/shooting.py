"""Single shooting of one release: from parameters and initial state to sensor readings, with sensitivities."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.joint.integrator import Buffered, Rollout
from sysid.roll import Array


@dataclass(slots=True)
class Shooting:
    """Integrates one record's motion and reads it off at the record's samples."""

    begin: Buffered
    """(parameters, unknowns, hold) → state and sensitivities at release."""
    path: Rollout
    at: Any
    """Sparse matrix from grid values and slopes to samples, shape (n, 2 steps)."""
    hold: float
    """For how long the deck was held before [s]."""

    def read(self, vector: Array, own: Array, step: float) -> Array:
        """Return values and sensitivities, shape (n, 1 + columns of the stepper), in SI, as the parameters are, shape (p,).

        Each record's own, shape (u,), is roll, rate and free internal states at release; the step is the integration's [s].
        """
        parameters, unknowns, hold = self.begin.inputs
        parameters[:], unknowns[:], hold[:] = vector, own, self.hold
        self.begin.run()
        grid = self.path(self.begin.outputs[0], np.concatenate((vector, (step,))))
        with np.errstate(all="ignore"):
            return np.asarray(self.at @ grid)
