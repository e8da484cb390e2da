"""The least-squares engine: truth recovered, intervals that cover, honest refusals."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made import decays

from sysid.board import Board
from sysid.effects._base import Scales
from sysid.errors import SysidError
from sysid.fitting.covariance import parameter_covariance
from sysid.fitting.joint import FitOptions, fit_joint
from sysid.fitting.problem import Problem
from sysid.fitting.profile import profiles
from sysid.fitting.records import make_records
from sysid.fitting.search import starting_points
from sysid.joint import JointLaw, simulate
from sysid.joint.structure import structure_of
from sysid.logs import read_roll
from sysid.noise.floor import difference_std, noise_floor
from sysid.noise.whiteness import correlation_length
from sysid.quantity import Quantity
from sysid.releases import find_releases
from sysid.synth import SynthOptions, synthesise
from sysid.synth.sensors import Sensor

NOISE = np.radians(0.1)


def releases_of(
    law: JointLaw, seed: int, *, noise=NOISE, rate=500.0, duration=1.2, angles=(0.19, -0.15, 0.11), rho=0.0
):
    time = np.arange(0.0, duration, 1 / rate)
    last = simulate(law, time, angles[0]).roll[-len(time) // 5 :]
    end = "rest" if np.abs(last - last[-1]).max() < 0.3 * noise else "log"
    return decays(law, angles, time, noise, seed=seed, rho=rho, end=end)


LIGHT = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.04)
HEAVY = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.402, rest_angle=0.01)


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("coulomb", (0.08,)), ("cubic-stiffness", (150.0,)), ("quadratic-damping", (0.03,)), ("freeplay", (0.015,)),
        ("asymmetric-stiffness", (20.0,)), ("hysteresis", (8.0, 0.15)), ("viscoelastic", (4.0, 0.05)),
    ],
)  # fmt: skip
def test_truth_is_recovered(pink, effect, values):
    fit = fit_joint(releases_of(LIGHT.with_effect(effect, *values), 1), pink, [effect])
    assert fit.law.stiffness == pytest.approx(LIGHT.stiffness, rel=0.02)
    assert fit.rmse == pytest.approx(fit.noise.std, rel=0.04)
    for name, truth in zip((q for q in fit.quantities if "." in q), values, strict=True):
        found = fit.quantities[name]
        assert abs(found.value - truth) < 4.5 * found.std
        assert found.std < 0.04 * truth


def test_start_far_away_gives_the_same_answer(pink):
    far = pink.with_tilt(
        stiffness=Quantity(60.0, 1.0, "N*m/rad"), damping=Quantity(0.005, 0.001, "N*m*s/rad")
    )
    releases = releases_of(LIGHT.with_effect("coulomb", 0.08), 2)
    one, two = (fit_joint(releases, board, ["coulomb"]) for board in (pink, far))
    assert one.law.vector == pytest.approx(two.law.vector, rel=1e-4, abs=1e-6)


def test_the_last_bits_of_the_clock_change_no_fit(pink):
    law = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.402).with_effect("coulomb", 0.15)
    releases = releases_of(law, 3)
    fits = [
        fit_joint([replace(one, time=one.time * scale) for one in releases], pink, ["coulomb"])
        for scale in (1 - 1e-12, 1.0, 1 + 1e-12)
    ]
    assert len({fit.problem.samples for fit in fits}) == 1
    for fit in fits[1:]:
        assert fit.law.vector == pytest.approx(fits[0].law.vector, rel=1e-6, abs=1e-9)


def test_friction_that_stops_each_release_after_half_a_swing_has_a_least_value_only(pink):
    releases = releases_of(HEAVY.with_effect("coulomb", 0.15), 1, noise=NOISE / 10)
    found = fit_joint(releases, pink, ["coulomb"], FitOptions(bias="per-release")).quantities[
        "coulomb.torque"
    ]
    low, high = found.interval or (0.0, 0.0)
    assert 0.1 < low <= 0.15
    assert high == float("inf")
    swinging = releases_of(LIGHT.with_effect("coulomb", 0.08), 1)
    told = fit_joint(swinging, pink, ["coulomb"], FitOptions(bias="per-release")).quantities["coulomb.torque"]
    assert abs(told.value - 0.08) < 4 * told.std < 0.02


def test_memory_of_a_covariance_grows_with_the_log_not_with_rows_times_releases(pink):
    peaks = []
    for count in (10, 40):
        fit = fit_joint(releases_of(HEAVY, 1, angles=np.linspace(0.1, 0.19, count)), pink)
        tracemalloc.start()
        parameter_covariance(fit.problem, fit.minimum, fit.residuals)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 6 * peaks[0]


def test_inertia_of_the_record_scales_every_torque(pink):
    releases = releases_of(HEAVY, 3)
    double = Board(
        **{**{f: getattr(pink, f) for f in pink.__slots__}, "inertia": Quantity(2 * 8.7e-3, 1e-3, "kg*m^2")}
    )
    one, two = fit_joint(releases, pink), fit_joint(releases, double)
    assert two.law.stiffness == pytest.approx(2 * one.law.stiffness, rel=1e-5)
    share = two.quantities["stiffness"].std / two.law.stiffness
    assert share > 0.99 * 1e-3 / (2 * 8.7e-3)  # the inertia's own deviation is in it


def test_an_uncertain_inertia_makes_no_two_parameters_look_alike(pink):
    """It moves stiffness and damping by one factor, which no other release parts; the logs tell them apart well."""
    vague = replace(pink, inertia=Quantity(8.7e-3, 5e-4, "kg*m^2"))
    fit = fit_joint(releases_of(LIGHT, seed=3), vague)
    shared = fit.correlation[list(fit.quantities).index("stiffness"), list(fit.quantities).index("damping")]
    assert shared > 0.99
    assert not [line for line in fit.warnings if "told apart" in line]


@pytest.mark.parametrize("name", ["inertia", "clock", "discretisation"])
def test_what_a_decay_cannot_identify_is_refused(pink, name):
    with pytest.raises(SysidError, match="only k/I, d/I and torque/I"):
        fit_joint(releases_of(HEAVY, 1), pink, [name])


def test_two_shifts_cannot_be_told_apart(pink):
    with pytest.raises(SysidError, match="cannot be told apart"):
        fit_joint(releases_of(HEAVY, 1), pink, ["offset", "preload"])


@pytest.mark.parametrize("effect", ["offset", "preload", "sensor-bias"])
def test_a_rest_farther_from_the_record_than_the_joint_swings_is_fitted(pink, effect):
    """The zero of an encoder is anywhere."""
    law = replace(HEAVY, rest_angle=0.25)
    releases = releases_of(law, 1, angles=(0.35, 0.12, 0.3))
    fit = fit_joint(releases, pink, [effect], FitOptions(fixed={"rest_angle": 0.0}))
    (found,) = (q for name, q in fit.quantities.items() if name.startswith(effect))
    truth = 0.25 * (14.684 if effect == "preload" else 1.0)
    assert abs(found.value - truth) < 3 * found.std
    assert found.std < 0.03 * truth


@settings(max_examples=12, deadline=None)
@given(st.sampled_from(["coulomb", "cubic-stiffness", "viscoelastic", "second-mode", "lowpass", "gravity"]))
def test_sensitivities_are_exact(name):
    """The Jacobian against central differences of the residuals."""
    releases = releases_of(LIGHT, 4, duration=0.4)
    scales = Scales(inertia=8.7e-3, stiffness=14.7, damping=0.04, amplitude=0.2)
    records = make_records(releases, NOISE, rate=False)
    problem = Problem(structure_of([name]), records, scales)
    at = problem.start({**starting_points(problem.structure, scales)[0], "rest_angle": 0.003})
    jacobian = problem.linearise(at)[0][1]
    for column in range(len(problem.names)):
        step = np.zeros_like(at)
        step[column] = 1e-6
        ahead, behind = (problem.residuals(at + s * step)[0] for s in (1, -1))
        slope = (ahead - behind) / (2e-6 * problem.sizes()[column])
        assert np.abs(slope - jacobian[:, column]).max() < 2e-3 * np.abs(jacobian[:, column]).max() + 1e-9


def test_own_bias_takes_up_sensor_zeros(pink):
    releases = releases_of(HEAVY, 6)
    for shift, one in zip((0.02, -0.03, 0.01), releases, strict=True):
        one.roll[:] += shift
    fit = fit_joint(releases, pink, options=FitOptions(bias="per-release"))
    assert fit.rmse == pytest.approx(fit.noise.std, rel=0.08)
    assert "rest_angle" not in fit.quantities  # it is not to be told from the zeros
    assert abs(fit.law.stiffness - 14.684) < 4 * fit.quantities["stiffness"].std


def test_held_out_error_shows_a_wrong_model(pink):
    releases = releases_of(LIGHT.with_effect("coulomb", 0.1), 7)
    right, wrong = (fit_joint(releases, pink, names) for names in (["coulomb"], []))
    assert right.heldout_rmse() < 1.15 * right.noise.std
    assert wrong.heldout_rmse() > 2 * right.heldout_rmse()


@pytest.mark.slow
@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_intervals_cover_the_truth(pink, rho):
    """95 % intervals of k, d and friction hold the truth in 95 of 100 logs, however the noise remembers.

    `benchmarks/interval_coverage.py` has more boards, whole logs, and a thousand of each.
    """
    law = HEAVY.with_effect("coulomb", 0.1)
    truth = {"stiffness": 14.684, "damping": 0.402, "coulomb.torque": 0.1}
    known = replace(pink, inertia=replace(pink.inertia, std=0.0))
    fits = [fit_joint(releases_of(law, 100 + seed, rho=rho), known, ["coulomb"]) for seed in range(150)]
    for name, value in truth.items():
        found = [fit.quantities[name] for fit in fits]
        inside = np.mean([q.ci95[0] <= value <= q.ci95[1] for q in found])
        assert inside > 0.95 - 3 * 0.018, (name, inside)  # of 150 logs
        # The deviations themselves are a sharper test than how often two of them are exceeded.
        scores = np.sort([(q.value - value) / q.std for q in found])[4:-4]  # less a few that kinks throw far
        assert 0.8 < np.std(scores) / 0.866 < 1.2, (name, np.std(scores))  # three standard deviations of 150


@pytest.mark.parametrize(("law", "rate"), [(LIGHT, 200.0), (HEAVY, 400.0), (LIGHT, 1000.0)])
def test_noise_floor_is_not_biased(law, rate):
    """Over many logs, neither the motion nor the choice of the order shows in it."""
    noise = np.radians(0.05)
    found = [noise_floor(releases_of(law, s, noise=noise, rate=rate, duration=0.5)).std for s in range(40)]
    mean, error = float(np.mean(found)) / noise, float(np.std(found)) / noise / np.sqrt(40)
    assert abs(mean - 1) < 0.012 + 3 * error
    assert error < 0.016


def test_noise_floor_of_a_quantised_and_of_a_smoothing_sensor():
    releases = releases_of(HEAVY, 9, noise=1e-9)
    for one in releases:
        one.roll[:] = np.round(one.roll / 0.002) * 0.002
    assert noise_floor(releases).std == pytest.approx(0.002 / np.sqrt(12), rel=0.05)
    smooth = releases_of(HEAVY, 10)
    for one in smooth:
        one.roll[:] = np.convolve(one.roll, np.ones(9) / 9, mode="same")
    assert noise_floor(smooth).std > 2 * difference_std([(smooth[0].roll, smooth[0].time)])


def test_noise_floor_of_uneven_samples():
    """A motion is smooth on the clock that it was sampled by: taken for even, these steps look like twice the noise and more."""
    rng = np.random.default_rng(4)
    time = np.cumsum(rng.uniform(0.004, 0.006, 300))
    motion = 0.2 * np.exp(-1 * time) * np.cos(40 * time)
    noisy = motion + rng.normal(0, 2e-4, 300)
    assert difference_std([(noisy, time)]) == pytest.approx(2e-4, rel=0.15)
    assert difference_std([(noisy, 0.005 * np.arange(300.0))]) > 4e-4
    holed = np.delete(np.arange(300), [100, 101, 102, 180])
    assert difference_std([(noisy[holed], time[holed])]) == pytest.approx(2e-4, rel=0.15)


def test_a_swing_is_correlated_and_noise_is_not():
    rng = np.random.default_rng(11)
    white = [rng.standard_normal(1000) for _ in range(3)]
    time = np.arange(1000) / 1000
    swing = [w + 0.4 * np.sin(2 * np.pi * 6 * time) for w in white]
    assert correlation_length(white) < 1.5 < correlation_length(swing)


def test_nothing_to_fit_is_said(pink):
    with pytest.raises(SysidError, match="no release to fit"):
        fit_joint([], pink)


@pytest.mark.parametrize("truth", [(0.1, 300.0), (0.13, 100.0)])
def test_an_end_stop_that_is_met_again_and_again_is_measured(pink, truth):
    """A hard stop has false valleys: each swing off it starts the next one elsewhere."""
    law = LIGHT.with_effect("end-stop", *truth, 0.0)
    fit = fit_joint(releases_of(law, 1, angles=(0.17, -0.17, 0.12, -0.12)), pink, ["end-stop"])
    assert fit.law.vector[4:6] == pytest.approx(truth, rel=0.04)
    assert fit.law.vector[6] == 0.0  # it brakes only where the data ask for it


def test_a_combination_that_alone_is_fixed_is_said(pink):
    """A heavily damped deck leans on the stop once: a far and hard one does what a near and soft one does."""
    law = HEAVY.with_effect("end-stop", 0.13, 100.0, 0.0)
    fit = fit_joint(releases_of(law, 3), pink, ["end-stop"])
    angle, stiffness = (fit.quantities[f"end-stop.{n}"] for n in ("angle", "stiffness"))
    assert stiffness.std > 0.15 * stiffness.value
    assert abs(angle.value - 0.13) < 3 * angle.std
    assert any("the releases fix angle" in w and "not its factors" in w for w in fit.warnings), fit.warnings


@pytest.mark.parametrize("truth", [(0.1, 0.2, 0.4), (0.06, 0.15, 0.5)])
def test_static_friction_is_found_beside_the_sliding_one(pink, truth):
    releases = releases_of(
        HEAVY.with_effect("stribeck", *truth), 2, rate=1000.0, angles=(0.17, -0.15, 0.13, -0.11)
    )
    fit, plain = fit_joint(releases, pink, ["stribeck"]), fit_joint(releases, pink, ["coulomb"])
    sliding, static, _ = fit.law.vector[4:]
    assert sliding < static
    assert fit.rmse < plain.rmse
    # Where it stops, a deck tells that static friction is enough, not how much more there is.
    shape = next(shape for shape in profiles(fit, pink) if shape.name == "stribeck.static_torque")
    low, high = shape.interval
    assert low - (high - low) / 2 <= truth[1] <= high + (high - low) / 2  # four standard deviations


def test_sliding_friction_is_found_where_a_damper_and_a_wide_stribeck_speed_mimic_it(tmp_path, pink):
    light = pink.with_tilt(
        damping=Quantity(0.0095, 2e-4, "N*m*s/rad"), stiffness=Quantity(9.67, 0.1, "N*m/rad")
    )
    sensor = Sensor(noise=5.2e-4)
    options = SynthOptions(angles=(-0.14, 0.118, -0.079), sensor=sensor)
    synthesise(light, {"stribeck": (0.0043, 0.013, 1.0)}, options).save(tmp_path / "log.csv")
    fit = fit_joint(find_releases(read_roll(tmp_path / "log.csv")), pink, ["stribeck"])
    assert fit.rmse < 1.02 * sensor.noise
