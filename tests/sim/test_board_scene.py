"""The free board: what is compiled is the record, the coupling steers, right edge down turns right."""

import math

import mujoco
import numpy as np
import pytest

from sim.board import scene as board_scene
from sim.board.bodies import FREE_JOINT, TRUCK_JOINTS
from sim.board.scene import board_spec, coupling_polynomial, roll_inertia, set_trucks
from sysid.board import Board
from sysid.errors import SysidError

pytestmark = pytest.mark.train


def test_compiled_mass_and_roll_inertia_are_the_records(board: Board):
    for coupling in ("equality", "direct"):
        model = board_spec(board, coupling=coupling).compile()
        geometry = board.geometry if coupling == "equality" else None
        assert roll_inertia(model, geometry) == pytest.approx(board.inertia.value, rel=1e-9)
        expected = sum(n * board.mass[key].value for key, n in (("deck", 1), ("truck", 2), ("wheel", 4)))
        assert model.body_mass.sum() == pytest.approx(expected, rel=1e-12)
        assert model.body("deck").mass[0] == pytest.approx(board.mass["deck"].value)


def test_the_inertia_assertion_can_fail(board: Board):
    spec = board_spec(board)
    spec.body("front_truck").ipos = [0.02, 0.0, 0.0]
    with pytest.raises(SysidError, match="compiled roll inertia"):
        board_scene.assert_matches_record(spec, board, "equality")
    spec = board_spec(board)
    spec.body("deck").mass *= 2
    with pytest.raises(SysidError, match="weighs"):
        board_scene.assert_matches_record(spec, board, "equality")


@pytest.mark.parametrize("tilt_range", [0.1, 0.2, 0.3])
def test_the_coupling_polynomial_is_the_papers_law(tilt_range: float):
    coefficients = coupling_polynomial(math.radians(60), tilt_range)
    roll = np.linspace(-tilt_range, tilt_range, 77)
    law = np.arctan(np.tan(math.radians(60)) * np.sin(roll))
    error = np.abs(np.polynomial.Polynomial(coefficients)(roll) - law).max()
    assert error < {0.1: 1e-5, 0.2: 2e-4, 0.3: 1.2e-3}[tilt_range]


@pytest.mark.parametrize("coupling", ["equality", "direct"])
def test_the_trucks_follow_a_loaded_deck_to_its_full_range(board: Board, coupling: str):
    """The limits agree: trucks neither stop the deck early nor leak, with a rider's torque on it."""
    spec = board_spec(board, coupling=coupling)
    spec.delete(spec.joint(FREE_JOINT))
    model = spec.compile()
    data = mujoco.MjData(model)
    rake = board.geometry["rake"].value
    data.qfrc_applied[model.joint("board_tilt_joint").dofadr[0]] = board.stiffness * 0.198
    for _ in range(600):
        mujoco.mj_step(model, data)
        if coupling == "direct":
            set_trucks(model, data, rake)
    roll = data.joint("board_tilt_joint").qpos[0]
    assert roll == pytest.approx(0.198, rel=0.005)
    expected = math.atan(math.tan(rake) * math.sin(roll))
    for name in TRUCK_JOINTS:
        assert data.joint(name).qpos[0] == pytest.approx(expected, abs=3e-4)


@pytest.mark.parametrize("coupling", ["equality", "direct"])
def test_right_edge_down_turns_right_at_the_rate_of_two_steered_trucks(board: Board, coupling: str):
    """Both trucks steer in opposite senses: ψ̇ = 2 v tan σ / L, and to the right is negative about z."""
    spec = board_spec(board, coupling=coupling)
    spec.joint("board_tilt_joint").springref = 0.05
    model = spec.compile()
    data = mujoco.MjData(model)
    rake = board.geometry["rake"].value
    data.qpos[model.joint("board_tilt_joint").qposadr[0]] = 0.05
    set_trucks(model, data, rake)
    data.qvel[0] = 1.0
    yaw = []
    for _ in range(200):
        mujoco.mj_step(model, data)
        if coupling == "direct":
            set_trucks(model, data, rake)
        yaw.append(data.qvel[5])
    speed = float(np.hypot(*data.qvel[:2]))
    steer = data.joint("front_truck_joint").qpos[0]
    expected = -2 * speed * math.tan(steer) / board.geometry["wheelbase"].value
    assert expected < -0.2
    assert np.mean(yaw[-40:]) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("rider", [0.0, 37.0])
def test_it_stands_still_on_its_four_wheels(board: Board, rider: float):
    """Light wheels must not make soft contacts: at most a millimetre under a rider."""
    spec = board_spec(board)
    if rider:
        load = spec.body("deck").add_body(name="rider", pos=[0.0, 0.0, 0.01])
        load.mass, load.inertia, load.ipos, load.explicitinertial = rider, [0.1, 0.1, 0.1], [0.0] * 3, True
    model = spec.compile()
    data = mujoco.MjData(model)
    for _ in range(600):
        mujoco.mj_step(model, data)
    assert data.ncon == 4
    assert np.abs(data.qvel).max() < 1e-5
    height = board.geometry["wheel_radius"].value + board.geometry["truck_height"].value
    assert height - 1e-3 < data.qpos[2] < height
