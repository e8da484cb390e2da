"""Every reward term and termination on states worked out by hand."""

import math
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from riding import pink

from sim.skate.cycle.push_clips import PushClip, PushReference
from sim.skate.mdp import rewards, terminations
from sim.skate.mdp.rewards import (
    gait_clock,
    push_tracking,
    pushing,
    riding,
    steering,
    tilt_guidance,
    transitions,
)
from sim.skate.mdp.state import SkateState
from sim.skate.options import NOMINAL, Guidance, Pushing, SkateOptions

pytestmark = pytest.mark.train


@pytest.fixture
def state():
    """One environment in which nothing is wrong and nothing moves."""
    no, zero, one = np.array([False]), np.zeros(1), np.ones(1)
    return SkateState(
        pushing=no, transition=no, steering=no, still=no,
        time_in_push=zero,
        commanded_speed=zero, target_heading=zero, heading_reference=zero, tilt_reference=zero,
        tilt_rate=zero, foot_place_error=zero,
        board_velocity=np.zeros((1, 3)), board_heading=zero, robot_heading=zero, tilt=zero,
        upright=one,
        foot_on_ground=np.array([[False, False]]), foot_on_deck=np.array([[False, True]]),
        foot_in_zone=np.array([[False, True]]), foot_marker_distance=np.zeros((1, 2)),
        mean_speed=zero, ground_load=np.zeros((1, 2)), deck_load=np.zeros((1, 2)),
        left_ground_time=zero, left_touchdown=no, left_travel=zero, left_slip=zero, left_place=zero,
        left_air_time=zero, left_sole_heights=np.zeros((1, 4)),
        wheel_on_ground=np.array([[True] * 4]), other_contacts=zero, self_contacts=zero,
        joint_position=np.zeros((1, 23)), joint_velocity=np.zeros((1, 23)),
        joint_acceleration=np.zeros((1, 23)), joint_torque=np.zeros((1, 23)),
        joint_excess=np.zeros((1, 23)),
        action=np.zeros((1, 23)), action_1=np.zeros((1, 23)), action_2=np.zeros((1, 23)),
        key_position_error=np.zeros((1, 14)), key_orientation_error=np.zeros((1, 14)),
    )  # fmt: skip


def first(columns, value):
    row = np.zeros((1, columns))
    row[0, 0] = value
    return row


def test_board_velocity_takes_forward_error_and_everything_sideways(state):
    state = replace(
        state,
        commanded_speed=np.array([1.0]),
        mean_speed=np.array([0.5]),
        board_velocity=np.array([[9.0, 0.3, 0.4]]),
    )
    assert pushing.board_velocity(state, tolerance=0.25)[0] == pytest.approx(math.exp(-0.5 / 0.25))


def test_facing_forward_wraps_the_angle(state):
    state = replace(state, robot_heading=np.array([3.0]), board_heading=np.array([-3.0]))
    apart = 2 * math.pi - 6.0
    assert pushing.facing_forward(state, tolerance=0.5)[0] == pytest.approx(math.exp(-apart / 0.5))


@pytest.mark.parametrize(("seconds", "value"), [(0.1, 0), (0.3, 1), (0.7, 0), (0.0, 0)])
def test_swing_is_as_long_as_the_clips(state, seconds, value):
    assert pushing.swing(replace(state, left_air_time=np.array([seconds])))[0] == value


def test_a_swing_counts_as_far_as_the_speed_is_held(state):
    late = replace(state, left_air_time=np.array([0.3]), commanded_speed=np.array([0.5]))
    assert pushing.swing(late, tolerance=0.25)[0] == pytest.approx(math.exp(-1))


def test_stance_wants_load_time_and_no_slip(state):
    stands = replace(state, left_ground_time=np.array([0.3]), ground_load=np.array([[0.3, 0.0]]))
    assert pushing.stance(stands)[0] == 1
    assert pushing.stance(replace(stands, left_slip=np.array([0.2])), sliding=0.2)[0] == pytest.approx(
        math.exp(-1)
    )
    assert pushing.stance(replace(stands, ground_load=np.array([[0.03, 0.0]])), load=0.15)[
        0
    ] == pytest.approx(0.2)
    assert pushing.stance(replace(stands, left_ground_time=np.array([0.06])))[0] == 0  # a tap
    assert pushing.stance(replace(stands, left_ground_time=np.array([0.8])))[0] == 0


def test_slip_counts_by_the_load_and_a_touchdown_once(state):
    slides = replace(state, left_slip=np.array([0.4]), ground_load=np.array([[0.5, 0.9]]))
    assert pushing.slip(slides)[0] == pytest.approx(0.2)
    assert pushing.touchdown(replace(state, left_touchdown=np.array([True])))[0] == 1
    assert pushing.touchdown(state)[0] == 0


def test_the_left_foot_shall_carry_a_quarter_of_the_weight(state):
    assert steering.left_foot_loaded(replace(state, deck_load=np.array([[0.1, 0.9]])))[0] == pytest.approx(
        0.4
    )
    assert steering.left_foot_loaded(replace(state, deck_load=np.array([[0.5, 0.5]])))[0] == 1


def test_beginners_pay_less_and_riders_all_from_a_quarter_of_the_variation_on():
    terms = {term.name: term for term in rewards.rewards(TASK)}
    less = {name for name, term in terms.items() if abs(term.weight_at(0.0)) < abs(term.weight)}
    assert {"push/speed_error", "still/speed_error", "always/course", "push/slip", "push/touchdown"} <= less
    assert all(term.weight_at(0.25) == term.weight_at(1.0) == term.weight for term in terms.values())
    limits = terms["always/joint_limits"]
    assert limits.weight_at(0.125) == pytest.approx((limits.weight_at(0.0) + limits.weight) / 2)


@pytest.mark.parametrize(("speed", "error"), [(1.4, 0.4), (0.7, 0.3), (3.9, 2.0)])
def test_speed_error_grows_evenly_up_to_a_limit(state, speed, error):
    moving = replace(state, mean_speed=np.array([speed]), commanded_speed=np.array([1.0]))
    assert pushing.speed_error(moving)[0] == pytest.approx(error)


def test_flat_push_needs_ground_and_a_flat_sole(state):
    down = replace(state, foot_on_ground=np.array([[True, False]]))
    assert pushing.flat_push(down)[0] == 1
    assert pushing.flat_push(state)[0] == 0  # in the air
    pitched = replace(down, left_sole_heights=np.array([[0.03, -0.03, 0.0, 0.0]]))  # variance 6e-4
    assert pushing.flat_push(pitched)[0] == 0
    assert pushing.flat_push(pitched, tolerance=7e-4)[0] == 1


@pytest.mark.parametrize(
    ("seconds", "down", "value"),
    [(0.1, True, 1), (0.1, False, 0), (0.5, True, 0), (0.5, False, 1), (1.0, True, 1)],
)
def test_gait_clock_wants_the_foot_down_for_a_third_of_each_period(state, seconds, down, value):
    state = replace(state, time_in_push=np.array([seconds]), foot_on_ground=np.array([[down, False]]))
    assert gait_clock.gait_clock(state, period=0.9, stance=0.35)[0] == value


def test_push_tracking_is_deepmimics_kernel_of_the_joints(state):
    state = replace(state, joint_position=first(23, 0.5))
    assert push_tracking.push_tracking(state, np.zeros((1, 23)))[0] == pytest.approx(
        math.exp(-2 * 0.25), rel=0.01
    )
    assert push_tracking.push_tracking(state, np.zeros((1, 23)), tolerance=0.1)[0] == pytest.approx(
        math.exp(-0.25 / 23 / 0.1)
    )
    assert push_tracking.push_tracking(state, state.joint_position)[0] == 1


def clip(name, speed, frames):
    """Return a clip whose every angle says its frame, plus the speed."""
    return PushClip(name, speed, np.arange(frames)[:, None] + np.full((1, 23), speed))


@pytest.mark.parametrize("kind", ["numpy", "torch"])
def test_the_clip_nearest_in_speed_is_followed_and_repeats(kind):
    array = np.asarray
    if kind == "torch":
        torch = pytest.importorskip("torch")
        array = lambda values: torch.tensor(values, dtype=torch.float)  # noqa: E731
    clips = (clip("slow", 0.5, 40), clip("fast", 1.0, 30))
    reference = PushReference(clips)
    # Single precision of k · 0.02 s must not fall into the frame before, whatever k is.
    steps = np.arange(120)
    for speed, nearest, length in ((0.1, 0.5, 40), (0.74, 0.5, 40), (0.76, 1.0, 30), (1.5, 1.0, 30)):
        found = reference.joints(array(np.full(120, speed)), array(steps * 0.02))
        assert found.shape == (120, 23)
        np.testing.assert_allclose(found[:, 5], steps % length + nearest)
    with pytest.raises(ValueError, match="at least one reference clip"):
        PushReference(())


def test_feet_on_board_counts_both_feet_in_the_zone_less_the_foot_on_the_ground(state):
    assert steering.feet_on_board(state)[0] == 0
    both = replace(state, foot_on_deck=np.array([[True, True]]), foot_in_zone=np.array([[True, True]]))
    assert steering.feet_on_board(both)[0] == 2
    beside = replace(both, foot_in_zone=np.array([[False, True]]))
    assert steering.feet_on_board(beside)[0] == 0
    assert steering.feet_on_board(replace(both, foot_on_ground=np.array([[True, False]])))[0] == 1


def test_left_foot_on_deck(state):
    assert pushing.left_foot_on_deck(state)[0] == 0
    assert pushing.left_foot_on_deck(replace(state, foot_on_deck=np.array([[True, False]])))[0] == 1


def test_steering_pose_is_one_in_the_pose_and_falls_with_the_mean_square(state):
    pose = tuple(np.full(23, 0.3))
    assert steering.steering_pose(state, pose, tolerance=0.2)[0] == pytest.approx(math.exp(-0.09 / 0.2))
    there = replace(state, joint_position=np.full((1, 23), 0.3))
    assert steering.steering_pose(there, pose)[0] == pytest.approx(1)


def test_feet_on_markers_takes_the_mean_distance(state):
    state = replace(state, foot_marker_distance=np.array([[0.1, 0.3]]))
    assert steering.feet_on_markers(state, tolerance=0.1)[0] == pytest.approx(math.exp(-2))


def test_board_heading_and_tilt_guide(state):
    turned = replace(state, board_heading=np.array([-3.1]), heading_reference=np.array([3.1]))
    apart = 2 * math.pi - 6.2
    assert steering.board_heading(turned, tolerance=0.02)[0] == pytest.approx(math.exp(-apart / 0.02))
    tilted = replace(state, tilt=np.array([0.03]), tilt_reference=np.array([0.05]))
    assert tilt_guidance.tilt_guide(tilted, tolerance=0.02)[0] == pytest.approx(math.exp(-1))


def test_key_bodies(state):
    state = replace(state, key_position_error=np.full((1, 14), 0.1), key_orientation_error=first(14, 1.0))
    assert transitions.key_positions(state, tolerance=0.05)[0] == pytest.approx(math.exp(-0.01 / 0.05))
    assert transitions.key_orientations(state, tolerance=0.10)[0] == pytest.approx(math.exp(-1 / 14 / 0.1))


def test_contacts_with_the_ground(state):
    assert riding.wheels_on_ground(state)[0] == 1
    assert (
        riding.wheels_on_ground(replace(state, wheel_on_ground=np.array([[True, True, True, False]])))[0] == 0
    )
    assert transitions.left_foot_on_ground(state)[0] == 0
    assert transitions.left_foot_on_ground(replace(state, foot_on_ground=np.array([[True, False]])))[0] == 1


def test_level_deck_and_standing_still(state):
    assert riding.level_deck(replace(state, tilt=np.array([-0.05])), tolerance=0.05)[0] == pytest.approx(
        math.exp(-1)
    )
    assert riding.standing_still(state, tuple(np.zeros(23)))[0] == pytest.approx(1)


def test_penalties_are_sums_of_squares(state):
    state = replace(
        state, joint_excess=first(23, 0.2), action=first(23, 3.0), action_1=first(23, 1.0),
        action_2=first(23, 2.0), joint_velocity=first(23, 4.0), joint_acceleration=first(23, 5.0),
        joint_torque=first(23, 6.0), self_contacts=np.array([7.0]),
    )  # fmt: skip
    assert riding.joint_limits(state)[0] == pytest.approx(0.2)
    assert riding.action_rate(state)[0] == pytest.approx(4)
    assert riding.action_smoothness(state)[0] == pytest.approx((3 - 2 + 2) ** 2)
    assert riding.joint_velocity(state)[0] == pytest.approx(16)
    assert riding.joint_acceleration(state)[0] == pytest.approx(25)
    assert riding.joint_torque(state)[0] == pytest.approx(36)
    assert riding.self_contact(state)[0] == 3
    assert riding.alive(state)[0] == 1


def test_foot_place_counts_only_under_a_loaded_foot(state):
    on_deck = np.array([[False, True]])
    state = replace(state, foot_place_error=np.array([-0.03]), foot_on_deck=on_deck)
    assert riding.foot_place(state, tolerance=0.03)[0] == pytest.approx(math.exp(-1))
    assert riding.foot_place(replace(state, foot_on_deck=~on_deck))[0] == 0.0


@pytest.mark.parametrize(
    ("tilt", "asked", "value"),
    [(-0.2, 0.1, 0.2), (0.2, 0.1, 0.0), (0.2, -0.1, 0.2), (0.2, -0.02, 0.0)],
)
def test_wrong_tilt_is_what_leans_against_the_turn(state, tilt, asked, value):
    state = replace(state, tilt=np.array([tilt]), tilt_reference=np.array([asked]))
    assert tilt_guidance.wrong_tilt(state, dead_zone=0.03)[0] == pytest.approx(value)


def test_tilt_rate_is_squared(state):
    assert steering.tilt_rate(replace(state, tilt_rate=np.array([-3.0])))[0] == 9.0


TASK = rewards.Task(
    options=SkateOptions(), steer_pose=(0.0,) * 23, stand_pose=(0.0,) * 23, clips=(clip("slow", 0.5, 40),)
)


@pytest.mark.parametrize("pushing", get_args(Pushing))
@pytest.mark.parametrize("transition", get_args(Guidance))
def test_every_term_has_a_test_and_a_name_of_its_own(pushing, transition):
    terms = rewards.rewards(replace(TASK, options=SkateOptions(pushing=pushing, transition=transition)))
    assert len({term.name for term in terms}) == len(terms)
    source = Path(__file__).read_text(encoding="utf-8")
    own = [term.value.__name__ for term in terms if term.name != "push/tracking"]
    assert [name for name in own if f".{name}(" not in source] == []


TOY = '''
"""The robot goes slowly about its turns."""

from sim.skate.mdp.rewards._base import Reward, Rewards


def slow_turn(state, limit=0.1):
    """How much faster than `limit` [rad/s] the deck tilts [rad/s]."""
    return (abs(state.tilt_rate) - limit).clip(0.0)


REWARDS = Rewards(
    order=8, terms=lambda task: [Reward("always/slow_turn", slow_turn, "always", -2.0, {"limit": task.options.turn})]
)
'''


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """One reward file more, in a folder that the repository does not have."""
    (tmp_path / "slow_turn.py").write_text(TOY, encoding="utf-8")
    monkeypatch.setattr(rewards, "__path__", [*rewards.__path__, str(tmp_path)])


@pytest.mark.usefixtures("toy")
def test_a_reward_is_one_file(state):
    """Found, with its weight and an argument of the variant, last of all, and paid; no other file was touched."""
    task = replace(TASK, options=SkateOptions(turn=0.5))
    last = rewards.rewards(task)[-1]
    assert (last.name, last.when, last.weight) == ("always/slow_turn", "always", -2.0)
    assert last.value(replace(state, tilt_rate=np.array([-0.8])), **last.arguments)[0] == pytest.approx(0.3)


@pytest.mark.slow
@pytest.mark.usefixtures("toy")
@pytest.mark.filterwarnings("ignore")
def test_a_reward_of_one_file_is_paid_in_training():
    for module in ("torch", "mjlab", "warp"):
        pytest.importorskip(module, reason="needs the training stack")
    import torch

    from policy_runtime.learning.fused_rewards import SkateEnv
    from sim.skate.mdp.measuring import measure
    from sim.skate.task import skate_env_cfg

    options = SkateOptions(boards=0, variation=NOMINAL, turn=0.1)
    env = SkateEnv(skate_env_cfg(pink(), options, environments=2, seed=3), device="cpu")
    try:
        env.reset()
        for _ in range(3):
            env.step(torch.ones(2, 23))
        place = env.reward_manager.active_terms.index("always/slow_turn")
        paid = env.reward_manager._step_reward[:, place]
        excess = measure(env).tilt_rate.abs() - 0.1
        assert excess.max() > 0
        assert torch.allclose(paid, -2 * excess.clip(0.0))
    finally:
        env.close()


def test_fallen_beyond_70_degrees(state):
    assert not terminations.fallen(state)[0]
    assert not terminations.fallen(replace(state, upright=np.array([math.cos(math.radians(69))])))[0]
    assert terminations.fallen(replace(state, upright=np.array([math.cos(math.radians(71))])))[0]


def test_off_board_takes_two_steps_without_a_foot(state):
    none = replace(state, foot_on_deck=np.array([[False, False]]))
    assert not terminations.off_board(none, np.array([False]))[0]
    assert terminations.off_board(none, np.array([True]))[0]
    assert not terminations.off_board(state, np.array([True]))[0]


def test_body_contact(state):
    assert not terminations.body_contact(state)[0]
    assert terminations.body_contact(replace(state, other_contacts=np.array([1.0])))[0]


@pytest.mark.parametrize(
    ("pushing", "air", "since", "ends"),
    [
        (True, 1.3, 2.0, True),
        (True, 1.2, 2.0, False),  # not longer than the patience
        (True, 5.0, 1.1, False),  # it steered before: only pushing counts
        (True, 0.3, 2.0, False),
        (False, 9.0, 9.0, False),
    ],
)
def test_idle_foot_counts_time_off_the_ground_within_the_pushing(state, pushing, air, since, ends):
    state = replace(
        state,
        pushing=np.array([pushing]),
        left_air_time=np.array([air]),
        time_in_push=np.array([since]),
    )
    assert bool(terminations.idle_foot(state, patience=1.2)[0]) == ends


def test_wrong_stance_counts_up_when_wrong_and_down_when_right(state):
    steering = replace(state, steering=np.array([True]))  # left foot off the deck: wrong
    assert terminations.wrong_stance(steering, np.array([3]))[0] == 4
    mounted = replace(steering, foot_on_deck=np.array([[True, True]]))
    assert terminations.wrong_stance(mounted, np.array([3]))[0] == 2
    assert terminations.wrong_stance(mounted, np.array([0]))[0] == 0
    pushing = replace(state, pushing=np.array([True]))  # left foot off the deck: right
    assert terminations.wrong_stance(pushing, np.array([3]))[0] == 2
    stays = replace(pushing, foot_on_deck=np.array([[True, True]]))
    assert terminations.wrong_stance(stays, np.array([3]))[0] == 4
    assert terminations.wrong_stance(state, np.array([9]))[0] == 0  # nothing to do
