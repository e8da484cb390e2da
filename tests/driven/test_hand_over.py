"""What a fit hands over: the next motion, mjlab's actuators, several logs in one table."""

import ast
import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from driven_truths import Truth, simulate

from sysid.driven.export import handed_over, mjlab_module
from sysid.driven.fit import fit, free_of
from sysid.driven.joint import Structure
from sysid.driven.log import DrivenLog, Load
from sysid.driven.next_motion import next_motion
from sysid.driven.problem import Problem
from sysid.driven.report import fit_text
from sysid.driven.runs import agreement
from sysid.errors import SysidError
from sysid.quantity import Quantity

GAINS = {"servo-gains.kp": 20.0, "servo-gains.kd": 0.3}


def log_of_arm(name: str, friction: float, seed: int) -> DrivenLog:
    truth = Truth((), "command", 0.02, 0.01, 0.15, 0.8, kp=20.0, kd=0.3, own={"friction": friction})
    t = np.arange(800) / 200
    u = 0.3 * np.sin(2 * np.pi * 0.6 * t) + 0.1 * np.sin(2 * np.pi * 2.1 * t + seed)
    angle = simulate(truth, u, 200) + 5e-4 * np.random.default_rng(seed).standard_normal(800)
    load = Load(inertia=np.full(800, 0.02), torque=-0.8 * np.sin(angle), slope=-0.8 * np.cos(angle), at=angle)
    return DrivenLog(name=name, time=t, angle=angle, std=5e-4, input=u, kind="command", load=load)


@pytest.fixture(scope="module")
def fits():
    structure = Structure("command", ("coulomb", "delay"))
    free = free_of(structure, structure.effects, {})
    logs = [
        log_of_arm("monday.csv", 0.2, 1),
        log_of_arm("tuesday.csv", 0.2, 2),
        log_of_arm("friday.csv", 0.3, 3),
    ]
    return [fit(Problem(log=one, structure=structure, values=GAINS, free=free)) for one in logs]


def test_a_parameter_that_differs_between_logs_is_named(fits):
    found = agreement(fits)
    assert set(found.differs) == {"coulomb.torque"}
    same = agreement(fits[:2])
    assert not same.differs
    quantity = same.combined.quantities["coulomb.torque"]
    assert abs(quantity.value - 0.2) < 4 * quantity.std
    assert quantity.std < min(one.quantities["coulomb.torque"].std for one in fits[:2])


def test_a_parameter_that_varies_in_order_is_said_to_warm_up(fits):
    falling = [
        replace(
            one,
            quantities={
                **one.quantities,
                "damping": Quantity(0.15 - 0.02 * i, 1e-3, "N*m*s/rad"),
                "bias": Quantity(0.0, 1.0, "N*m"),
            },
        )
        for i, one in enumerate(fits)
    ]
    found = agreement(falling)
    assert "warms up" in found.causes["damping"]
    assert "bias" in found.loose
    assert "goes with the order" in fit_text("elbow", falling, found, {})


def test_the_next_motion_narrows_the_worst_interval_and_stays_in_range(fits):
    found = next_motion(fits[0])
    assert found.narrower < 0.7
    rows = np.loadtxt(found.csv().splitlines()[1:], delimiter=",")
    assert rows[-1, 0] == pytest.approx(fits[0].log.duration)
    assert np.ptp(rows[:, 1]) <= np.ptp(fits[0].log.angle)
    with pytest.raises(SysidError, match="Widen the range"):
        next_motion(fits[0], reach=(1.0, 1.0 + 1e-9))  # its weight overcomes the friction there


@pytest.fixture
def json_of_fit(fits, tmp_path):
    path = tmp_path / "fit.json"
    path.write_text(json.dumps({"joints": {"elbow": fits[0].to_json()}}))
    return path


def test_training_gets_values_and_ranges(json_of_fit, fits):
    one = handed_over(json_of_fit)["elbow"]
    assert one["kp"] == 20.0
    assert one["friction"] == fits[0].values["coulomb.torque"]
    assert one["ranges"]["armature"][0] < one["armature"] < one["ranges"]["armature"][1]
    text = mjlab_module({"elbow": one}, timestep=0.005, source="fit.json")
    assert {node.targets[0].id for node in ast.parse(text).body if isinstance(node, ast.Assign)} == {
        "ACTUATORS",
        "EVENTS",
    }
    with pytest.raises(SysidError, match="fit --input"):
        json_of_fit.write_text("{}")
        handed_over(json_of_fit)


@pytest.mark.train
@pytest.mark.filterwarnings("ignore")
def test_mjlab_reads_the_module(json_of_fit):
    pytest.importorskip("mjlab")
    joints = handed_over(json_of_fit)
    space: dict = {}
    exec(mjlab_module(joints, timestep=0.005, source="fit.json"), space)
    (one,) = space["ACTUATORS"]
    assert one.stiffness == joints["elbow"]["kp"]
    assert one.armature == joints["elbow"]["armature"]
    assert one.frictionloss == joints["elbow"]["friction"]
    assert one.viscous_damping == joints["elbow"]["damping"]
    term = space["EVENTS"]["elbow armature"]
    assert list(term.params["ranges"]) == joints["elbow"]["ranges"]["armature"]
    assert term.func.__name__ == "joint_armature"


@pytest.mark.train
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("own", [{"kp": 20.0, "kd": 0.3}, {"gain": 1.2}, {"limit": 3.0}])
def test_mjlab_builds_the_actuator_on_the_joint(own):
    entity = pytest.importorskip("mjlab.entity")
    joint = {"armature": 0.02, "damping": 0.3, "friction": 0.1, "ranges": {}, **own}
    space: dict = {}
    exec(mjlab_module({"elbow": joint}, timestep=0.005, source="fit.json"), space)
    arm = '<mujoco><worldbody><body><joint name="elbow"/><geom size="0.1" mass="1"/></body></worldbody></mujoco>'
    configuration = entity.EntityCfg(
        spec_fn=lambda: mujoco.MjSpec.from_string(arm),
        articulation=entity.EntityArticulationInfoCfg(actuators=space["ACTUATORS"]),
    )
    model = entity.Entity(configuration).spec.compile()
    assert model.actuator_gainprm[0, 0] == own.get("kp", 1.0)
    found = model.dof_armature[0], model.dof_damping[0], model.dof_frictionloss[0]
    assert found == (0.02, 0.3, 0.1)
    assert model.actuator_forcerange[0, 1] == own.get("limit", 0.0 if "kp" in own else mujoco.mjMAXVAL)
