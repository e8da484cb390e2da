"""A joint's step as a linear map, both ways, against MuJoCo's step itself."""

import mujoco
import numpy as np
import pytest

from sysid.joint.sampled import joint_of_map, step_map

JOINT = (8.7e-3, 14.684, 0.4)
INTEGRATORS = [
    name
    for name in ("Euler", "implicit", "implicitfast", "discrete", "RK4")
    if f"mjINT_{name.upper()}" in mujoco.mjtIntegrator.__members__
]


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("timestep", [0.001, 0.005])
def test_trace_and_determinant_are_those_of_mujocos_step(integrator, timestep):
    inertia, stiffness, damping = JOINT
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}" integrator="{integrator}" gravity="0 0 0"/><worldbody><body>
        <joint stiffness="{stiffness}" damping="{damping}" axis="1 0 0"/>
        <inertial pos="0 0 0" mass="1" diaginertia="{inertia} {inertia} {inertia}"/></body></worldbody></mujoco>"""
    )
    ends = []
    for start in ((1e-3, 0.0), (0.0, 1e-3)):
        data = mujoco.MjData(model)
        data.qpos[0], data.qvel[0] = start
        mujoco.mj_step(model, data)
        ends.append([data.qpos[0] / 1e-3, data.qvel[0] / 1e-3])
    expected = np.trace(ends), np.linalg.det(ends)
    assert step_map(*JOINT, timestep, integrator) == pytest.approx(
        expected, rel=1e-5 if integrator == "RK4" else 1e-11
    )


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_joint_comes_back_from_its_map(integrator):
    inertia, stiffness, damping = JOINT
    back = joint_of_map(*step_map(*JOINT, 0.005, integrator), stiffness, 0.005, integrator)
    assert back == pytest.approx((inertia, damping), rel=1e-9)
