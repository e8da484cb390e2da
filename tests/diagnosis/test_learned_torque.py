"""Learned torques: as smooth as the evidence wants, and nothing from noise."""

import numpy as np
import pytest
from light_board import BOARD, NOISE, magnet, releases

from sysid.diagnosis.learned_torque import WEIGHTS, choose, learn, learned_torque
from sysid.effects import effect
from sysid.effects._algebra import NUMPY
from sysid.effects._base import JointState
from sysid.effects._table import bending, cardinals, knots, position
from sysid.effects.learned import RATE, SUPPORT, TILT, basis, smoothness, tabulated
from sysid.errors import SysidError
from sysid.fitting.initial_state import fit_initial_states
from sysid.fitting.joint import FitOptions, fit_joint
from sysid.fitting.problem import ZERO_TABLE_WEIGHT
from sysid.fitting.record_update import require_usable
from sysid.fitting.records import make_records
from sysid.logs import read_roll
from sysid.releases import find_releases

M = NUMPY
RANGE = dict(zip(SUPPORT, (-0.2, 0.2, -8.0, 8.0), strict=True))


def learned_from(torque, beside=(), **options):
    return learn(releases(torque, **options), BOARD, [*beside, "learned"], FitOptions())


def test_a_table_is_met_at_its_knots_and_smooth_between():
    x, values = knots(4, 0.5), np.array([3.0, -1.0, 2.0, 0.5, 1.0, -2.0, 0.0, 4.0])
    at = np.stack(cardinals(M, position(M, x, 0.5), 4), axis=1)
    assert at == pytest.approx(np.eye(8), abs=1e-12)
    assert np.all(np.array(cardinals(M, 0.0, 4)) == 0.0)
    s = np.linspace(-1, 1, 401)
    between = np.stack(cardinals(M, s, 4), axis=1)
    assert np.abs(np.diff(between @ values)).max() < 0.2
    line = np.arange(-4, 5)[[0, 1, 2, 3, 5, 6, 7, 8]] / 4.0
    assert between @ line == pytest.approx(s, abs=1e-12)
    assert line @ bending(4) @ line < 1e-1 * values @ bending(4) @ values


def test_the_prior_leaves_spring_and_damper_out_and_tells_odd_from_even():
    space = smoothness().space
    assert space.T @ space == pytest.approx(np.eye(space.shape[1]), abs=1e-9)
    for law in (lambda x, v: x + 0 * v, lambda x, v: v + 0 * x):
        assert np.abs(tabulated(law, RANGE) @ space).max() < 1e-9
    odd, even = (
        np.abs(tabulated(law, RANGE) @ space)
        for law in (lambda x, v: x**3 + 0 * v, lambda x, v: x**2 + 0 * v)
    )
    assert odd[smoothness().part != 0].max() < 1e-9
    assert even[smoothness().part != 1].max() < 1e-9
    assert len(TILT) + len(RATE) == (smoothness().part < 4).sum() + 2


def test_of_noise_no_part_acts_and_of_a_bend_its_own():
    rng, space = np.random.default_rng(1), smoothness().space
    x, v = rng.uniform(-0.2, 0.2, 2000), rng.uniform(-8, 8, 2000)
    columns = basis(x, v, RANGE) @ space
    for torque, acting in ((0 * x, []), (400 * x**3, [0]), (0.3 * np.abs(v), [3])):
        log = torque + 0.3 * rng.standard_normal(len(x))
        plain = np.linalg.qr(np.column_stack([x, v, np.ones_like(x)]))[0]
        free, log, truth = (a - plain @ (plain.T @ a) for a in (columns, log, torque))
        found = choose(free.T @ free / 0.09, free.T @ log / 0.09)
        assert {i for i, w in enumerate(found.weights) if w < ZERO_TABLE_WEIGHT} >= set(acting)
        assert np.sqrt(np.mean((free @ found.values - truth) ** 2)) < 0.05
        assert found.is_nothing == (not acting)
        assert (found.log_evidence > 6) == bool(acting)
        assert set(found.weights) <= {ZERO_TABLE_WEIGHT, *WEIGHTS}


@pytest.fixture(scope="module")
def of_a_magnet():
    return learned_from(magnet)


def test_a_magnet_is_learned_within_its_band(of_a_magnet):
    """The torque that pulls back is the truth's as far as the band says, which is narrow where the deck has often been."""
    learned, formula = of_a_magnet
    tilt = np.linspace(-0.14, 0.17, 100)
    torque, std = learned_torque(learned, tilt, 0 * tilt, with_joint=True)
    off = torque - (magnet(0, tilt, 0) - BOARD.stiffness * tilt)
    assert np.mean(np.abs(off) < 2 * std) > 0.85
    often = np.abs(tilt) < 0.03
    assert np.abs(off[often]).max() < 0.02
    assert std[often].max() < 0.04
    assert learned.rmse < 1.08 * NOISE
    assert learned.quantities["damping"].value == pytest.approx(0.06, abs=0.004)
    assert formula.shapes[0].name.startswith("magnet")
    assert formula.share > 0.8
    assert "a pull to the middle within 1." in formula.text
    assert formula.coefficients[0] > 0


def test_it_predicts_a_release_that_it_has_not_seen(of_a_magnet):
    unseen = make_records(releases(magnet, angles=(0.12,), seed=9), NOISE, rate=False)
    residuals, _ = fit_initial_states(of_a_magnet[0].law, unseen)
    assert np.sqrt(np.mean(residuals[0] ** 2)) < 1.15 * NOISE


def test_beyond_the_measured_range_the_torque_stays(of_a_magnet):
    part = effect("learned")
    values = part.named(dict(of_a_magnet[0].law.effects)["learned"])
    edge = values["tilt_high"]
    assert 0.18 < edge < 0.2
    at = np.array([edge, 1.5 * edge, 3 * edge])
    torque = part.torque(M, JointState(at, 0 * at, at, 1.0), values, ())
    assert torque == pytest.approx(torque[0], abs=1e-12)


@pytest.mark.parametrize("seed", [1, 2])
def test_of_a_clean_log_nothing_is_learned(seed):
    fit, formula = learned_from(lambda t, x, v: 0.0, seed=seed)
    values = np.array(dict(fit.law.effects)["learned"][4:])
    assert np.abs(values).max() < 1e-6
    assert formula is None
    with pytest.raises(SysidError, match="nothing was learned"):
        require_usable(fit, BOARD)


def test_a_joint_without_a_table_cannot_hold_one():
    with pytest.raises(SysidError, match="no table"):
        fit_joint(releases(magnet), BOARD, ["learned"])


@pytest.mark.slow
def test_a_one_way_damper_is_named():
    _, formula = learned_from(lambda t, x, v: -0.08 * max(v, 0.0))
    assert formula.shapes[0].name == "one-way damper"
    assert "more damping in one direction" in formula.text


@pytest.mark.slow
def test_a_change_with_time_is_told_from_a_torque(of_a_magnet):
    """A spring that loosens during each release is imitated by a table, but its own law fits better."""
    loosens, _ = learned_from(lambda t, x, v: 1.5 * x * (1 - np.exp(-t / 0.5)))
    assert any("changes with time" in warning for warning in loosens.warnings)
    assert not any("changes with time" in warning for warning in of_a_magnet[0].warnings)


@pytest.mark.slow
def test_tables_leave_no_more_than_the_joint_without_them(real_logs):
    found = find_releases(read_roll(real_logs / "rotary_pendulum_freeswing/swing_01.csv"))
    plain = fit_joint(found, BOARD, ["coulomb", "gravity"])
    learned, _ = learn(found, BOARD, ["coulomb", "gravity", "learned"], FitOptions())
    assert learned.rmse < 1.001 * plain.rmse
