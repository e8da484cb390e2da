"""A learned torque in the training's own simulator, against plain MuJoCo with the documented callback."""

import contextlib
import sys
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from sim.board.bench import rig_spec
from sim.board.learned import left_out, passive
from sim.board.scene import TILT_JOINT
from sim.skate.options import NOMINAL, SkateOptions
from sysid.board import Board, BoardEffect
from sysid.effects import effect
from sysid.effects._table import knots
from sysid.quantity import Quantity

torch = pytest.importorskip("torch")
pytest.importorskip("mjlab")
pytestmark = [
    pytest.mark.train,
    pytest.mark.filterwarnings("ignore"),
]  # the stack's own warnings, at its import too

SUPPORT = {"tilt_low": -0.2, "tilt_high": 0.2, "rate_low": -8.0, "rate_high": 8.0}
RATES = dict(zip([*range(-8, 0), *range(1, 9)], 8 * knots(8, 0.5), strict=True))


def one_sided():
    """Return the pink board, little damped, with a one-way damper and damping that grows with the tilt's square."""
    part = effect("learned")
    values = {f"rate_{j}": -0.08 * max(v, 0.0) for j, v in RATES.items()}
    values |= {
        f"both_{i}_{j}": -0.3 * (0.2 * i / 3) ** 2 * 8 * j / 3
        for i in (-3, -2, -1, 1, 2, 3)
        for j in (-3, -2, -1, 1, 2, 3)
    }
    known = {**SUPPORT, **values}
    parameters = {p.name: Quantity(known.get(p.name, 0.0), 0.1, p.unit) for p in part.parameters}
    plain = Board.load("pink").with_tilt(damping=Quantity(0.06, 0.0, "N*m*s/rad"))
    return replace(plain, effects=(BoardEffect("learned", parameters),))


def applied(model, tilts, rates, dampers=None):
    """Return what the term applies to worlds at tilts and rates, shape (n,)."""
    from sim.skate.mdp.board_term import BoardTermCfg

    n = len(tilts)
    data = SimpleNamespace(
        qpos=torch.tensor(tilts, dtype=torch.float)[:, None],
        qvel=torch.tensor(rates, dtype=torch.float)[:, None],
        qfrc_applied=torch.full((n, 1), 9.0),
    )
    env = SimpleNamespace(
        sim=SimpleNamespace(mj_model=model, data=data), scene={"board": None}, num_envs=n, device="cpu"
    )
    BoardTermCfg(entity_name="board", dampers=dampers).build(env).apply_actions()
    return data.qfrc_applied[:, 0].numpy()


def test_all_worlds_at_once_have_what_one_has_alone():
    model = rig_spec(one_sided()).compile()
    rng = np.random.default_rng(1)
    tilts, rates = rng.uniform(-0.3, 0.3, 50), rng.uniform(-10, 10, 50)  # beyond the support too
    ((_, _, left),) = left_out(model)
    expected = [left(tilt, rate) for tilt, rate in zip(tilts, rates, strict=True)]
    assert np.ptp(expected) > 0.3
    np.testing.assert_allclose(applied(model, tilts, rates), expected, atol=2e-6)


@pytest.mark.slow
def test_the_training_world_swings_as_plain_mujoco_with_the_callback():
    from mjlab.envs import ManagerBasedRlEnv

    from sim.skate.task import skate_env_cfg

    settings = SkateOptions(boards=0, pushes=0.0, noise=False, variation=NOMINAL)
    with contextlib.redirect_stdout(sys.stderr):
        env = ManagerBasedRlEnv(skate_env_cfg(one_sided(), settings, environments=2, seed=0), device="cpu")
    model, data = env.sim.mj_model, env.sim.data
    state = mujoco.MjData(model)
    tilt, base = (model.joint(name) for name in (f"board/{TILT_JOINT}", "robot/floating_base_joint"))
    q, v = int(tilt.qposadr[0]), int(tilt.dofadr[0])
    state.qpos[base.qposadr[0]] = -15.0  # the robot is far behind
    state.qpos[q] = 0.15
    env.reset()
    data.qpos[:] = torch.as_tensor(state.qpos, dtype=torch.float32)
    data.qvel[:] = 0.0
    data.qacc_warmstart[:] = 0.0
    paths = np.empty((3, 60))
    for i in range(60):
        env.action_manager.process_action(torch.zeros(2, 23))
        env.action_manager.apply_action()
        env.sim.step()
        paths[0, i] = data.qpos[0, q].item()
    begin = state.qpos.copy()
    for name in ("body_ipos", "geom_friction"):  # what the worlds have drawn
        getattr(model, name)[:] = getattr(env.sim.model, name)[0].numpy()
    mujoco.mj_setConst(model, state)
    for row, callback in ((1, passive), (2, None)):
        mujoco.mj_resetData(model, state)
        state.qpos[:] = begin
        mujoco.set_mjcb_passive(callback)
        try:
            for i in range(60):
                mujoco.mj_step(model, state)
                paths[row, i] = state.qpos[q]
        finally:
            mujoco.set_mjcb_passive(None)
    env.close()
    theirs, ours, without = paths
    size = np.sqrt(np.mean(ours**2))
    apart, alone = (float(np.sqrt(np.mean((path - ours) ** 2)) / size) for path in (theirs, without))
    assert (apart < 3e-3, alone > 0.02) == (True, True), (apart, alone)
    assert float(data.qfrc_applied[0, v]) != 0.0
