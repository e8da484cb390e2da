"""Where errors come from, on rides whose every step is known."""

import math

import numpy as np
import pytest
from rides import made_rides

from policy_runtime.evaluation.breakdown import add_up, break_down
from policy_runtime.evaluation.metrics import Rides
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
    speed = rides().board_speed.copy()
    speed[CLOCK.period : CLOCK.period + 16, 1] -= 0.4  # first fifth of the second pushing phase
    found = table(break_down(rides(board_speed=speed), CLOCK), "speed while pushing")
    assert found.mean("phase 1", "|v-v_cmd|") == 0
    assert found.mean("phase 2", "v-v_cmd") == pytest.approx(-0.4 * 16 / 160)
    assert found.mean("0.3 to 0.6 m/s", "|v-v_cmd|") == 0
    assert found.mean("0.9 to 1.2 m/s", "|v-v_cmd|") == pytest.approx(0.4 * 16 / 160)
    assert found.mean("0.00-0.32 s", "v-v_cmd") == pytest.approx(-0.4 / 4)
    assert found.mean("0.32-0.64 s", "v-v_cmd") == 0
    assert math.isnan(found.mean("1.2 to 1.5 m/s", "v-v_cmd"))


def test_wrong_feet_are_told_apart_by_foot_and_time():
    deck, ground = rides().foot_on_deck.copy(), rides().foot_on_ground.copy()
    deck[:5, 0, 0] = True  # left foot still on the deck
    deck[70:80, 1, 1] = False  # right foot off it at the end
    ground[CLOCK.push + CLOCK.mount, :, 0] = True
    tables = break_down(rides(foot_on_deck=deck, foot_on_ground=ground), CLOCK)
    pushing = table(tables, "feet while pushing")
    assert pushing.mean("0.00-0.32 s", "left on deck") == pytest.approx(5 / 64)
    assert pushing.mean("0.00-0.32 s", "right off deck") == 0
    assert pushing.mean("1.28-1.60 s", "right off deck") == pytest.approx(10 / 64)
    assert pushing.mean("1.28-1.60 s", "wrong") == pytest.approx(10 / 64)
    assert table(tables, "feet while steering").mean("0.00-0.16 s", "left on ground") == pytest.approx(2 / 32)


def test_a_turn_that_comes_short_is_told_from_one_that_goes_too_far():
    target, heading = np.zeros((STEPS, 2)), np.zeros((STEPS, 2))
    steer = np.flatnonzero(CLOCK.steering(np.arange(STEPS)))
    first, second = steer[: CLOCK.steer], steer[CLOCK.steer :]
    target[first] = [0.3, -0.7]
    heading[first[1:]] = [0.2, -0.9]  # left: 0.1 short, right: 0.2 too far; at the first step not yet
    target[second] = heading[second] = 0.05
    found = table(
        break_down(rides(target_heading=target, board_heading=heading), CLOCK), "heading while steering"
    )
    assert found.mean("last step", "error along the turn") == pytest.approx((-0.1 + 0.2 + 0 + 0) / 4)
    assert found.mean("0.16 to 0.47 rad", "error along the turn") == pytest.approx(
        -(0.3 + 39 * 0.1) / 40, rel=1e-6
    )
    assert found.mean("phase 2", "|error|") == 0


def test_parts_add_up_to_the_whole_even_where_one_ended_early():
    rng = np.random.default_rng(4)
    speed = rng.uniform(0, 1, (STEPS, 2))
    alive = np.ones((STEPS, 2), bool)
    alive[100:, 1] = False  # the second episode never comes to a second phase
    whole = rides(board_speed=speed, alive=alive)

    def one(n):
        fields = {name: getattr(whole, name) for name in Rides.__slots__}
        return Rides(**{k: v[n : n + 1] if k == "succeeded" else v[:, n : n + 1] for k, v in fields.items()})

    together = add_up([break_down(one(0), CLOCK), break_down(one(1), CLOCK)])
    for a, b in zip(break_down(whole, CLOCK), together, strict=True):
        assert a.title == b.title
        for label in a.rows:
            assert np.allclose(a.rows[label], b.rows[label])
