"""Dry friction behind a spring: loss that depends on the path, not on the rate."""

from sysid.effects._algebra import Algebra, Numbers, States, Value, Values
from sysid.effects._base import JointState, MjsJoint, MjSpec, MujocoSupport, Parameter, State, TorqueEffect
from sysid.effects._mjcf import add_hinged_body, add_tendon, rest_of, set_friction


def torque(m: Algebra, motion: JointState, parameters: Values, states: States) -> Value:
    """Return -k₁ z, with z the stretch of the slider's spring [N*m]."""
    return -parameters["stiffness"] * states[0]


def slip(m: Algebra, stretch: Value, moved: Value, parameters: Values) -> Value:
    """Return the stretch after a move: it follows the tilt, and slips at ±T/k₁ [rad]."""
    reach = parameters["torque"] / (parameters["stiffness"] + 1e-12)
    return m.maximum(-reach, m.minimum(reach, stretch + moved))


def held(m: Algebra, tilt: Value, hold: Value, stiffness: Value, parameters: Values) -> Value:
    """Return the stretch of a slider that was dragged from rest to the release angle [rad]."""
    return slip(m, 0.0, tilt, parameters)


_SHARE = 3e-4
"""Inertia of the slider's body, as a share of the joint's own [1]."""


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Write a small body on the spring, dragged along by dry friction, or a tendon that yields (MuJoCo 4.0)."""
    stiffness, limit, rest = parameters["stiffness"], parameters["torque"], rest_of(spec, joint)
    if stiffness <= 0:
        return ()
    if native and hasattr(joint, "springyield"):
        tendon = add_tendon(spec, joint, "hysteresis", stiffness, (rest, rest))
        tendon.springyield = limit / stiffness
        return (f"hysteresis: tendon of {stiffness:.6g} N*m/rad that yields at {limit:.6g} N*m",)
    # The lightest body that the friction constraint and the time step allow. Its damping ratio of 1/√2 stops it soonest.
    inertia = max(_SHARE * float(joint.parent.inertia[0]), stiffness * float(spec.option.timestep) ** 2)
    hinge = add_hinged_body(
        joint.parent.parent, joint, "slider", joint.parent.pos, inertia=inertia, stiffness=stiffness,
        damping=(2 * stiffness * inertia) ** 0.5,
    )  # fmt: skip
    tendon = spec.add_tendon(name=f"{joint.name}_on_slider")
    tendon.wrap_joint(joint.name, 1.0)
    tendon.wrap_joint(hinge.name, -1.0)
    set_friction(tendon, limit)
    return (f"hysteresis: a body on {stiffness:.6g} N*m/rad that the joint drags along with {limit:.6g} N*m",)


EFFECT = TorqueEffect(
    name="hysteresis",
    title="rate-independent hysteresis (Jenkins slider)",
    family="hysteresis",
    also_called=("bushing",),
    parameters=(
        Parameter("stiffness", "N*m/rad", low=0.0, high=30.0, starts=(0.3, 2.0)),
        Parameter("torque", "N*m", low=0.0, high=1.0, starts=(0.04, 0.3), rough=True),
    ),
    law="τ = -k₁ z, z follows x and slips at ±T/k₁",
    source="Jenkin 1922; Iwan, J. Applied Mechanics 33 (1966)",
    does="Wide swings lose a fixed torque like dry friction; small ones only see a stiffer spring.",
    look_alikes=("coulomb", "stribeck"),
    experiment="Release from {1°}: a slider behind a spring swings on, dry friction stops.",
    mujoco=MujocoSupport(means="a small body on a spring, dragged along by a tendon's dry friction"),
    to_mjcf=to_mjcf,
    example=(8.0, 0.2),
    torque=torque,
    states=(State(name="stretch", start=held, size=lambda s: 0.1 * s.amplitude, return_map=slip),),
    nonsmooth=True,
)
