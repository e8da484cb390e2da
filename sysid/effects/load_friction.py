"""Dry friction that grows with the tilt, as the spring loads the bearing.

Friction of bushings, leaf springs, belts and gears is proportional to their load. Friction proportional to the tilt takes the same
share of each swing, like a damper. It differs by its jumps at the turning points.
"""

import math

from sysid.effects._algebra import Algebra, Numbers, Value, Values
from sysid.effects._base import MjsJoint, MjSpec, MujocoSupport, Parameter, TorqueEffect
from sysid.effects._mjcf import set_friction
from sysid.errors import SysidError


def friction(m: Algebra, tilt: Value, speed: Value, parameters: Values) -> Value:
    """Return F + b |x| [N*m] for all speeds."""
    return parameters["torque"] + parameters["growth"] * m.abs(tilt)


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Write frictionloss, and for the growing part a damper of the same loss.

    A cycle of the amplitude a loses 2 b a² to the growing part, and π d ω a² to a damper.

    Raises:
        SysidError: The joint has no spring, so its frequency is unknown.
    """
    if joint.stiffness[0] <= 0:
        raise SysidError(
            f"effect 'load-friction' cannot be written for a joint of stiffness {float(joint.stiffness[0]):g}: MuJoCo has no "
            "friction that grows with the tilt, and the damper in its place is chosen for the frequency of a spring. "
            "Fit the joint with --effect coulomb instead."
        )
    frequency = math.sqrt(float(joint.stiffness[0]) / (float(joint.parent.inertia[0]) + joint.armature))
    damping = 2 * parameters["growth"] / (math.pi * frequency)
    set_friction(joint, parameters["torque"])
    joint.damping[0] += damping
    return (
        f"load-friction: frictionloss {parameters['torque']:.6g} N*m, and a damper of {damping:.6g} N*m*s/rad for the part that grows with tilt",
    )


EFFECT = TorqueEffect(
    name="load-friction",
    title="dry friction that grows with the load",
    family="friction",
    parameters=(
        Parameter(
            "torque", "N*m", low=0.0, high=1.0, starts=(0.01, 0.06), rough=True, default=0.0
        ),
        Parameter("growth", "N*m/rad", low=0.0, high=0.8, starts=(0.05,)),
    ),
    law="τ = -(F + b |x|) sgn v; sticks while the other torques stay within ±(F + b |x|)",
    formula="({torque} + {growth} |φ|) sgn φ̇",
    source="Caughey and Vijayaraghavan, Int. J. Non-Linear Mechanics 5 (1970), for F = 0",
    does="Each swing loses the same share, as with a damper, and a fixed amount beside it; the torque jumps at each turning point.",
    look_alikes=("coulomb", "hysteresis"),
    experiment="Pull the joint slowly to {3°} and to {12°} and back: the force there and back differs by more at {12°}.",
    mujoco=MujocoSupport(
        means="nothing that grows with the tilt",
        substitute="frictionloss, and a damper with the loss of the growing part",
    ),
    to_mjcf=to_mjcf,
    example=(0.05, 1.5),
    friction=friction,
    excludes=("coulomb", "stribeck", "dahl"),
)  # fmt: skip
