"""Hysteresis with round corners: a loss that depends on the path and starts gradually."""

import numpy as np

from sysid.effects._algebra import Algebra, Numbers, States, Value, Values
from sysid.effects._base import JointState, MjsJoint, MjSpec, MujocoSupport, Parameter, State, TorqueEffect
from sysid.effects.dahl import write_bristles


def torque(m: Algebra, motion: JointState, parameters: Values, states: States) -> Value:
    """Return -T z [N*m]; z between -1 and 1 is the current share of the yield torque."""
    return -parameters["torque"] * states[0]


def share_rate(m: Algebra, motion: JointState, states: States, parameters: Values) -> Value:
    """Return (v - u |v| z - (1 - u) v |z|) / a [1/s]: steep after a turn, flat after yielding."""
    (z,), rate, u = states, motion.rate, parameters["unloading"]
    return (rate - u * m.abs(rate) * z - (1 - u) * rate * m.abs(z)) / parameters["reach"]


def held(m: Algebra, tilt: Value, hold: Value, stiffness: Value, parameters: Values) -> Value:
    """Return the share after a slow drag from rest to the release angle."""
    side = m.where(tilt > 0, 1.0, -1.0)
    return side * (1 - m.exp(-m.abs(tilt) / parameters["reach"]))


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Write bristles of the same yield torque and the same loss in a wide swing.

    From a turning point until it yields again, the law loses T (s + a + W) less than dry friction. Here s is the way back to
    z = 0, and T W the energy that this way gives back. Bristles of the reach b lose 2 T b less.
    """
    return write_bristles(spec, joint, "bouc-wen", parameters["torque"], _reach(parameters), native=native)


def _reach(parameters: Numbers) -> float:
    """Return the reach of bristles with the same loss in a wide swing [rad]."""
    share = (np.arange(1000) + 0.5) / 1000
    back = np.mean((1 + share) / (1 + (2 * parameters["unloading"] - 1) * share))  # (s + W) / a
    return parameters["reach"] * float(1 + back) / 2


EFFECT = TorqueEffect(
    name="bouc-wen",
    title="hysteresis with round corners (Bouc–Wen)",
    family="hysteresis",
    parameters=(
        Parameter("torque", "N*m", low=0.0, high=2.0, starts=(0.05, 0.2)),
        Parameter("reach", "rad", low=0.01, high=5.0, starts=(0.1, 0.5), neutral=None),
        # At 0 it unloads along its loading line without a loss: a bent spring.
        Parameter("unloading", "", low=0.1, high=1.0, starts=(0.6,), neutral=None, default=0.5),
    ),
    law="τ = -T z, ż = (v - u |v| z - (1 - u) v |z|) / a",
    source="Bouc 1967; Wen, J. Engineering Mechanics 102 (1976), with exponent 1",
    does="Wide swings lose a fixed torque, small ones less and less: the loss a swing grows gradually with amplitude.",
    look_alikes=("hysteresis", "dahl", "coulomb", "viscoelastic"),
    experiment="Release from {1°}, {3°} and {10°}: the loss a swing, over its amplitude, is largest in the middle.",
    mujoco=MujocoSupport(
        means="nothing that unloads so",
        substitute="LuGre bristles of the same torque and loss of a wide swing",
    ),
    to_mjcf=to_mjcf,
    example=(0.3, 0.02, 0.5),
    torque=torque,
    states=(State(name="share", start=held, size=lambda s: 0.3, most=1 / 0.3, rate=share_rate),),
)  # fmt: skip
