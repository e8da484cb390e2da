"""A gear that twists: rotor and joint are two bodies on a spring."""

from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import DriveEffect, MujocoSupport, Parameter, left_out


def transmit(m: Algebra, twist: Value, rate: Value, parameters: Values) -> Value:
    """Return K twist + D rate [N*m]."""
    return parameters["stiffness"] * twist + parameters["damping"] * rate


EFFECT = DriveEffect(
    name="compliance",
    title="compliant gear",
    family="compliance",
    parameters=(
        Parameter("stiffness", "N*m/rad", low=0.3, high=300.0, starts=(2.0, 8.0, 30.0), neutral=None),
        Parameter("damping", "N*m*s/rad", low=0.0, high=10.0, starts=(0.05,)),
    ),
    law="τ = K (θ - q) + D (θ̇ - q̇) between rotor θ and joint q; armature, damping and friction are the rotor's",
    source="Spong, J. Dyn. Sys. Meas. Control 109 (1987): elastic joint robots",
    does="The joint rings behind every jerk at a frequency of its own.",
    look_alikes=("backlash", "delay", "second-mode"),
    experiment="Lock the output and drive the motor: what still turns is the gear.",
    mujoco=MujocoSupport(
        means="nothing of one joint", substitute="a joint of its own between motor and link, with stiffness and damping"
    ),
    to_mjcf=left_out("compliance is not written: it needs a second joint between motor and link; build it in with its stiffness and damping"),
    example=(200.0, 0.5),
    stage=3,
    transmit=transmit,
)  # fmt: skip
