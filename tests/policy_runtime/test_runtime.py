import math

import numpy as np
import pytest
from riding import HoldStill, Puppet, world_or_skip

from policy_runtime.loop.commands import Command, Script, constant
from policy_runtime.loop.safety import Guard, Limits
from policy_runtime.loop.world import joint_limits
from policy_runtime.runtime import SERVO_STEPS, Runtime
from sim.skate.robot.g1 import servos

LIMITS = Limits(joint_low=np.full(23, -3.0), joint_high=np.full(23, 3.0))


def run(robot=None, policy=None, commands=None, duration=1.0, **options):
    robot = robot or Puppet()
    runtime = Runtime(
        robot=robot,
        policy=policy or HoldStill(),
        commands=commands or constant(Command(1.0, 0.0)),
        limits=LIMITS,
        **options,
    )
    return runtime.run(duration), robot


def test_fifty_decisions_a_second_over_five_hundred_servo_steps():
    policy = HoldStill()
    result, robot = run(policy=policy, duration=2.0, stop_time=0.0)
    assert SERVO_STEPS == 10
    assert result.ticks == len(policy.seen) == 100
    assert robot.steps == 1000
    assert result.stopped is None
    assert [event.kind for event in result.events] == ["start", "end"]
    assert len(result.times) == 100


def test_told_to_stand_while_pushing_the_cycle_waits_at_the_beginning_of_the_next():
    policy = HoldStill()
    script = Script((0.0, 0.1, 0.2), (Command(1.0, 0), Command(0.05, 0), Command(1.0, 0)))
    run(policy=policy, commands=script, duration=0.3)
    assert [step for _, step in policy.seen] == [
        *range(6),
        *[300] * 5,
        *range(301, 305),
    ]  # a cycle is 300 steps


def test_a_cycle_that_is_to_stop_goes_on_to_the_next_pushing_phase():
    policy = HoldStill()
    run(policy=policy, commands=Script((0.0, 2.5), (Command(1.0, 0), Command(0.0, 0))), duration=8.0)
    assert [step for _, step in policy.seen] == [*range(300), *[300] * 100]


def test_the_handset_stops_and_lets_go_on():
    robot, policy = Puppet(), HoldStill()

    def press(tick):
        robot.change = {"buttons": frozenset({{4: "X", 9: "A"}.get(len(policy.seen), "")} - {""})}

    run(robot=robot, policy=policy, duration=0.3, on_tick=press)
    speeds = [command.speed for command, _ in policy.seen]
    assert speeds == [1.0] * 4 + [0.0] * 5 + [1.0] * 6


def test_speed_counts_at_once_and_a_turn_from_the_start_of_steering():
    policy = HoldStill()
    script = Script((0.0, 1.0), (Command(0.5, 0.1), Command(0.9, 0.4)))
    run(policy=policy, commands=script, duration=4.0)
    speeds = [command.speed for command, _ in policy.seen]
    turns = [command.turn for command, _ in policy.seen]
    assert speeds == [0.5] * 50 + [0.9] * 150
    assert turns == [0.0] * 150 + [0.4] * 50  # steering begins 3 s into the cycle


FAULTS = {
    "lost link": {"age": 0.2},
    "not finite: angular velocity": {"angular_velocity": np.array([0, np.nan, 0])},
    "not finite: joint position": {"joint_position": np.full(23, np.inf)},
    "not finite: quaternion": {"quaternion": np.full(4, np.nan)},
    "tilt": {"quaternion": np.array([math.cos(0.6), math.sin(0.6), 0, 0])},
    "joint limit": {"joint_position": np.where(np.arange(23) == 3, 3.06, 0.0)},
    "torque limit: left_knee_joint": {"joint_torque": np.where(np.arange(23) == 3, -139.0, 0.0)},
}


@pytest.mark.parametrize("reason", FAULTS)
def test_each_fault_ends_in_a_damped_stop_that_is_logged(reason):
    robot = Puppet()
    seen = []

    def fault_after_a_while(tick):
        if tick.time > 0.09:
            robot.change = FAULTS[reason]

    result, _ = run(robot, duration=5.0, on_tick=fault_after_a_while, on_event=seen.append)
    assert result.stopped is not None
    assert result.stopped.startswith(reason)
    assert 5 <= result.ticks <= 32  # a torque may stay at its limit for half a second
    brake = robot.sent[-1]
    assert np.all(brake.stiffness == 0)
    np.testing.assert_array_equal(brake.damping, servos().damping)
    assert robot.steps == 10 * result.ticks + 750  # the brake holds for 1.5 s
    assert seen[-1].kind == "stop"
    assert result.stopped in seen[-1].text
    assert result.to_json()["events"][-1]["kind"] == "stop"


def test_a_robot_that_repeats_itself_is_stopped():
    robot = Puppet()
    robot.clock = False
    result, _ = run(robot, duration=5.0)
    assert result.stopped.startswith("stale observation")
    assert result.ticks <= 7


def test_a_policy_that_answers_nan_is_not_obeyed():
    class Breaks(HoldStill):
        def act(self, state, command, step):
            target = super().act(state, command, step).copy()
            return target * np.nan if step == 10 else target

    result, robot = run(policy=Breaks(), duration=5.0)
    assert result.stopped.startswith("not finite: the policy's answer")
    assert result.ticks == 10
    assert all(np.all(np.isfinite(command.position)) for command in robot.sent)


class Raises(HoldStill):
    def __init__(self, error):
        super().__init__()
        self.error = error

    def act(self, state, command, step):
        if step == 5:
            raise self.error
        return super().act(state, command, step)


def test_ctrl_c_brakes():
    result, robot = run(policy=Raises(KeyboardInterrupt()), duration=5.0)
    assert result.stopped == "interrupted"
    assert result.ticks == 5
    assert np.all(robot.sent[-1].stiffness == 0)
    assert robot.steps == 50 + 750


def test_a_bug_in_a_policy_brakes_before_it_surfaces():
    robot, events = Puppet(), []
    with pytest.raises(ZeroDivisionError):
        run(robot, policy=Raises(ZeroDivisionError("bug")), duration=5.0, on_event=events.append)
    assert np.all(robot.sent[-1].stiffness == 0)
    assert robot.steps == 50 + 750
    assert "bug" in events[-1].text


def test_what_is_within_limits_does_not_stop():
    guard = Guard(LIMITS, 0.02)
    robot = Puppet()
    for i in range(200):
        robot.steps = i
        peak = -139.0 if i % 20 < 19 else 0.0  # at the limit for 0.38 s at a time
        robot.change = {
            "joint_torque": np.where(np.arange(23) == 3, peak, 0.0),
            "joint_position": np.where(np.arange(23) == 3, 3.04, 0.0),
            "quaternion": np.array([math.cos(0.5), math.sin(0.5), 0, 0]),
            "age": 0.09,
        }
        assert guard.check(robot.read()) is None


def test_damped_stop_lets_a_standing_robot_sink_slowly():
    world = world_or_skip()
    world.reset()
    robot = world.robot
    height = robot.truth().pelvis_position[2]
    limits = joint_limits(robot.model, tilt=0.0)  # stops at once
    result = Runtime(
        robot=robot, policy=HoldStill(), commands=constant(Command(0, 0)), limits=limits, stop_time=0.3
    ).run(1.0)
    assert result.stopped.startswith("tilt")
    sunk = height - robot.truth().pelvis_position[2]
    assert 0.02 < sunk < 0.44  # free fall would be 0.44 m
    assert np.abs(robot.read().joint_torque).max() <= servos().effort.max()
