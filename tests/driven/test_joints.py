"""Joints of one model that are fitted together."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from driven_coverage import run, xml

from sim.model.driven import Course, coupling_along, free_inertia, load_along, stated
from sim.model.driven_fit import shifts_of
from sim.model.setup import Setup
from sysid.driven.joint import VARYING, Structure, simulate
from sysid.driven.log import DrivenLog
from sysid.driven.problem import Problem
from sysid.effects import coulomb

STEP, STEPS = 0.002, 1500


def leg(tmp_path, integrator, knee_damping=1.8):
    """A leg of two joints, its angles and rates, and its inputs, by MuJoCo."""
    own = [
        'armature="0.1" damping="0.6" frictionloss="0.3"',
        f'armature="0.04" damping="{knee_damping}" frictionloss="1.5"',
    ]
    file = tmp_path / "leg.xml"
    option = f'<option timestep="{STEP}" integrator="{integrator}"/>'
    file.write_text(xml([(2.0, 0.3), (1.5, 0.25)], own, option, servo=True))
    model = mujoco.MjModel.from_xml_path(str(file))
    data, states = mujoco.MjData(model), []
    inputs = 0.4 * np.sin(2 * np.pi * np.outer([1.3, 2.1], STEP * np.arange(STEPS)))
    for u in inputs.T:
        states.append([data.qpos.copy(), data.qvel.copy()])
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
    return file, model, np.array(states).transpose(1, 2, 0), inputs


def courses_of(model, angles, rates, integrator):
    damping = model.dof_damping + 0.6 * (integrator == "implicitfast")  # kd of its servos
    return {
        f"j{i}": Course(angle=angles[i, :-1], rate=rates[i, :-1], acceleration=np.diff(rates[i]) / STEP,
                        armature=model.dof_armature[i], damping=damping[i])
        for i in range(2)
    }  # fmt: skip


def law_of(file, name):
    setup = Setup(file=file, joint=name)
    known = stated(setup, "command")
    simulator = replace(known.simulator, alone=free_inertia(setup, {}))
    return setup, Structure("command", (coulomb.EFFECT.name,), simulator=simulator), known.values


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_a_joint_beside_another_moves_as_mujoco_moves_it(tmp_path, integrator):
    file, model, (angles, rates), inputs = leg(tmp_path, integrator)
    courses = courses_of(model, angles, rates, integrator)
    for i, name in enumerate(courses):
        setup, structure, known = law_of(file, name)
        vector = np.array([known.get(p, 0.0) for p in structure.parameters])
        rows = load_along(setup, courses).rows
        none = np.zeros((1, STEPS - 1))
        given = np.vstack(
            [none + STEP, none, inputs[i, :-1], none, rows, *(none for _ in VARYING)]
        )  # a step of Euler takes all at its start
        path = simulate(structure, (), np.array([angles[i, 0], rates[i, 0]]), vector, given)
        assert np.abs(path[:, 0, 0] - angles[i]).max() < 1e-9  # rounding; its range is 0.5 rad


def test_a_joint_answers_to_the_parameter_of_another_as_in_mujoco(tmp_path):
    file, model, (angles, rates), inputs = leg(tmp_path, "Euler")
    courses = courses_of(model, angles, rates, "Euler")
    time, waves, moves = STEP * np.arange(STEPS), [], []
    for i, name in enumerate(courses):
        setup, structure, known = law_of(file, name)
        load = load_along(setup, courses, time[:-1])
        log = DrivenLog(
            name="", time=time, angle=angles[i], std=1.0, input=inputs[i], kind="command", load=load
        )
        values = dict.fromkeys(structure.parameters, 0.0) | known
        problem = Problem(log=log, structure=structure, values=values, free=("damping",))
        point = np.r_[known["damping"], angles[i, 0], rates[i, 0]] / problem.sizes
        path = next(problem.paths(point, slopes=True))
        waves.append(path[:, :2, 1] / problem.sizes[0] * (name == "j1"))
        moves.append(problem.transitions(point, path[:, :, 0]))
    low, high = (leg(tmp_path, "Euler", 1.8 + change)[2][0] for change in (-1e-3, 1e-3))
    whole = (high - low) / 2e-3
    full = {
        name: Course(angle=angles[i], rate=rates[i], acceleration=np.gradient(rates[i], STEP))
        for i, name in enumerate(courses)
    }
    coupling = coupling_along(Setup(file=file, joint="j0"), full)
    shifts = shifts_of(moves, coupling, np.concatenate(waves, axis=1)[:, :, None], STEP)
    for found, wanted, wave in zip(shifts, whole, waves, strict=True):
        assert np.abs(wave[:, 0] + found[:, 0, 0] - wanted).max() < 0.03 * np.abs(whole).max()


@pytest.mark.slow
@pytest.mark.parametrize("case", ["double", "servo"])
def test_two_joints_of_mujoco_give_their_parameters_back(case):
    row = run(case, 1)  # Euler at 2 ms, MuJoCo's own friction
    assert row["simulator"] == [True, True]
    assert row["error"] < 1.02  # times the noise of the encoders
    for name in {"armature", "damping", "friction", "bias", "zero", "delay"} & set(row):
        assert max(map(abs, row[name])) < 3.5, name  # deviations
