"""A rubber that creeps: a spring and a damper in series, beside the main spring."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import JointState, MujocoSupport, Parameter, State, TorqueEffect

if TYPE_CHECKING:
    import mujoco


def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
    """Return -k₁ z, with z the stretch of the arm's spring [N*m]."""
    del m, motion
    return -parameters["stiffness"] * states[0]


def stretch_rate(m: Algebra, motion: JointState, states: Sequence[Value], parameters: Values) -> Value:
    """Return v - z/T: the arm's damper lets its spring relax [rad/s]."""
    del m
    return motion.rate - states[0] / parameters["time_constant"]


def held(m: Algebra, tilt: Value, hold: Value, stiffness: Value, parameters: Values) -> Value:
    """Return what a hold of that length has left of the stretch [rad]."""
    del stiffness
    return tilt * m.exp(-hold / parameters["time_constant"])


def to_mjcf(
    spec: "mujoco.MjSpec", joint: "mujoco.MjsJoint", parameters: Mapping[str, float], *, exact: bool = True
) -> tuple[str, ...]:
    """Write a passive motor winding: K²/L is the arm's stiffness, L/R its time constant."""
    import mujoco

    stiffness, time_constant = parameters["stiffness"], parameters["time_constant"]
    if not exact or not hasattr(getattr(mujoco, "mjtCtrlInput", None), "mjINPUT_NONE"):
        joint.stiffness[0] += stiffness
        return (f"viscoelastic: stiffness raised by {stiffness:.6g} N*m/rad, without the creep",)
    motor = spec.add_actuator(
        name=f"{joint.name}_viscoelastic", target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
    )
    motor.set_to_dcmotor(
        motorconst=[1.0, 1.0],
        resistance=1.0 / (stiffness * time_constant),
        inductance=[1.0 / stiffness, 0.0],
        ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_NONE),
    )
    return (
        f"viscoelastic: shorted winding as a Maxwell arm, {stiffness:.6g} N*m/rad, {time_constant:.6g} s",
    )


EFFECT = TorqueEffect(
    name="viscoelastic",
    title="viscoelastic rubber (Maxwell arm)",
    family="relaxation",
    parameters=(
        Parameter(
            name="stiffness", unit="N*m/rad", size=lambda s: s.stiffness, low=0.0, high=5.0, starts=(0.15,)
        ),
        Parameter(
            name="time_constant",
            unit="s",
            size=lambda s: 1.0 / s.frequency,
            low=0.1,
            high=60.0,
            starts=(0.6, 3.0, 12.0),
            neutral=None,
        ),
    ),
    law="τ = -k₁ z, ż = v - z/T",
    source="Maxwell 1867; Zener, Elasticity and Anelasticity of Metals (1948)",
    does="After a long hold the deck creeps back late; stiffness and damping depend on frequency.",
    look_alikes=("second-mode", "hanging-body", "two arms"),
    experiment=(
        "Hold for 0.2 s and for 5 s before release: rubber remembers the hold, a second mode does not. Two arms look "
        "like one in a free decay (three releases with 0.1° of noise: χ² of 15 at most while they carry a tenth of "
        "the spring's torque): only how far the deck creeps after holds of 0.1, 1 and 10 s tells them apart."
    ),
    mujoco=MujocoSupport(
        means="passive dcmotor: shorted R-L winding",
        since="3.12",
        warp=True,
        substitute="its high-frequency stiffness on the joint's spring",
    ),
    to_mjcf=to_mjcf,
    example=(5.0, 0.05),
    torque=torque,
    states=(State(name="stretch", start=held, size=lambda s: s.amplitude, rate=stretch_rate),),
)
