"""A learned torque in MuJoCo: of the tilt by itself, of the rate with what is added from outside."""

from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from sim.board.clamped import ClampedScene
from sim.board.learned import left_out, passive
from sim.board.scene import rig_spec
from sysid.board import Board, BoardEffect
from sysid.effects import effect
from sysid.effects._table import knots
from sysid.joint import JointLaw, simulate
from sysid.quantity import Quantity


def board(values):
    """Return the pink board, little damped, with a learned torque."""
    part = effect("learned")
    known = {**dict(zip(part.parameter_names, [-0.2, 0.2, -8.0, 8.0], strict=False)), **values}
    parameters = {p.name: Quantity(known.get(p.name, 0.0), 0.0, p.unit) for p in part.parameters}
    plain = Board.load("pink").with_tilt(damping=Quantity(0.06, 0.0, "N*m*s/rad"))
    return replace(plain, effects=(BoardEffect("learned", parameters),))


ONE_SIDED = {
    f"rate_{j}": -0.08 * max(v, 0.0)
    for j, v in zip([*range(-8, 0), *range(1, 9)], 8 * knots(8, 0.5), strict=True)
}
BUMPER = {
    f"tilt_{j}": -25 * max(x - 0.06, 0.0)
    for j, x in zip([*range(-20, 0), *range(1, 21)], 0.2 * knots(20, 1.0), strict=True)
}


def error(rich, roll_of):
    """Return the NRMSE of MuJoCo's decay against the law's."""
    time = np.linspace(0, 1, 200)
    truth = simulate(JointLaw.from_board(rich), time, 0.17).roll
    model = rig_spec(rich, timestep=1e-4).compile()
    return np.sqrt(np.mean((roll_of(model, time) - truth) ** 2) / np.mean(truth**2))


def plain(model, time):
    """Return the roll of plain MuJoCo's own steps."""
    data = mujoco.MjData(model)
    data.qpos[0] = 0.17
    path = [0.17]
    while data.time < time[-1]:
        mujoco.mj_step(model, data)
        path.append(data.qpos[0])
    return np.interp(time, model.opt.timestep * np.arange(len(path)), path)


def with_callback(model, time):
    """Return the same with the documented callback."""
    mujoco.set_mjcb_passive(passive)
    try:
        return plain(model, time)
    finally:
        mujoco.set_mjcb_passive(None)


def test_a_table_over_the_tilt_needs_nothing_from_outside():
    assert error(board(BUMPER), plain) < 3e-3


@pytest.mark.slow
def test_a_table_over_the_rate_is_near_alone_and_exact_with_what_is_left_out():
    alone, helped, swung = (
        error(board(ONE_SIDED), how)
        for how in (
            plain,
            with_callback,
            lambda model, time: np.interp(time, *ClampedScene(model=model).swing(0.17, 0.0, 1.0)),
        )
    )
    assert helped < 3e-3
    assert swung < 3e-3
    assert 0.005 < alone < 0.2


@pytest.mark.train
@pytest.mark.filterwarnings("ignore")  # the training stack's own
def test_all_worlds_of_the_training_at_once_have_what_one_has_alone():
    torch = pytest.importorskip("torch")
    pytest.importorskip("mjlab")
    from sim.skate.mdp.actions import BoardTermCfg

    wings = [-3, -2, -1, 1, 2, 3]
    both = {f"both_{i}_{j}": -0.3 * (0.2 * i / 3) ** 2 * 8 * j / 3 for i in wings for j in wings}
    model = rig_spec(board(ONE_SIDED | both)).compile()
    rng = np.random.default_rng(1)
    tilts, rates = rng.uniform(-0.3, 0.3, 50), rng.uniform(-10, 10, 50)  # beyond the support too
    data = SimpleNamespace(
        qpos=torch.tensor(tilts, dtype=torch.float)[:, None],
        qvel=torch.tensor(rates, dtype=torch.float)[:, None],
        qfrc_applied=torch.full((50, 1), 9.0),
    )
    sim = SimpleNamespace(mj_model=model, data=data)
    env = SimpleNamespace(sim=sim, scene={"board": None}, num_envs=50, device="cpu")
    BoardTermCfg(entity_name="board").build(env).apply_actions()
    ((_, _, left),) = left_out(model)
    expected = [left(tilt, rate) for tilt, rate in zip(tilts, rates, strict=True)]
    assert np.ptp(expected) > 0.3
    np.testing.assert_allclose(data.qfrc_applied[:, 0].numpy(), expected, atol=2e-6)
