"""Torque of a motor that comes back with every pole or tooth."""

from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import Actuation, DriveEffect, MujocoSupport, Parameter, left_out


def act(m: Algebra, actuation: Actuation, parameters: Values) -> Value:
    """Return the torque plus S sin(n q) + C cos(n q) [N*m]."""
    phase = parameters["teeth"] * actuation.angle
    return actuation.torque + parameters["sine"] * m.sin(phase) + parameters["cosine"] * m.cos(phase)


EFFECT = DriveEffect(
    name="cogging",
    title="cogging torque",
    family="cogging",
    parameters=(
        Parameter("sine", "N*m", low=-1.0, high=1.0, starts=(0.05,)),
        Parameter("cosine", "N*m", low=-1.0, high=1.0, starts=(0.05,)),
        Parameter("teeth", "1/rad", lambda s: 1.0, low=2.0, high=300.0, starts=tuple(range(3, 61)), neutral=None),
    ),
    law="τ = S sin n q + C cos n q",
    source="Hanselman, Brushless Permanent Magnet Motor Design (2003): torque without current, n times a turn",
    does="The joint runs unevenly, with one ripple for each pole or tooth, and likes to rest at some angles.",
    look_alikes=("coulomb", "gravity"),
    experiment="Drive it slowly through a full turn both ways: the ripple stays with the angle.",
    mujoco=MujocoSupport(means="nothing that repeats with the angle"),
    to_mjcf=left_out("cogging is not written: MuJoCo has no torque that repeats with the angle of a joint"),
    example=(0.05, 0.02, 12.0),
    stage=2,
    act=act,
)  # fmt: skip
