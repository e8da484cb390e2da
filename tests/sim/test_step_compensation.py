"""The bench at a training step decays like the board, and its static stiffness stays the board's."""

import math

import mujoco
import numpy as np
import pytest
from made import with_effect

from sim.compensation.scene import bench_scene, compensate
from sim.compensation.step import closed_form, decay_error, release_amplitudes
from sysid.board import Board, load_board
from sysid.effects import catalogue
from sysid.errors import SysidError
from sysid.joint import JointLaw, simulate
from sysid.quantity import Quantity
from sysid.roll import Array
from sysid.workspace import shipped_data

pytestmark = pytest.mark.train  # in the trainer's MuJoCo too, which is older


def poles_of(board: Board) -> tuple[float, float]:
    """ω_d [rad/s] and ζ of the record's spring, damper and inertia."""
    natural = math.sqrt(board.stiffness / board.inertia.value)
    ratio = board.damping / (2 * math.sqrt(board.stiffness * board.inertia.value))
    return natural * math.sqrt(1 - ratio**2), ratio


def measured_poles(roll: Array, timestep: float) -> tuple[float, float]:
    """ω_d and ζ of a sampled free decay, from its two-term recursion x₊ = T x - D x₋."""
    history = np.stack([roll[1:-1], -roll[:-2]], axis=1)
    (trace, determinant), *_ = np.linalg.lstsq(history, roll[2:], rcond=None)
    z = (trace + np.sqrt(complex(trace**2 - 4 * determinant))) / 2
    s = np.log(z) / timestep
    return abs(s.imag), -s.real / abs(s)


@pytest.mark.parametrize(("name", "inertia", "damping"), [("black", -16.9, 1.0), ("pink", -10.8, 0.4)])
def test_the_closed_form_moves_inertia_and_damping_as_calculated(name: str, inertia: float, damping: float):
    board = load_board(shipped_data() / "boards" / f"{name}.toml")
    done = compensate(board, "step-compensated")
    assert 100 * (done.inertia_ratio - 1) == pytest.approx(inertia, abs=0.06)
    assert 100 * (done.damping_ratio - 1) == pytest.approx(damping, abs=0.06)
    assert done.board.stiffness == board.stiffness
    assert done.decay_error < 1e-3 < 0.02 < done.decay_error_before
    assert abs(done.static_error) < 1e-9


@pytest.mark.parametrize("integrator", ["implicitfast", "implicit", "Euler", "discrete", "RK4"])
@pytest.mark.parametrize("timestep", [0.002, 0.005])
def test_mujocos_own_rollout_has_the_boards_poles(board: Board, integrator: str, timestep: float):
    if integrator == "discrete" and "mjINT_DISCRETE" not in mujoco.mjtIntegrator.__members__:
        pytest.skip("this MuJoCo has no integrator 'discrete'")
    written = closed_form(board, timestep=timestep, integrator=integrator)
    scene = bench_scene(written, timestep=timestep, integrator=integrator)
    frequency, ratio = measured_poles(scene.swing(0.3, 0.0, 0.4)[1], timestep)
    assert (frequency, ratio) == pytest.approx(poles_of(board), rel=1e-9 if integrator != "RK4" else 1e-2)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("coulomb", (0.15,)),
        ("cubic-stiffness", (200.0,)),
        ("quadratic-damping", (0.05,)),
        ("freeplay", (0.01,)),
        ("viscoelastic", (5.0, 0.05)),
        ("hysteresis", (8.0, 0.2)),
        ("second-mode", (0.004, 60.0, 0.1)),
        ("hanging-body", (0.002, 22.0, 0.05)),
    ],
)
def test_richer_joints_are_compensated_numerically(pink: Board, name: str, values: tuple[float, ...]):
    done = compensate(with_effect(pink, name, *values), "step-compensated")
    assert done.decay_error < 0.01
    assert done.decay_error < 0.5 * done.decay_error_before
    assert abs(done.static_error) < 1e-6


@pytest.mark.parametrize(("name", "angle"), [("one-sided-stop", 0.09), ("end-stop", 0.12)])
def test_the_loss_of_a_stop_is_not_spread_into_the_joint(pink: Board, name: str, angle: float):
    """MuJoCo has none that acts beyond the stop only: the damper would make up for it and be wrong below."""
    lossy = compensate(with_effect(pink, name, angle, 60.0, 0.21), "step-compensated")
    without = compensate(with_effect(pink, name, angle, 60.0, 0.0), "step-compensated")
    assert lossy.damping_ratio == pytest.approx(without.damping_ratio, rel=1e-6)
    assert lossy.step_error == pytest.approx(without.decay_error, rel=1e-6)
    assert lossy.step_error < 0.02 < lossy.decay_error
    assert f"'{name}': MuJoCo cannot represent its damping of 0.21 N*m*s/rad" in " ".join(lossy.lines())
    assert not without.left_out


def test_what_hangs_on_the_deck_is_at_rest_where_that_is_let_go(board: Board):
    """Its joint counts from the deck: it must turn back as fast as a deck that has a rate at once."""
    rich = with_effect(board, "hanging-body", 0.5 * board.inertia.value, 22.0, 0.05)
    time, moved = bench_scene(rich, timestep=0.0005, integrator="RK4").swing(0.1, 2.0, 0.3)
    law = simulate(JointLaw.from_board(rich), time, 0.1, 2.0).roll
    assert np.max(np.abs(moved - law)) < 1e-3 * 0.1


IN_THE_JOINT = sorted(
    name for name, part in catalogue().items() if part.role not in ("measurement", "record")
)


SUBSTITUTES = {"bouc-wen": 0.03, "load-friction": 0.03}
"""Effects that MuJoCo has only a neighbour of, or none, and how near that comes: bristles unload as they load, a damper
has no jump at the turning points."""


@pytest.mark.parametrize("name", IN_THE_JOINT)
def test_mujoco_moves_by_the_law_of_every_effect(pink: Board, name: str):
    """With a fine step the bench decays as the law says: each effect's MJCF is its torque law."""
    rich = with_effect(pink, name)
    assert decay_error(rich, bench_scene(rich, timestep=0.0002), release_amplitudes(rich)) < SUBSTITUTES.get(
        name, 0.0075
    )
    assert decay_error(rich, bench_scene(pink, timestep=0.0005), release_amplitudes(rich)) > 0.015, (
        "the example must show"
    )


def test_a_record_without_a_spring_is_refused_at_once(board: Board):
    """Its decay has no end: one such check stepped for 261,187 s of the joint's time."""
    with pytest.raises(SysidError, match=r"stiffness of 0 N·m/rad.*husky-sysid fit LOG --board"):
        compensate(board.with_tilt(stiffness=Quantity(0.0, 0.0, "N*m/rad")), "step-compensated")


def test_what_cannot_be_compensated_is_refused(board: Board):
    with pytest.raises(SysidError, match="too long"):
        closed_form(board, timestep=0.2)
    light = board.with_tilt(damping=Quantity(0.01, 0.0, "N*m*s/rad"))
    with pytest.raises(SysidError, match=r"'discrete'.*damps more"):
        closed_form(light, timestep=0.005, integrator="discrete")
