"""An inertia that changes along the path, as in a closed loop of joints: known from a model."""

from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import MujocoSupport, TorqueEffect
from sysid.effects._harmonics import FORMULA, HARMONICS, held, slope_of, value_of
from sysid.effects._mjcf import refusing


def changing(m: Algebra, roll: Value, parameters: Values) -> tuple[Value, Value]:
    """Return the added inertia at a roll [kg*m^2], and its derivative."""
    return value_of(m, roll, parameters), slope_of(m, roll, parameters)


EFFECT = TorqueEffect(
    name="linkage",
    title="inertia that changes along the way",
    family="inertia",
    role="record",
    parameters=held("kg*m^2"),
    law=f"I → I + ΔI(φ), and τ = -½ ΔI'(φ) v²; ΔI = {FORMULA}",
    source="Lagrange's equation of one degree of freedom; the mass matrix of a model along the arc of the joint",
    does="The joint is slower where it moves more mass, so its period changes with the amplitude.",
    look_alikes=("cubic-stiffness", "gravity"),
    experiment="Open the loop: without it the inertia is the same everywhere.",
    mujoco=MujocoSupport(means="the loop of the model (equality constraints)"),
    to_mjcf=refusing(
        "a bench of one body has one inertia, and this joint's changes along its way. Release it in its own model "
        "(--model, --joint)."
    ),
    example=(0.0,) * len(HARMONICS),
    changing=changing,
    identifiable_from_decay=False,
)
