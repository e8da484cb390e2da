"""What a record says of a pendulum's weight is known as well as it says, and no better."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made import release

from sysid.board import BoardEffect
from sysid.comparison.compare import compare
from sysid.diagnosis.diagnose import diagnose
from sysid.effects import weight
from sysid.fitting.joint import fit_joint
from sysid.fitting.record_update import updated_board
from sysid.quantity import Quantity
from sysid.synth.law import Modes, TrueLaw
from sysid.synth.motion import Condition, simulate
from sysid.workspace import Workspace

NOISE, FRICTION = 3e-4, 0.006
TIME = np.arange(0.0, 5.0, 8e-3)


@pytest.fixture(scope="module")
def releases():
    """A pendulum of 0.02 kg*m² and 1.3 N*m with dry friction, released from wide angles to both sides."""
    law = TrueLaw(
        inertia=0.02, stiffness=0.0, damping=0.003, gravity=1.3, static_friction=FRICTION, friction=FRICTION
    )
    rng = np.random.default_rng(5)
    made = []
    for number, angle in enumerate((1.8, -1.2), start=1):
        start = Condition(np.array([angle, 0.0, 0.0, 0.0, 0.0]), Modes().regions(law, angle))
        samples, _ = simulate(law, start, 0.0, float(TIME[-1]), TIME)
        made.append(release(TIME, samples[:, 0], NOISE, rng=rng, number=number))
    return made


def record(off: float, std: float = 0.0):
    """A record whose weight over its inertia is off by a share, and that says so much of its deviation."""
    values = {"scale": (1.0, std), "sine": (-1.3 * (1 + off), 0.0)}
    pull = {p.name: Quantity(*values.get(p.name, (0.0, 0.0)), p.unit) for p in weight.EFFECT.parameters}
    pink = Workspace(Path()).load_board("pink")
    none = {name: Quantity(0.0, 0.0, pink.tilt[name].unit) for name in ("stiffness", "damping", "rest_angle")}
    return replace(
        pink, name="arm", inertia=Quantity(0.02, 2e-5, "kg*m^2"), tilt={**pink.tilt, **none}, decay={}, fit={},
        effects=(BoardEffect("weight", pull),),
    )  # fmt: skip


def test_motion_counts_from_where_an_encoder_reads_a_hanging_pendulum(releases):
    """An actuator's middle is half a turn from where it hangs: what it missed was then a share of 3 rad."""
    board = record(0.0)
    moved = [replace(r, roll=r.roll + 3.0, rest=3.0) for r in releases]
    here, there = (compare(some, board) for some in (releases, moved))
    assert not here.passed
    assert not there.passed
    assert there.nrmse == pytest.approx(here.nrmse, rel=0.01)
    fits = [fit_joint(some, board) for some in (releases, moved)]
    assert fits[1].measured_rms == pytest.approx(fits[0].measured_rms, rel=0.01)


def test_a_weight_that_errs_as_scales_do_makes_no_unknown_law_of_friction(releases):
    verdict = diagnose(releases, record(-0.008)).verdict
    assert verdict.status == "missing"
    assert verdict.families == ("friction",)


def test_a_weight_that_is_off_by_more_than_the_record_knows_it_is_said(releases):
    found = diagnose(releases, record(-0.08))
    assert set(found.verdict.families) == {"friction", "inertia"}
    assert "+8.7 % against the record, which knows it to ± 2 %" in found.report()
    told = diagnose(releases, record(-0.08, std=0.04)).verdict
    assert told.families == ("friction",)


def test_a_fit_finds_the_ratio_and_records_no_more_of_it_than_was_known(releases):
    board = record(-0.008)
    fit = fit_joint(releases, board, ("weight", "coulomb"))
    assert fit.quantities["weight.scale"].value == pytest.approx(1 / 0.992, abs=2e-4)
    assert fit.quantities["coulomb.torque"].value == pytest.approx(FRICTION, rel=0.02)
    assert fit.rmse < 1.05 * NOISE
    kept = next(
        p for p in updated_board(board, fit, {}, heldout=0.0).effects if p.name == "weight"
    ).parameters["scale"]
    assert (kept.value, kept.std) == (fit.quantities["weight.scale"].value, weight.ASSUMED)


def test_an_inertia_that_the_weight_gives_is_known_no_better_than_the_weight(releases):
    names = ("armature", "coulomb", "weight")
    exact, told = (fit_joint(releases, record(0.1, std), names).quantities for std in (0.0, 0.01))
    inertia = 0.02 + told["armature.inertia"].value
    assert inertia == pytest.approx(0.022, rel=1e-3)
    assert exact["armature.inertia"].std < 1e-3 * inertia
    assert told["armature.inertia"].std == pytest.approx(0.01 * inertia, rel=0.02)
    assert told["coulomb.torque"].std == pytest.approx(
        np.hypot(exact["coulomb.torque"].std, 0.01 * told["coulomb.torque"].value), rel=0.02
    )
