"""Dry friction that does not depend on speed."""

from collections.abc import Sequence

from sysid.effects._algebra import Algebra, Numbers, Value, Values
from sysid.effects._base import MjsJoint, MjSpec, MujocoSupport, Parameter, TorqueEffect
from sysid.effects._mjcf import set_friction


def friction(m: Algebra, tilt: Value, speed: Value, parameters: Values) -> Value:
    """Return F [N*m] for all tilts and speeds."""
    return parameters["torque"] + 0 * speed


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Write frictionloss with a hardened constraint."""
    set_friction(joint, parameters["torque"])
    return (
        f"coulomb: frictionloss {parameters['torque']:.6g} N*m; hardened (solreffriction, solimpfriction) "
        "so that it neither yields nor creeps",
    )


def from_mjcf(joint: MjsJoint) -> Sequence[float]:
    """Return the joint's frictionloss."""
    return (float(joint.frictionloss),) if joint.frictionloss else ()


EFFECT = TorqueEffect(
    name="coulomb",
    title="dry friction",
    family="friction",
    also_called=("friction", "dry friction", "stiction"),
    parameters=(Parameter("torque", "N*m", low=0.0, high=1.0, starts=(0.01, 0.06), rough=True),),
    law="τ = -F sgn v; sticks while the other torques stay within ±F",
    formula="{torque} sgn φ̇",
    source="Coulomb 1785; Feeny and Liang, J. Sound and Vibration 195 (1996): decrement of dry friction",
    does="Amplitude falls by the same amount 4F/k each period, then the joint stops, not always at rest.",
    look_alikes=("hysteresis", "stribeck", "dahl"),
    experiment="Release from {1°} and from {10°}: dry friction stops the small one at once, within ±F/k of rest.",
    mujoco=MujocoSupport(means="frictionloss with solreffriction 0.002 and solimpfriction 0.9999"),
    to_mjcf=to_mjcf,
    from_mjcf=from_mjcf,
    example=(0.15,),
    friction=friction,
)
