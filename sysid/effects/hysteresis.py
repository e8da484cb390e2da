"""Dry friction behind a spring: loss that depends on the path, not on the rate."""

from collections.abc import Sequence

from sysid.effects import coulomb
from sysid.effects._algebra import Algebra, Numbers, Value, Values
from sysid.effects._base import JointState, MjsJoint, MjSpec, MujocoSupport, Parameter, State, TorqueEffect
from sysid.effects._mjcf import add_tendon, rest_of


def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
    """Return -k₁ z, with z the stretch of the slider's spring [N*m]."""
    return -parameters["stiffness"] * states[0]


def slip(m: Algebra, stretch: Value, moved: Value, parameters: Values) -> Value:
    """Return the stretch after a move: it follows the tilt, and slips at ±T/k₁ [rad]."""
    reach = parameters["torque"] / (parameters["stiffness"] + 1e-12)
    return m.maximum(-reach, m.minimum(reach, stretch + moved))


def held(m: Algebra, tilt: Value, hold: Value, stiffness: Value, parameters: Values) -> Value:
    """Return the stretch of a slider that was dragged from rest to the release angle [rad]."""
    return slip(m, 0.0, tilt, parameters)


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, exact: bool = True) -> tuple[str, ...]:
    """Write a tendon that yields, or dry friction where MuJoCo is older than 4.0."""
    stiffness, limit = parameters["stiffness"], parameters["torque"]
    if not exact or not hasattr(joint, "springyield"):
        coulomb.to_mjcf(spec, joint, {"torque": limit})
        return (f"hysteresis: frictionloss {limit:.6g} N*m only (springyield needs MuJoCo 4.0)",)
    rest = rest_of(spec, joint)
    tendon = add_tendon(spec, joint, "hysteresis", stiffness, (rest, rest))
    tendon.springyield = limit / stiffness
    return (f"hysteresis: tendon of {stiffness:.6g} N*m/rad that yields at {limit:.6g} N*m",)


def as_coulomb(parameters: Values) -> list[dict[str, float]]:
    """Return dry friction of the torque at which the slider slips: behind a hard spring it slips at once."""
    return [{"coulomb.torque": parameters["hysteresis.torque"]}]


EFFECT = TorqueEffect(
    name="hysteresis",
    title="rate-independent hysteresis (Jenkins slider)",
    family="hysteresis",
    parameters=(
        Parameter("stiffness", "N*m/rad", lambda s: s.stiffness, low=0.0, high=30.0, starts=(0.3, 2.0)),
        Parameter("torque", "N*m", lambda s: s.torque, low=0.0, high=1.0, starts=(0.04, 0.3), rough=True),
    ),
    law="τ = -k₁ z, z follows x and slips at ±T/k₁",
    source="Jenkin 1922; Iwan, J. Applied Mechanics 33 (1966)",
    does="Wide swings lose a fixed torque like dry friction; small ones only see a stiffer spring.",
    look_alikes=("coulomb", "stribeck"),
    experiment="Release from 1°: a slider behind a spring swings on, dry friction stops.",
    mujoco=MujocoSupport(
        means="fixed tendon with springyield",
        since="4.0",
        warp=True,
        substitute="coulomb at the slipping torque",
    ),
    to_mjcf=to_mjcf,
    example=(8.0, 0.2),
    torque=torque,
    states=(State(name="stretch", start=held, size=lambda s: 0.1 * s.amplitude, return_map=slip),),
    limiting_cases=(("coulomb", as_coulomb),),
    nonsmooth=True,
    sharpness=1.5,
)
