"""The verdict: it names what is hidden, says nothing where nothing is, and does not guess."""

import json
import subprocess
import sys

import hidden_effects as suite
import hidden_truths as truths
import numpy as np
import pytest

from sysid.board import load_board
from sysid.diagnosis.diagnose import _fast_starts, check_releases, diagnose
from sysid.diagnosis.search import Search
from sysid.errors import SysidError
from sysid.fitting.records import make_records
from sysid.fitting.search import scales_of
from sysid.joint import JointLaw, simulate
from sysid.quantity import Quantity
from sysid.roll import Release
from sysid.workspace import shipped_data

BY_NAME = {truth.name: truth for truth in truths.TRUTHS}
QUICK = ("none, heavy", "coulomb 0.15, heavy")
SLOW = (
    "cubic-stiffness 300, heavy",
    "offset -0.01, heavy",
    "inertia 0.8, heavy",
    "none",
    "coulomb 0.03",
    "quadratic-damping and cubic-stiffness",
    "freeplay 0.02",
    "cogging",
    "hysteresis 6,0.15",
)


def verdict_of(name, seed, tmp_path):
    truth = BY_NAME[name]
    return truth, diagnose(truths.make(truth, seed, tmp_path), truths.board_of(truth))


@pytest.mark.slow
@pytest.mark.parametrize("name", QUICK)
def test_hidden_effect_is_named(name, tmp_path):
    truth, result = verdict_of(name, 40, tmp_path)
    assert suite.right(truth, result), result.verdict
    assert result.verdict.error_after <= 1.15 * result.noise.std


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOW)
def test_hidden_effect_is_named_on_a_light_board(name, tmp_path):
    truth, result = verdict_of(name, 41, tmp_path)
    assert suite.right(truth, result), result.verdict


@pytest.mark.slow
def test_a_suite_that_expects_something_else_would_fail(tmp_path):
    """The judge of the suite is not blind."""
    _, result = verdict_of("coulomb 0.15, heavy", 40, tmp_path)
    for other in ("none", "cubic-stiffness 300, heavy", "cogging"):
        assert not suite.right(BY_NAME[other], result)


@pytest.mark.slow
def test_what_the_record_has_is_not_missing_any_more(tmp_path):
    from sysid.board import BoardEffect

    truth = BY_NAME["coulomb 0.15, heavy"]
    board = truths.board_of(truth)
    known = BoardEffect("coulomb", {"torque": Quantity(0.15, 0.01, "N*m")})
    richer = type(board)(**{**{f: getattr(board, f) for f in board.__slots__}, "effects": (known,)})
    result = diagnose(truths.make(truth, 40, tmp_path), richer)
    assert result.verdict.status == "none-missing", result.verdict
    assert all("coulomb" not in candidate.effects for candidate in result.candidates)


def test_what_json_cannot_hold_becomes_null():
    """A model that runs away has an infinite error; the file says null."""
    from types import SimpleNamespace

    from sysid.diagnosis.diagnose import Candidate, Hint, Verdict
    from sysid.diagnosis.importance import Importance
    from sysid.diagnosis.report import to_json

    lost = Candidate(
        effects=("freeplay",), rmse=np.inf, heldout_rmse=-np.inf, score=np.nan, score_std=np.nan,
        parameters={"stiffness": Quantity(np.inf, np.nan, "N*m/rad", "x")},
    )  # fmt: skip
    size = Importance(
        torque_share=np.inf, energy_share=0.1, amplitude_after_10_periods=0.0, signal_share=0.0, each={}
    )
    verdict = Verdict(
        status="none-missing", effects=(), families=(), confidence=0.9, indistinguishable_from=((),), error_before=np.inf,
        error_after=1e-3, explained=0.5, matters=size, remainder=np.nan, remainder_text="",
        hints=(Hint(effects=("coulomb",), size=size, text="x"),), next_experiment="", explanation="",
    )  # fmt: skip
    result = SimpleNamespace(
        noise=SimpleNamespace(std=1e-3), baseline=lost, candidates=(lost,), verdict=verdict,
        shares={"freeplay": np.nan}, doubts=(), learned=None, board="pink", logs=("a.csv",), swing_frequency=None, heldout_before=(np.inf,), heldout_after=(0.1,),
    )  # fmt: skip
    content = json.loads(json.dumps(to_json(result), allow_nan=False))
    first = content["candidates"][0]
    assert first["rmse_rad"] is first["heldout_rmse_rad"] is first["score"] is None
    assert first["parameters"]["stiffness"]["value"] is None
    assert content["verdict"]["error_before_rad"] is None
    assert content["verdict"]["error_after_rad"] == 1e-3
    assert content["verdict"]["heldout_nrmse_before"] == [None]
    assert content["verdict"]["share_of_peak_torque"]["freeplay"] is None
    assert content["verdict"]["matters"]["torque_share"] is None
    assert content["verdict"]["remainder"]["rmse_rad"] is None
    assert content["verdict"]["hints"][0]["size"]["energy_share"] == 0.1


def release(roll, time, **changes):
    fields = {"log": "x", "number": 1, "origin": "angle", "rest": 0.0, "hold": 1.0, "end": "log"}
    return Release(time=time, roll=roll, std=np.full(len(time), 1e-3), **{**fields, **changes})


def made(law, seconds, angle=0.15, noise=1e-3, seed=0):
    time = np.arange(0.0, seconds, 2e-3)
    return release(
        simulate(law, time, angle).roll + noise * np.random.default_rng(seed).standard_normal(len(time)), time
    )


LAW = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.05)


@pytest.fixture(scope="module")
def pink():
    return load_board(shipped_data() / "boards" / "pink.toml")


def synthetic(name, seed, effects, folder, *, noise_deg=0.05, **options):
    """Releases of a shipped board with a hidden effect, by the hand of the synthesiser."""
    from sysid.logs import read_roll
    from sysid.releases import find_releases
    from sysid.synth import SynthOptions, synthesise
    from sysid.synth.sensors import Sensor

    board = load_board(shipped_data() / "boards" / f"{name}.toml")
    how = SynthOptions(
        angles=(0.175, -0.154, 0.132), seed=seed, sensor=Sensor(noise=np.radians(noise_deg)), **options
    )
    synthesise(board, effects, how).save(folder / "log.csv")
    return find_releases(read_roll(folder / "log.csv")), board


@pytest.mark.parametrize(
    ("name", "seed", "effects"),
    [
        (
            "pink",
            801,
            {"hysteresis": (4.0, 0.12)},
        ),  # starts as the hold left it, 4 ms before the first sample
        ("pink", 803, {"viscoelastic": (5.0, 0.08)}),
    ],
)
@pytest.mark.slow
def test_what_acts_at_the_start_is_named_alone(name, seed, effects, tmp_path):
    verdict = diagnose(*synthetic(name, seed, effects, tmp_path)).verdict
    assert verdict.status == "missing"
    assert set(verdict.effects) == set(effects), verdict


@pytest.mark.slow
def test_a_stop_that_hardly_acts_is_not_claimed_to_matter(tmp_path):
    """It is touched in the first milliseconds only and moves 0.4 % of the motion: a hint at most, never 'unexplained'."""
    result = diagnose(*synthetic("black", 802, {"end-stop": (0.1, 300.0, 0.5)}, tmp_path))
    assert result.verdict.status == "none-missing", result.verdict
    assert result.verdict.error_after < 1.15 * result.noise.std
    assert any("end-stop" in candidate.effects for candidate in result.candidates[:5])


@pytest.fixture(scope="module")
def slider(tmp_path_factory):
    """Releases of a slider, with the search that a diagnosis makes of them."""
    from sysid.diagnosis.search import Search
    from sysid.fitting.records import make_records
    from sysid.fitting.search import scales_of
    from sysid.noise.floor import noise_floor

    releases, board = synthetic("pink", 801, {"hysteresis": (4.0, 0.12)}, tmp_path_factory.mktemp("slider"))
    records = make_records(releases, noise_floor(releases).std, rate=False)
    return Search(records=records, scales=scales_of(records, board), bias="shared")


def test_an_effect_stuck_alone_is_found_again_from_its_pair(slider):
    """A single model in a false valley is replaced by what is left of the pair without the other effect."""
    from dataclasses import replace

    from sysid.least_squares import minimise

    good = slider.single(("hysteresis",))
    problem = good.problem
    start = problem.start(
        {
            **good.parameters,
            "stiffness": slider.scales.stiffness,
            "hysteresis.stiffness": 0.0,
            "hysteresis.torque": 1.0,
        }
    )
    stuck = replace(good, minimum=minimise(problem.normal, start, *problem.bounds(), iterations=1))
    pair = slider.union(good, slider.single(("cubic-stiffness",)))
    assert stuck.cost > 1.5 * good.cost
    found = {m.effects: m for m in slider.reduced([pair], [stuck])}
    assert found[("hysteresis",)].cost < 1.1 * good.cost
    assert ("cubic-stiffness",) in found


def test_a_start_faster_than_from_rest_is_charged(slider):
    model = slider.single(())
    problem = model.problem
    at_rest = problem.start({**model.parameters})
    own = len(problem.names)
    for index in range(3):
        at_rest[own + 2 * index + 1] = 0.0
    assert problem.start_penalty(at_rest) == 0.0
    side = np.sign(slider.records[0].release.roll[0])
    pushed, dragged = at_rest.copy(), at_rest.copy()
    pushed[own + 1], dragged[own + 1] = -0.5 * side, 0.5 * side
    assert problem.start_penalty(pushed) > 10.0
    assert problem.start_penalty(dragged) == 0.0
    low, high = (problem.normal(pushed + e * np.eye(len(pushed))[own + 1]).cost for e in (-1e-5, 1e-5))
    slope = problem.normal(pushed).gradient[own + 1]
    assert slope == pytest.approx((high - low) / 2e-5, rel=1e-3)


@pytest.mark.parametrize(("late", "push", "warned"), [(0.0, 0.0, False), (1.5, 0.0, False), (0.0, 0.6, True)])
def test_releases_that_the_noise_hid_for_a_while_were_not_pushed(late, push, warned):
    """However many there are: `late` in times that a release from rest takes to leave the noise, `push` in amplitudes times ω."""
    law, noise = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.1), 1e-3
    rng, time, records = np.random.default_rng(0), np.arange(0.0, 1.2, 4e-3), []
    for number in range(6):
        angle = (-1) ** number * (0.17 - 0.01 * number)
        hidden = np.sqrt(2 * noise / abs(angle)) / law.frequency
        path = simulate(law, np.r_[0.0, time + late * hidden + 1e-9], angle, -push * angle * law.frequency)
        roll = path.roll[1:] + noise * rng.standard_normal(len(time))
        records.append(
            Release(
                log="x", number=number, time=time, roll=roll, std=np.full(len(time), noise), origin="angle",
                rest=0.0, hold=1.0, end="log",
            )
        )  # fmt: skip
    records = make_records(records, noise, rate=False)
    board = load_board(shipped_data() / "boards" / "pink.toml")
    search = Search(records=records, scales=scales_of(records, board), bias="shared")
    assert bool(_fast_starts(search.single(()))) is warned


def test_what_a_start_is_charged_builds_no_integrator(slider):
    """A hundred models are reported; building the functions of each would cost more than reporting it."""
    from sysid.fitting.problem import Problem
    from sysid.joint.structure import structure_of

    problem = Problem(structure_of(("stribeck", "end-stop")), slider.records, slider.scales)
    problem.start_penalty(np.zeros(len(problem.sizes())))
    assert "_paths" not in vars(problem)


def test_a_search_goes_on_where_another_ended_without_looking_again(slider):
    from sysid.least_squares import minimise

    model = slider.single(())
    calls = []

    def watched(point):
        calls.append(point)
        return model.problem.normal(point)

    start, bounds = 1.02 * model.minimum.point, model.problem.bounds()
    again = minimise(watched, start, *bounds)
    seen = len(calls)
    calls.clear()
    known = minimise(watched, start, *bounds, known=model.problem.normal(np.clip(start, *bounds)))
    np.testing.assert_array_equal(known.point, again.point)
    assert len(calls) == seen - 1 == known.evaluations


def test_too_short_for_a_verdict_is_said(pink):
    with pytest.raises(SysidError, match="too short for a verdict"):
        diagnose([made(LAW, 0.06)], pink)


def test_few_samples_of_several_releases_are_enough(pink):
    """Of a slow gyro's stiff board no release alone holds as many."""
    few = [made(LAW, 1.0, seed=seed)[::23][:22] for seed in range(3)]
    assert all(len(r.time) < 24 for r in few)
    period = float(np.ptp(few[0].time))
    check_releases(few, pink, period)
    with pytest.raises(SysidError, match="too short for a verdict"):
        check_releases(few[:1], pink, period)


def test_degrees_taken_for_radians_are_said(pink):
    base = made(LAW, 1.0)
    with pytest.raises(SysidError, match="--unit deg"):
        diagnose([release(np.degrees(base.roll), base.time)], pink)


@pytest.mark.slow
def test_a_board_that_changed_between_releases_is_unexplained(pink):
    soft, hard = LAW, JointLaw(inertia=8.7e-3, stiffness=16.5, damping=0.05)
    releases = [made(law, 1.0, seed=i) for i, law in enumerate((soft, hard, soft))]
    found = diagnose(releases, pink)
    assert found.verdict.status == "unexplained"
    assert "changed between the releases" in found.verdict.explanation
    assert found.verdict.next_experiment.startswith("Repeat the first release later")
    assert found.learned is None  # no torque of tilt and rate stands for it
    assert "learned" not in found.report()


@pytest.mark.slow
def test_a_rest_that_moved_between_releases_is_no_hysteresis(pink):
    """A slider that never slips has a free place in each release, and would stand for a sensor that was knocked."""
    moved = [made(LAW, 1.0, angle, seed=i) for i, angle in enumerate((0.15, -0.13, 0.1))]
    releases = [
        release(one.roll + shift, one.time) for one, shift in zip(moved, (0.0, 0.02, 0.02), strict=True)
    ]
    found = diagnose(releases, pink)
    assert found.verdict.status == "unexplained"
    assert "rest that moved between the releases" in found.verdict.explanation


@pytest.mark.slow
def test_command_line_gives_the_binding_json(tmp_path):
    log = shipped_data() / "decays" / "pink_hidden.csv"
    done = subprocess.run(
        [sys.executable, "-m", "sysid.cli", "diagnose", str(log), "--board", "pink", "--json", "-",
         "--workspace", str(tmp_path)], capture_output=True, text=True, check=True,
    )  # fmt: skip
    content = json.loads(done.stdout)
    assert content["verdict"]["status"] == "missing"
    assert content["verdict"]["effects"] == ["coulomb"]
    assert content["verdict"]["families"] == ["friction"]
    assert content["verdict"]["explained"] >= 0.8
    assert content["verdict"]["matters"]["torque_share"] > 0.01
    assert "°" in content["verdict"]["next_experiment"]
    assert 0 < content["verdict"]["confidence"] < 1
    assert content["verdict"]["error_after_rad"] < 1.15 * content["noise_floor_rad"]
    assert content["verdict"]["error_before_rad"] > 1.2 * content["noise_floor_rad"]
    coulomb = next(c for c in content["candidates"] if c["effects"] == ["coulomb"])
    assert coulomb["parameters"]["coulomb.torque"]["value"] == pytest.approx(0.15, rel=0.25)
    assert set(content["baseline"]) == {"rmse_rad", "heldout_rmse_rad"}
