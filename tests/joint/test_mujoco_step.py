"""The CasADi step against MuJoCo itself, over random joints and steps."""

from types import SimpleNamespace

import casadi as ca
import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sysid.joint.mujoco_step import step

pytestmark = pytest.mark.train

DURATION = 0.5
"""Of a rollout [s]: one to six periods."""
SIZES = {
    "frequency": (10, 80), "damping_ratio": (0.005, 0.9), "inertia": (0.003, 0.1), "armature": (0, 0.3), "even": (-1, 1),
    "cubic": (-1, 30), "quadratic": (0, 0.3), "cubic_damping": (0, 0.05), "rest": (-0.05, 0.05), "friction": (0.001, 0.05),
    "start": (-0.2, 0.2), "rate": (-2, 2),
}  # fmt: skip
"""Sizes of real joints, for which all steps are stable."""


def rolled(inertia, torque, parameters, values, start, steps, *, timestep, frictionloss=0.0):
    """Return the positions of a joint's steps [rad], shape (steps + 1,), for values of its parameters."""
    y = ca.SX.sym("y", 2)
    after = ca.vertcat(*step(inertia, torque, y[0], y[1], timestep=timestep, frictionloss=frictionloss))
    many = ca.Function("step", [y, parameters], [after]).mapaccum("steps", steps)
    return ca.horzcat(start[0], many(start, values)[0, :])


@pytest.mark.parametrize("timestep", [0.001, 0.005])
@pytest.mark.parametrize("sticks", [False, True])
@given(case=st.fixed_dictionaries({name: st.floats(*ends) for name, ends in SIZES.items()}))
@settings(max_examples=8, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
def test_a_step_is_mujocos_to_rounding(sticks: bool, timestep: float, case: dict[str, float]):
    """With polynomials of spring and damper, and through sticking and slipping."""
    part = SimpleNamespace(**case)
    spring = part.frequency**2 * part.inertia * np.array([1.0, part.even, part.cubic])
    damper = part.inertia * np.array(
        [2 * part.damping_ratio * part.frequency, part.quadratic, part.cubic_damping]
    )
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep, spec.option.gravity = timestep, [0.0, 0.0, 0.0]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    body = spec.worldbody.add_body(mass=1.0, ipos=[0.0, 0.0, 0.0])
    body.inertia, body.explicitinertial = [part.inertia] * 3, True
    joint = body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[1.0, 0.0, 0.0])
    joint.stiffness, joint.damping, joint.springref = spring, damper, part.rest
    joint.armature, joint.frictionloss = part.armature * part.inertia, sticks * part.friction * spring[0]
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = part.start, part.rate
    expected = [part.start]
    for _ in range(int(DURATION / timestep)):
        mujoco.mj_step(model, data)
        expected.append(float(data.qpos[0]))

    def torque(q, v):
        x = q - part.rest
        pull = spring[0] * x + spring[1] * x**2 + spring[2] * x**3
        return -pull - damper[0] * v - damper[1] * v * ca.fabs(v) - damper[2] * v**3

    mass, none = part.inertia * (1 + part.armature), ca.SX.sym("none", 0)
    ours = rolled(
        mass, torque, none, ca.DM(0, 1), [part.start, part.rate], len(expected) - 1, timestep=timestep,
        frictionloss=float(joint.frictionloss),
    )  # fmt: skip
    assert np.abs(np.array(ours).ravel() - expected).max() < (1e-7 if sticks else 1e-9)


def test_sensitivities_are_exact():
    """CasADi's derivative of a rollout against central differences, through friction."""
    p, values = ca.SX.sym("p", 3), ca.MX.sym("values", 5)
    path = rolled(
        0.00715, lambda q, v: -p[0] * q - p[1] * v, p, ca.repmat(values[2:], 1, 400), values[:2], 400,
        timestep=0.005, frictionloss=p[2],
    )  # fmt: skip
    value = ca.Function("value", [values], [path[61]])
    slope = ca.Function("slope", [values], [ca.jacobian(path[61], values)])
    at = np.array([0.14, 0.5, 34.0, 0.3, 0.02])
    for delta, exact in zip(1e-6 * np.eye(5), np.array(slope(at)).ravel(), strict=True):
        high, low = float(value(at + delta)), float(value(at - delta))
        assert exact == pytest.approx((high - low) / 2e-6, rel=1e-5, abs=1e-9)
