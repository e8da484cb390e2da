import os
import time

import numpy as np
import pytest
from riding import HoldStill, world_or_skip

from policy_runtime.loop.commands import Command, constant
from policy_runtime.loop.world import joint_limits
from policy_runtime.robots import JointCommand
from policy_runtime.runtime import Runtime
from sim.skate.robot.g1 import default_pose, servos
from sysid.errors import SysidError

pytest.importorskip("cyclonedds", reason="the robot's interface needs cyclonedds (extra 'robot')")

from cyclonedds.idl import IdlStruct
from cyclonedds.idl._support import Endianness

from policy_runtime.robots import unitree_messages as messages
from policy_runtime.robots.loopback import SimulatedG1
from policy_runtime.robots.unitree import POLICY_MOTORS, UnitreeG1

pytestmark = pytest.mark.train

DOMAIN = 77 + 2 * int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
"""Of this test process; nobody answers in the next one."""
LOOPBACK = "lo"


@pytest.fixture
def robot_pair():
    from policy_runtime.robots.simulated import Gantry

    world = world_or_skip(gantry=Gantry())
    world.reset()
    with SimulatedG1(world.robot, interface=LOOPBACK, domain=DOMAIN) as simulated:
        robot = UnitreeG1(LOOPBACK, DOMAIN)
        try:
            yield simulated, robot, world
        finally:
            robot.close()


def crc_bit_by_bit(data):
    """CRC-32/MPEG-2 of little-endian words, highest bit first, by long division."""
    remainder = 0xFFFFFFFF
    for i in range(0, len(data), 4):
        word = int.from_bytes(data[i : i + 4], "little")
        for bit in range(31, -1, -1):
            carry = (remainder >> 31) ^ (word >> bit & 1)
            remainder = (remainder << 1 & 0xFFFFFFFF) ^ (0x04C11DB7 if carry else 0)
    return remainder


def test_check_sum_is_crc32_mpeg2_of_words():
    rng = np.random.default_rng(0)
    for size in (4, 8, 1000):
        data = rng.bytes(size)
        assert messages.crc32(data) == crc_bit_by_bit(data)
    # The published check value of CRC-32/MPEG-2, '123456789', cut to whole words.
    assert messages.crc32(b"43218765") == crc_bit_by_bit(b"43218765")


@pytest.mark.parametrize("version_2", [None, False, True])
@pytest.mark.parametrize("kind", ["command", "state"])
def test_what_travels_is_what_cyclonedds_itself_would_send(kind, version_2):
    rng = np.random.default_rng(3)
    message = getattr(messages, f"empty_{kind}")()
    message.mode_machine, message.crc, message.reserve = 5, 0xDEADBEEF, [1, 2, 3, 2**32 - 1]
    for motor in message.motor_cmd if kind == "command" else message.motor_state:
        motor.mode, motor.q, motor.dq = (
            int(rng.integers(256)),
            *rng.normal(size=2).astype(np.float32).tolist(),
        )
    if kind == "state":
        message.version, message.tick = [7, 8], 123456789
        message.imu_state.quaternion = rng.normal(size=4).astype(np.float32).tolist()
        message.imu_state.temperature = -40
        message.motor_state[0].temperature, message.motor_state[34].reserve = [-3, 70], [9, 8, 7, 6]
        message.wireless_remote = bytes(range(40))
    theirs = IdlStruct.serialize(message, use_version_2=version_2)
    assert message.serialize(use_version_2=version_2) == theirs
    again = type(message).deserialize(theirs)
    assert again == type(message).__idl__.deserialize(theirs, has_header=True)
    assert again == message
    big = IdlStruct.serialize(message, endianness=Endianness.Big, use_version_2=version_2)
    assert type(message).deserialize(big) == message


def test_names_and_slots_are_the_robots_own():
    assert messages.LowCmd.__idl_typename__ == "unitree_hg.msg.dds_.LowCmd_"
    assert messages.LowState.__idl_typename__ == "unitree_hg.msg.dds_.LowState_"
    assert (messages.COMMAND_TOPIC, messages.STATE_TOPIC) == ("rt/lowcmd", "rt/lowstate")
    assert POLICY_MOTORS[11:19] == (11, 12, 13, 14, 15, 16, 17, 18)  # last ankle, waist, left arm
    assert POLICY_MOTORS[19:] == (22, 23, 24, 25)  # right arm; wrists at 19 to 21 and 26 to 28


def test_command_moves_the_right_joints(robot_pair):
    _, robot, _ = robot_pair
    target = default_pose()
    target[19:] += 0.3  # right arm: shoulder and elbow
    deadline = time.monotonic() + 20
    reached = np.zeros(23)
    while time.monotonic() < deadline:
        robot.send(JointCommand(position=target, stiffness=servos().stiffness, damping=servos().damping))
        robot.step()
        reached = robot.read().joint_position
        if np.all(np.abs(reached[19:] - target[19:]) < 0.12):
            break
    assert np.all(np.abs(reached[19:] - target[19:]) < 0.12)


def silent(simulated):
    """The cable is pulled."""
    simulated.publish = lambda: None


def hung(simulated):
    """The sensors repeat themselves."""
    state = simulated._state()
    simulated.publish = lambda: simulated._writer.write(state)


def garbled(simulated):
    """The check sums are wrong."""

    def publish():
        state = simulated._state()
        state.crc ^= 1
        simulated._writer.write(state)

    simulated.publish = publish


def drive(simulated, robot, world, fault, duration=30.0):
    """Run until the fault that begins after a while stops the robot."""
    waiting = [fault]

    def on_tick(tick):
        if tick.time > 0.2 and waiting:
            waiting.pop()(simulated)

    # A silent robot repeats its state as well: the link is checked first, and is the one that is named.
    limits = joint_limits(world.robot.model, link_timeout=1.5, torque_time=1e9, joint_margin=1.0)
    return Runtime(
        robot=robot,
        policy=HoldStill(),
        commands=constant(Command(0.0, 0.0)),
        limits=limits,
        on_tick=on_tick,
        stop_time=0.1,
    ).run(duration)


@pytest.mark.parametrize(
    ("fault", "reason"), [(silent, "lost link"), (hung, "stale observation"), (garbled, "lost link")]
)
def test_pulled_cable_hung_sensors_and_garbage_stop_the_robot(robot_pair, fault, reason):
    simulated, robot, world = robot_pair
    result = drive(simulated, robot, world, fault)
    assert result.stopped is not None
    assert result.stopped.startswith(reason)
    assert result.duration > 0.2
    deadline = time.monotonic() + 5  # the brake reaches the robot
    while (
        np.any(world.robot.model.actuator_gainprm[world.robot.actuators, 0]) and time.monotonic() < deadline
    ):
        robot.step()
    assert not np.any(world.robot.model.actuator_gainprm[world.robot.actuators, 0])


def test_no_robot_is_said_in_words():
    with pytest.raises(SysidError, match=f"no G1 answers on lo, DDS domain {DOMAIN + 1}"):
        UnitreeG1(LOOPBACK, DOMAIN + 1, timeout=0.2)


def test_no_interface_is_said_in_words():
    with pytest.raises(SysidError, match=r"no network interface 'nope0'. This computer has: .*lo"):
        UnitreeG1("nope0", DOMAIN)


def test_buttons_of_the_handset_are_where_the_sdk_has_them():
    remote = bytes([0x55, 0x51, 0b00101100, 0b00000011, *range(36)])  # start, select, L2; A, B
    assert messages.pressed_buttons(remote) == {"start", "select", "L2", "A", "B"}
    for name in messages.BUTTONS:
        assert messages.pressed_buttons(messages.handset_bytes(frozenset({name}))) == {name}
    assert messages.pressed_buttons(bytes(40)) == frozenset()


def test_buttons_travel_and_wrists_are_led_slowly_to_where_the_model_has_them(robot_pair):
    simulated, robot, _ = robot_pair
    simulated.wrists = np.array([0.2, -0.2, 0.1, 0.0, 0.15, -0.1])
    simulated.pressed = frozenset({"L2", "B"})
    deadline = time.monotonic() + 20
    while robot.read().buttons != {"L2", "B"} and time.monotonic() < deadline:
        robot.step()
    assert robot.read().buttons == {"L2", "B"}
    seen = []
    begin = time.monotonic()
    while time.monotonic() < begin + 20:
        robot.send(JointCommand.hold(default_pose()))
        seen.append((time.monotonic(), simulated.wrists.copy()))
        if not np.any(simulated.wrists):
            break
        robot.step()
    assert not np.any(simulated.wrists)
    assert seen[-1][0] - begin > 0.2 / 0.5 - 0.1  # the furthest, at half a radian a second
    assert np.abs(np.diff([wrists for _, wrists in seen], axis=0)).max() < 0.1
