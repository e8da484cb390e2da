"""A log in, a verdict out: logs of a generator of its own, of shipped files and of a gyro."""

import json
from dataclasses import replace

import decay_truths
import numpy as np
import pytest

from sysid.board import BoardEffect, load_board
from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.motion import motion_of, natural_frequency
from sysid.diagnosis.report import to_json
from sysid.errors import SysidError
from sysid.quantity import Quantity
from sysid.recording import Recording
from sysid.workspace import shipped_data

PINK = load_board(shipped_data() / "boards" / "pink.toml")
VERDICT = {
    "status", "effects", "confidence", "indistinguishable_from", "error_before_rad", "error_after_rad", "next_experiment",
    "explanation",
}  # fmt: skip


def unit(v):
    return float(np.tanh(v / 2e-3))


LAWS = {
    "nothing": (),
    "friction": (("coulomb", lambda x, v, z, t: (0.05 * unit(v), []), 0),),
    "drag": (("drag", lambda x, v, z, t: (0.3 * v * abs(v), []), 0),),
    "hardening": (("cubic", lambda x, v, z, t: (0.3 * x**3, []), 0),),
}


def made(name, zeta, seed, sensor="plain", hand="clean"):
    """Return a log of a joint of 20 rad/s that swings by 0.3 rad, and its record: an inertia of 1 kg*m^2 only."""
    truth = decay_truths.Truth(
        kind="known", families=(name,), omega=20.0, zeta=zeta, amplitude=0.3, bent=False, hand=hand, sensor=sensor, laws=list(LAWS[name])
    )  # fmt: skip
    unknown = {key: replace(q, std=0.0) for key, q in PINK.tilt.items()}
    board = replace(PINK, tilt=unknown, inertia=Quantity(1.0, 0.01, "kg*m^2"))
    return decay_truths._record(truth, np.random.default_rng(seed), seed)[0], board


@pytest.mark.parametrize(("zeta", "seed"), [(0.08, 1), (0.15, 2)])
@pytest.mark.parametrize("name", LAWS)
def test_the_family_that_acts_is_named(name, zeta, seed):
    result = diagnose(*made(name, zeta, seed))
    families = set(result.verdict.families) - {"rest"}
    assert families == (set() if name == "nothing" else {name}), result
    assert result.status == ("none-missing" if name == "nothing" else "missing")
    assert result.verdict.confidence > 0.5


@pytest.mark.parametrize(("name", "zeta", "seed"), [("friction", 0.05, 3), ("nothing", 0.2, 8)])
def test_a_gyro_alone_shows_what_acts(name, zeta, seed):
    result = diagnose(*made(name, zeta, seed, sensor="gyro"))
    assert result.is_rate
    assert set(result.verdict.families) - {"rest"} == (set() if name == "nothing" else {name}), result


@pytest.mark.parametrize(("sensor", "hand", "seed"), [("plain", "slow", 4), ("drift", "clean", 2)])
@pytest.mark.parametrize("name", ["nothing", "friction"])
def test_neither_a_slow_hand_nor_a_drift_is_an_effect(name, sensor, hand, seed):
    result = diagnose(*made(name, 0.08, seed, sensor, hand))
    assert set(result.verdict.families) - {"rest"} == (set() if name == "nothing" else {name}), result
    assert ("A hand acted" in result.report()) == (hand == "slow")


@pytest.fixture(scope="module")
def hidden():
    return diagnose(Recording.read(shipped_data() / "decays" / "pink_hidden.csv"), PINK)


def test_dry_friction_of_the_shipped_log_is_found_with_its_size(hidden):
    assert (hidden.status, hidden.verdict.effects) == ("missing", ("coulomb",))
    low, high = hidden.best.parameters["coulomb.torque"].ci95
    assert low < 0.15 < high
    assert hidden.explained > 0.98
    # It works against every swing: 0.15 N*m along 1.1 times the release angle, of half k times its square.
    assert hidden.posterior.sizes["friction"].energy_share == pytest.approx(0.13, abs=0.04)


def test_json_has_the_binding_fields(hidden):
    content = json.loads(json.dumps(to_json(hidden), allow_nan=False))
    assert {"board", "logs", "noise_floor_rad", "baseline", "candidates", "verdict"} <= set(content)
    assert set(content["baseline"]) == {"rmse_rad", "heldout_rmse_rad"}
    assert set(content["verdict"]) >= VERDICT | {
        "families",
        "explained",
        "matters",
        "remainder",
        "hints",
        "sets",
        "inclusion",
        "sizes",
    }
    first = content["candidates"][0]
    assert set(first) == {"effects", "rmse_rad", "heldout_rmse_rad", "score", "parameters"}
    assert set(first["parameters"]["coulomb.torque"]) >= {"value", "std", "ci95", "unit"}
    assert first["score"] == 0 <= content["candidates"][1]["score"]
    assert sum(s["probability"] for s in content["verdict"]["sets"]) == pytest.approx(1.0, abs=0.05)
    assert content["verdict"]["error_before_rad"] > 1.5 * content["verdict"]["error_after_rad"]


def test_numbers_that_json_cannot_hold_are_null(hidden):
    lost = replace(hidden, posterior=replace(hidden.posterior, inclusion={"stop": np.inf, "drag": np.nan}))
    assert to_json(lost)["verdict"]["inclusion"] == {"stop": None, "drag": None}


def test_what_is_printed_says_verdict_and_next_command(hidden):
    text = hidden.report()
    assert text.startswith("Result: coulomb is missing (confidence ")
    assert [line.split("│")[2].strip() for line in text.splitlines() if "→" in line] == ["coulomb"]
    assert "fit pink_hidden.csv --board pink --effect coulomb" in text.replace(
        str(shipped_data() / "decays") + "/", ""
    )
    many = replace(hidden, candidates=hidden.candidates * 9)
    assert len(repr(hidden)) < len(many.report()) > 2000 > len(repr(many))
    assert many.report().startswith(repr(many).removesuffix("\n…"))
    assert hidden.to_dataframe()["effects"].iloc[0] == ("coulomb",)


def test_what_the_record_has_is_not_missing_any_more():
    known = BoardEffect("coulomb", {"torque": Quantity(0.15, 0.01, "N*m")})
    result = diagnose(
        Recording.read(shipped_data() / "decays" / "pink_hidden.csv"), replace(PINK, effects=(known,))
    )
    assert result.status == "none-missing", result
    assert all("coulomb" not in c.effects for c in result.candidates)


def test_the_shipped_log_of_the_record_lacks_nothing():
    result = diagnose(Recording.read(shipped_data() / "decays" / "pink.csv"), PINK)
    assert (result.status, result.effects) == ("none-missing", ()), result


def test_a_motion_is_the_log_in_units_of_the_swing():
    recording, _ = made("nothing", 0.1, 5)
    releases = recording.releases
    motion = motion_of(releases, 0.0, 1e-3, rate=False)
    assert motion.frequency == pytest.approx(20.0, rel=0.05)
    assert natural_frequency(releases[0], rate=False) == pytest.approx(20.0, rel=0.05)
    assert np.abs(motion.reading[motion.inside]).max() == pytest.approx(1.0, abs=0.05)
    time = (np.arange(motion.length[0]) * motion.step + motion.lag[0, : motion.length[0]]) / motion.frequency
    seen = np.isfinite(motion.variance[0, : motion.length[0]])
    roll = np.interp(motion.starts[0] + time, releases[0].time, releases[0].roll) / motion.amplitude
    np.testing.assert_allclose(motion.reading[0, : motion.length[0]][seen], roll[seen], atol=0.02)


def test_a_release_that_is_all_noise_is_refused_with_the_next_step():
    recording, board = made("nothing", 0.1, 6)
    short = [release[:9] for release in recording.releases]
    with pytest.raises(SysidError, match=r"samples|motion|rate"):
        diagnose(short, board)


def test_a_log_that_jumps_home_is_judged_until_then():
    """A swing that is set to zero before it has ended, as a log does that is made of pieces."""
    time, noise = np.arange(0.0, 2.5, 2e-3), 5e-4
    after = np.clip(time - 0.5, 0.0, None)
    free = np.exp(-1.0 * after) * (np.cos(20 * after) + 0.05 * np.sin(20 * after))
    roll = np.where(after < 1.2, 0.2 * free, 0.0) + noise * np.random.default_rng(4).standard_normal(
        len(time)
    )
    found = diagnose(
        Recording.from_arrays(time, angle=roll), replace(PINK, inertia=Quantity(1.0, 0.01, "kg*m^2"))
    )
    assert not set(found.verdict.families) - {"rest", "inertia", "clock"}, found
    assert found.best.rmse < 1.3 * noise
