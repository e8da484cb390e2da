"""Synthetic logs: timeline, sensors, dialects, truth file, command line."""

import json
import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from command_line import husky
from hypothesis import given, settings
from hypothesis import strategies as st

from sysid.board import Board
from sysid.effects import catalogue
from sysid.errors import SysidError
from sysid.quantity import GRAVITY
from sysid.synth import SynthOptions, synthesise
from sysid.synth.sensors import Sensor
from sysid.workspace import Workspace

QUIET = SynthOptions(sensor=Sensor(gyro_bias=0.0, gyro_noise=0.0, accelerometer_noise=0.0), tremor=0.0)


def with_options(**changes: object) -> SynthOptions:
    from dataclasses import replace

    sensor = {key: changes.pop(key) for key in list(changes) if key in Sensor.__dataclass_fields__}
    return replace(QUIET, **changes, sensor=replace(QUIET.sensor, **sensor))


def test_timeline_is_rest_hand_and_free_decay_in_turn(pink: Board) -> None:
    log = synthesise(pink, {}, with_options(angles=(0.17, -0.1, 0.05)))
    roll = log.channels[:, 0]
    assert np.all(roll[log.time < 0.6] == 0.0)
    assert [r.angle for r in log.releases] == pytest.approx([0.17, -0.1, 0.05], abs=1e-9)
    for release, angle in zip(log.releases, (0.17, -0.1, 0.05), strict=True):
        held = (log.time > release.start - 0.5) & (log.time < release.start)
        assert roll[held] == pytest.approx(angle, abs=1e-6)
        assert abs(roll[np.searchsorted(log.time, release.end - 2e-3)]) < 1e-6
        assert np.abs(np.diff(roll[log.time < release.end])).max() < 0.02  # no jump anywhere


VALUES = {name: effect.example for name, effect in catalogue().items()} | {
    "stribeck": (0.05, 0.15, 0.5), "linkage": (0.0, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0),
    "payload": (0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0),
}  # fmt: skip
"""Every effect of the catalogue can be made."""


@pytest.mark.parametrize("name", VALUES)
def test_every_effect_goes_with_every_dialect(pink: Board, name: str) -> None:
    if name == "sensor-bias":
        with pytest.raises(SysidError, match="rate gyro has none"):
            synthesise(pink, {name: VALUES[name]}, with_options(rate=200.0, dialect="gyro"))
        return
    for dialect, width in (("gyro", 1), ("imu", 6)):
        log = synthesise(pink, {name: VALUES[name]}, with_options(rate=200.0, dialect=dialect, duration=0.5))
        assert log.channels.shape == (len(log.time), width)
        assert np.all(np.isfinite(log.channels))


def test_discretisation_is_what_mujoco_does(pink: Board) -> None:
    effects = {
        "discretisation": (0.005,), "cubic-stiffness": (80.0,), "quadratic-damping": (0.02,),
        "asymmetric-stiffness": (5.0,), "cubic-damping": (0.001,),
    }  # fmt: skip
    log = synthesise(pink, effects, with_options(rate=200.0, hand=False))
    xml = f"""<mujoco><option timestep="0.005" integrator="implicitfast" gravity="0 0 0"/><worldbody><body>
      <joint type="hinge" axis="1 0 0" stiffness="{pink.stiffness} 5 80" damping="{pink.damping} 0.02 0.001"/>
      <inertial pos="0 0 0" mass="1" diaginertia="{pink.inertia.value} 1 1"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qpos[0] = log.releases[0].angle
    path = []
    for _ in log.time:
        path.append(data.qpos[0])
        mujoco.mj_step(model, data)
    assert np.abs(log.channels[:, 0] - path).max() < 1e-12


@pytest.mark.parametrize(
    ("effects", "changes", "match"),
    [
        ({"discretisation": (0.005,)}, {"rate": 1000.0}, "between the simulator's steps"),
        ({"discretisation": (0.005,), "coulomb": (0.1,)}, {"rate": 200.0}, "together with coulomb"),
        ({"discretisation": (0.005,)}, {"rate": 200.0, "jitter": 0.1}, "jitter"),
        ({"colomb": (0.1,)}, {}, "Did you mean 'coulomb'"),
        ({"coulomb": ()}, {}, r"got 0 value\(s\); it takes torque"),
        ({"coulomb": (-0.1,)}, {}, "torque is -0.1; expected 0 or more"),
        ({"stribeck": (0.3, 0.1, 1.0)}, {}, "static_torque is below"),
        ({}, {"angles": (0.0,)}, "release angle is 0"),
        ({}, {"rate": 0.0}, "rate is 0"),
        ({}, {"noise": -1.0}, "noise is -1"),
        ({}, {"rate": 1e9}, "number of samples"),
        ({"preload": (100.0,)}, {}, "tips over"),
        ({"discretisation": (0.1,)}, {"rate": 10.0, "duration": 20.0}, "use a shorter one"),
        ({}, {"hand": False, "angles": (0.1, 0.2)}, "without a hand"),
    ],
)
def test_impossible_wishes_are_refused(pink: Board, effects, changes, match: str) -> None:
    with pytest.raises(SysidError, match=match):
        synthesise(pink, effects, with_options(**changes))


SIZES = (
    st.floats(1e-3, 1e3)
    | st.floats(-1e3, 1e3)
    | st.floats(1e-6, 1.0)
    | st.sampled_from([0.0, 1e12, -1e12, math.inf, math.nan])
)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_any_effects_make_a_finite_log_or_one_clear_refusal(data: st.DataObject) -> None:
    names = data.draw(st.lists(st.sampled_from(sorted(VALUES)), min_size=1, max_size=3, unique=True))
    effects = {name: data.draw(st.tuples(*[SIZES] * len(VALUES[name]))) for name in names}
    board = Workspace(Path()).load_board("pink")
    try:
        log = synthesise(board, effects, with_options(rate=100.0, duration=0.3))
    except SysidError:
        return
    assert np.all(np.isfinite(log.channels))
    assert np.all(np.diff(log.time) > 0)


def test_angle_sensor_errors(pink: Board) -> None:
    plain = synthesise(pink, {}, QUIET)
    drifting = synthesise(pink, {"sensor-bias": (0.01,), "sensor-drift": (0.002,)}, QUIET)
    assert drifting.channels[:, 0] - plain.channels[:, 0] == pytest.approx(0.01 + 0.002 * plain.time)
    fast = synthesise(pink, {"clock": (1.02,)}, QUIET)
    assert fast.time == pytest.approx(1.02 * plain.time)
    assert fast.releases[0].start == pytest.approx(1.02 * plain.releases[0].start)
    assert np.array_equal(fast.channels, plain.channels)
    coarse = synthesise(pink, {}, with_options(quantisation=0.01)).channels[:, 0]
    assert np.abs(coarse / 0.01 - np.round(coarse / 0.01)).max() < 1e-9
    assert np.abs(coarse - plain.channels[:, 0]).max() <= 0.005 + 1e-12
    noisy = synthesise(pink, {}, with_options(noise=2e-3))
    errors = (noisy.channels - plain.channels)[:, 0]
    assert errors.std() == pytest.approx(2e-3, rel=0.05)
    assert abs(np.corrcoef(errors[1:], errors[:-1])[0, 1]) < 0.05
    assert noisy.to_roll().std[0] == pytest.approx(2e-3)


def test_jitter_samples_the_true_motion_where_the_stamps_say(pink: Board) -> None:
    plain, jittered = (synthesise(pink, {}, with_options(jitter=j, rate=2000.0)) for j in (0.0, 0.2))
    steps = np.diff(jittered.time)
    assert steps.min() > 0
    assert steps.std() == pytest.approx(0.2 * math.sqrt(2) / 2000, rel=0.2)
    believed = np.interp(jittered.time, plain.time, plain.channels[:, 0])
    assert np.abs(believed - jittered.channels[:, 0]).max() < 1e-4


def test_accelerometer_feels_gravity_and_the_lever_arm(pink: Board) -> None:
    """Against the second derivative of the sensor's place in the world, turned into the sensor's frame."""
    arm = (0.1, 0.03, 0.05)
    log = synthesise(pink, {}, with_options(dialect="imu", lever_arm=arm, rate=4000.0, hand=False))
    roll = log.true_motion[:, 0]
    place = np.column_stack((
        arm[1] * np.cos(roll) - arm[2] * np.sin(roll), arm[1] * np.sin(roll) + arm[2] * np.cos(roll)
    ))  # fmt: skip
    step = log.time[1] - log.time[0]
    world = np.gradient(np.gradient(place, step, axis=0), step, axis=0) + np.array([0.0, GRAVITY.value])
    felt_y = np.cos(roll) * world[:, 0] + np.sin(roll) * world[:, 1]
    felt_z = -np.sin(roll) * world[:, 0] + np.cos(roll) * world[:, 1]
    assert log.channels[3:-3, 1] == pytest.approx(felt_y[3:-3], abs=0.03)
    assert log.channels[3:-3, 2] == pytest.approx(felt_z[3:-3], abs=0.03)
    assert np.abs(felt_y).max() > 10  # most of it is the lever arm, not gravity
    assert log.channels[:, 3] == pytest.approx(log.true_motion[:, 1])
    tilted = synthesise(pink, {"sensor-bias": (0.05,)}, with_options(dialect="imu"))
    still = tilted.time < 0.5
    assert np.arctan2(tilted.channels[still, 1], tilted.channels[still, 2]) == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("dialect", "suffix", "error_deg"),
    [
        ("angle", ".csv", 0.11), ("angle-deg", ".csv", 0.11), ("gyro", ".csv", 0.05), ("imu", ".csv", 0.05),
        ("phyphox", ".csv", 0.05), ("phyphox", ".zip", 0.05), ("sensor-logger", ".zip", 0.05),
    ],
)  # fmt: skip
def test_every_dialect_is_read_back_as_the_true_roll(
    pink: Board, tmp_path: Path, dialect, suffix: str, error_deg: float
) -> None:
    """Without one option: columns, units, axis, gyro offset and lever arm are found by the reader."""
    from sysid.logs import read_roll

    log = synthesise(pink, {}, SynthOptions(angles=(0.17, -0.15, 0.1), rate=400.0, seed=1, dialect=dialect))
    path, _ = log.save(tmp_path / f"log{suffix}")
    roll = read_roll(path)
    error = roll.roll - np.interp(roll.time, log.time - log.time[0], log.true_motion[:, 0])
    assert math.degrees(np.std(error)) < error_deg
    assert math.degrees(abs(np.mean(error))) < 0.1


def test_command_writes_log_and_truth(tmp_path: Path) -> None:
    arguments = (
        "synth", "--board", "pink", "-o", "log.csv", "--effect", "coulomb=0.1", "--release-angle", "10",
        "--release-angle", "-0.1rad", "--rate", "500", "--seed", "4",
    )  # fmt: skip
    result = husky(*arguments, "--json", "-", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    printed = json.loads(result.stdout)
    truth = json.loads((tmp_path / "log.truth.json").read_text())
    assert truth["effects"] == printed["effects"]
    assert truth["effects"] == [{"name": "coulomb", "parameters": {"torque": {"value": 0.1, "unit": "N*m"}}}]
    assert [r["angle_rad"] for r in truth["releases"]] == pytest.approx([math.radians(10), -0.1], abs=2e-3)
    assert truth["command"].startswith("husky-sysid synth --board pink")
    assert truth["parameters"]["stiffness"]["value"] == pytest.approx(14.684)
    first = (tmp_path / "log.csv").read_bytes()
    assert husky(*arguments, cwd=tmp_path).returncode == 0
    assert (tmp_path / "log.csv").read_bytes() == first


@pytest.mark.parametrize(
    ("arguments", "code", "match"),
    [
        (("--board", "pnk", "-o", "a.csv"), 1, "Did you mean 'pink'"),
        (("--board", "pink", "-o", "a.csv", "--effect", "x=1"), 1, "unknown effect 'x'"),
        (("--board", "pink", "-o", "a.csv", "--effect", "coulomb=1", "--effect", "coulomb=2"), 1, "twice"),
        (
            ("--board", "pink", "-o", "a.csv", "--release-angle", "5", "--releases", "2"),
            1,
            "one or the other",
        ),
        (("--board", "pink", "-o", "file/a.csv"), 1, "cannot write there"),
        (("-o", "a.csv"), 2, "--board"),
    ],
)
def test_command_refuses_in_one_line(tmp_path: Path, arguments, code: int, match: str) -> None:
    (tmp_path / "file").write_text("not a folder")
    result = husky("synth", *arguments, cwd=tmp_path)
    assert result.returncode == code
    assert match in result.stderr + (result.stdout if code == 2 else "")
    if code == 1:
        assert result.stderr.count("\n") == 1
        assert result.stdout == ""
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


JOINTS = """<mujoco><worldbody>
  <body name="arm"><joint name="knee" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.01" mass="0.5"/></body>
  <body name="cart" pos="1 1 0"><joint name="rail" type="slide" axis="1 0 0" stiffness="40" damping="1" range="-0.2 0.2" limited="true"/>
    <geom type="box" size="0.05 0.05 0.02" mass="0.8"/></body>
</worldbody></mujoco>"""


def test_a_pendulum_of_a_model_moves_as_mujoco_moves_it(tmp_path: Path) -> None:
    (tmp_path / "joints.xml").write_text(JOINTS)
    husky("synth", "--model", tmp_path / "joints.xml", "--joint", "knee", "--release-angle", "40", "--rate", "200", "--no-hand",
          "--noise", "0", "-o", tmp_path / "knee.csv")  # fmt: skip
    time, angle = np.loadtxt(tmp_path / "knee.csv", delimiter=",", skiprows=1).T
    model = mujoco.MjModel.from_xml_string(JOINTS)
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, 1e-3
    truth = json.loads((tmp_path / "knee.truth.json").read_text())["releases"][0]
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = truth["angle_rad"], truth["rate_rad_s"]
    expected = []
    for _ in time:
        expected.append(data.qpos[0])
        for _ in range(5):
            mujoco.mj_step(model, data)
    np.testing.assert_allclose(angle, expected, atol=1e-5)


def test_a_slide_of_a_model_is_made_in_its_own_units(tmp_path: Path) -> None:
    (tmp_path / "joints.xml").write_text(JOINTS)
    joint = ("--model", tmp_path / "joints.xml", "--joint", "rail", "--workspace", tmp_path)
    log = tmp_path / "rail.csv"
    said = husky("synth", *joint, "--release-angle", "50", "--duration", "6", "--rate", "200", "-o", log)
    assert "+50." in said.stdout or "+49." in said.stdout
    truth = json.loads((tmp_path / "rail.truth.json").read_text())
    assert truth["parameters"]["stiffness"] == {"value": 40.0, "unit": "N/m"}
    assert truth["releases"][0]["position_m"] == pytest.approx(0.05, abs=2e-3)
    decay = json.loads(husky("decay", log, *joint, "--json", "-").stdout)
    assert decay["stiffness"]["value"] == pytest.approx(40.0, rel=0.01)
    assert decay["damping"]["value"] == pytest.approx(1.0, rel=0.02)
    for options, match in (
        (("--noise", "1deg"), "write 20, 20mm"),
        (("--dialect", "imu"), "'position' for a joint that slides"),
        (("--release-angle", "5deg"), "write 20, 20mm or 0.02m"),
    ):
        assert match in husky("synth", *joint, *options, "-o", tmp_path / "x.csv").stderr
        assert not (tmp_path / "x.csv").exists()
