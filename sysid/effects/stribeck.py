"""Dry friction that is larger at standstill than in motion."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from sysid.effects.base import Algebra, Effect, MujocoSupport, Parameter, Value, Values

if TYPE_CHECKING:
    import mujoco

BRISTLE_STIFFNESS = 5000.0
BRISTLE_DAMPING = 1.0
"""Of the LuGre model that stands in for a hard stick in MuJoCo [N*m/rad, N*m*s/rad]."""


def friction(m: Algebra, speed: Value, parameters: Values) -> Value:
    """Return Fc + (Fs - Fc) exp(-(v/vs)²) [N*m]; Fs below Fc counts as Fc."""
    extra = m.maximum(parameters["static_torque"] - parameters["torque"], 0.0)
    return parameters["torque"] + extra * m.exp(-((speed / parameters["velocity"]) ** 2))


def to_mjcf(
    spec: "mujoco.MjSpec", joint: "mujoco.MjsJoint", parameters: Mapping[str, float], *, exact: bool = True
) -> tuple[str, ...]:
    """Write a LuGre element without an input, or plain dry friction where MuJoCo is older than 3.12."""
    import mujoco

    sliding, static, velocity = (parameters[name] for name in ("torque", "static_torque", "velocity"))
    if not exact or not hasattr(getattr(mujoco, "mjtCtrlInput", None), "mjINPUT_NONE"):
        from sysid.effects import coulomb

        coulomb.to_mjcf(spec, joint, {"torque": sliding})
        return (f"stribeck: frictionloss {sliding:.6g} N*m only (this MuJoCo has no passive LuGre element)",)
    motor = spec.add_actuator(
        name=f"{joint.name}_stribeck", target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
    )
    motor.set_to_dcmotor(
        motorconst=[0.0, 0.0],
        resistance=1.0,
        lugre=[BRISTLE_STIFFNESS, BRISTLE_DAMPING, sliding, static, velocity],
        ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_NONE),
    )
    return (f"stribeck: LuGre element {sliding:.6g} / {static:.6g} N*m, {velocity:.6g} rad/s",)


EFFECT = Effect(
    name="stribeck",
    title="dry friction with stiction",
    parameters=(
        Parameter(name="torque", unit="N*m", size=lambda s: s.torque, low=0.0, high=1.0, starts=(0.02,)),
        Parameter(
            name="static_torque",
            unit="N*m",
            size=lambda s: s.torque,
            low=0.0,
            high=1.0,
            starts=(0.06,),
            neutral=None,
        ),
        Parameter(
            name="velocity",
            unit="rad/s",
            size=lambda s: s.rate,
            low=0.003,
            high=2.0,
            starts=(0.1, 0.4),
            neutral=None,
        ),
    ),
    law="τ = -(Fc + (Fs - Fc) exp(-(v/vs)²)) sgn v; sticks while the other torques stay within ±Fs",
    source="Stribeck 1902; Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30 (1994)",
    does="Slow swings lose more than dry friction alone would take, and the deck stops early and off rest.",
    look_alikes=("coulomb", "hysteresis"),
    experiment="Pull the deck slowly with a spring balance: stiction shows as a jerk when it lets go.",
    mujoco=MujocoSupport(
        means="passive dcmotor with LuGre friction",
        since="3.12",
        warp=True,
        substitute="coulomb at the sliding torque",
    ),
    to_mjcf=to_mjcf,
    example=(0.08, 0.25, 0.5),
    friction=friction,
)
