"""Rake and rolling resistance from simulated roll-outs: MuJoCo's contacts are the truth, no formula of the estimate."""

import json
import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from command_line import called
from riding import pink

from sim.board.scene import TILT_JOINT, WHEELS, board_spec
from sysid.board import load_board
from sysid.errors import SysidError
from sysid.experiments.roll_out import from_imu, from_path, roll_out
from sysid.quantity import Quantity

WHEELBASE = Quantity(0.4, 0.001, "m", "ruler")


def rolled(
    rake_deg=60.0, speed=2.0, tilts=(0.05, -0.06, 0.03), time=3.0, slope=0.0, friction=None, pushed=0.0
):
    """Return time, position, heading, forward specific force and roll of a board, its tilt held at values in turn.

    With `pushed` it stands for a second and is then pushed by so many newtons for one second.
    """
    board = pink()
    geometry = {**board.geometry, "rake": replace(board.geometry["rake"], value=math.radians(rake_deg))}
    spec = board_spec(replace(board, geometry=geometry), timestep=0.002, friction=friction)
    spec.body("board").add_body().add_geom(  # a load on the level part
        type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.2, 0.1, 0.05], mass=33.3, contype=0, conaffinity=0
    )
    joint = spec.joint(TILT_JOINT)
    joint.stiffness[0], joint.damping[0] = 5e3, 50.0
    model = spec.compile()
    model.opt.gravity[:] = 9.81 * np.array([math.sin(slope), 0, -math.cos(slope)])
    data = mujoco.MjData(model)
    start = 0.0 if pushed else speed
    data.qvel[0] = start
    for wheel in WHEELS:
        data.joint(f"{wheel}_wheel_joint").qvel[0] = start / board.geometry["wheel_radius"].value
    root, spring = model.body("board").id, model.jnt_qposadr[model.joint(TILT_JOINT).id]
    rows, before = [], start
    for i in range(round(time / 0.002)):
        t = i * 0.002
        place = np.linspace(0, time, len(tilts) + 1)[:-1] + time / len(tilts) / 2
        model.qpos_spring[spring] = np.interp(t, place, tilts)
        data.xfrc_applied[root, 0] = pushed * (1.0 <= t < 2.0)
        mujoco.mj_step(model, data)
        along = data.xmat[root].reshape(3, 3)[:, 0]
        v = float(data.qvel[:3] @ along)
        force = (v - before) / 0.002 - float(model.opt.gravity @ along)
        before = v
        if i % 5 == 0:
            heading = math.atan2(along[1], along[0])
            rows.append((t, *data.qpos[:2], heading, force, float(data.joint(TILT_JOINT).qpos[0]), v))
    return np.array(rows).T


def filmed(seed=0, **options):
    """Return a roll-out seen with 2 mm of noise, and 0.3° in roll."""
    t, x, y, _, _, roll, _ = rolled(**options)
    rng = np.random.default_rng(seed)
    position = np.column_stack([x, y]) + rng.normal(0, 0.002, (len(t), 2))
    return from_path(t, position, roll + rng.normal(0, math.radians(0.3), len(t)))


@pytest.mark.parametrize("rake", [45.0, 60.0])
def test_rake_is_recovered_from_a_film(rake):
    found = roll_out(
        [
            filmed(rake_deg=rake, seed=n, tilts=tilts)
            for n, tilts in enumerate(((0.05, -0.06, 0.03), (-0.04, 0.06)))
        ],
        WHEELBASE,
    )
    low, high = found.rake.ci95
    assert low < math.radians(rake) < high
    assert high - low < math.radians(6)


def test_a_roll_of_the_wrong_sign_fails():
    run = filmed(tilts=(0.05, -0.06, 0.03))
    with pytest.raises(SysidError, match=r"turns left where its right edge is down .*change it in the log"):
        roll_out([replace(run, roll=-run.roll)], WHEELBASE)


def test_resistance_is_what_the_coasting_board_loses():
    found = roll_out([filmed(speed=v, seed=n, tilts=(0.0,)) for n, v in enumerate((1.3, 1.1))], WHEELBASE)
    assert found.at_speed == pytest.approx(1.0, abs=0.1)
    t, *_, v = rolled(speed=1.1, tilts=(0.0,))
    low, high = found.deceleration.ci95
    assert low < -np.polyfit(t, v, 1)[0] < high
    assert high - low < 0.06
    assert found.rake is None  # it never tilted


def test_an_imu_that_rests_first_tells_the_same():
    runs = []
    for n, tilts in enumerate(((0.05, -0.05, 0.05, -0.05), (-0.05, 0.05, -0.05, 0.05))):
        t, _, _, heading, force, roll, _ = rolled(time=6.0, tilts=tilts, pushed=80.0)
        rng = np.random.default_rng(n)
        yaw_rate = np.gradient(np.unwrap(heading), t) + 0.02 + rng.normal(0, 0.01, len(t))
        runs.append(
            from_imu(t, force + 0.1 + rng.normal(0, 0.05, len(t)), yaw_rate, roll, rest=0.9, free=2.2)
        )
    found = roll_out(runs, WHEELBASE)
    assert found.rake.value == pytest.approx(math.radians(60), abs=math.radians(2.5))
    assert found.deceleration.value == pytest.approx(0.12, abs=0.05)


def test_what_tells_nothing_is_refused_in_words():
    with pytest.raises(SysidError, match=r"stretches of 0\.25 s in all; it takes 10"):
        roll_out([filmed(time=1.5)], WHEELBASE)
    t = np.arange(0, 5, 0.01)
    straight = from_path(t, np.column_stack([t - 0.05 * t**2, 0 * t]), 0.05 * np.sin(t))
    assert roll_out([straight], WHEELBASE).rake is None  # it did not turn at all
    still = from_path(t, np.zeros((len(t), 2)), np.zeros_like(t))
    with pytest.raises(SysidError, match="hardly rolls"):
        roll_out([still], WHEELBASE)
    with pytest.raises(SysidError, match="evenly spaced"):
        from_path(np.array([0, 0.1, 0.5, 0.6]), np.zeros((4, 2)), np.zeros(4))
    with pytest.raises(SysidError, match="a while of rest first"):
        from_imu(t, t, t, t, rest=3.0, free=2.0)


def test_the_command_reads_both_kinds_and_saves(tmp_path, capsys):
    t, x, y, _, _, roll, _ = rolled(speed=1.5)
    film = tmp_path / "film.csv"
    np.savetxt(
        film, np.column_stack([t, x, y, roll]), delimiter=",", header="time_s,x_m,y_m,roll_rad", comments=""
    )
    space = ("--workspace", tmp_path)
    called("rollout", film, "-b", "pink", "--save", "--json", tmp_path / "r.json", *space)
    said = capsys.readouterr()
    assert "rake" in said.out
    saved = json.loads((tmp_path / "r.json").read_text())
    board = load_board(Path(saved["saved"]))
    assert board.geometry["rake"].value == pytest.approx(saved["rake"]["value"])
    assert board.rolling["deceleration"].value == pytest.approx(saved["deceleration"]["value"])
    called("boards", "pink", *space)
    assert "deceleration" in capsys.readouterr().out
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(SysidError, match="has columns a, b; expected time_s,x_m"):
        called("rollout", tmp_path / "other.csv", "-b", "pink", *space)
    (tmp_path / "bad.csv").write_text("time_s,x_m,y_m,roll_rad\n1,2,three,4\n")
    with pytest.raises(SysidError, match="cannot be read as numbers"):
        called("rollout", tmp_path / "bad.csv", "-b", "pink", *space)
