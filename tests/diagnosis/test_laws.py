"""Laws as columns: each is the effect's own torque on a known motion."""

import numpy as np
import pytest
from made_motion import decaying, known_motion, motion_of_angles
from scipy.integrate import solve_ivp

from sysid import effects
from sysid.diagnosis.laws import Laws, Shape, candidates, shape_values, split
from sysid.diagnosis.nuisances import bends, nameless, sensor
from sysid.effects import _own, effect
from sysid.effects._template import effect_file

INERTIA, NODES = 0.01, 64


@pytest.fixture(scope="module")
def swing():
    angle, rate = decaying(NODES)
    motion = motion_of_angles(angle, NODES)
    return motion, known_motion(angle, rate), Laws(motion, INERTIA, 1.0, 0.1)


def column(swing, name, shape=()):
    """Return opposing torques [N*m], shape (n, c), of a law with these shape parameters in units of their size, and its strengths."""
    _, smoothed, laws = swing
    parts, grid = {name: effect(name)}, [Shape(shape, 1.0, tuple((v, v) for v in shape))]
    (term,) = laws.terms(smoothed, parts, {name: grid})
    return term.columns[0] * laws.unit, term


def si(swing):
    motion, smoothed, _ = swing
    a, w = motion.amplitude, motion.frequency
    return (
        smoothed.angle[0] * a,
        smoothed.rate[0] * a * w,
        np.arange(smoothed.angle.shape[1]) * motion.step / w,
    )


def test_dry_friction_and_cubic_stiffness(swing):
    x, v, _ = si(swing)
    torque, term = column(swing, "coulomb")
    np.testing.assert_allclose(torque[:, 0], term.unit[0] * np.sign(v), rtol=1e-9)
    assert (term.strengths, term.signs, term.family) == (("torque",), (1,), "friction")
    torque, term = column(swing, "cubic-stiffness")
    np.testing.assert_allclose(torque[:, 0], term.unit[0] * x**3, rtol=1e-9)
    assert term.signs == (0,)


def test_dry_friction_is_smeared_by_how_well_the_rate_is_known(swing):
    _, smoothed, laws = swing
    vague = known_motion(smoothed.angle, smoothed.rate)
    object.__setattr__(vague, "rate_variance", np.full(smoothed.angle.shape, 0.1**2))
    (term,) = laws.terms(vague, {"coulomb": effect("coulomb")}, {})
    slow = np.abs(smoothed.rate) < 0.05
    sharp = np.abs(column(swing, "coulomb")[0]).max() / laws.unit
    assert np.abs(term.columns[slow]).max() < 0.5 * sharp


def test_a_stop_has_a_column_for_stiffness_and_one_for_damping(swing):
    x, v, _ = si(swing)
    torque, term = column(swing, "end-stop", (0.6,))
    angle = term.parameters["angle"]
    assert angle == pytest.approx(0.6 * effect("end-stop").parameters[0].size(swing[2].scales))
    beyond = np.sign(x) * np.maximum(np.abs(x) - angle, 0)
    unit = dict(zip(term.strengths, term.unit, strict=True))
    at = term.strengths.index("stiffness")
    np.testing.assert_allclose(torque[:, at], unit["stiffness"] * beyond, atol=1e-12)
    damper = torque[:, term.strengths.index("damping")]
    clear = np.abs(np.abs(x) / angle - 1) > 0.1
    inside = np.abs(x) < angle
    np.testing.assert_allclose(damper[clear], np.where(inside, 0.0, unit["damping"] * v)[clear], atol=1e-12)


def driven(swing, start, rate):
    """Return a state that the motion drives from its hold, by an integrator of its own, shape (n,)."""
    x, _, time = si(swing)
    speed = np.gradient(x, time)
    found = solve_ivp(
        lambda t, z: rate(np.interp(t, time, speed), z),
        (0, time[-1]),
        [start],
        "LSODA",
        time,
        rtol=1e-8,
        atol=1e-11,
    )
    return found.y[0]


def test_a_maxwell_arm_is_driven_by_the_motion(swing):
    torque, term = column(swing, "viscoelastic", (2.0,))
    constant = term.parameters["time_constant"]
    held = swing[0].held[0] / swing[0].frequency
    z = driven(swing, si(swing)[0][0] * np.exp(-held / constant), lambda v, z: v - z / constant)
    np.testing.assert_allclose(torque[:, 0], term.unit[0] * z, atol=0.01 * np.abs(torque).max())


def test_bouc_wen_is_driven_by_the_motion(swing):
    torque, term = column(swing, "bouc-wen", (0.3, 0.6))
    a, u = term.parameters["reach"], term.parameters["unloading"]
    start = 1 - np.exp(-si(swing)[0][0] / a)
    z = driven(swing, start, lambda v, z: (v - u * abs(v) * z - (1 - u) * v * abs(z)) / a)
    np.testing.assert_allclose(torque[:, 0], term.unit[0] * z, atol=0.02 * np.abs(torque).max())


def test_parameters_are_sorted_by_what_they_do(swing):
    scales = swing[2].scales
    stop, arm = split(effect("end-stop"), scales), split(effect("viscoelastic"), scales)
    assert ([p.name for p in stop.strengths], [p.name for p in stop.shapes]) == (
        ["stiffness", "damping"],
        ["angle"],
    )
    assert ([p.name for p in arm.strengths], [p.name for p in arm.shapes]) == (
        ["stiffness"],
        ["time_constant"],
    )
    values = shape_values(arm.shapes[0], scales, 7)
    np.testing.assert_allclose(np.diff(np.log(values)), np.log(values[1] / values[0]))
    finer = Shape((1.0,), 0.5, ((0.0, 2.0),)).finer()
    assert sorted(s.values[0] for s in finer) == [0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75]


def test_an_effect_of_ones_own_file_is_a_candidate(swing, tmp_path, monkeypatch):
    monkeypatch.setenv(_own.FILES, "")
    effects.catalogue.cache_clear()
    path = tmp_path / "mine.py"
    path.write_text(effect_file("fifth-power"))
    name = effects.use_file(path)
    assert name in candidates()
    assert name not in candidates([name])
    x, *_ = si(swing)
    torque, term = column(swing, name)
    np.testing.assert_allclose(torque[:, 0], term.unit[0] * x**5, rtol=1e-9)
    monkeypatch.undo()
    effects.catalogue.cache_clear()


def test_the_record_says_what_a_candidate_is_not(swing):
    _, smoothed, laws = swing
    (torque,) = laws.recorded(smoothed, [(effect("coulomb"), {"torque": 0.03})])
    np.testing.assert_allclose(torque, 0.03 * np.sign(smoothed.rate) / laws.unit)
    assert "coulomb" not in candidates(["coulomb"])


def test_a_torque_without_a_name_takes_none_that_has_one(swing):
    motion, smoothed, _ = swing
    x, v = smoothed.angle[0], smoothed.rate[0]
    g = nameless(motion, smoothed, 0.7, 0.1)
    named = np.column_stack([x, v, np.ones_like(x), x * x, x**3, v * np.abs(v), v**3, np.tanh(v / 0.02)])
    shadow = named.T @ g / np.linalg.norm(named, axis=0)[:, None]
    assert np.abs(shadow).max() < 1e-9 * np.linalg.norm(g, axis=0).max()
    detent = np.sin(9 * x)
    detent -= named @ np.linalg.lstsq(named, detent, rcond=None)[0]
    left = detent - g @ np.linalg.lstsq(g, detent, rcond=None)[0]
    assert np.linalg.norm(left) < 0.1 * np.linalg.norm(detent)


def test_the_sensors_own_terms_and_bends_have_a_row_a_node(swing):
    motion, smoothed, _ = swing
    terms, wide = sensor(motion, smoothed)
    assert terms.shape == (motion.length.sum(), len(wide))
    assert bends(motion, smoothed).shape == (motion.length.sum(), 4)
    # The walk has the variance of a random walk at the end of the release.
    walks = terms[:, 6:]
    assert np.sum(walks[-1] ** 2) == pytest.approx(motion.length[0] / NODES, rel=0.1)
