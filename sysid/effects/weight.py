"""The weight of what hangs on a joint, as a model of it states: known along the whole arc, so that it is not fitted."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.effects._algebra import Algebra, NumpyAlgebra, Value, Values
from sysid.effects._base import JointState, MujocoSupport, Parameter, TorqueEffect
from sysid.errors import SysidError
from sysid.roll import Array

if TYPE_CHECKING:
    import mujoco

HARMONICS = ("constant", "sine", "cosine", "sine2", "cosine2")
"""The terms 1, sin φ, cos φ, sin 2φ, cos 2φ; a rigid body on a hinge needs the second and third alone, on a slide the first."""


def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
    """Return s (c₀ + a₁ sin φ + b₁ cos φ + a₂ sin 2φ + b₂ cos 2φ) [N*m]."""
    del states
    terms = zip(HARMONICS, _terms(m, motion.roll), strict=True)
    return parameters["scale"] * sum(parameters[name] * term for name, term in terms)


def _terms(m: Algebra, roll: Value) -> tuple[Value, ...]:
    quarter = math.pi / 2
    return 1.0 + 0 * roll, m.sin(roll), m.sin(roll + quarter), m.sin(2 * roll), m.sin(2 * roll + quarter)


def slope(parameters: Mapping[str, float], roll: float) -> float:
    """Return the stiffness that it is for small motions about a roll [N*m/rad]."""
    p = parameters
    first = p["sine"] * math.cos(roll) - p["cosine"] * math.sin(roll)
    second = 2 * (p["sine2"] * math.cos(2 * roll) - p["cosine2"] * math.sin(2 * roll))
    return -p["scale"] * (first + second)


def of_table(roll: Array, torques: Array) -> tuple[dict[str, float], float]:
    """Return the parameters of a tabulated torque, and by how much they miss it at most [N*m].

    Args:
        roll: Where it was looked up [rad], shape (n,).
        torques: What pulls there [N*m], shape (n,); positive towards larger roll.
    """
    columns = np.column_stack(_terms(NumpyAlgebra(), roll))
    for count in (1, 3, 5):  # the fewest that hold it: on a short arc all five look alike
        values = np.zeros(5)
        values[:count] = np.linalg.lstsq(columns[:, :count], torques, rcond=1e-12)[0]
        missed = float(np.abs(columns @ values - torques).max())
        if missed < 1e-6 * max(float(np.abs(torques).max()), 1e-12):
            break
    values[np.abs(values) < 1e-10 * np.abs(values).max(initial=1e-12)] = 0.0
    return {"scale": 1.0, **dict(zip(HARMONICS, map(float, values), strict=True))}, missed


def to_mjcf(
    spec: "mujoco.MjSpec", joint: "mujoco.MjsJoint", parameters: Mapping[str, float], *, exact: bool = True
) -> tuple[str, ...]:
    """Put the centre of mass of a bench's body where it pulls so; a model of the robot has its masses already.

    Raises:
        SysidError: More than one rigid body on a hinge pulls there.
    """
    del exact
    body, p = joint.parent, parameters
    force = body.mass * float(-spec.option.gravity[2])
    if p["constant"] or p["sine2"] or p["cosine2"] or force <= 0:
        raise SysidError(
            "a bench of one body cannot pull as this weight does (a slide, a linkage, or gravity is off). Release the joint "
            "in its own model (--model, --joint)."
        )
    y, z = -p["scale"] * p["cosine"] / force, p["scale"] * p["sine"] / force
    about_own = body.inertia[0] - body.mass * (y * y + z * z)
    if about_own <= 0:
        raise SysidError(
            f"the weight needs the mass {body.mass:.4g} kg {math.hypot(y, z):.3g} m off the axis, more than the inertia "
            f"{body.inertia[0]:.4g} kg*m^2 allows. Check the mass."
        )
    body.ipos, body.inertia[0] = [0.0, y, z], about_own
    return (
        f"weight: centre of mass {math.hypot(y, z):.6g} m off the axis, inertia about the axis unchanged",
    )


def _held(name: str, unit: str) -> Parameter:
    return Parameter(
        name=name,
        unit=unit,
        size=lambda s: s.torque / s.amplitude,
        low=-10.0,
        high=10.0,
        starts=(0.0,),
        held=True,
    )


EFFECT = TorqueEffect(
    name="weight",
    title="weight as the model states it",
    family="hardening",
    role="record",
    parameters=(
        Parameter(
            name="scale",
            unit="1",
            size=lambda s: 1.0,
            low=0.1,
            high=10.0,
            starts=(1.0,),
            neutral=1.0,
            held=True,
        ),
        *(_held(name, "N*m") for name in HARMONICS),
    ),
    law="τ = s (c₀ + a₁ sin φ + b₁ cos φ + a₂ sin 2φ + b₂ cos 2φ), all but s from the masses of a model",
    source="mj_inverse along the arc of the joint; s = 1 unless it is bounded, and then fitted",
    does="Pulls the joint to where its weight hangs, known in N·m: what is measured against it has a scale.",
    look_alikes=("gravity", "stiffness of the record"),
    experiment="Measure in another pose or with a known mass added: weight changes as the model says, a spring does not.",
    mujoco=MujocoSupport(means="the masses of the model", since="3.0", warp=True),
    to_mjcf=to_mjcf,
    example=(1.0, 0.0, -2.0, 0.3, 0.0, 0.0),
    torque=torque,
    grounded=True,
    identifiable_from_decay=False,
    slope=slope,
)
