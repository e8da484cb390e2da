"""Joints of one model that are fitted together."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from driven_coverage import run, xml

from sim.model.driven import Course, free_inertia, load_along, stated
from sim.model.setup import Setup
from sysid.driven.joint import VARYING, Structure, simulate
from sysid.effects import coulomb


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_a_joint_beside_another_moves_as_mujoco_moves_it(tmp_path, integrator):
    own = [
        'armature="0.1" damping="0.6" frictionloss="0.3"',
        'armature="0.04" damping="1.8" frictionloss="1.5"',
    ]
    file, step, steps = tmp_path / "leg.xml", 0.002, 1500
    option = f'<option timestep="{step}" integrator="{integrator}"/>'
    file.write_text(xml([(2.0, 0.3), (1.5, 0.25)], own, option, servo=True))
    model = mujoco.MjModel.from_xml_path(str(file))
    data, states = mujoco.MjData(model), []
    inputs = 0.4 * np.sin(2 * np.pi * np.outer([1.3, 2.1], step * np.arange(steps)))
    for u in inputs.T:
        states.append([data.qpos.copy(), data.qvel.copy()])
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
    angles, rates = np.array(states).transpose(1, 2, 0)
    damping = model.dof_damping + 0.6 * (integrator == "implicitfast")  # kd of its servos
    courses = {
        f"j{i}": Course(angle=angles[i, :-1], rate=rates[i, :-1], acceleration=np.diff(rates[i]) / step,
                        armature=model.dof_armature[i], damping=damping[i])
        for i in range(2)
    }  # fmt: skip
    for i, name in enumerate(courses):
        setup = Setup(file=file, joint=name)
        known = stated(setup, "command")
        simulator = replace(known.simulator, alone=free_inertia(setup, {}))
        structure = Structure("command", (coulomb.EFFECT.name,), simulator=simulator)
        vector = np.array([known.values.get(p, 0.0) for p in structure.parameters])
        rows = load_along(setup, courses).rows
        none = np.zeros((1, steps - 1))
        given = np.vstack(
            [none + step, none, inputs[i, :-1], none, rows, *(none for _ in VARYING)]
        )  # a step of Euler takes all at its start
        path = simulate(structure, (), np.array([angles[i, 0], rates[i, 0]]), vector, given)
        assert np.abs(path[:, 0, 0] - angles[i]).max() < 1e-9  # rounding; its range is 0.5 rad


@pytest.mark.slow
@pytest.mark.parametrize("case", ["double", "servo"])
def test_two_joints_of_mujoco_give_their_parameters_back(case):
    row = run(case, 1)  # Euler at 2 ms, MuJoCo's own friction
    assert row["simulator"] == [True, True]
    assert row["error"] < 1.02  # times the noise of the encoders
    for name in {"armature", "damping", "friction", "bias", "zero", "delay"} & set(row):
        assert max(map(abs, row[name])) < 3.5, name  # deviations
