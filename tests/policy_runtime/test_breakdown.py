"""Where errors come from, on rides whose every step is known."""

import math

import numpy as np
import pytest
from rides import made_rides

from policy_runtime.evaluation.breakdown import add_up, break_down
from policy_runtime.evaluation.metrics import Rides, episode_errors
from sim.skate.cycle.clock import Clock

CLOCK = Clock(push=80, mount=10, steer=40, dismount=10)
CYCLES = 2
STEPS = CYCLES * CLOCK.period


def rides(**changes):
    """Two cycles of two episodes, told 0.5 m/s and 1 m/s, in which everything is as asked for."""
    step = np.arange(STEPS)
    return made_rides(CLOCK.pushing(step), CLOCK.steering(step), (0.5, 1.0), **changes)


def table(tables, start):
    (found,) = [t for t in tables if t.title.startswith(start)]
    return found


def test_an_error_of_speed_shows_in_its_phase_its_command_and_its_time():
    speed = rides().speed.copy()
    later = slice(CLOCK.period, CLOCK.period + 10)  # first eighth of the second pushing phase
    speed[later, 1] -= 0.4
    tables = break_down(rides(speed=speed), CLOCK)
    by_phase = table(tables, "speed by pushing phase")
    assert by_phase.mean("phase 1", "|v-v_cmd|") == 0
    assert by_phase.mean("phase 2", "v-v_cmd") == pytest.approx(-0.4 * 10 / 160)
    by_command = table(tables, "speed by command")
    assert by_command.mean("0.4-0.8 m/s, later", "|v-v_cmd|") == 0
    assert by_command.mean("0.8-1.2 m/s, later", "|v-v_cmd|") == pytest.approx(0.4 * 10 / 80)
    assert by_command.mean("0.8-1.2 m/s, first", "|v-v_cmd|") == 0
    by_time = table(tables, "v-v_cmd by time in the later")
    labels = list(by_time.rows)
    assert by_time.mean(labels[0], "v_cmd 0.8-1.2 m/s") == pytest.approx(-0.4)
    assert by_time.mean(labels[1], "all") == 0
    assert math.isnan(by_time.mean(labels[0], "v_cmd 1.2-1.5 m/s"))


def test_wrong_feet_are_told_apart_by_foot_and_time():
    deck, ground = rides().foot_on_deck.copy(), rides().foot_on_ground.copy()
    deck[:5, 0, 0] = True  # left foot still on the deck
    deck[70:80, 1, 1] = False  # right foot off it at the end
    ground[CLOCK.push + CLOCK.mount, :, 0] = True
    tables = break_down(rides(foot_on_deck=deck, foot_on_ground=ground), CLOCK)
    by_time = table(tables, "feet by time in pushing")
    first, *_, last = by_time.rows
    assert by_time.mean(first, "left on deck") == pytest.approx(5 / 40)
    assert by_time.mean(first, "right off deck") == 0
    assert by_time.mean(last, "right off deck") == pytest.approx(10 / 40)
    assert by_time.mean(last, "wrong") == pytest.approx(10 / 40)
    steering = table(tables, "feet by time in steering")
    assert steering.mean(next(iter(steering.rows)), "left on ground") == pytest.approx(2 / 20)


def test_a_turn_that_comes_short_is_told_from_one_that_goes_too_far():
    target, heading = np.zeros((STEPS, 2)), np.zeros((STEPS, 2))
    steer = np.flatnonzero(CLOCK.steering(np.arange(STEPS)))
    first, second = steer[: CLOCK.steer], steer[CLOCK.steer :]
    target[first] = [0.3, -0.7]
    heading[first[1:]] = [0.2, -0.9]  # left: 0.1 short, right: 0.2 too far; at the first step not yet
    target[second] = heading[second] = 0.05
    tables = break_down(rides(target_heading=target, heading=heading), CLOCK)
    by_turn = table(tables, "heading by turn")
    assert by_turn.mean("0.2-0.4 rad, at the end", "error along the turn") == pytest.approx(-0.1)
    assert by_turn.mean("0.6-0.8 rad, at the end", "error along the turn") == pytest.approx(0.2)
    assert by_turn.mean("right, at the end", "beyond 0.1 rad") == 1.0
    by_phase = table(tables, "heading by steering phase")
    assert by_phase.mean("phase 2", "|error|") == 0


def test_means_agree_with_the_metrics():
    rng = np.random.default_rng(3)
    noisy = rides(speed=rng.uniform(0, 1, (STEPS, 2)), heading=rng.uniform(-1, 1, (STEPS, 2)))
    tables, errors = break_down(noisy, CLOCK), episode_errors(noisy)
    by_phase = table(tables, "speed by pushing phase")
    assert by_phase.mean("all", "|v-v_cmd|") == pytest.approx(errors["E_vel"].mean())
    assert table(tables, "heading by steering phase").mean("all", "|error|") == pytest.approx(
        errors["E_yaw"].mean()
    )


def test_parts_add_up_to_the_whole_even_where_one_ended_early():
    rng = np.random.default_rng(4)
    speed = rng.uniform(0, 1, (STEPS, 2))
    alive = np.ones((STEPS, 2), bool)
    alive[100:, 1] = False  # the second episode never comes to a second phase
    whole = rides(speed=speed, alive=alive)

    def one(n):
        fields = {name: getattr(whole, name) for name in Rides.__slots__}
        return Rides(**{k: v[n : n + 1] if k == "succeeded" else v[:, n : n + 1] for k, v in fields.items()})

    together = add_up([break_down(one(0), CLOCK), break_down(one(1), CLOCK)])
    for a, b in zip(break_down(whole, CLOCK), together, strict=True):
        assert a.title == b.title
        for label in a.rows:
            assert np.allclose(a.rows[label], b.rows[label])
