"""A scale of the sensor that is known only so well: intervals of what depends on the amplitude hold, spring and damper stay."""

from dataclasses import replace

import numpy as np
import pytest
from made import decays

from sysid.board import load_board
from sysid.fitting.bootstrap import bootstrap
from sysid.fitting.covariance import scale_shift
from sysid.fitting.joint import FitOptions, fit_joint
from sysid.fitting.profile import profiles
from sysid.joint import JointLaw
from sysid.logs.sources.swing_smoother import GAIN_STD
from sysid.logs.table.names import ACCEL_UNITS
from sysid.quantity import Z95, Quantity
from sysid.recording import Recording
from sysid.synth import SynthOptions, synthesise
from sysid.synth.sensors import Sensor, measure, write_log
from sysid.workspace import shipped_data

PINK = load_board(shipped_data() / "boards" / "pink.toml")
BOARD = replace(
    PINK,
    inertia=Quantity(8.7e-3, 0.0, "kg*m^2", "exact"),
    tilt={**PINK.tilt, "damping": replace(PINK.tilt["damping"], value=0.05)},
)
VALUES = {"cubic-stiffness": (150.0,), "coulomb": (0.1,)}
TRUTH = {"cubic-stiffness.coefficient": 150.0, "coulomb.torque": 0.1}
LOGS = 20
ACCEL_OFFSET_STD = 0.01 * ACCEL_UNITS["g"]
"""Typical offset of a MEMS accelerometer [m/s²]."""


@pytest.fixture(scope="module")
def deviations(tmp_path_factory):
    """Errors of both torques over their deviations, shape (logs, 2), from IMUs whose errors scatter as the smoother takes them to."""
    options = SynthOptions(
        dialect="imu",
        rate=150,
        duration=1.0,
        angles=(0.2, -0.17, 0.14, -0.2),
        sensor=Sensor(lever_arm=(0, 0.01, 0.03)),
    )
    log = synthesise(BOARD, VALUES, options)
    path = tmp_path_factory.mktemp("imu") / "imu.csv"
    rng = np.random.default_rng(0)
    found = []
    for _ in range(LOGS):
        read = measure(log.time, log.true_motion, options.sensor, "imu", rng)
        read[:, :3] *= 1 + 0.01 * rng.standard_normal()
        read[:, :3] += ACCEL_OFFSET_STD * rng.standard_normal(3)
        read[:, 3:] = read[:, 3:] @ (np.eye(3) + GAIN_STD * rng.standard_normal((3, 3)))
        write_log(path, log.time, read, "imu")
        releases = Recording.read(path).releases
        fit = fit_joint(releases, BOARD, tuple(VALUES), FitOptions(use_rate=True, bias="per-release"))
        found.append([(fit.quantities[n].value - true) / fit.quantities[n].std for n, true in TRUTH.items()])
    return np.array(found)


@pytest.mark.parametrize("index", [0, 1], ids=TRUTH)
def test_intervals_from_an_imu_hold(deviations, index):
    """Of 20 logs at 95 %, 17 or more intervals hold (98 %), and deviations scatter by 0.69 to 1.31 (95 %)."""
    assert np.count_nonzero(np.abs(deviations[:, index]) < Z95) >= 17
    assert 0.69 < np.sqrt(np.mean(deviations[:, index] ** 2)) < 1.31


def fitted(*effects, scale=1.0, scale_std=0.01, **options):
    known = tuple((name, VALUES[name]) for name in effects)
    law = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.05, effects=known)
    time = np.arange(0.0, 0.8, 0.004)
    made = decays(law, (0.19, -0.15, 0.11), time, 1e-3, seed=3, scale_std=scale_std, hold=0.0)
    made = [replace(one, roll=scale * one.roll) for one in made]
    return fit_joint(made, BOARD, effects, FitOptions(**options))


def changes(one, other):
    return {name: other.quantities[name].value - q.value for name, q in one.quantities.items()}


def test_a_larger_signal_moves_the_fit_as_foretold():
    one = fitted("cubic-stiffness", "coulomb")
    other = fitted("cubic-stiffness", "coulomb", scale=1.01)
    shift = dict(zip(one.problem.names, scale_shift(one.problem, one.minimum), strict=True))
    moved = changes(one, other)
    assert shift["coulomb.torque"] == pytest.approx(0.01 * 0.1, rel=0.03)
    assert shift["cubic-stiffness.coefficient"] == pytest.approx(-0.02 * 150, rel=0.03)
    for name in TRUTH:
        assert moved[name] == pytest.approx(shift[name], rel=0.03)
    certain = fitted("cubic-stiffness", "coulomb", scale_std=0.0)
    for name, quantity in one.quantities.items():
        assert quantity.std == pytest.approx(np.hypot(certain.quantities[name].std, shift[name]), rel=1e-6)
    assert one.warnings == certain.warnings  # no release would tell the two torques' common scale apart


def test_spring_and_damper_of_a_linear_joint_stay():
    one, certain = fitted(scale_std=0.1), fitted(scale_std=0.0)
    for name in ("stiffness", "damping"):
        assert one.quantities[name].std == pytest.approx(certain.quantities[name].std, rel=1e-4)


def test_profile_and_bootstrap_hold_the_scale():
    fit = fitted("cubic-stiffness")
    name = "cubic-stiffness.coefficient"
    low, high = next(shape for shape in profiles(fit, BOARD) if shape.name == name).interval
    assert high - low == pytest.approx(2 * Z95 * fit.quantities[name].std, rel=0.1)
    assert np.std(bootstrap(fit, BOARD, 100).draws[:, fit.problem.names.index(name)]) == pytest.approx(
        fit.quantities[name].std, rel=0.25
    )
    assert fit.quantities[name].std > 0.019 * 150
