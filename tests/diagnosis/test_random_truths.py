"""The logs of the random suite hold what they say."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import random_truths
import reliability
from hidden_truths import VISIBLE
from random_suite import board_of, missed, run
from random_truths import (
    INERTIA,
    OUTSIDE,
    STIFFNESS,
    VARIANTS,
    Case,
    Truth,
    draw,
    move,
    read,
    sizes,
    visible,
    write,
)

from sysid.diagnosis.judgement import calibrated
from sysid.logs import read_roll
from sysid.releases import find_releases


def held_and_let_go(truth: Truth, seed: int = 0) -> Case:
    """Return a case of one release from 0.1 rad, neither pushed nor caught, with that truth."""
    case = draw(seed)
    recording = replace(
        case.recording, sensor="angle", rate=1000.0, angles=(0.1,), caught=False, pushed=False, step=0.0
    )
    return replace(case, truth=truth, recording=recording)


def test_ten_seeds_hold_two_clean_logs_and_one_outside_the_catalogue() -> None:
    kinds = [draw(seed).kind for seed in range(30)]
    assert [kinds.count(kind) for kind in ("clean", "inside", "outside")] == [6, 21, 3]


def test_every_variant_and_every_law_outside_is_drawn_and_a_third_of_clean_logs_is_caught() -> None:
    cases = [draw(seed) for seed in range(1000)]
    assert {case.truth.name for case in cases} >= {*VARIANTS, *(t.name for t in OUTSIDE)}
    caught = [case.recording.caught for case in cases if case.kind == "clean"]
    assert np.mean(caught) == pytest.approx(1 / 3, abs=0.02)


def test_the_same_seed_is_the_same_log() -> None:
    first, again = (read(draw(5), move(draw(5)))[2] for _ in range(2))
    assert all(np.array_equal(first[name], again[name]) for name in first)


def test_a_linear_joint_decays_as_the_formula_says() -> None:
    case = held_and_let_go(Truth("nothing", (), damping=0.03))
    motion = move(case)
    (begin, end), frequency, fall = motion.free[0], np.sqrt(STIFFNESS / INERTIA), 0.03 / (2 * INERTIA)
    inside = (motion.time >= begin + 1e-9) & (motion.time <= end)
    t = motion.time[inside] - begin
    swing, roll = np.sqrt(frequency**2 - fall**2), motion.states[inside, 0]
    basis = np.exp(-fall * t)[:, None] * np.column_stack((np.cos(swing * t), np.sin(swing * t)))
    left = roll - basis @ np.linalg.lstsq(basis, roll, rcond=None)[0]
    assert np.abs(left).max() < 1e-6
    assert visible(case, motion)["visible"] < 1e-3


def test_dry_friction_takes_four_times_its_torque_over_the_stiffness_a_period() -> None:
    truth = Truth("coulomb", ("friction",))
    truth.parts.append(random_truths._friction(0.05))
    motion = move(held_and_let_go(truth))
    begin = motion.free[0][0]
    period = 2 * np.pi / truth.frequency
    peaks = np.interp(begin + period * np.arange(4), motion.time, motion.states[:, 0])
    assert np.diff(peaks) == pytest.approx(-4 * 0.05 / STIFFNESS, rel=0.01)
    assert sizes(held_and_let_go(truth), motion)["energy_share"] == pytest.approx(1.0)


def test_a_log_that_cannot_be_made_or_read_is_a_row_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("random_suite.read_roll", lambda path: 1 / 0)
    row = run(0)
    assert (row["status"], row["error"]) == ("error", "ZeroDivisionError: division by zero")
    monkeypatch.setattr(random_truths, "MOST_STEPS", 10)
    assert run(0)["status"] == "void"


def test_a_record_that_knows_the_joint_is_off_by_its_deviation_only() -> None:
    case = next(
        c for c in map(draw, range(100)) if c.record_known and c.truth.stiffness and c.kind == "clean"
    )
    stiffness = board_of(case).tilt["stiffness"]
    assert abs(stiffness.value - case.truth.stiffness) < 4 * stiffness.std
    assert board_of(replace(case, record_known=False)).stiffness == STIFFNESS


ROW = {
    "kind": "inside", "status": "missing", "said": ["friction"], "alike": [["drag"]], "families": ["drag"],
    "visible": 1e4, "torque_share": 0.1, "energy_share": 0.0, "confidence": 0.9,
    "calibration": (1.0, 0.0),
}  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "right", "answered"),
    [
        ({}, True, True),
        ({"families": ["stop"]}, False, False),
        ({"families": ["drag", "friction"]}, False, False),
        ({"status": "none-missing"}, False, False),
        ({"status": "none-missing", "visible": 10.0}, False, True),
        ({"status": "none-missing", "torque_share": 0.001}, False, True),
        ({"families": ["drag", "friction"], "said": ["drag"], "missed": 10.0}, False, True),
        ({"status": "none-missing", "kind": "clean", "families": []}, True, True),
        ({"status": "unexplained"}, False, False),
        ({"status": "unexplained", "kind": "outside"}, True, True),
        ({"kind": "outside", "families": ["outside"]}, False, False),
    ],
)
def test_a_verdict_is_right_if_it_names_the_families_or_a_look_alike(
    changes, right: bool, answered: bool
) -> None:
    row = {**ROW, **changes}
    assert (reliability.right(row), reliability.answered(row)) == (right, answered)


def test_intervals_of_shares_are_wilsons() -> None:
    assert reliability.wilson(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-3)
    assert reliability.wilson(5, 10) == pytest.approx((0.2366, 0.7634), abs=1e-3)


def test_calibration_finds_what_confidence_is_deserved() -> None:
    """Verdicts whose true odds are the root of the printed ones, times two."""
    rng = np.random.default_rng(0)
    printed = rng.uniform(0.1, 0.95, 20_000)
    deserved = calibrated(printed, 0.5, np.log(2))
    rows = [  # printed with another calibration, which is taken back
        {**ROW, "confidence": p, "calibration": (0.8, -0.2), "families": ["drag"] if hit else ["stop"]}
        for p, hit in zip(calibrated(printed, 0.8, -0.2), rng.random(len(printed)) < deserved, strict=True)
    ]
    assert reliability.calibration(rows) == pytest.approx((0.5, np.log(2)), abs=0.05)
    assert reliability.brier(deserved, np.ones(len(deserved))) < reliability.brier(
        printed, np.ones(len(printed))
    )
    mean, hits, count = reliability.bins(np.array([0.92, 0.94, 1.0]), np.array([True, False, True]))[0]
    assert (mean, hits, count) == (pytest.approx(0.93), 1, 2)


def test_promised_beside_right() -> None:
    """A hundred verdicts at 0.9 promise 90 right ones, give or take three."""
    said = reliability.balance(np.full(100, 0.9), np.arange(100) < 84)
    assert said == "84 of 100 right, 90 ± 3 promised"


@pytest.mark.parametrize(
    "seed", [87042, 86854], ids=["stamps that jitter", "a stop within the first milliseconds"]
)
def test_what_a_start_alone_would_show_is_missed_no_further_than_its_instant_is_seen(
    seed: int, tmp_path: Path
) -> None:
    """A sample that begins late, or a stop that is left before the release is found, starts faster than from rest."""
    case = draw(seed)
    motion = move(case)
    write(case, motion, tmp_path / "log.csv")
    releases = find_releases(read_roll(tmp_path / "log.csv"))
    assert missed(case, motion, releases, [("coulomb",)]) < VISIBLE / 2
