"""What is fitted of a release, and what a fit says against the record."""

import pickle
from dataclasses import replace

import hidden_truths as truths
import numpy as np
import pytest

from sysid.diagnosis.against_record import record_deviation
from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.search import Search
from sysid.effects import effect
from sysid.errors import SysidError
from sysid.fitting.records import make_records
from sysid.fitting.search import scales_of
from sysid.noise.floor import noise_floor

BY_NAME = {truth.name: truth for truth in truths.TRUTHS}
SEED = 60


def fitted(name, effects, tmp_path, **changes):
    """A model fitted to the single samples of a log of the hidden-effect suite."""
    truth = replace(BY_NAME[name], **{"rates": (500.0,), "noises": (0.04,), **changes})
    releases = truths.make(truth, SEED, tmp_path)
    records = make_records(releases, noise_floor(releases).std, rate=False)
    searcher = Search(records=records, scales=scales_of(records, truths.board_of(truth)), bias="shared")
    return searcher.fine(searcher.single(effects), average=1)


def test_a_problem_goes_to_another_process_and_back(tmp_path):
    model = fitted("none, heavy", ("coulomb",), tmp_path)
    copy = pickle.loads(pickle.dumps(model))
    assert copy.problem.normal(model.minimum.point).cost == model.minimum.normal.cost


def test_a_drift_goes_on_between_releases(tmp_path):
    """A sensor that drifts does not start again at each release."""
    model = fitted("sensor-drift -0.02", ("sensor-drift",), tmp_path)
    assert model.parameters["sensor-drift.rate"] == pytest.approx(-0.02, rel=0.02)
    assert model.rmse < 1.02 * model.problem.records[0].std


def test_a_drift_from_release_to_release_may_be_wider_than_any_swing(tmp_path):
    """The rest angle of the log's first sample lies far from where the releases come to rest."""
    truth, drift = BY_NAME["none"], 0.06
    releases = [
        replace(r, roll=r.roll + drift * r.time, rest=r.rest + drift * float(r.time[-1]))
        for r in truths.make(truth, SEED, tmp_path)
    ]
    records = make_records(releases, noise_floor(releases).std, rate=False)
    scales = scales_of(records, truths.board_of(truth))
    assert sorted(r.rest for r in releases)[1] > 2 * scales.amplitude
    searcher = Search(records=records, scales=scales, bias="shared")
    model = searcher.fine(searcher.single(("sensor-drift",)), average=1)
    assert model.parameters["sensor-drift.rate"] == pytest.approx(drift, rel=0.01)
    assert model.rmse < 1.05 * records[0].std


def test_the_last_of_a_swing_is_no_noise(tmp_path):
    """The stretch at rest still swings a little; it must not raise the noise floor."""
    releases = [replace(r, end="rest") for r in truths.make(replace(BY_NAME["none"], noises=(0.2,), rates=(1000.0,)), 31, tmp_path)]  # fmt: skip
    assert noise_floor(releases).std == pytest.approx(np.radians(0.2), rel=0.03)


def test_a_filter_is_found_though_the_release_is_noticed_late(tmp_path):
    """Behind a filter of 15 ms the first milliseconds look like rest; the fit knows that the reading trails."""
    model = fitted("lowpass 0.015", ("lowpass",), tmp_path)
    assert model.parameters["lowpass.time_constant"] == pytest.approx(0.015, rel=0.02)
    assert model.parameters["damping"] == pytest.approx(0.04, rel=0.02)
    assert model.rmse < 1.03 * model.problem.records[0].std
    starts = model.minimum.point[len(model.problem.names) :].reshape(3, 2) * model.problem.sizes()[-2:]
    assert np.all(starts[:, 0] * starts[:, 1] < 0), "no release was late, so this log tests nothing"


def test_where_a_deck_sticks_is_no_shift_of_its_rest_angle(tmp_path):
    """From one short release friction, stiffness and rest angle trade places, which a linearised deviation does not see."""
    truth = BY_NAME["coulomb 0.15, heavy"]
    (release, *_), board = truths.make(truth, 3007, tmp_path), truths.board_of(truth)
    records = make_records([release], noise_floor([release]).std, rate=False)
    searcher = Search(records=records, scales=scales_of(records, board), bias="shared")
    model = searcher.fine(searcher.single(("coulomb",)), average=1)
    assert record_deviation(model, board, look_at_linear=False).effects == ()
    moved = board.with_tilt(rest_angle=replace(board.tilt["rest_angle"], value=0.08))
    assert record_deviation(model, moved, look_at_linear=False).effects == ("offset",)
    nothing = {name: replace(moved.tilt[name], value=0.0, std=0.0) for name in ("stiffness", "damping")}
    fresh = record_deviation(model, moved.with_tilt(**nothing), look_at_linear=False)
    assert fresh.effects == ()  # what was never measured did not move
    assert "no rest angle yet" in fresh.text


@pytest.mark.parametrize(
    ("effect_name", "values"), [("viscoelastic", (0.15, 0.02)), ("second-mode", (0.002, 1200.0, 1.0))]
)
def test_what_is_too_weak_to_bend_a_decay_is_among_what_may_have_moved_k_and_d(tmp_path, effect_name, values):
    """Rubber adds stiffness and damping at the one frequency of a decay, a support takes from them; what is simpler comes first."""
    truth = truths.Truth("weak", {effect_name: values}, rates=(500.0,), noises=(0.04,))
    releases, board = truths.make(truth, SEED, tmp_path), truths.board_of(truth)
    records = make_records(releases, noise_floor(releases).std, rate=False)
    searcher = Search(records=records, scales=scales_of(records, board), bias="shared")
    model = searcher.fine(searcher.single(()), average=1)
    deviation = record_deviation(model, board, look_at_linear=True)
    named = [deviation.effects, *deviation.alike]
    assert (effect_name,) in named
    sizes = [len(effect(name).parameters) for (name,) in named]
    assert sizes == sorted(sizes)


def test_what_a_record_states_counts_however_it_was_measured(tmp_path):
    """Stiffness and damping that a user wrote with their deviations, without the peaks that they are from."""
    model, truth = fitted("clock 1.06", (), tmp_path), BY_NAME["clock 1.06"]
    board = replace(truths.board_of(truth), decay={}, fit=None)
    deviation = record_deviation(model, board, look_at_linear=True)
    assert ("clock",) in (deviation.effects, *deviation.alike)


def test_a_support_that_moves_k_and_d_as_nothing_simpler_does_is_told_and_not_named(tmp_path):
    """It has three numbers, and two changed: that they did says as much."""
    truth = truths.Truth("soft", {"second-mode": (0.01, 500.0, 0.3)}, rates=(500.0,), noises=(0.04,))
    releases, board = truths.make(truth, SEED, tmp_path), truths.board_of(truth)
    records = make_records(releases, noise_floor(releases).std, rate=False)
    searcher = Search(records=records, scales=scales_of(records, board), bias="shared")
    deviation = record_deviation(searcher.fine(searcher.single(()), average=1), board, look_at_linear=True)
    assert (deviation.effects, deviation.alike) == ((), ())
    assert "'second-mode' (compliant support)" in deviation.text
    assert "brings the record up to date" in deviation.text


@pytest.mark.parametrize(("share", "effects"), [(0.009, ()), (0.011, ("offset",))])
def test_a_hundredth_of_the_amplitude_is_a_shift_that_matters(share, effects, tmp_path):
    """Of the amplitude that was released, not of the size that the problem is scaled by."""
    model, board = fitted("none, heavy", (), tmp_path), truths.board_of(BY_NAME["none, heavy"])
    rest = model.parameters["rest_angle"]
    widest = max(abs(angle - rest) for angle, _ in model.problem.starts(model.minimum.point))
    known = replace(board.tilt["rest_angle"], value=rest + share * widest, std=0.0)
    assert record_deviation(model, board.with_tilt(rest_angle=known), look_at_linear=False).effects == effects


@pytest.mark.parametrize(
    ("name", "shifts"), [("offset", True), ("sensor-drift", True), ("hysteresis", False), ("coulomb", False)]
)
def test_what_holds_the_deck_aside_by_its_past_is_no_shift_of_the_middle(name, shifts):
    """A slider shows in the shape of each swing too, so it may explain where the deck rests; what only moves the middle may not."""
    from sysid.diagnosis.against_record import _shifts

    assert _shifts(name) is shifts


def test_one_release_cannot_tell_a_drift_from_a_shift(tmp_path):
    truth = replace(BY_NAME["offset -0.01, heavy"], rates=(500.0,), noises=(0.2,))
    releases = truths.make(truth, SEED, tmp_path)
    board = truths.board_of(truth)
    for some, alike in ((releases[:1], True), (releases, False)):
        records = make_records(some, noise_floor(some).std, rate=False)
        searcher = Search(records=records, scales=scales_of(records, board), bias="shared")
        deviation = record_deviation(
            searcher.fine(searcher.single(()), average=1), board, look_at_linear=False
        )
        assert deviation.effects == ("offset",)
        assert (("sensor-drift",) in deviation.alike) == alike


def test_a_release_too_short_for_differences_leaves_the_noise_to_the_others(tmp_path):
    releases = truths.make(replace(BY_NAME["none"], noises=(0.1,), rates=(500.0,)), SEED, tmp_path)
    stub = replace(releases[0], **{n: getattr(releases[0], n)[:9] for n in ("time", "roll", "std")})
    assert noise_floor([stub, *releases[1:]]).std == pytest.approx(np.radians(0.1), rel=0.05)
    with pytest.raises(SysidError, match="has 9 samples"):
        noise_floor([stub])


@pytest.mark.slow
def test_coloured_noise_and_coarse_steps_raise_no_alarm(tmp_path):
    for name in ("none, noise of 30 ms", "none, coarse steps"):
        truth = BY_NAME[name]
        result = diagnose(truths.make(truth, 3, tmp_path), truths.board_of(truth))
        assert result.verdict.status == "none-missing", (name, result.verdict)
        if name == "none, coarse steps":  # the floor is of the white part: noise that lasts 30 ms is above it
            assert result.verdict.error_after < 1.15 * result.noise.std


@pytest.mark.slow
def test_a_weak_filter_that_moves_the_stiffness_is_an_explanation(tmp_path):
    """What does not show in the decay's shape may still have moved k and d against the record."""
    truth = BY_NAME["lowpass 0.01, heavy"]
    verdict = diagnose(truths.make(truth, 31, tmp_path), truths.board_of(truth)).verdict
    assert {"lowpass"} in [set(verdict.effects), *map(set, verdict.indistinguishable_from)]
