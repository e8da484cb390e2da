"""A joint's step as a linear map, both ways, against MuJoCo's step itself."""

import numpy as np
import pytest
from stepped_joint import simulate_steps

from sysid.joint.mujoco_step import Hinge
from sysid.joint.sampled import joint_of_map, step_map

JOINT = (8.7e-3, 14.684, 0.4)
INTEGRATORS = ("Euler", "implicit", "implicitfast", "discrete", "RK4")


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("timestep", [0.001, 0.005])
def test_trace_and_determinant_are_those_of_mujocos_step(integrator, timestep):
    inertia, stiffness, damping = JOINT
    hinge = Hinge(inertia=inertia, stiffness=(stiffness, 0.0, 0.0), damping=(damping, 0.0, 0.0))
    ends = [
        simulate_steps(hinge, start, 1, timestep=timestep, integrator=integrator)[1]
        for start in ((1.0, 0.0), (0.0, 1.0))
    ]
    matrix = np.column_stack(ends)
    expected = np.trace(matrix), np.linalg.det(matrix)
    assert step_map(*JOINT, timestep, integrator) == pytest.approx(
        expected, rel=1e-5 if integrator == "RK4" else 1e-12
    )


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_joint_comes_back_from_its_map(integrator):
    inertia, stiffness, damping = JOINT
    back = joint_of_map(*step_map(*JOINT, 0.005, integrator), stiffness, 0.005, integrator)
    assert back == pytest.approx((inertia, damping), rel=1e-9)
