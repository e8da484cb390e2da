"""The spring, gravity and steering under a rigid rider: the formula against the simulated board."""

import mujoco
import numpy as np
import pytest
from ridden_board import (
    Rider,
    critical_speed,
    ridden_stiffness,
)
from riding import pink

from sim.board.scene import TILT_JOINT, WHEELS, board_spec

RIDER = Rider(mass=30.0, height=0.5)


def roll(speed, torque=0.0, tilt=0.0, time=4.0, damping=30.0):
    """Return the tilt over time [rad] of a board with a rigid rider, pushed by a torque about its tilt axis.

    Damping changes no equilibrium; without it the heavy rider would swing for a minute.
    """
    board = pink()
    spec = board_spec(board, timestep=0.002, friction=(1.0, 0.01, 0.0))
    spec.joint(TILT_JOINT).damping[0] = damping
    spec.body("deck").add_body(name="rider", pos=[0, 0, RIDER.height]).add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.01, 0, 0], mass=RIDER.mass, contype=0, conaffinity=0
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qvel[0] = speed
    for wheel in WHEELS:
        data.joint(f"{wheel}_wheel_joint").qvel[0] = speed / board.geometry["wheel_radius"].value
    data.joint(TILT_JOINT).qpos[0] = tilt
    dof = int(model.joint(TILT_JOINT).dofadr[0])
    found = []
    for _ in range(round(time / 0.002)):
        data.qfrc_applied[dof] = torque
        mujoco.mj_step(model, data)
        found.append(float(data.joint(TILT_JOINT).qpos[0]))
    return np.array(found), float(np.hypot(*data.qvel[:2]))


@pytest.mark.parametrize("speed", [1.6, 2.0, 2.5])
def test_the_tilt_under_a_torque_is_what_the_formula_says(speed):
    torque = 0.02 * ridden_stiffness(pink(), RIDER, speed)
    tilt, last = roll(speed, torque)
    mean_speed = (speed + last) / 2
    expected = torque / ridden_stiffness(pink(), RIDER, mean_speed)
    assert np.mean(tilt[-250:]) == pytest.approx(expected, rel=0.05)


def test_below_the_critical_speed_the_rider_topples_and_above_stands():
    critical = critical_speed(pink(), RIDER)
    assert np.abs(roll(0.85 * critical, tilt=0.01, damping=5.0)[0][-1]) > 0.1
    assert np.abs(roll(1.2 * critical, tilt=0.01, damping=5.0)[0][-250:]).max() < 0.015
