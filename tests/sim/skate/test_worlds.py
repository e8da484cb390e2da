"""How worlds differ: ranges, strength, and delays to the step."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import training

torch = pytest.importorskip("torch")

pytestmark = [
    pytest.mark.train,
    pytest.mark.filterwarnings("ignore"),
]  # the stack's own warnings, at its import too


def test_steps_back_by_hand():
    """An answer that takes 15 ms (3 steps of 5 ms) reaches the servos in the last quarter of its policy step."""
    from sim.skate.mdp.worlds import steps_back

    lags, substeps = torch.tensor([0, 3, 4, 5, 8]), torch.arange(4)[:, None]
    expected = [[0, 1, 1, 2, 2], [0, 1, 1, 1, 2], [0, 1, 1, 1, 2], [0, 0, 1, 1, 2]]
    assert steps_back(lags, substeps).tolist() == expected


def late(lag, frames):
    """Return what a world whose sensors are `lag` steps late tells of three frames, newest first."""
    from sim.skate.mdp.worlds import Worlds

    worlds = SimpleNamespace(
        sensor_lag=torch.tensor([lag]),
        bias=torch.zeros(1, 2),
        _world=torch.arange(1),
        _measured=torch.tensor([True, False]),
    )
    return Worlds.sensed(worlds, torch.tensor(frames)[:, None, None].expand(3, 1, 2)).tolist()


@pytest.mark.parametrize(("lag", "expected"), [(0.0, 5.0), (0.25, 4.75), (1.0, 4.0), (1.5, 3.0), (2.0, 2.0)])
def test_sensed_is_interpolated_between_the_frames_before(lag, expected):
    (measured, own), *_ = late(lag, [5.0, 4.0, 2.0])
    assert measured == pytest.approx(expected)
    assert own == 5.0  # what the policy told itself is not late


@pytest.fixture(scope="module")
def env():
    """Thirty-two worlds that differ at full strength."""
    torch.manual_seed(0)
    with training.worlds(32, seed=1, boards=4) as env:
        yield env


@pytest.fixture
def worlds(env):
    worlds = env.event_manager.get_term_cfg("worlds").func
    worlds.set_strength(1.0)
    return worlds


@pytest.mark.slow
def test_worlds_lie_within_their_ranges_and_fill_them(env, worlds):
    model, plain = env.sim.model, env.sim.mj_model
    links = [i for i in range(plain.nbody) if plain.body(i).name.startswith("robot/")]
    mass = model.body_mass[:, links].numpy() / plain.body_mass[links]
    assert 0.899 < mass.min() < 0.92
    assert 1.08 < mass.max() < 1.101
    kp = model.actuator_gainprm[:, :, 0].numpy() / plain.actuator_gainprm[:, 0]
    np.testing.assert_allclose(
        model.actuator_biasprm[:, :, 1].numpy(), -model.actuator_gainprm[:, :, 0].numpy()
    )
    assert 0.849 < kp.min() < 0.86
    assert 1.14 < kp.max() < 1.151
    wheel = plain.geom("board/front_left_wheel_collision").id
    rolling = model.geom_friction[:, wheel, 2].numpy() / plain.geom_friction[wheel, 2]
    assert 0.5 <= rolling.min() < 0.8
    assert 3.0 < rolling.max() <= 4.0
    assert set(worlds.action_lag.tolist()) <= set(range(9))
    assert worlds.action_lag.max() >= 7
    assert 0.8 < float(worlds.sensor_lag.max()) <= 1.0
    gravity = worlds._gravity.numpy()
    np.testing.assert_allclose(np.linalg.norm(gravity, axis=1), 9.81, rtol=1e-5)


@pytest.mark.slow
def test_ground_is_level_sloped_or_goes_down_ahead_for_a_while(env, worlds):
    """Of 32 worlds drawn 60 times, turned by 0.3 rad: what is not level goes up or down within 45° of their way."""
    worlds._env.sim.data.qpos[:, worlds._board_q + 3] = math.cos(0.15)
    worlds._env.sim.data.qpos[:, worlds._board_q + 6] = math.sin(0.15)
    gradient, length = (
        torch.cat(parts) for parts in zip(*(worlds._segment() for _ in range(60)), strict=True)
    )
    env.reset()
    level = (gradient == 0).all(dim=-1)
    assert 0.26 < float(level.float().mean()) < 0.34
    assert 0.29 < float(length[level].sum() / length.sum()) < 0.42
    aside = torch.atan2(gradient[~level, 1], gradient[~level, 0]) - 0.3
    forward = gradient[:, 0] * math.cos(0.3) + gradient[:, 1] * math.sin(0.3)
    upwards = forward[~level] > 0
    assert 0.45 < float(upwards.float().mean()) < 0.55
    down = torch.atan2(aside.sin(), aside.cos()).abs()
    down = torch.where(upwards, down, math.pi - down)
    assert 0.77 < float(down.max()) <= math.pi / 4 + 1e-4
    steepness = gradient.norm(dim=-1).rad2deg()
    assert 7.8 < float(steepness[forward > 0].max()) <= 8.0001
    assert 9.8 < float(steepness.max()) <= 10.0001
    short = length < 3  # no long slope is
    assert float(steepness[~short & (length > 4)].max()) <= 8.0001
    assert 0.12 < float(short.float().mean()) < 0.2
    assert 0.4 < float((steepness[forward > 0] > 6.0).float().mean()) < 0.48
    assert 19 < float(length.max()) <= 20.0001


@pytest.mark.slow
def test_a_board_stands_on_the_slab_and_falls_when_it_is_gone(env, worlds):
    env.reset()
    ledges, board = worlds.ledges, env.sim.data.qpos[:, worlds._board_q + 2]
    ledges.roll_on(*worlds._board(), torch.ones(32, dtype=torch.bool), 0.06)
    before = board.clone()
    for _ in range(20):
        env.sim.step()
    assert float((board - before).abs().max()) < 0.004
    ledges.slab[:, 2] = -1000.0
    for _ in range(40):
        env.sim.step()
    # Robots fall with them, some of them onto the nose.
    assert float((board - before - ledges.height).abs().median()) < 0.004
    env.reset()


@pytest.mark.slow
def test_strength_leads_from_the_nominal_world_to_the_drawn_one(env, worlds):
    full = {name: getattr(env.sim.model, name).clone() for name in ("body_mass", "geom_friction")}
    lag, bias = worlds.action_lag.clone(), worlds.bias.clone()
    worlds.set_strength(0.0)
    plain = env.sim.mj_model
    np.testing.assert_allclose(env.sim.model.body_mass[3].numpy(), plain.body_mass, rtol=1e-6)
    assert not worlds.action_lag.any()
    assert not worlds.bias.any()
    worlds.set_strength(0.5)
    half = env.sim.model.body_mass.clone()
    torch.testing.assert_close(2 * half - torch.tensor(plain.body_mass, dtype=torch.float), full["body_mass"])
    torch.testing.assert_close(worlds.bias, bias / 2)
    worlds.set_strength(1.0)
    torch.testing.assert_close(worlds.action_lag, lag)
    torch.testing.assert_close(env.sim.model.geom_friction[:], full["geom_friction"])


@pytest.mark.slow
def test_targets_arrive_late_by_each_worlds_own_delay(env, worlds):
    env.reset()
    worlds.action_lag.copy_(torch.arange(32) % 9)
    seen = []
    apply_action = env.action_manager.apply_action

    def apply():
        apply_action()
        seen.append(env.scene["robot"].data.joint_pos_target[:, 0].clone())

    env.action_manager.apply_action = apply
    try:
        actions = [torch.full((32, 23), float(n)) for n in (1, 2, 3)]
        for action in actions:
            env.step(action)
    finally:
        env.action_manager.apply_action = apply_action
    term = env.action_manager.get_term("joint_pos")
    answered = ((torch.stack(seen) - term._offset[:, 0]) / term._scale[:, 0]).round().long()
    for world in range(9):
        lag = world
        # What was answered in policy step n (value n + 1) is there from simulation step 4 n + lag on.
        for n, m in [(k, 4 * k + lag) for k in range(3) if 4 * k + lag < 12]:
            assert int(answered[m, world]) == n + 1, (world, n)
            assert m == lag or int(answered[m - 1, world]) == n, (world, n)
