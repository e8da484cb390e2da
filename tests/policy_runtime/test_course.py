"""Turns add up to a course; held, what earlier turns missed is made up for."""

import math
from dataclasses import replace

import numpy as np
import pytest
from riding import HoldStill, Puppet

from policy_runtime.loop.commands import Command, constant
from policy_runtime.loop.course import Course
from policy_runtime.loop.safety import Limits
from policy_runtime.runtime import Runtime
from sim.skate.cycle.clock import Clock

LIMITS = Limits(joint_low=np.full(23, -3.0), joint_high=np.full(23, 3.0))
CLOCK = Clock()
STEERING = CLOCK.push + CLOCK.mount


def yawed(angle):
    return replace(Puppet().read(), quaternion=np.array([math.cos(angle / 2), 0, 0, math.sin(angle / 2)]))


def ride(turns, missed, stance=0.7, start=0.0, hold=True):
    """Return what a rider is told who turns by what he is told less what he misses, and where he then heads.

    His pelvis faces `stance` away from the board while he pushes.
    """
    course, heading, told = Course(hold=hold), start, []
    for cycle, turn in enumerate(turns):
        for position in range(CLOCK.period):
            answer = course.follow(yawed(heading + stance), cycle * CLOCK.period + position, turn)
            assert (answer is not None) == (position == STEERING)
            if answer is not None:
                told.append(answer)
                heading += answer - missed
    return told, heading - start, course.asked


def test_held_the_course_keeps_what_each_turn_misses_from_adding_up():
    told, heading, asked = ride([0.0] * 6, missed=0.1)
    assert told == pytest.approx([0.0, 0.1, 0.1, 0.1, 0.1, 0.1])
    assert heading == pytest.approx(-0.1)  # of one cycle, not of six
    assert asked == 0


def test_not_held_it_walks_off():
    told, heading, _ = ride([0.0] * 6, missed=0.1, hold=False)
    assert told == [0.0] * 6
    assert heading == pytest.approx(-0.6)


@pytest.mark.parametrize("start", [0.0, 3.0])
def test_turns_asked_for_are_part_of_the_course_also_across_the_back(start):
    turns = [0.5, -0.2, 0.3, 0.7, 0.7]
    _, heading, asked = ride(turns, missed=0.05, start=start)
    assert asked == pytest.approx(sum(turns))
    assert heading == pytest.approx(sum(turns) - 0.05)


def test_what_is_too_much_for_one_turn_is_left_for_the_next():
    course = Course(hold=True)
    told = []
    for cycle, heading in enumerate((0.0, -1.2, -1.2 + math.pi / 4)):
        for position in range(CLOCK.period):
            answer = course.follow(yawed(heading), cycle * CLOCK.period + position, 0.0)
            told += [] if answer is None else [answer]
    assert told == pytest.approx([0.0, math.pi / 4, 1.2 - math.pi / 4])


def test_a_cycle_that_stands_still_asks_for_no_turn_twice():
    course = Course()
    for _ in range(10):
        course.follow(yawed(0.0), STEERING, 0.2)
    assert course.asked == pytest.approx(0.2)


def test_the_runtime_tells_the_policy_the_held_turn_and_its_ticks_the_course():
    robot, policy, ticks = Puppet(), HoldStill(), []

    def on_tick(tick):
        ticks.append(tick)
        if tick.step == STEERING:  # blown 0.3 rad off course
            robot.change = {"quaternion": yawed(0.3).quaternion}

    Runtime(
        robot=robot, policy=policy, commands=constant(Command(1.0, 0.1)), limits=LIMITS, on_tick=on_tick,
        stop_time=0.0, hold_heading=True,
    ).run((CLOCK.period + STEERING + 1) * 0.02)  # fmt: skip
    assert ticks[STEERING].command.turn == pytest.approx(0.1)
    assert ticks[STEERING].course == pytest.approx(0.1)
    assert ticks[-1].command.turn == pytest.approx(0.2 - 0.3)
    assert ticks[-1].course == pytest.approx(0.2)
