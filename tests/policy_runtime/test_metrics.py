import math

import numpy as np
import pytest
from rides import made_rides

from policy_runtime.evaluation.metrics import (
    clip_distances,
    episode_errors,
    reachable_headings,
    stride_metrics,
)
from policy_runtime.evaluation.statistics import mean_over, proportion

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


def row(otherwise, *changes):
    """One number a step, shape (STEPS, 1): the same at all but at some."""
    values = np.full((STEPS, 1), otherwise)
    for where, value in changes:
        values[where, 0] = value
    return values


def feet(*changes):
    """Whether the left and the right foot touch, shape (STEPS, 1, 2), flipped at some steps."""
    flipped = np.zeros((STEPS, 1, 2), bool)
    for step, foot in changes:
        flipped[step, 0, foot] = True
    return flipped


ODD, STEP, NAN = np.arange(20) % 2, np.arange(STEPS), math.nan
LEANS = row(0.0, (STEER.start + 2, -0.07), (STEER.start + 5, 0.03), (PUSH, 0.2))
MOVES = row(0.0)[..., None].repeat(23, 2)
ERRORS = {
    "speed counts in pushing only": (
        {"board_speed": row(9.0, (PUSH, np.where(ODD, 1.3, 0.9)))}, {"E_vel": 0.2, "E_vel_mean_speed": 0.1},
    ),
    "heading counts in steering only, and wraps": (
        {"board_heading": row(2.0, (STEER, math.pi - 0.1), (34, math.pi - 0.05)), "target_heading": row(0.1 - math.pi)},
        {"E_yaw": (9 * 0.2 + 0.15) / 10, "E_yaw_final": 0.15},
    ),
    "smoothness is the change of joints a step": (
        {"joint_position": MOVES + 0.023 * STEP[:, None, None] * (np.arange(23) == 0)}, {"E_smth": 0.001},
    ),
    "side slip is of either side, and of the ride alone": (
        {"board_drift": row(9.0, (slice(10), np.where(ODD[:10], 0.2, -0.1))), "alive": row(False, (slice(10), True))},
        {"side_slip": 0.15},
    ),
    "rolling where it is told to stand": (
        {"commanded_speed": row(0.8, (slice(10), 0.05)), "still": row(False, (slice(10), True)),
         "board_speed": row(0.8, (slice(10), -0.4))},
        {"E_still": 0.4},
    ),
    "a wrong foot: the right off the deck or the left on it in pushing, the left on the ground in steering": (
        {"foot_on_deck": rides().foot_on_deck ^ feet((3, 1), (4, 0), (22, 0), (22, 1)), "foot_on_ground": feet((26, 0))},
        {"E_contact": 3 / 30, "E_contact_push": 2 / 20, "E_contact_steer": 1 / 10},
    ),
    "nothing counts after the end": (
        {"alive": row(True, (slice(10, None), False)), "board_speed": row(1.0, (slice(10, None), 77.0)),
         "joint_position": MOVES + 5.0 * (STEP >= 10)[:, None, None]},
        {"E_vel": 0, "E_smth": 0, "E_yaw": NAN, "E_yaw_final": NAN},
    ),
    "the course is that of every turn asked for since the start": (
        {"board_heading": row(0.3, (STEER.stop - 1, 0.3 + 0.45)), "course": row(0.0, (slice(STEER.start, None), 0.5)),
         "target_heading": row(0.8)},
        {"E_course": 0.05},
    ),
    "a tilt against a turn to the left": ({"tilt": LEANS, "target_heading": row(0.5)}, {"E_tilt": 0.07}),
    "a tilt against a turn to the right": ({"tilt": LEANS, "target_heading": row(-0.5)}, {"E_tilt": 0.03}),
    "a turn to the right over the back": ({"tilt": LEANS, "target_heading": row(math.tau - 0.5)}, {"E_tilt": 0.03}),
}  # fmt: skip


@pytest.mark.parametrize("name", ERRORS)
def test_an_error_is_what_the_page_says(name):
    changes, expected = ERRORS[name]
    found = episode_errors(rides(**changes))
    assert {key: found[key][0] for key in expected} == pytest.approx(expected, nan_ok=True)


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
