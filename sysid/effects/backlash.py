"""A gear with play: rotor and joint are two bodies that meet at the ends of a gap."""

from dataclasses import replace

from sysid.effects import compliance
from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import Parameter, left_out

JOINT = "a joint of its own between motor and link, with the gap as its range"


def transmit(m: Algebra, twist: Value, rate: Value, parameters: Values) -> Value:
    """Return the torque of the teeth beyond the gap [N*m]: K (twist ∓ w) + D rate; 0 within it."""
    gap = parameters["half_width"]
    beyond = twist - m.maximum(-gap, m.minimum(gap, twist))
    touching = m.where(m.abs(twist) > gap, 1.0, 0.0)
    return compliance.transmit(m, beyond, touching * rate, parameters)


EFFECT = replace(
    compliance.EFFECT,
    name="backlash",
    title="play of the gear under load",
    family="backlash",
    parameters=(
        Parameter("half_width", "rad", low=0.0, high=0.5, starts=(0.01, 0.05)),
        Parameter("stiffness", "N*m/rad", low=3.0, high=1000.0, starts=(60.0,), neutral=None),
        Parameter("damping", "N*m*s/rad", low=0.0, high=50.0, starts=(1.0,)),
    ),
    law="τ = K (θ - q ∓ w) + D (θ̇ - q̇) beyond the gap ±w between rotor θ and joint q, else 0",
    source="Nordin and Gutman, Automatica 38 (2002): controlling mechanical systems with backlash",
    does="At each change of direction the joint waits until the motor has crossed the gap.",
    look_alikes=("coulomb", "delay", "compliance"),
    experiment="Hold the motor and turn the joint by hand: it moves freely within the gap.",
    mujoco=replace(compliance.EFFECT.mujoco, substitute=JOINT),
    to_mjcf=left_out(f"backlash is not written: it needs {JOINT}"),
    example=(0.02, 300.0, 1.0),
    transmit=transmit,
)  # fmt: skip
