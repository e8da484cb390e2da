"""The task's pure parts: rotations, cycle, guidance, transitions, observation frame."""

import mujoco
import numpy as np
import pytest

from sim.skate import rotation
from sim.skate.cycle.clock import Clock
from sim.skate.cycle.start import AT_REST, Start
from sim.skate.cycle.tilt_guidance import TiltGuidance
from sim.skate.cycle.transitions import KEY_BODIES, TransitionPath
from sim.skate.mdp.actor_observation import scale_frame

pytestmark = pytest.mark.train


def quaternions(count, seed=0):
    q = np.random.default_rng(seed).normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def test_rotations_agree_with_mujoco():
    q, p = quaternions(2)
    v = np.array([0.3, -1.2, 2.0])
    turned, product = np.zeros(3), np.zeros(4)
    mujoco.mju_rotVecQuat(turned, v, q)
    mujoco.mju_mulQuat(product, q, p)
    np.testing.assert_allclose(rotation.rotate(q, v), turned, atol=1e-14)
    np.testing.assert_allclose(rotation.rotate_back(q, turned), v, atol=1e-14)
    np.testing.assert_allclose(rotation.multiply(q, p), product, atol=1e-14)


def test_slerp_goes_the_short_way_at_constant_rate():
    start, end = quaternions(2, seed=1)
    if start @ end < 0:
        end = -end
    whole = rotation.angle_between(start, end)
    for fraction in (0.0, 0.25, 1.0):
        here = rotation.slerp(start, -end, np.float64(fraction))  # -end is the same orientation
        assert rotation.angle_between(start, here) == pytest.approx(fraction * whole, abs=1e-9)


def test_the_cycle_is_40_10_45_5_percent_of_six_seconds():
    clock, steps = Clock(), np.arange(300)
    assert clock.period * 0.02 == pytest.approx(6.0)
    shares = [f(steps).mean() for f in (clock.pushing, clock.mounting, clock.steering, clock.dismounting)]
    np.testing.assert_allclose(shares, [0.40, 0.10, 0.45, 0.05])
    together = sum(
        f(steps).astype(int) for f in (clock.pushing, clock.mounting, clock.steering, clock.dismounting)
    )
    assert np.all(together == 1)


def test_half_of_the_episodes_begin_at_rest_and_the_others_in_each_phase_alike():
    clock, steps = Clock(mount=24), np.arange(294)
    chances = Start().chances(clock)
    assert chances[0] == pytest.approx(0.5)
    assert np.all(chances >= 0)
    rolls = steps > 0
    for phase in (clock.pushing, clock.mounting, clock.steering, clock.dismounting):
        assert chances[phase(steps) & rolls].sum() == pytest.approx(0.125)
    assert np.all(chances[clock.mounting(steps) | clock.dismounting(steps)] > 0)
    assert AT_REST.chances(clock)[0] == 1.0


def test_transitions_run_from_just_above_zero_to_one():
    clock = Clock()
    mount, dismount = np.arange(120, 150), np.arange(285, 300)
    for steps in (mount, dismount):
        fractions = clock.transition_fraction(steps)
        np.testing.assert_allclose(fractions, np.arange(1, len(steps) + 1) / len(steps))
    assert clock.steering_time_left(np.array([150, 284, 285])).tolist() == pytest.approx([2.7, 0.02, 0.0])


def test_guidance_inverts_the_boards_turning():
    guidance = TiltGuidance(wheelbase=0.4, rake=np.pi / 3, limit=0.2)
    tilt = guidance.reference(np.array(0.1), np.array(0.5), np.array(1.3), np.array(1.0))
    yaw_rate = 2 * 1.3 * np.tan(np.pi / 3) * np.sin(tilt) / 0.4
    assert yaw_rate * 1.0 == pytest.approx(0.4 * 1.3**2 / (1.3**2 + 0.3**2))
    paper = TiltGuidance(wheelbase=0.4, rake=np.pi / 3, limit=0.2, kinematics="single-truck")
    twice = paper.reference(np.array(0.1), np.array(0.5), np.array(1.3), np.array(1.0))
    assert np.sin(twice) == pytest.approx(2 * np.sin(tilt))


def test_guidance_asks_for_no_tilt_at_rest_and_for_the_other_tilt_backwards():
    guidance = TiltGuidance(wheelbase=0.4, rake=np.pi / 3, limit=0.2)
    speeds = np.array([-1.0, -0.01, 0.0, 0.01, 0.3, 1.0])
    tilts = guidance.reference(np.zeros(6), np.full(6, 0.7), speeds, np.full(6, 2.0))
    assert tilts[2] == 0
    np.testing.assert_allclose(tilts[[0, 1]], -tilts[[5, 3]])
    assert 0 < tilts[3] < 0.01 < tilts[5] < tilts[4] <= 0.2
    assert guidance.reference(np.array(3.0), np.array(-3.0), np.array(1.0), np.array(1.0)) > 0  # through π


@pytest.mark.parametrize("order", [1, 2, 3, 5])
def test_paths_of_any_order_start_and_end_where_they_shall(order):
    rng = np.random.default_rng(order)
    start, end = rng.normal(size=(2, 4, len(KEY_BODIES), 3))
    path = TransitionPath(order=order, lift=0.2)
    lifted = np.ones(len(KEY_BODIES))
    np.testing.assert_allclose(path.positions(start, end, np.zeros(4), lifted), start, atol=1e-12)
    np.testing.assert_allclose(path.positions(start, end, np.ones(4), lifted), end, atol=1e-12)


def test_quadratic_path_peaks_at_half_the_lift_and_spares_what_stands():
    start = np.zeros((1, 2, 3))
    middle = TransitionPath(lift=0.2).positions(start, start, np.array([0.5]), np.array([1.0, 0.0]))
    np.testing.assert_allclose(middle[0, :, 2], [0.1, 0.0], atol=1e-12)


def test_torch_and_numpy_give_the_same():
    torch = pytest.importorskip("torch")
    q, p = quaternions(4), quaternions(4, seed=5)
    fraction = np.linspace(0, 1, 4)
    for ours, theirs in (
        (rotation.multiply(q, p), rotation.multiply(torch.tensor(q), torch.tensor(p))),
        (
            rotation.slerp(q, p, fraction),
            rotation.slerp(torch.tensor(q), torch.tensor(p), torch.tensor(fraction)),
        ),
        (
            rotation.rotate(q[:, None], q[:, 1:]),
            rotation.rotate(torch.tensor(q[:, None]), torch.tensor(q[:, 1:])),
        ),
        (scale_frame(np.ones((2, 78))), scale_frame(torch.ones(2, 78, dtype=torch.float64))),
    ):
        np.testing.assert_allclose(ours, theirs.numpy(), atol=1e-7)
