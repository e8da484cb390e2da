import math

import numpy as np
import pytest
from rides import made_rides

from policy_runtime.evaluation.metrics import episode_errors, reachable_headings
from policy_runtime.evaluation.statistics import mean_over, proportion
from policy_runtime.evaluation.strides import clip_distances, stride_metrics

STEPS, PUSH, STEER = 40, slice(0, 20), slice(25, 35)


def rides(**changes):
    """One episode: 20 steps of pushing, 10 of steering, everything as told."""
    step = np.arange(STEPS)
    return made_rides(step < 20, (step >= 25) & (step < 35), **changes)


def test_a_perfect_ride_has_no_error():
    found = episode_errors(rides())
    assert all(
        found[name][0] == 0 for name in ("E_vel", "E_yaw", "E_smth", "E_contact", "E_course", "E_tilt")
    )
    assert np.isnan(
        [found[name][0] for name in ("E_still", "E_stop", "stride_period", "slip", "transport")]
    ).all()


def test_side_slip_is_of_either_side_and_of_the_ride_alone():
    drift, alive = np.full((STEPS, 1), 9.0), np.zeros((STEPS, 1), bool)
    drift[:10], alive[:10] = np.where(np.arange(10) % 2, 0.2, -0.1)[:, None], True
    assert episode_errors(rides(board_drift=drift, alive=alive))["side_slip"][0] == pytest.approx(0.15)


def long_ride(**changes):
    """One episode of 12 s in pushing, and told to move unless said otherwise."""
    return made_rides(
        np.ones(600, bool),
        np.zeros(600, bool),
        **{"foot_on_deck": np.array([[[False, True]]] * 600), **changes},
    )


def test_strides_are_counted_from_touchdown_to_touchdown():
    """A foot that stands for 0.4 s of each 1.0 s, sliding at 0.1 m/s under a tenth of the weight, travels 0.3 m."""
    step = np.arange(600) % 50
    down = np.zeros((600, 1, 2), bool)
    down[:, 0, 0] = step < 20
    found = stride_metrics(
        long_ride(
            foot_on_ground=down,
            ground_load=np.where(step < 20, 0.1, 0.0)[:, None],
            left_slip=np.where(step < 20, 0.1, 3.0)[:, None],
            left_place=(0.3 * np.abs(step - 25) / 25)[:, None],
        )
    )
    expected = {
        "strides": 11,
        "stride_period": 1.0,
        "stance_time": 0.4,
        "foot_travel": 0.3,
        "slip": 0.1,
        "impact": 0.1,
    }
    assert {name: found[name][0] for name in expected} == pytest.approx(expected)
    assert found["style_distance"][0] > 0.1  # joints at zero are no push


def test_the_reference_clips_are_near_themselves_and_each_other():
    """Half a second of stance a stride of 0.9 s, and hardly any slip, as `motions` measures them."""
    distances = dict(clip_distances())
    assert len(distances) == 4
    assert all(0 < distance < 0.1 for distance in distances.values())


@pytest.mark.parametrize(("rest", "falls", "share"), [(300, None, 0.0), (590, None, 1.0), (300, 400, 1.0)])
def test_a_stop_fails_when_the_board_rolls_on_or_the_robot_falls(rest, falls, share):
    told = np.where(np.arange(600) < 100, 1.0, 0.0)[:, None]
    speed = np.where(np.arange(600) < rest, 1.0, 0.05)[:, None]
    alive = (np.arange(600) < (falls or 600))[:, None]
    ride = long_ride(
        commanded_speed=told, board_speed=speed, alive=alive, succeeded=np.array([falls is None])
    )
    assert episode_errors(ride)["E_stop"][0] == share


def test_cost_of_transport_is_work_over_weight_and_way():
    """0.3 weights · m/s at 1 m/s."""
    assert episode_errors(long_ride(power=np.full((600, 1), 0.3)))["transport"][0] == pytest.approx(0.3)


def test_rolling_where_it_is_told_to_stand_is_an_error_of_its_own():
    told = np.where(np.arange(STEPS) < 10, 0.05, 0.8)[:, None]
    waits = told < 0.1
    speed = np.where(np.arange(STEPS) < 10, -0.4, 0.8)[:, None]
    assert episode_errors(rides(commanded_speed=told, still=waits, board_speed=speed))["E_still"][
        0
    ] == pytest.approx(0.4)
    assert np.isnan(episode_errors(rides())["E_still"][0])


def test_velocity_counts_in_pushing_only():
    speed = np.full((STEPS, 1), 9.0)
    speed[PUSH] = np.where(np.arange(20) % 2, 1.3, 0.9)[:, None]
    errors = episode_errors(rides(board_speed=speed))
    assert errors["E_vel"][0] == pytest.approx(0.2)
    assert errors["E_vel_mean_speed"][0] == pytest.approx(0.1)  # mean speed 1.1


def test_heading_counts_in_steering_only_and_wraps():
    heading = np.full((STEPS, 1), 2.0)
    heading[STEER] = math.pi - 0.1
    heading[34] = math.pi - 0.05
    target = np.full((STEPS, 1), -math.pi + 0.1)
    errors = episode_errors(rides(board_heading=heading, target_heading=target))
    assert errors["E_yaw"][0] == pytest.approx((9 * 0.2 + 0.15) / 10)
    assert errors["E_yaw_final"][0] == pytest.approx(0.15)


def test_smoothness_is_the_change_of_joints_a_step():
    joints = np.zeros((STEPS, 1, 23))
    joints[:, 0, 0] = 0.023 * np.arange(STEPS)
    errors = episode_errors(rides(joint_position=joints))
    assert errors["E_smth"][0] == pytest.approx(0.001)


def test_wrong_feet_are_counted():
    deck, ground = rides().foot_on_deck.copy(), rides().foot_on_ground.copy()
    deck[3, 0, 1] = False  # pushing: right foot off the deck
    deck[4, 0, 0] = True  # pushing: left foot on it
    ground[26, 0, 0] = True  # steering: left foot on the ground
    deck[22] = False  # mounting: whatever it does
    errors = episode_errors(rides(foot_on_deck=deck, foot_on_ground=ground))
    assert errors["E_contact"][0] == pytest.approx(3 / 30)
    assert errors["E_contact_push"][0] == pytest.approx(2 / 20)
    assert errors["E_contact_steer"][0] == pytest.approx(1 / 10)


def test_what_comes_after_the_end_does_not_count():
    alive = np.ones((STEPS, 1), bool)
    alive[10:] = False
    speed = np.full((STEPS, 1), 1.0)
    speed[10:] = 77.0
    joints = np.zeros((STEPS, 1, 23))
    joints[10:] = 5.0
    errors = episode_errors(rides(alive=alive, board_speed=speed, joint_position=joints))
    assert errors["E_vel"][0] == 0
    assert errors["E_smth"][0] == 0
    assert np.isnan(errors["E_yaw"][0])
    assert np.isnan(errors["E_yaw_final"][0])


def test_headings_reached_are_those_of_whole_steering_phases():
    heading = np.zeros((STEPS, 1))
    heading[STEER, 0] = np.linspace(3.1, 3.1 + 0.4, 10)  # through π
    target = np.full((STEPS, 1), 3.1 + 0.5 - 2 * math.pi)
    rows = reachable_headings(
        rides(board_heading=(heading + math.pi) % (2 * math.pi) - math.pi, target_heading=target)
    )
    np.testing.assert_allclose(rows, [[0.5, 0.4, 1.0]], atol=1e-9)
    alive = np.ones((STEPS, 1), bool)
    alive[30:] = False
    assert len(reachable_headings(rides(alive=alive))) == 0


def test_wilson_interval_against_textbook_values():
    share = proportion(90, 100)
    low, high = share.ci95
    assert share.value == 0.9
    assert (low, high) == (pytest.approx(0.8256, abs=1e-4), pytest.approx(0.9448, abs=1e-4))
    assert proportion(0, 20).ci95[0] == 0
    assert proportion(20, 20).ci95[1] == 1
    assert math.isnan(proportion(0, 0).value)


def test_interval_over_seeds_covers_the_truth_as_often_as_it_says():
    rng = np.random.default_rng(11)
    covered = 0
    for _ in range(400):
        seeds = [rng.normal(1.0 + shift, 0.5, 50) for shift in rng.normal(0, 0.2, 5)]
        low, high = mean_over(seeds, "m/s").ci95
        covered += low <= 1.0 <= high
    assert 0.92 <= covered / 400 <= 0.98


@pytest.mark.parametrize(("turn", "largest"), [(0.5, 0.07), (-0.5, 0.03), (2 * math.pi - 0.5, 0.03)])
def test_wrong_tilt_is_the_largest_against_the_turn(turn, largest):
    tilt = np.zeros((STEPS, 1))
    tilt[STEER.start + 2], tilt[STEER.start + 5] = -0.07, 0.03
    tilt[PUSH] = 0.2
    errors = episode_errors(rides(tilt=tilt, target_heading=np.full((STEPS, 1), turn)))
    assert errors["E_tilt"][0] == pytest.approx(largest)


def test_course_counts_from_the_start_and_every_turn_asked_for_since():
    heading, course = np.full((STEPS, 1), 0.3), np.zeros((STEPS, 1))
    heading[STEER.stop - 1] = 0.3 + 0.45  # at the end of steering
    course[STEER.start :] = 0.5
    errors = episode_errors(
        rides(board_heading=heading, course=course, target_heading=np.full((STEPS, 1), 0.8))
    )
    assert errors["E_course"][0] == pytest.approx(0.05)
