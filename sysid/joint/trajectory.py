"""What a joint does after it is let go."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.errors import HuskyError
from sysid.joint.equations import EquationsOfMotion
from sysid.joint.hermite import hermite_matrix
from sysid.joint.integrator import build_stepper, rollout, steps_for
from sysid.joint.law import JointLaw
from sysid.roll import Array

STEPS_PER_PERIOD = 120
"""RK4 steps in one natural period: the local error is then below 1e-8 of the amplitude."""


@dataclass(frozen=True, slots=True)
class Trajectory:
    """A simulated release."""

    time: Array
    """Time since the release [s], shape (n,)."""
    roll: Array
    """What an angle sensor would read [rad], shape (n,)."""
    rate: Array
    """Its rate [rad/s], shape (n,)."""


def simulate(law: JointLaw, time: Array, angle: float, rate: float = 0.0, *, hold: float = 1e3) -> Trajectory:
    """Let go of the deck and watch it.

    Args:
        law: The joint.
        time: Times since the release at which to look [s], shape (n,), ascending, from 0 on.
        angle: Roll at release [rad].
        rate: Roll rate at release [rad/s].
        hold: For how long the deck was held there before [s]; only rubber that creeps remembers it.

    Raises:
        HuskyError: The motion grows without bound: the law has no stable rest there.
    """
    effects = dict(law.effects)
    if "discretisation" in effects:
        return _simulate_steps(law, time, angle, rate, effects["discretisation"][0])
    ratio = effects.get("clock", (1.0,))[0]
    stepper = build_stepper(law.structure, free_states=False, sensitivities=False)
    h = 2 * np.pi / law.frequency / STEPS_PER_PERIOD
    true_time = np.asarray(time, dtype=np.float64) / ratio
    steps = steps_for(float(true_time[-1]), h)
    vector = law.vector
    start = stepper.initial(vector, [angle, rate], hold)
    seen = np.asarray(rollout(stepper, steps)(start, np.append(vector, h)))
    if not np.all(np.isfinite(seen)):
        raise HuskyError(
            f"the simulated roll grows without bound from {np.degrees(angle):.3g} degrees: "
            "the law has no stable rest. Check the signs and sizes of its effects."
        )
    grid = seen.T.ravel()
    roll = hermite_matrix(true_time, h, steps) @ grid
    roll_rate = hermite_matrix(true_time, h, steps, slope=True) @ grid / ratio
    roll = roll + effects.get("sensor-bias", (0.0,))[0] + effects.get("sensor-drift", (0.0,))[0] * true_time
    return Trajectory(np.asarray(time), roll, roll_rate)


def _simulate_steps(law: JointLaw, time: Array, angle: float, rate: float, h: float) -> Trajectory:
    """Move as implicitfast does at step h: rate first, implicit in the damping, then roll with that rate."""
    import casadi

    ca: Any = casadi
    plain = replace(law, effects=tuple(item for item in law.effects if item[0] != "discretisation"))
    if plain.structure.has_dry_friction or plain.structure.states:
        raise HuskyError(
            f"effect 'discretisation' together with {', '.join(plain.structure.effects)}: the plain step loop "
            "holds smooth laws without memory only. Simulate the MJCF instead (husky-sysid mjcf)."
        )
    vector = plain.vector
    y, step = ca.SX.sym("y", 2), ca.SX.sym("h")
    mechanics = EquationsOfMotion(plain.structure, ca.DM(vector))
    joint, deck = mechanics.torques(y)
    slope = -ca.jacobian(joint, y)[1]
    next_rate = y[1] + step * (joint + deck) / (mechanics.inertia + step * slope)
    move = ca.Function("move", [y, step], [ca.vertcat(y[0] + step * next_rate, next_rate)])
    count = int(float(time[-1]) / h) + 2
    path = np.column_stack([[angle, rate], np.asarray(move.mapaccum("moves", count)([angle, rate], h))])
    grid = h * np.arange(count + 1)
    return Trajectory(np.asarray(time), np.interp(time, grid, path[0]), np.interp(time, grid, path[1]))
