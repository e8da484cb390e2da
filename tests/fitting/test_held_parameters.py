"""Parameters that are held or bounded, and gravity in the place of a spring."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made import release

from sysid.board import board_to_toml
from sysid.cli.parameter_options import parse_bounds, parse_fixed
from sysid.errors import SysidError
from sysid.fitting.joint import FitOptions, check_parameters, fit_joint
from sysid.fitting.record_update import require_usable, updated_board
from sysid.joint.law import JointLaw
from sysid.joint.trajectory import simulate as motion
from sysid.quantity import Quantity
from sysid.roll import Release
from sysid.synth.law import Modes, TrueLaw
from sysid.synth.motion import Condition, simulate
from sysid.workspace import Workspace

NOISE = 3e-4
TIME = np.arange(0.0, 6.0, 4e-3)
PINK = Workspace(Path()).load_board("pink")


def pendulum(stiffness: float, zero: float = 0.0) -> list[Release]:
    """A pendulum of 0.02 kg*m² and 1.3 N*m, with dry friction, released from both sides; its sensor's zero is off."""
    friction = {"static_friction": 0.03, "friction": 0.03}
    law = TrueLaw(inertia=0.02, stiffness=stiffness, damping=0.01, gravity=1.3, **friction)
    rng = np.random.default_rng(5)
    releases = []
    for number, angle in enumerate((1.2, -0.8), start=1):
        start = Condition(np.array([angle, 0.0, 0.0, 0.0, 0.0]), Modes().regions(law, angle))
        samples, _ = simulate(law, start, 0.0, float(TIME[-1]), TIME)
        releases.append(release(TIME, samples[:, 0] + zero, NOISE, rng=rng, number=number, rest=zero))
    return releases


def arm(stiffness: float = 1.0):
    """A record in which nothing was measured but the inertia."""
    tilt = {
        **PINK.tilt,
        "stiffness": Quantity(stiffness, 0.0, "N*m/rad"),
        "damping": Quantity(0.02, 0.0, "N*m*s/rad"),
    }
    inertia = Quantity(0.02, 2e-5, "kg*m^2")
    return replace(PINK, name="arm", inertia=inertia, tilt=tilt, decay={}, fit={}, effects=())


EFFECTS = ("gravity", "coulomb")


@pytest.mark.parametrize("recorded", [1.0, 0.0])
def test_gravity_takes_the_place_of_a_spring_that_is_not_there(recorded):
    board = arm(recorded)
    fit = fit_joint(pendulum(0.0, zero=0.02), board, EFFECTS)
    require_usable(fit, board)
    assert fit.law.stiffness == 0.0
    moment = fit.quantities["gravity.moment"]
    assert abs(moment.value - 1.3) < 4 * moment.std < 0.05
    assert any("no spring" in warning for warning in fit.warnings) == bool(recorded)
    new = updated_board(board, fit, {}, heldout=0.0)
    assert new.stiffness == 0.0


@pytest.mark.parametrize("zero", [-3.0, 1.9, 3.0])
def test_a_pendulums_encoder_may_have_its_zero_anywhere(zero):
    """From 120° to either side a pendulum falls the other way, and a zero that is searched from 0 does not come back."""
    fit = fit_joint(pendulum(0.0, zero=zero), arm(0.0), EFFECTS)
    moment = fit.quantities["gravity.moment"]
    assert abs(moment.value - 1.3) < 4 * moment.std < 0.05
    assert fit.rmse < 1.1 * NOISE


def test_a_spring_beside_gravity_is_kept():
    fit = fit_joint(pendulum(2.0), arm(), EFFECTS)
    assert abs(fit.quantities["stiffness"].value - 2.0) < 4 * fit.quantities["stiffness"].std
    assert abs(fit.quantities["gravity.moment"].value - 1.3) < 4 * fit.quantities["gravity.moment"].std


def test_what_is_held_stays_and_the_rest_follows():
    fit = fit_joint(pendulum(2.0), arm(), EFFECTS, FitOptions(fixed={"gravity.moment": 1.3}))
    assert "gravity.moment" not in fit.quantities
    assert dict(fit.law.effects)["gravity"] == (1.3,)
    assert fit.quantities["stiffness"].value == pytest.approx(2.0, rel=0.01)


def test_a_bound_is_kept_and_no_fault_of_the_logs():
    fit = fit_joint(pendulum(2.0), arm(), EFFECTS, FitOptions(bounds={"damping": (0.012, 0.05)}))
    assert fit.quantities["damping"].value == pytest.approx(0.012)
    require_usable(fit, arm())
    assert any("damping" in warning and "bound" in warning for warning in fit.warnings)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (FitOptions(fixed={"stifness": 0.0}), "Did you mean 'stiffness'"),
        (FitOptions(bounds={"stribeck.torque": (0.0, 1.0)}), "no parameter 'stribeck.torque'"),
        (FitOptions(bounds={"damping": (0.2, 0.1)}), "lower one first"),
        (FitOptions(fixed={"damping": 0.1}, bounds={"damping": (0.0, 0.2)}), "held and bounded at once"),
        (FitOptions(fixed={"stiffness": 0.0}), "--effect gravity"),
    ],
)
def test_what_cannot_be_held_is_refused(options, says):
    with pytest.raises(SysidError, match=says):
        check_parameters(("coulomb",), options, arm())


def test_names_and_numbers_of_the_command_line():
    assert parse_fixed(["stiffness=0", "rest=0.02", "end-stop.angle=1e-1"]) == {
        "stiffness": 0.0, "rest_angle": 0.02, "end-stop.angle": 0.1,
    }  # fmt: skip
    assert parse_bounds(["damping=0:0.2"]) == {"damping": (0.0, 0.2)}


@pytest.mark.parametrize(
    ("parse", "text", "says"),
    [
        (parse_fixed, "stiffness", "NAME=VALUE"),
        (parse_fixed, "stiffness=soft", "'soft' is not a number"),
        (parse_bounds, "damping=0.2", "LOW:HIGH"),
        (parse_bounds, "damping=0:x", "'x' is not a number"),
    ],
)
def test_other_shapes_are_refused(parse, text, says):
    with pytest.raises(SysidError, match=says):
        parse([text])


def test_a_record_may_lack_spring_or_damper(tmp_path):
    boards = tmp_path / "data" / "boards"
    boards.mkdir(parents=True)
    (boards / "arm.toml").write_text(board_to_toml(arm(0.0)), encoding="utf-8")
    assert Workspace(tmp_path).load_board("arm").stiffness == 0.0
    (boards / "arm.toml").write_text(board_to_toml(arm(-1.0)), encoding="utf-8")
    with pytest.raises(SysidError, match="a positive number"):
        Workspace(tmp_path).load_board("arm")


def test_a_damper_is_never_made_to_drive():
    """Friction that grows weaker with speed looks like a damper that feeds the swing."""
    law = JointLaw(inertia=0.02, stiffness=2.0, damping=-1e-3).with_effect("coulomb", 0.03)
    noise = NOISE * np.random.default_rng(5).standard_normal(len(TIME))
    releases = [
        replace(one, roll=motion(law, TIME, angle).roll + noise)
        for one, angle in zip(pendulum(2.0), (0.3, -0.2), strict=True)
    ]
    fit = fit_joint(releases, arm(), ("coulomb",))
    assert fit.law.damping == 0.0
    assert "damping" not in fit.quantities


def test_a_prior_counts_as_a_measurement_of_its_own():
    """Between what the record says and what the logs say, weighted by both variances; the interval is narrower than either."""
    releases = pendulum(2.0)
    board = replace(arm(), inertia=replace(arm().inertia, std=0.0))  # which no damping measured could tell
    options = {"fixed": {"gravity.moment": 1.3}}
    free = fit_joint(releases, board, EFFECTS, FitOptions(**options)).quantities["damping"]
    stated = Quantity(free.value + 3 * free.std, free.std, free.unit)
    known = fit_joint(
        releases, board.with_tilt(damping=stated), EFFECTS, FitOptions(**options, priors=("damping",))
    )
    both = known.quantities["damping"]
    assert both.value == pytest.approx(free.value + 1.5 * free.std, abs=0.4 * free.std)
    assert 0.55 * free.std < both.std < 0.9 * free.std
    far = fit_joint(
        releases, board.with_tilt(damping=replace(stated, std=1e3 * free.std)), EFFECTS,
        FitOptions(**options, priors=("damping",)),
    )  # fmt: skip
    assert far.quantities["damping"].value == pytest.approx(free.value, abs=0.01 * free.std)


@pytest.mark.parametrize("name", ["stribeck.torque", "rest_angle"])
def test_a_prior_that_the_record_does_not_know_is_refused(name):
    board = arm().with_tilt(rest_angle=Quantity(0.0, 0.0, "rad"))
    with pytest.raises(SysidError, match="no uncertainty of"):
        fit_joint(pendulum(2.0), board, EFFECTS, FitOptions(priors=(name,)))
