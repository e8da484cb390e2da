"""Simulation of a release."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.board import Board
from sysid.errors import SysidError
from sysid.joint.hermite import hermite_matrix
from sysid.joint.integrator import Rollout, build_stepper, steps_for
from sysid.joint.law import JointLaw
from sysid.joint.sensor import clock_ratio, read
from sysid.roll import Array
from sysid.shown import Shown

if TYPE_CHECKING:
    import pandas as pd

STEPS_PER_PERIOD = 120
"""RK4 steps in one natural period: the local error is below 1e-8 of the amplitude."""
HALVINGS = 3
"""How often the step is halved where the motion diverges: a stiff internal state may need shorter steps."""


@dataclass(frozen=True, slots=True, repr=False)
class Trajectory(Shown):
    """A simulated release."""

    time: Array
    """Time since the release [s], shape (n,)."""
    roll: Array
    """Reading of an angle sensor [rad], shape (n,)."""
    rate: Array
    """Its rate [rad/s], shape (n,)."""

    def brief(self) -> str:
        """Return how long it is, and between which angles it moves."""
        low, high = float(self.roll.min()), float(self.roll.max())
        return f"Trajectory: {len(self.time)} samples in {self.time[-1]:.4g} s, {low:.4g} to {high:.4g} rad"

    def to_dataframe(self) -> "pd.DataFrame":
        """Return a table: time_s, roll_rad, rate_rad_s."""
        import pandas as pd

        return pd.DataFrame({"time_s": self.time, "roll_rad": self.roll, "rate_rad_s": self.rate})


def simulate(
    law: JointLaw | Board, time: Array, angle: float, rate: float = 0.0, *, hold: float = 1e3,
    begin: float = 0.0,
) -> Trajectory:  # fmt: skip
    """Simulate a release.

    Args:
        law: The joint, or a board whose joint it is.
        time: Times since the release [s], shape (n,), ascending, from 0 on.
        angle: Roll at release [rad].
        rate: Roll rate at release [rad/s].
        hold: Time of the hold before the release [s]; counts for creep only.
        begin: Time of the release on the log's clock [s], for a sensor that drifts.

    Raises:
        SysidError: The motion grows without bound however fine the step: the law has no stable rest there.
    """
    law = JointLaw.from_board(law) if isinstance(law, Board) else law
    if law.timestep:
        from sysid.joint.sampled import stepped

        return Trajectory(np.asarray(time), *stepped(law, time, angle, rate))
    structure, vector = law.structure, law.vector
    ratio = clock_ratio(structure, law.parameters)
    stepper = build_stepper(structure, free_states=False, sensitivities=False)
    true_time = np.asarray(time, dtype=np.float64) / ratio
    start = np.asarray(stepper.initial(vector, [angle, rate], hold)).ravel()
    for halving in range(HALVINGS + 1):
        h = 2 * np.pi / law.frequency / STEPS_PER_PERIOD / 2**halving
        steps = steps_for(float(true_time[-1]), h)
        grid = Rollout(stepper, steps)(start, np.append(vector, h))[:, 0]
        if np.all(np.isfinite(grid)):
            break
    else:
        raise SysidError(
            f"the simulated roll grows without bound from {np.degrees(angle):.3g} degrees: "
            "the law has no stable rest. Check the signs and sizes of its effects."
        )
    roll = hermite_matrix(true_time, h, steps) @ grid
    roll_rate = hermite_matrix(true_time, h, steps, slope=True) @ grid / ratio
    reading = read(law, roll, roll_rate, begin + np.asarray(time, dtype=np.float64))
    return Trajectory(np.asarray(time), reading.angle, reading.rate)
