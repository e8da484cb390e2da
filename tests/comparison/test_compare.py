"""The comparison: right about how far, about where, and about the torque between."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import called
from made import decays, release
from scipy.integrate import solve_ivp

from sysid.comparison.compare import compare
from sysid.fitting.joint import fit_joint
from sysid.joint import JointLaw
from sysid.quantity import Quantity
from sysid.workspace import shipped_data

NOISE = np.radians(0.03)
LIGHT = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.06)


def releases_of(law, *, noise=NOISE, seed=0, seconds=1.2):
    return decays(law, (0.18, -0.15), np.arange(0.0, seconds, 1e-3), noise, seed=seed)


def test_the_right_law_is_at_the_noise_floor(pink):
    result = compare(releases_of(LIGHT), pink, law=LIGHT)
    assert result.rmse == pytest.approx(NOISE, rel=0.05)
    assert result.passed
    assert result.where == ()
    assert "noise" in result.summary


def test_the_missing_torque_is_found_where_it_acts(pink):
    truth = LIGHT.with_effect("cubic-stiffness", 300.0)
    result = compare(releases_of(truth), pink, law=LIGHT)
    assert not result.passed
    found = result.missing.over(result.missing.angle)
    off = np.abs(found.torque + 300.0 * found.at**3)
    assert (off < 3 * found.std).all()
    known = found.std < 0.1
    assert off[known].max() < 0.1
    assert np.abs(found.torque[known]).max() > 0.5


def test_backbone_shows_hardening_in_the_measurement_only(pink):
    truth = LIGHT.with_effect("cubic-stiffness", 300.0)
    result = compare(releases_of(truth), pink, law=LIGHT)
    slope = [
        np.polyfit(b.amplitude**2, b.period, 1)[0]
        for b in (result.measured_backbone, result.simulated_backbone)
    ]
    assert slope[0] < 5 * -abs(slope[1])


def test_a_sensor_on_one_side_puts_the_error_there(pink):
    releases = releases_of(LIGHT)
    for one in releases:
        one.roll[one.roll > 0] *= 1.15
    result = compare(releases, pink, law=LIGHT)
    side = {p.range[0]: p.share for p in result.where if p.axis == "side"}
    assert side[1.0] > side[-1.0]
    shares = {
        axis: sum(p.share for p in result.where if p.axis == axis)
        for axis in ("time", "amplitude", "velocity")
    }
    for share in shares.values():
        assert share == pytest.approx(1.0, abs=0.02)


def test_command_line_writes_json_and_picture(tmp_path):
    log = shipped_data() / "decays" / "pink_hidden.csv"
    assert called("compare", log, "--board", "pink", "--workspace", tmp_path) == 0
    content = json.loads((tmp_path / "reports" / "pink" / "compare.json").read_text())
    assert content["passed"] is False
    assert content["rmse_rad"] > 2 * content["noise_floor_rad"]
    assert {p["axis"] for p in content["where"]} >= {"time", "amplitude", "velocity", "side"}
    assert content["heldout_rmse_rad"] == content["rmse_rad"]
    assert (tmp_path / "reports" / "pink" / "compare.png").stat().st_size > 20_000


def few_samples(seed):
    """Two releases of 140 samples together, 0.1° of noise."""
    law = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.402)
    return law, decays(law, (0.12, -0.1), np.arange(0.0, 0.28, 4e-3), np.radians(0.1), seed=seed)


def test_the_right_law_is_not_blamed_for_a_floor_that_few_samples_tell(pink):
    """The floor of 140 samples is known to ±25 %: taken for exact, it blames the true law in every eighth log."""
    blamed = passed = inside = located = 0
    for seed in range(30):
        law, releases = few_samples(seed)
        result = compare(releases, pink, law=law)
        low, high = result.excess_range
        assert low <= result.excess <= high
        blamed += result.excess > result.tolerance
        passed += result.passed
        located += bool(result.where)
        inside += result.noise.lowest < np.radians(0.1) < result.noise.highest
    assert blamed >= 2
    assert passed >= 27
    assert located <= 3
    assert inside >= 26


def test_a_magnet_beside_the_rest_shows_where_it_is(pink):
    """It pulls to 5° within 1.3°; most samples are of the rest after the decay, which says nothing of it."""
    at, width, strength = np.radians(5), np.radians(1.3), 0.12

    def pull(time, state):
        off = (state[0] - at) / width
        torque = -9.0 * state[0] - 0.05 * state[1] - strength * off * np.exp(0.5 - 0.5 * off**2)
        return state[1], torque / 0.01

    time, rng = np.arange(0.0, 2.4, 1 / 300), np.random.default_rng(3)
    releases = [
        release(
            time,
            solve_ivp(pull, (0, 2.4), (angle, 0.0), t_eval=time, rtol=1e-8).y[0],
            NOISE,
            rng=rng,
            number=number,
        )
        for number, angle in enumerate(np.radians([12, -11, 8, -6]), start=1)
    ]
    board = replace(pink, inertia=Quantity(0.01, 1e-4, "kg*m^2"))
    missing = compare(releases, board, law=fit_joint(releases, board).law).missing
    profile = missing.over(missing.angle)
    below = (profile.at > np.radians(2.5)) & (profile.at < at)
    above = (profile.at > at) & (profile.at < np.radians(7.5))
    assert np.max((profile.torque / profile.std)[below]) > 3.5
    assert np.min((profile.torque / profile.std)[above]) < -3.5


def test_a_wrong_model_does_not_blind_the_backbone(pink):
    """30 Hz sampling of a 0.6 s swing, under a model that swings in 0.185 s."""
    slow = JointLaw(inertia=8.7e-3, stiffness=8.7e-3 * (2 * np.pi / 0.6) ** 2, damping=0.003)
    releases = [replace(r, **every(r, 33)) for r in releases_of(slow, seconds=6.0)]
    measured = compare(releases, pink).measured_backbone
    assert len(measured.period) > 5
    assert np.median(measured.period) == pytest.approx(0.6, rel=0.05)


def test_where_is_told_by_where_the_joint_was(pink):
    """A model that dies at once has its error at the measured amplitudes, not at its own."""
    slow = JointLaw(inertia=8.7e-3, stiffness=2.0, damping=0.002)
    where = compare(releases_of(slow, seconds=6.0), pink).where
    small = next(p for p in where if p.axis == "amplitude" and p.range[0] == 0)
    assert small.share < 0.2


def every(one, n):
    return {name: getattr(one, name)[::n] for name in ("time", "roll", "std")}
