"""A pendulum has no spring: gravity takes its place in a fit, asked for or not."""

import numpy as np
import pytest

from sysid.board import load_board
from sysid.cli.fixed import fixed_values
from sysid.errors import HuskyError
from sysid.fit_mjcf import FitOptions, fit_joint
from sysid.fitting.record_update import recorded, refuse_bad
from sysid.joint import JointLaw, simulate
from sysid.roll import Release
from sysid.workspace import shipped_data

NOISE, ZERO = 1e-3, 0.04


@pytest.fixture(scope="module")
def board():
    return load_board(shipped_data() / "boards" / "pink.toml")


@pytest.fixture(scope="module")
def swing(board):
    """A pendulum that swings from 60°, read by an encoder whose zero is off by 0.04 rad."""
    law = JointLaw(inertia=board.inertia.value, stiffness=0.0, damping=0.004).with_effect("gravity", 0.5)
    time = np.arange(0.0, 4.0, 0.01)
    roll = ZERO + simulate(law, time, 1.05).roll + NOISE * np.random.default_rng(4).standard_normal(len(time))
    return Release(
        log="x", number=1, time=time, roll=roll, std=np.full(len(time), NOISE), origin="angle", rest=ZERO, hold=0.0, end="log",
    )  # fmt: skip


@pytest.mark.parametrize("fixed", [{}, {"stiffness": 0.0}])
def test_gravity_takes_the_place_of_the_spring(board, swing, fixed):
    fit = fit_joint([swing], board, ("gravity",), FitOptions(fixed=fixed))
    refuse_bad(fit)
    assert fit.law.stiffness == 0.0
    assert fit.quantities["gravity.moment"].value == pytest.approx(0.5, rel=1e-3)
    assert fit.quantities["sensor-bias.angle"].value == pytest.approx(ZERO, abs=3e-4)
    assert fit.rmse == pytest.approx(NOISE, rel=0.1)


def test_what_was_held_is_recorded(board, swing, tmp_path):
    log = tmp_path / "x.csv"
    log.write_text("x", encoding="utf-8")
    fit = fit_joint([swing], board, ("gravity",), FitOptions(fixed={"stiffness": 0.0}))
    assert recorded(board, fit, {"x.csv": log}, heldout=0.0).stiffness == 0.0


def test_a_spring_that_is_there_stays(board):
    law = JointLaw(inertia=board.inertia.value, stiffness=0.4, damping=0.004).with_effect("gravity", 0.3)
    time = np.arange(0.0, 4.0, 0.01)
    roll = simulate(law, time, 1.05).roll + NOISE * np.random.default_rng(4).standard_normal(len(time))
    swing = Release(
        log="x", number=1, time=time, roll=roll, std=np.full(len(time), NOISE), origin="angle", rest=0.0, hold=0.0, end="log",
    )  # fmt: skip
    fit = fit_joint([swing], board, ("gravity",), FitOptions())
    assert fit.law.stiffness == pytest.approx(0.4, rel=0.05)


def test_no_spring_and_no_gravity_is_refused(board, swing):
    with pytest.raises(HuskyError, match="--effect gravity"):
        fit_joint([swing], board, (), FitOptions(fixed={"stiffness": 0.0}))


def test_what_is_held_is_read_from_the_command_line():
    assert fixed_values(("stiffness=0", "coulomb.torque=1e-2"), ("coulomb",)) == {
        "stiffness": 0.0,
        "coulomb.torque": 0.01,
    }
    for text, message in (
        ("stifness=0", "Did you mean 'stiffness'"),
        ("damping=x", "no number"),
        ("coulomb.torque=1", "no parameter"),
    ):
        with pytest.raises(HuskyError, match=message):
            fixed_values((text,), ())
    with pytest.raises(HuskyError, match="held already"):
        fixed_values(("damping=1", "damping=2"), ())
