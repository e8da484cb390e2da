"""Every reward term and termination on states worked out by hand."""

import math
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from sim.skate.mdp import rewards, terminations
from sim.skate.mdp.rewards import (
    _base,
    push_teachers,
    pushing,
    riding,
    steering,
    tilt_guidance,
    transitions,
)
from sim.skate.mdp.rewards.push_teachers import PushReference
from sim.skate.mdp.state import SkateState
from sim.skate.options import Guidance, Pushing, SkateOptions

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
        left_ground_time=zero, left_touchdown=no, left_landing_speed=zero, left_travel=zero, left_slip=zero, left_place=zero,
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


E, TURN = math.exp, 2 * math.pi
DOWN, ON_DECK, BOTH = np.array([[True, False]]), np.array([[True, False]]), np.array([[True, True]])
STANDS = {"left_ground_time": 0.3, "left_travel": 0.5, "ground_load": np.array([[0.3, 0.0]])}
PITCHED = np.array([[0.03, -0.03, 0.0, 0.0]])
"""Heights of the sole of variance 6e-4."""
PULLED = {
    "joint_excess": first(23, 0.2), "action": first(23, 3.0), "action_1": first(23, 1.0), "action_2": first(23, 2.0),
    "joint_velocity": first(23, 4.0), "joint_acceleration": first(23, 5.0), "joint_torque": first(23, 6.0),
}  # fmt: skip
POSE = tuple(np.full(23, 0.3))
BY_HAND = [
    (pushing.board_velocity, {"commanded_speed": 1.0, "mean_speed": 0.5}, {"tolerance": 0.25}, E(-0.25 / 0.25)),
    (pushing.board_velocity, {"board_velocity": np.array([[9.0, 0.3, 0.4]])}, {"tolerance": 0.25}, E(-0.25 / 0.25)),
    (pushing.facing_forward, {"robot_heading": 3.0, "board_heading": -3.0}, {"tolerance": 0.5}, E(-(TURN - 6) / 0.5)),
    *((pushing.swing, {"left_air_time": t}, {}, paid) for t, paid in ((0.1, 0), (0.3, 1), (0.7, 0), (0.0, 0))),
    (pushing.swing, {"left_air_time": 0.3, "commanded_speed": 0.5}, {"tolerance": 0.25}, E(-1)),
    (pushing.stance, STANDS, {}, 1),
    (pushing.stance, {**STANDS, "left_slip": 0.2}, {"sliding": 0.2}, E(-1)),
    (pushing.stance, {**STANDS, "ground_load": np.array([[0.03, 0.0]])}, {"load": 0.15}, 0.2),
    (pushing.stance, {**STANDS, "left_ground_time": 0.06}, {}, 0),
    (pushing.stance, {**STANDS, "left_ground_time": 0.8}, {}, 0),
    (pushing.stance, {**STANDS, "left_travel": 0.1}, {"reach": 0.4}, 0.25),
    (pushing.landing, {"left_touchdown": True, "left_landing_speed": 0.7}, {}, 0.7),
    (pushing.landing, {"left_landing_speed": 0.7}, {}, 0),
    (pushing.slip, {"left_slip": 0.4, "ground_load": np.array([[0.5, 0.9]])}, {}, 0.2),
    (pushing.touchdown, {"left_touchdown": True}, {}, 1),
    (pushing.touchdown, {}, {}, 0),
    *(
        (pushing.speed_error, {"mean_speed": v, "commanded_speed": 1.0}, {}, error)
        for v, error in ((1.4, 0.4), (0.7, 0.3), (3.9, 2.0))
    ),
    (pushing.flat_push, {"foot_on_ground": DOWN}, {}, 1),
    (pushing.flat_push, {}, {}, 0),
    (pushing.flat_push, {"foot_on_ground": DOWN, "left_sole_heights": PITCHED}, {}, 0),
    (pushing.flat_push, {"foot_on_ground": DOWN, "left_sole_heights": PITCHED}, {"tolerance": 7e-4}, 1),
    (pushing.left_foot_on_deck, {}, {}, 0),
    (pushing.left_foot_on_deck, {"foot_on_deck": ON_DECK}, {}, 1),
    *(
        (push_teachers.gait_clock, {"time_in_push": t, "foot_on_ground": DOWN & down}, {"period": 0.9, "stance": 0.35}, paid)
        for t, down, paid in ((0.1, True, 1), (0.1, False, 0), (0.5, True, 0), (0.5, False, 1), (1.0, True, 1))
    ),
    (push_teachers.push_tracking, {"joint_position": first(23, 0.5)}, {"reference": np.zeros((1, 23)), "tolerance": 0.1}, E(-0.25 / 2.3)),
    (steering.left_foot_loaded, {"deck_load": np.array([[0.1, 0.9]])}, {}, 0.4),
    (steering.left_foot_loaded, {"deck_load": np.array([[0.5, 0.5]])}, {}, 1),
    (steering.feet_on_board, {}, {}, 0),
    (steering.feet_on_board, {"foot_on_deck": BOTH, "foot_in_zone": BOTH}, {}, 2),
    (steering.feet_on_board, {"foot_on_deck": BOTH}, {}, 0),
    (steering.feet_on_board, {"foot_on_deck": BOTH, "foot_in_zone": BOTH, "foot_on_ground": DOWN}, {}, 1),
    (_base.holds_pose, {}, {"pose": POSE, "tolerance": 0.2}, E(-0.09 / 0.2)),
    (_base.holds_pose, {"joint_position": np.full((1, 23), 0.3)}, {"pose": POSE, "tolerance": 0.2}, 1),
    (steering.feet_on_markers, {"foot_marker_distance": np.array([[0.1, 0.3]])}, {"tolerance": 0.1}, E(-2)),
    (steering.board_heading, {"board_heading": -3.1, "heading_reference": 3.1}, {"tolerance": 0.02}, E(-(TURN - 6.2) / 0.02)),
    (steering.tilt_rate, {"tilt_rate": -3.0}, {}, 9),
    (tilt_guidance.tilt_guide, {"tilt": 0.03, "tilt_reference": 0.05}, {"tolerance": 0.02}, E(-1)),
    *(
        (tilt_guidance.wrong_tilt, {"tilt": tilt, "tilt_reference": asked}, {"dead_zone": 0.03}, value)
        for tilt, asked, value in ((-0.2, 0.1, 0.2), (0.2, 0.1, 0.0), (0.2, -0.1, 0.2), (0.2, -0.02, 0.0))
    ),
    (transitions.key_positions, {"key_position_error": np.full((1, 14), 0.1)}, {"tolerance": 0.05}, E(-0.01 / 0.05)),
    (transitions.key_orientations, {"key_orientation_error": first(14, 1.0)}, {"tolerance": 0.1}, E(-1 / 1.4)),
    (transitions.left_foot_on_ground, {}, {}, 0),
    (transitions.left_foot_on_ground, {"foot_on_ground": DOWN}, {}, 1),
    (riding.wheels_on_ground, {}, {}, 1),
    (riding.wheels_on_ground, {"wheel_on_ground": np.array([[True, True, True, False]])}, {}, 0),
    (riding.level_deck, {"tilt": -0.05}, {"tolerance": 0.05}, E(-1)),
    (riding.joint_limits, PULLED, {}, 0.2),
    (riding.action_rate, PULLED, {}, 4),
    (riding.action_smoothness, PULLED, {}, 9),
    (riding.squared, PULLED, {"of": "joint_velocity"}, 16),
    (riding.squared, PULLED, {"of": "joint_acceleration"}, 25),
    (riding.squared, PULLED, {"of": "joint_torque"}, 36),
    (riding.self_contact, {"self_contacts": 7.0}, {}, 3),
    (riding.alive, {}, {}, 1),
    (riding.foot_place, {"foot_place_error": -0.03}, {"tolerance": 0.03}, E(-1)),
    (riding.foot_place, {"foot_place_error": -0.03, "foot_on_deck": ON_DECK}, {}, 0),
]  # fmt: skip
"""A term, what differs from the state, the term's arguments, and its value as worked out."""


@pytest.mark.parametrize(("term", "changes", "arguments", "value"), BY_HAND)
def test_a_term_is_worth_what_it_is_by_hand(state, term, changes, arguments, value):
    changed = {
        name: part if isinstance(part, np.ndarray) else np.array([part]) for name, part in changes.items()
    }
    assert float(term(replace(state, **changed), **arguments)[0]) == pytest.approx(
        float(value), rel=1e-6, abs=1e-9
    )


def test_beginners_pay_less_and_riders_all_from_a_quarter_of_the_variation_on():
    terms = {term.name: term for term in rewards.rewards(TASK)}
    less = {name for name, term in terms.items() if abs(term.weight_at(0.0)) < abs(term.weight)}
    assert {
        "push/speed_error",
        "still/speed_error",
        "always/course",
        "moving/slip",
        "moving/touchdown",
        "moving/landing",
    } <= less
    assert all(term.weight_at(0.25) == term.weight_at(1.0) == term.weight for term in terms.values())


def clip(speed, frames):
    """Return a clip whose every angle says its frame, plus the speed."""
    return speed, np.arange(frames)[:, None] + np.full((1, 23), speed)


@pytest.mark.parametrize("kind", ["numpy", "torch"])
def test_the_clip_nearest_in_speed_is_followed_and_repeats(kind):
    array = np.asarray
    if kind == "torch":
        torch = pytest.importorskip("torch")
        array = lambda values: torch.tensor(values, dtype=torch.float)  # noqa: E731
    reference = PushReference((clip(0.5, 40), clip(1.0, 30)))
    # Single precision of k · 0.02 s must not fall into the frame before, whatever k is.
    steps = np.arange(120)
    for speed, nearest, length in ((0.1, 0.5, 40), (0.74, 0.5, 40), (0.76, 1.0, 30), (1.5, 1.0, 30)):
        found = reference.joints(array(np.full(120, speed)), array(steps * 0.02))
        np.testing.assert_allclose(found[:, 5], steps % length + nearest)


TASK = rewards.Task(options=SkateOptions(), clips=(clip(0.5, 40),))


@pytest.mark.parametrize("pushing", get_args(Pushing))
@pytest.mark.parametrize("transition", get_args(Guidance))
def test_every_term_has_a_row_and_a_name_of_its_own(pushing, transition):
    terms = rewards.rewards(replace(TASK, options=SkateOptions(pushing=pushing, transition=transition)))
    assert len({term.name for term in terms}) == len(terms)
    rows = {term for term, *_ in BY_HAND}
    assert [term.name for term in terms if term.name != "push/tracking" and term.value not in rows] == []


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


def test_fallen_beyond_70_degrees(state):
    assert not terminations.fallen(state)[0]
    assert not terminations.fallen(replace(state, upright=np.array([math.cos(math.radians(69))])))[0]
    assert terminations.fallen(replace(state, upright=np.array([math.cos(math.radians(71))])))[0]


def test_off_board_takes_two_steps_without_a_foot(state):
    none = replace(state, foot_on_deck=np.array([[False, False]]))
    assert terminations.off_board(none, np.array([0]))[0] == 1
    assert terminations.off_board(none, np.array([1]))[0] == 2
    assert terminations.off_board(state, np.array([1]))[0] == 0


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
