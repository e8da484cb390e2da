"""Before a policy takes over: armed, eased into the pose, checked, timed; and the dry run's comparison."""

import math
from dataclasses import replace

import numpy as np
import pytest
from riding import HoldStill, Puppet, make_onnx, our_metadata, pink, published_metadata

from policy_runtime.loop.commands import Command, constant
from policy_runtime.loop.observing import RELEASE_SIZE
from policy_runtime.loop.preparation import PROBE_JOINT, Preparation
from policy_runtime.loop.safety import Limits
from policy_runtime.runtime import Runtime
from sim.skate.robot.g1 import JOINTS, default_pose, servos

LIMITS = Limits(joint_low=np.full(23, -3.0), joint_high=np.full(23, 3.0))


class Obedient(Puppet):
    """Its joints are where they are told to be after a delay, and its torques answer as a servo's do."""

    def __init__(self, delay=0):
        super().__init__()
        self.q, self.torque = default_pose() + 0.5, np.zeros(23)
        self.coming = []
        self.delay = delay

    def step(self):
        super().step()
        while self.coming and self.coming[0][0] < self.steps:
            command = self.coming.pop(0)[1]
            self.torque = command.stiffness * (command.position - self.q)
            if np.any(command.stiffness):
                self.q = self.q + 0.05 * (command.position - self.q)

    def send(self, command):
        super().send(command)
        self.coming.append((self.steps + self.delay, command))

    def read(self):
        return replace(super().read(), joint_position=self.q, joint_torque=self.torque)


def begin(robot, policy=None, duration=0.1, on_event=None, limits=LIMITS, **options):
    preparation = Preparation(**{"pose": default_pose(), "ramp": 1.0, "handset": False} | options)
    return Runtime(
        robot=robot,
        policy=policy or HoldStill(),
        commands=constant(Command(1.0, 0.0)),
        limits=limits,
        preparation=preparation,
        on_event=on_event,
        stop_time=0.0,
    ).run(duration)


def test_joints_are_led_to_the_start_pose_without_a_jump():
    robot = Obedient()
    result = begin(robot)
    assert result.stopped is None
    assert [event.kind for event in result.events] == ["ramp", "delay", "start", "end"]
    ramp = np.array([command.position for command in robot.sent[1:52]])
    np.testing.assert_allclose(ramp[0], default_pose() + 0.5)
    np.testing.assert_allclose(ramp[-1], default_pose())
    assert np.abs(np.diff(ramp, axis=0)).max() < 0.5 * 1.55 / 50  # a smooth step of half a radian in 50


def test_the_handset_says_when():
    robot, policy = Obedient(), HoldStill()
    seen = []

    def on_event(event):
        if event.kind in ("wait", "ready"):
            assert not policy.seen
            seen.append((event.kind, robot.steps))
            robot.change = {"buttons": frozenset({"start"} if event.kind == "wait" else {"A"})}

    result = begin(robot, policy, on_event=on_event, handset=True)
    assert result.stopped is None
    assert [kind for kind, _ in seen] == ["wait", "ready"]
    assert len(policy.seen) == 5
    assert not np.any(robot.sent[0].stiffness)  # until it is armed it only brakes


@pytest.mark.parametrize("buttons", [{"select"}, {"L2", "B"}, {"L2", "B", "A"}])
def test_the_handset_stops_at_any_time(buttons):
    robot = Puppet()

    def press(event):
        robot.change = {"buttons": frozenset(buttons)}

    waiting = begin(robot, on_event=press, handset=True)
    assert waiting.stopped.startswith("handset:")
    assert waiting.ticks == 0
    assert not any(np.any(command.stiffness) for command in robot.sent)
    running = Puppet()
    result = Runtime(
        robot=running, policy=HoldStill(), commands=constant(Command(1, 0)), limits=LIMITS, stop_time=0.0,
        on_tick=lambda tick: setattr(running, "change", {"buttons": frozenset(buttons)}),
    ).run(1.0)  # fmt: skip
    assert result.stopped.startswith("handset:")
    assert result.ticks == 1
    assert not np.any(running.sent[-1].stiffness)


def test_a_joint_that_does_not_come_along_is_named():
    class Stuck(Obedient):
        def read(self):
            state = super().read()
            q = state.joint_position.copy()
            q[7] = default_pose()[7] - 0.6
            return replace(state, joint_position=q)

    result = begin(Stuck())
    assert result.ticks == 0
    assert result.stopped.startswith(f"start pose: {JOINTS[7]} is -0.60 rad from it, tolerance 0.5")


def test_a_robot_that_leans_does_not_begin():
    robot = Obedient()
    robot.change = {"quaternion": np.array([math.cos(0.2), 0, math.sin(0.2), 0])}
    assert begin(robot).stopped.startswith("start pose: the pelvis leans 23°")


def test_motors_that_do_not_answer_are_noticed():
    assert begin(Puppet()).stopped.startswith(f"delay: {JOINTS[PROBE_JOINT]} did not answer")


@pytest.mark.parametrize("steps", [0, 5, 20])
def test_delay_is_measured(steps):
    result = begin(Obedient(delay=steps))
    np.testing.assert_allclose(result.delay.times, 0.002 * (steps + 1))
    assert result.to_json()["delay"]["median_ms"] == pytest.approx(2 * (steps + 1))


def test_a_dry_run_sends_nothing_of_what_the_policy_answers():
    robot, policy = Obedient(), HoldStill(default_pose() + 0.3)
    result = begin(robot, policy, dry=True)
    assert len(policy.seen) == 5
    assert "dry" in [event.kind for event in result.events]
    for command in robot.sent[-6:-1]:
        np.testing.assert_array_equal(command.position, default_pose())
        np.testing.assert_array_equal(command.stiffness, servos().stiffness)


# The comparison with the training's ranges


@pytest.fixture(params=[390, RELEASE_SIZE])
def checked(tmp_path, request):
    pytest.importorskip("onnxruntime", reason="policies need onnxruntime (extra 'run')")
    from policy_runtime.loop.policy import OnnxPolicy
    from policy_runtime.loop.policy_file import open_policy
    from policy_runtime.loop.ranges import RangeCheck

    ours = request.param == 390
    metadata = our_metadata(pink()) if ours else published_metadata()
    constants = make_onnx(tmp_path / "p.onnx", size=request.param, metadata=metadata)
    policy = OnnxPolicy(open_policy(tmp_path / "p.onnx"))
    return policy, RangeCheck(policy), constants


def look(checked, steps=10, **change):
    policy, check, _ = checked
    robot = Puppet()
    robot.change = change
    policy.reset(robot.read())
    for step in range(steps):
        check.add(robot.read(), policy.act(robot.read(), Command(0.5, 0.0), step))
    return check


def test_what_the_training_saw_is_not_outside(checked):
    check = look(checked)
    assert check.outside() == []
    assert not [n for n in check.seen() if n.name.startswith(("last_action", "command", "phase"))]


def test_a_gyro_in_degrees_and_a_sensor_upside_down_are_named(checked):
    outside = look(checked, angular_velocity=np.array([0.0, 180.0, 0.0])).outside()
    assert [number.name for number in outside] == ["angular_velocity y"]
    number = outside[0]
    assert number.live == (45.0, 45.0)  # 180 · 0.25, the observation's scale
    assert number.far == 1.0
