"""A rubber that creeps: a spring and a damper in series, beside the main spring."""

from sysid.effects._algebra import Algebra, Numbers, States, Value, Values
from sysid.effects._base import JointState, MjsJoint, MjSpec, MujocoSupport, Parameter, State, TorqueEffect
from sysid.effects._mjcf import add_passive_motor


def torque(m: Algebra, motion: JointState, parameters: Values, states: States) -> Value:
    """Return -k₁ z, with z the stretch of the arm's spring [N*m]."""
    return -parameters["stiffness"] * states[0]


def stretch_rate(m: Algebra, motion: JointState, states: States, parameters: Values) -> Value:
    """Return v - z/T: the arm's damper lets its spring relax [rad/s]."""
    return motion.rate - states[0] / parameters["time_constant"]


def held(m: Algebra, tilt: Value, hold: Value, stiffness: Value, parameters: Values) -> Value:
    """Return the stretch after a hold of that length [rad]."""
    return tilt * m.exp(-hold / parameters["time_constant"])


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Write a passive motor winding: K²/L is the arm's stiffness, L/R its time constant."""
    stiffness, time_constant = parameters["stiffness"], parameters["time_constant"]
    add_passive_motor(
        spec, joint, "viscoelastic", native=native, motorconst=[1.0, 1.0],
        resistance=1.0 / (stiffness * time_constant), inductance=[1.0 / stiffness, 0.0],
    )  # fmt: skip
    return (
        f"viscoelastic: shorted winding as a Maxwell arm, {stiffness:.6g} N*m/rad, {time_constant:.6g} s",
    )


EFFECT = TorqueEffect(
    name="viscoelastic",
    title="viscoelastic rubber (Maxwell arm)",
    family="relaxation",
    also_called=("rubber", "creep", "relaxation", "maxwell"),
    parameters=(
        Parameter("stiffness", "N*m/rad", low=0.0, high=5.0, starts=(0.15,)),
        Parameter("time_constant", "s", low=0.1, high=300.0, starts=(0.6, 3.0, 12.0), neutral=None),
    ),
    law="τ = -k₁ z, ż = v - z/T",
    source="Maxwell 1867; Zener, Elasticity and Anelasticity of Metals (1948)",
    does="After a long hold the joint creeps back late; stiffness and damping depend on frequency.",
    look_alikes=("second-mode", "hanging-body", "two arms"),
    experiment=(
        "Hold for 0.2 s and for 5 s before release: rubber remembers the hold, a second mode does not. A free decay cannot "
        "separate two arms with a tenth of the spring's torque (χ² below 15 for three releases with 0.1° of noise). "
        "Compare the creep after holds of 0.1, 1 and 10 s."
    ),
    mujoco=MujocoSupport(means="dcmotor without power: shorted R-L winding"),
    to_mjcf=to_mjcf,
    example=(5.0, 0.05),
    torque=torque,
    states=(
        State(
            name="stretch",
            start=held,
            size=lambda s: s.amplitude,
            most=2.0,
            rate=stretch_rate,
        ),
    ),
)
