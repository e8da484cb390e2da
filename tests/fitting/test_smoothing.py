"""Torques that are tables: learned through the motion, as smooth as held-out motion wants, and nothing from noise."""

import numpy as np
import pytest
from light_board import BOARD, NOISE, magnet, releases

from sysid.effects import effect
from sysid.effects._algebra import NUMPY
from sysid.effects._base import JointState
from sysid.effects._table import bending, cardinals, interpolate, knots, position
from sysid.errors import SysidError
from sysid.fitting.initial_state import fit_initial_states
from sysid.fitting.joint import fit_joint
from sysid.fitting.learned_torque import learned_torque
from sysid.fitting.record_update import require_usable
from sysid.fitting.records import make_records
from sysid.logs import read_roll
from sysid.releases import find_releases

M = NUMPY


def test_a_table_is_met_at_its_knots_and_smooth_between():
    x, values = knots(4, 0.5), np.array([3.0, -1.0, 2.0, 0.5, 1.0, -2.0, 0.0, 4.0])
    at = np.stack(cardinals(M, position(M, x, 0.5), 4), axis=1)
    assert at == pytest.approx(np.eye(8), abs=1e-12)
    assert interpolate(M, 0.0, values) == 0.0
    s = np.linspace(-1, 1, 401)
    assert np.abs(np.diff(interpolate(M, s, values))).max() < 0.2
    line = np.arange(-4, 5)[[0, 1, 2, 3, 5, 6, 7, 8]] / 4.0
    assert interpolate(M, s, line) == pytest.approx(s, abs=1e-12)
    assert line @ bending(4) @ line < 1e-1 * values @ bending(4) @ values


@pytest.fixture(scope="module")
def learned():
    return fit_joint(releases(magnet), BOARD, ["learned"])


def test_a_magnet_is_learned_within_its_band(learned):
    """The torque that pulls back is the truth's as far as the band says, which is narrow where the deck has often been."""
    tilt = np.linspace(-0.14, 0.17, 100)
    torque, std = learned_torque(learned, tilt, 0 * tilt, with_joint=True)
    off = torque - (magnet(0, tilt, 0) - BOARD.stiffness * tilt)
    assert np.mean(np.abs(off) < 2 * std) > 0.85
    often = np.abs(tilt) < 0.03
    assert np.abs(off[often]).max() < 0.02
    assert std[often].max() < 0.04
    assert learned.rmse < 1.08 * NOISE
    assert learned.quantities["damping"].value == pytest.approx(0.06, abs=0.004)


def test_it_predicts_a_release_that_it_has_not_seen(learned):
    unseen = make_records(releases(magnet, angles=(0.12,), seed=9), NOISE, rate=False)
    residuals, _ = fit_initial_states(learned.law, unseen)
    assert np.sqrt(np.mean(residuals[0] ** 2)) < 1.15 * NOISE


def test_nothing_is_said_beyond_the_support(learned):
    """Beyond the tilt that was measured the learned part stays where it is."""
    part, values = effect("learned"), effect("learned").named(dict(learned.law.effects)["learned"])
    edge = values["tilt_high"]
    assert 0.18 < edge < 0.2
    at = np.array([edge, 1.5 * edge, 3 * edge])
    torque = part.torque(M, JointState(at, 0 * at, at, 1.0), values, ())
    assert torque == pytest.approx(torque[0], abs=1e-12)


@pytest.mark.parametrize("seed", [1, 2])
def test_of_a_clean_log_nothing_is_learned(seed):
    fit = fit_joint(releases(lambda t, x, v: 0.0, seed=seed), BOARD, ["learned"])
    values = np.array(dict(fit.law.effects)["learned"][4:])
    assert np.abs(values).max() < 1e-6
    with pytest.raises(SysidError, match="nothing was learned"):
        require_usable(fit)


@pytest.mark.slow
def test_what_changes_with_time_is_said_to(learned):
    """A spring that loosens during each release is mimicked by a table, but not as well as by what it is."""
    loosens = fit_joint(releases(lambda t, x, v: 1.5 * x * (1 - np.exp(-t / 0.5))), BOARD, ["learned"])
    assert any("changes with time" in warning for warning in loosens.warnings)
    assert not any("changes with time" in warning for warning in learned.warnings)


@pytest.mark.slow
def test_tables_leave_no_more_than_the_joint_without_them(real_logs):
    """In step over the whole release already, this pendulum was lost by a search that began with its first swings."""
    found = find_releases(read_roll(real_logs / "rotary_pendulum_freeswing/swing_01.csv"))
    plain, learned = (fit_joint(found, BOARD, ["coulomb", "gravity", *more]) for more in ((), ("learned",)))
    assert learned.rmse < 1.001 * plain.rmse  # as far as the search for the smoothness goes
