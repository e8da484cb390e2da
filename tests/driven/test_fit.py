"""Driven joints: fits of logs whose truth was moved by other code, in plain MuJoCo or by formulas."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from driven_truths import Truth, make, simulate

from sysid.driven.diagnose import diagnose
from sysid.driven.fit import _shorter, fit, free_of, start_values, with_likelier_input
from sysid.driven.joint import Simulator, Structure
from sysid.driven.log import DrivenLog, Load, log_of
from sysid.driven.problem import Problem
from sysid.effects import drives, effect
from sysid.errors import SysidError
from sysid.roll import Roll


def driven(truth: Truth, u: np.ndarray, rate: float, noise: float, seed: int = 0) -> DrivenLog:
    angle = simulate(truth, u, rate)
    measured = angle + noise * np.random.default_rng(seed).standard_normal(len(u))
    load = Load(
        inertia=np.full(len(u), truth.inertia),
        torque=-truth.weight * np.sin(measured),
        slope=-truth.weight * np.cos(measured),
        at=measured,
    )
    return DrivenLog(
        name="log",
        time=np.arange(len(u)) / rate,
        angle=measured,
        std=noise,
        input=u,
        kind=truth.kind,
        load=load,
    )


def posed(log: DrivenLog, structure: Structure, given: dict[str, float], *named: str) -> Problem:
    free = free_of(structure, (*structure.effects, *named), {})
    return Problem(log=log, structure=structure, values=given, free=free)


def waves(seconds: float, rate: float, size: float) -> np.ndarray:
    t = np.arange(round(seconds * rate)) / rate
    return size * (
        np.sin(2 * np.pi * 0.7 * t)
        + 0.5 * np.sin(2 * np.pi * 1.9 * t + 1)
        + 0.2 * np.sin(2 * np.pi * 4.3 * t)
    )


SERVO = {"servo-gains.kp": 20.0, "servo-gains.kd": 0.3}


def test_a_servo_joint_is_found_within_its_intervals():
    truth = Truth(
        ("friction", "delay"),
        "command",
        0.02,
        0.01,
        0.15,
        0.8,
        kp=20.0,
        kd=0.3,
        own={"friction": 0.3, "delay": 0.015},
    )
    log = driven(truth, waves(8, 200, 0.4), 200, 4e-4)
    structure = Structure("command", ("coulomb", "delay"))
    found = fit(posed(log, structure, SERVO))
    for name, value in {
        "armature": 0.01,
        "damping": 0.15,
        "coulomb.torque": 0.3,
        "delay.time": 0.015,
        "bias": 0.0,
    }.items():
        quantity = found.quantities[name]
        assert abs(quantity.value - value) < 4 * quantity.std, name
        assert quantity.std < 0.03 * max(value, 0.3), name
    assert found.rmse == pytest.approx(4e-4, rel=0.05)


def test_a_torque_gives_inertia_and_an_unknown_gain_needs_a_known_load():
    truth = Truth((), "torque", 0.02, 0.01, 0.15, 0.8)
    log = driven(truth, waves(8, 200, 0.5), 200, 4e-4)
    structure = Structure("torque")
    known = fit(posed(log, structure, {}))
    assert known.values["armature"] == pytest.approx(0.01, rel=0.03)
    free = fit(posed(log, structure, {}, "torque-constant"))
    assert free.values["torque-constant.gain"] == pytest.approx(1.0, abs=0.02)
    assert free.quantities["torque-constant.gain"].std > 0


def test_windows_shorten_to_the_end_though_intervals_widen_in_between():
    """Else the result depends on the number of windows of the first fit, and so on the model's share of the inertia."""
    truth = Truth((), "torque", 0.02, 0.01, 0.15, 0.8)
    problem = posed(driven(truth, waves(8, 100, 0.5), 100, 4e-4), Structure("torque"), {})
    problem = replace(problem, values=start_values(problem.structure, {"armature": 0.01}, problem.log))
    assert [one.windows for one, *_ in _shorter((problem, problem.fitted()))] == [64, 16, 4, 1]


def test_dry_friction_is_named_by_its_simplest_law():
    truth = Truth(("friction",), "torque", 0.02, 0.01, 0.15, 0.8, own={"friction": 0.15})
    found = diagnose(driven(truth, waves(6, 100, 0.8), 100, 4e-4), {})
    assert found.effects == ("coulomb",)  # the friction of `stribeck` holds it
    assert found.status == "missing"


def test_friction_turns_within_a_step():
    truth = Truth(("friction",), "torque", 0.5, 0.1, 3.0, 10.0, own={"friction": 2.0})
    log = driven(truth, waves(6, 100, 6.0), 100, 1e-6)
    structure = Structure("torque", ("coulomb",))
    values = start_values(structure, {"armature": 0.1, "damping": 3.0, "coulomb.torque": 2.0}, log)
    worst = []
    for finer in (1, 2, 4):
        problem = Problem(log=log, structure=structure, values=values, free=("armature",), finer=finer)
        begin = problem.begin()
        begin[1:] = 0.0  # it starts from rest
        worst.append(np.abs(problem.residuals(begin, slopes=False)[0][0]).max() * 1e-6)
    assert max(worst) < 4e-4 * np.ptp(
        log.angle
    )  # one step a sample is 3 times the error of an impulse at its end


@pytest.mark.parametrize("name", [name for name, part in drives().items() if not part.sources])
def test_sensitivities_are_those_of_the_motion(name):
    truth = Truth((), "command", 0.02, 0.02, 0.15, 0.8, kp=20.0, kd=0.3)
    log = driven(truth, waves(2, 100, 0.4), 100, 1e-3)
    structure = Structure("command", (name,))
    free = free_of(structure, (name,), {})
    part = effect(name)
    given = {f"{name}.{p.name}": 1.37 * x for p, x in zip(part.parameters, part.example, strict=True)}
    problem = Problem(
        log=log,
        structure=structure,
        values=start_values(structure, {**SERVO, "armature": 0.02, **given}, log),
        free=free,
    )
    point = problem.begin()
    _, (rows,) = problem.residuals(point)
    for index in range(len(free)):
        step = 1e-6 * max(abs(point[index]), 1e-2)
        ends = []
        for sign in (1, -1):
            moved = point.copy()
            moved[index] += sign * step
            ends.append(problem.residuals(moved, slopes=False)[0][0])
        numeric = -(ends[0] - ends[1]) / (2 * step)
        assert np.abs(numeric - rows[:, index]).max() < 2e-3 * np.abs(rows[:, index]).max() + 1e-3, free[
            index
        ]


HELD = DrivenLog(
    name="", time=np.arange(5.0), angle=np.arange(5.0), std=1.0, input=np.array([0.0, 1, 3, 3, 0]), kind="torque",
    load=Load.constant(1.0, 5),
)  # fmt: skip


def test_a_held_input_is_late_by_exactly_the_delay():
    grid = np.arange(0.0, 5.0)
    assert HELD.mean_input(grid, 0.0)[0].tolist() == [0, 1, 3, 3]
    assert HELD.mean_input(grid, 0.25)[0].tolist() == [0, 0.75, 2.5, 3]
    mean, ramp, *slopes = HELD.mean_input(grid, 0.25)
    assert np.allclose((HELD.mean_input(grid, 0.26)[0] - mean) / 0.01, slopes[0])
    assert np.allclose((HELD.mean_input(grid, 0.25001)[1] - ramp) / 1e-5, slopes[1], atol=1e-3)


def test_mean_and_ramp_move_a_joint_as_the_input_does():
    mean, ramp = HELD.mean_input(np.arange(0.0, 5.0), 0.25)[:2]
    rate, way = np.cumsum(np.r_[0.0, mean]), [0.0]
    for before, m, r in zip(rate[:-1], mean, ramp, strict=True):
        way.append(way[-1] + before + m / 2 - r / 12)
    fine = np.arange(0.0, 4.0, 1e-4) + 5e-5
    exact = np.cumsum(np.cumsum(HELD.input[np.floor(np.maximum(fine - 0.25, 0)).astype(int)])) * 1e-8
    assert np.allclose(way[1:], exact[9999::10000], atol=1e-3)


@pytest.mark.parametrize("smooth", [True, False])
def test_the_log_says_whether_its_input_was_held(smooth):
    truth = Truth((), "torque", 0.02, 0.01, 0.15, 0.8)
    fine = np.arange(4000) / 1000
    u = 0.8 * np.sin(2 * np.pi * (0.3 * fine + 0.5 * fine**2))
    u = u if smooth else np.repeat(u[::10], 10)
    whole = driven(truth, u, 1000, 4e-4)
    load = Load.of(whole.load.rows[:, ::10])
    log = replace(whole, time=whole.time[::10], angle=whole.angle[::10], input=u[::10], load=load, held=None)
    structure = Structure("torque", ("delay",))
    found = with_likelier_input(posed(log, structure, {}))
    assert found.held is not smooth
    assert found.between == ("smooth" if smooth else "held")


def test_an_input_that_drives_nothing_is_refused():
    time = np.arange(100.0)
    roll = Roll(
        log="x.csv",
        time=time,
        roll=np.sin(time),
        std=np.full(100, 0.1),
        origin="angle",
        extra={"tau": np.zeros(100), "gap": np.full(100, np.nan)},
    )
    with pytest.raises(SysidError, match="always 0"):
        log_of(roll, "tau", "torque")
    with pytest.raises(SysidError, match="holds no number"):
        log_of(roll, "gap", "torque")


def moved_by_mujoco(seconds: float, rate: int) -> tuple[np.ndarray, np.ndarray, mujoco.MjModel]:
    """Inputs and angles of a link under a torque, by MuJoCo's own Euler at 2 ms and its own friction."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep="0.002"/><worldbody><body><joint axis="0 1 0" armature="0.01" damping="0.2" frictionloss="0.15"/>
        <inertial pos="0 0 -0.15" mass="0.8" diaginertia="0.004 0.004 0.001"/></body></worldbody></mujoco>"""
    )
    data, u = mujoco.MjData(model), waves(seconds, rate, 1.2)
    angle = np.empty_like(u)
    for i, torque in enumerate(u):
        angle[i], data.qfrc_applied[0] = data.qpos[0], torque
        mujoco.mj_step(model, data, round(500 / rate))
    return u, angle, model


def test_a_log_of_mujoco_is_fitted_as_mujoco_moves_it():
    u, angle, model = moved_by_mujoco(6, 250)
    seen = angle + 3e-4 * np.random.default_rng(3).standard_normal(len(u))
    inertia, weight = 0.004 + 0.8 * 0.15**2, 0.8 * 9.81 * 0.15
    load = Load(
        inertia=np.full(len(u), inertia), torque=-weight * np.sin(seen), slope=-weight * np.cos(seen), at=seen
    )
    log = DrivenLog(
        name="mujoco", time=np.arange(len(u)) / 250, angle=seen, std=3e-4, input=u, kind="torque", load=load
    )
    structure = Structure("torque", ("coulomb",))
    simulator = Simulator(
        step=0.002, implicit="joint", rate=2 / (0.95 * 0.02), softness=1 / 0.9 - 1, alone=inertia
    )
    off = {}
    for law in (None, simulator):
        found = fit(posed(log, structure, {}), simulator=law)
        assert found.structure.simulator is law
        q = found.quantities["armature"]
        off[law] = abs(q.value - model.dof_armature[0]) / q.std
        assert found.rmse < 1.05 * 3e-4 or law is None
    assert off[simulator] < 4 < off[None]  # its friction turns before the joint does


def test_effects_that_do_not_go_together_are_refused():
    with pytest.raises(SysidError, match="one gear"):
        Structure("torque", ("backlash", "compliance")).checked()
    with pytest.raises(SysidError, match="another input than a torque"):
        Structure("torque", ("servo-gains",)).checked()
    with pytest.raises(SysidError, match="--gains"):
        start_values(Structure("command"), {}, make(3, ("saturation",))[1])
