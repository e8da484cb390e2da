import mujoco
import numpy as np
import pytest

from sim.skate.robot import g1
from sysid.errors import SysidError

pytestmark = pytest.mark.train


@pytest.fixture(scope="module")
def model():
    try:
        g1.g1_xml()
    except SysidError as error:
        pytest.skip(str(error))
    spec = g1.g1_spec(visuals=False)
    g1.add_servos(spec)
    return spec.compile()


def test_model_has_the_23_joints_in_policy_order_and_the_mass_of_the_stock_robot(model):
    names = [model.joint(i).name for i in range(1, model.njnt)]
    assert names == list(g1.JOINTS)
    assert (model.nq, model.nv, model.nu) == (30, 29, 23)
    assert model.body_mass.sum() == pytest.approx(33.3411, abs=1e-3)  # the wrist links stay, welded


def test_servos_follow_from_armature_frequency_and_damping_ratio(model):
    servos = g1.servos()
    omega = 2 * np.pi * 10
    armature = model.dof_armature[6:]
    np.testing.assert_allclose(servos.stiffness, armature * omega**2, rtol=1e-12)
    np.testing.assert_allclose(servos.damping, 4 * armature * omega, rtol=1e-12)
    knee, elbow = g1.JOINTS.index("left_knee_joint"), g1.JOINTS.index("right_elbow_joint")
    assert servos.stiffness[knee] == pytest.approx(99.0984, abs=1e-3)
    assert servos.action_scale[knee] == pytest.approx(0.35066, abs=1e-5)
    assert servos.damping[elbow] == pytest.approx(0.90722, abs=1e-5)


def test_servos_in_the_model_pull_with_kp_and_stop_at_the_limit(model):
    data = mujoco.MjData(model)
    data.ctrl[:] = 0.01
    data.qvel[6:] = 0.02
    mujoco.mj_forward(model, data)
    servos = g1.servos()
    np.testing.assert_allclose(
        data.actuator_force, servos.stiffness * 0.01 - servos.damping * 0.02, rtol=1e-9
    )
    data.ctrl[:] = 100.0
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.actuator_force, servos.effort)


def test_missing_mjlab_is_said_in_words(monkeypatch):
    monkeypatch.setattr(g1, "find_spec", lambda name: None)
    with pytest.raises(SysidError, match=r"mjlab.*not installed.*pip install mjlab"):
        g1.g1_xml()
