"""What makes a ride harder, in plain MuJoCo: by hand where it can be, and on the policies that are shipped."""

import math

import mujoco
import numpy as np
import pytest
from riding import HoldStill, pink

from policy_runtime.evaluation.plain import Protocol, evaluate_policy, run_episode
from policy_runtime.evaluation.stress import StressedRobot, change
from policy_runtime.loop.world import World, make_world
from policy_runtime.robots import JointCommand
from sim.skate.robot.g1 import servos
from sysid.errors import SysidError

pytestmark = pytest.mark.train

pytest.importorskip("mjlab", reason="the robot comes with mjlab (extra 'train')")


def stressed(**numbers):
    world = make_world(pink())
    protocol = Protocol(**numbers)
    change(world.robot.model, protocol)
    return World(StressedRobot(world.robot.model, protocol), world.start)


def told(position):
    return JointCommand(
        position=np.full(23, position), stiffness=servos().stiffness, damping=servos().damping
    )


@pytest.mark.parametrize(("delay", "steps"), [(0.0, 0), (0.002, 1), (0.02, 10)])
def test_a_command_reaches_the_servos_after_the_delay(delay, steps):
    robot = stressed(delay=delay).robot
    before = robot.data.ctrl[robot.actuators].copy()
    robot.send(told(0.123))
    for _ in range(steps):
        robot.step()
        np.testing.assert_array_equal(robot.data.ctrl[robot.actuators], before)
    robot.step()
    assert robot.data.ctrl[robot.actuators] == pytest.approx(np.full(23, 0.123))


def test_masses_frictions_and_gravity_are_changed():
    plain = make_world(pink()).robot.model
    model = stressed(mass=1.1, friction=0.4, rolling=3.0, slope=math.radians(3)).robot.model
    links = [i for i in range(model.nbody) if model.body(i).name.startswith("robot/")]
    np.testing.assert_allclose(model.body_mass[links], 1.1 * plain.body_mass[links])
    board = [i for i in range(model.nbody) if model.body(i).name.startswith("board/")]
    np.testing.assert_array_equal(model.body_mass[board], plain.body_mass[board])
    assert model.body("robot/pelvis").subtreemass[0] == pytest.approx(
        1.1 * plain.body("robot/pelvis").subtreemass[0]
    )
    assert model.geom("robot/left_foot1_collision").friction[0] == 0.4
    wheel = "board/rear_left_wheel_collision"
    assert model.geom(wheel).friction[2] == pytest.approx(3 * plain.geom(wheel).friction[2])
    assert model.opt.gravity == pytest.approx(
        9.81 * np.array([-math.sin(0.05236), 0, -math.cos(0.05236)]), rel=1e-4
    )


def test_a_board_gathers_speed_downhill_by_g_sin_of_the_slope():
    world = stressed(slope=-math.radians(3), rolling=1e-3)
    robot = world.robot
    qpos = robot.model.qpos0.copy()
    qpos[robot.base_q + 1] = 5.0  # the robot lies beside the board
    robot.reset(qpos, 0.5)
    for _ in range(100):
        robot.step()
    begin = robot.truth().board_speed
    for _ in range(200):
        robot.step()
    assert robot.truth().board_speed - begin == pytest.approx(
        9.81 * math.sin(math.radians(3)) * 0.4, rel=0.03
    )


def test_a_push_is_a_force_of_a_tenth_of_a_second():
    robot = stressed(push=100.0).robot
    qpos = robot.model.qpos0.copy()
    qpos[robot.base_q + 2] += 5.0  # in the air, nothing else pushes
    robot.reset(qpos)
    robot.push_with(np.array([0.0, 100.0]))
    for _ in range(80):
        robot.step()
    mass = float(robot.model.body("robot/pelvis").subtreemass[0])
    momentum = np.zeros(3)
    mujoco.mj_subtreeVel(robot.model, robot.data)
    momentum = mass * robot.data.subtree_linvel[robot.ids.pelvis]
    assert momentum[1] == pytest.approx(100 * 0.1, rel=0.02)


def test_noise_is_the_trainings_and_each_rides_own():
    world = stressed(noise=1.0)
    world.reset()
    off = np.array(
        [world.robot.read().joint_velocity - world.robot.data.qvel[world.robot._v] for _ in range(50)]
    )
    assert 1.4 < np.abs(off).max() <= 1.5
    policy, protocol = HoldStill(), Protocol(duration=0.2, noise=1.0)
    rides = [run_episode(world, policy, protocol, np.random.default_rng([0, n]))[0] for n in (1, 1, 2)]
    assert np.array_equal(rides[0].column("joints"), rides[1].column("joints"))
    assert not np.array_equal(rides[0].column("joints"), rides[2].column("joints"))


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"delay": 0.005}, "multiple of the servos' 0.002 s"),
        ({"delay": 20.0}, "20 ms is 0.02"),
        ({"mass": 0.0}, "--mass 0: a factor"),
        ({"slope": 1.0}, "within ±30 degrees"),
    ],
)
def test_what_cannot_be_is_said(numbers, message):
    with pytest.raises(SysidError, match=message):
        stressed(**numbers)


def test_standing_is_counted_apart():
    protocol = Protocol(duration=0.3, speed=(0.0, 0.05))
    result = evaluate_policy("stand", pink(), episodes=2, seeds=(0,), protocol=protocol)
    assert math.isnan(result.success.value)
    assert result.standing.value == 1.0
    assert math.isnan(result.median_duration)
