"""One judgement: what counts as equally good, what matters, and the experiment that decides."""

import math
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.board import load_board
from sysid.diagnosis.against_record import Deviation
from sysid.diagnosis.diagnose import (
    Diagnosis,
    _experiment,
    _hints,
    _judged,
    _material,
    _missing,
    _nothing,
    _outside,
)
from sysid.diagnosis.error_model import Fitted
from sysid.diagnosis.experiment import DECIDED, deciding, widest
from sysid.diagnosis.importance import _amplitude_share, _energy_share, importance, reading_share
from sysid.diagnosis.judgement import (
    FEWEST_BLOCKS,
    INEXACT,
    NEGLIGIBLE,
    PRICE,
    TEMPERATURE,
    TIE,
    UNMET,
    Field,
    families_of,
    still_noise,
)
from sysid.diagnosis.search import Candidate, Search
from sysid.diagnosis.surrogates import surrogate
from sysid.diagnosis.wording import size_in_words
from sysid.fitting.records import make_records
from sysid.fitting.search import scales_of
from sysid.joint import JointLaw, simulate
from sysid.quantity import Quantity
from sysid.roll import Release
from sysid.workspace import shipped_data

NOISE = 1e-3
LAW = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.05)


def releases_of(law, noise):
    rng, time = np.random.default_rng(0), np.arange(0.0, 1.6, 4e-3)
    return [
        Release(
            log="x", number=n, time=time, roll=simulate(law, time, angle).roll + noise(rng, len(time)),
            std=np.full(len(time), NOISE), origin="angle", rest=0.0, hold=1.0, end="log",
        )
        for n, angle in enumerate((0.17, -0.14, 0.1), start=1)
    ]  # fmt: skip


def white(rng, count):
    return NOISE * rng.standard_normal(count)


def lasting(rng, count):
    """Noise of 20 ms, three times as large as what it jumps from sample to sample."""
    return lfilter([3 * NOISE * np.sqrt(1 - 0.82**2)], [1, -0.82], rng.standard_normal(count + 100))[100:]


def tried(law, names, noise=white):
    """Fitted and predicted: the linear joint and some effects alone."""
    board = load_board(shipped_data() / "boards" / "pink.toml")
    records = make_records(releases_of(law, noise), NOISE, rate=False)
    search = Search(records=records, scales=scales_of(records, board), bias="shared")
    linear = search.single(())
    models = [linear, *(search.single((name,), linear) for name in names)]
    final = search.foretold(search.finalists(models))
    return search, Field(final, (), 2 * np.pi / search.scales.frequency, NOISE)


@pytest.fixture(scope="module")
def friction():
    return tried(LAW.with_effect("coulomb", 0.08), ("coulomb", "quadratic-damping", "stribeck"))


def test_a_law_that_is_only_another_one_here_is_no_candidate(friction):
    """Stribeck friction that does not fall within the log's rates is Coulomb's, with numbers that nothing tells."""
    _, field = friction
    assert field.winner().model.effects == ("coulomb",)
    stribeck = next(s for s in field.scored if s.model.effects == ("stribeck",))
    assert stribeck.model.at_edge
    assert stribeck.score == pytest.approx(field.best.score, abs=TIE)
    assert {s.model.effects for s in field.near(field.best)} == {("coulomb",)}


@pytest.mark.parametrize(("gained", "possible"), [(2.0, False), (20.0, True)])
def test_what_is_no_likelier_than_a_law_at_its_edge_that_it_contains_is_no_candidate(
    friction, monkeypatch, gained, possible
):
    """An idle effect that takes a stop off its bound does not make a stop of it."""
    _, field = friction
    edged = next(s for s in field.scored if s.model.effects == ("stribeck",))
    pair = replace(
        edged, model=replace(edged.model, effects=("quadratic-damping", "stribeck")),
        score=edged.score + gained, choices=edged.choices + 2,
    )  # fmt: skip
    monkeypatch.setattr(Candidate, "edged", lambda model, exact: model.effects == ("stribeck",))
    monkeypatch.setattr(field, "scored", [*field.scored, pair])
    assert (pair in field._possible()) is possible


def test_when_a_wave_comes_is_no_choice_but_what_changed_between_releases_is(friction):
    search, field = friction
    linear, heldout = field.base.model, field.base.model.heldout
    wave, changed = (
        field.score(replace(surrogate(search, linear, (), shape), heldout=heldout))
        for shape in ("sin t", "k d")
    )
    assert wave.choices == 1 + 2  # strength and frequency
    assert changed.choices >= 1 + 3  # a spring in each release at least


def test_what_is_scored_on_the_same_motion_is_not_scored_again(friction):
    search, field = friction
    models = [s.model for s in field.scored]
    period = 2 * np.pi / search.scales.frequency
    assert Field(models, (), period, NOISE, known=field).best is field.best
    closer = replace(field.best.model, minimum=replace(field.best.model.minimum))
    # Another is the nearest: its motion counts.
    again = Field([closer, *models], (), period, NOISE, known=field)
    assert again.best is not field.best
    assert again.best.score == pytest.approx(field.best.score)


def test_a_prediction_that_ran_away_explains_nothing(friction):
    _, field = friction
    best = field.best.model
    lost = field.score(replace(best, heldout=tuple(np.full_like(one, np.nan) for one in best.heldout)))
    assert field.explained(lost) == 0.0
    assert field.left(lost) == np.inf


@pytest.mark.parametrize(("shape", "choices", "missing"), [("", 2, True), ("x⁵", 2, False), ("", 5, False)])
def test_what_is_richer_or_what_nobody_has_met_must_gain_more_to_show_that_something_is_missing(
    friction, monkeypatch, shape, choices, missing
):
    """And nothing is named that is less likely than the joint as it is."""
    _, field = friction
    gained = TEMPERATURE * (PRICE * 2 + UNMET) + 1.0
    other = replace(
        field.best,
        model=replace(field.best.model, shape=shape),
        choices=choices,
        score=field.base.score + gained,
    )
    monkeypatch.setattr(field, "scored", [field.base, other])
    monkeypatch.setattr(field, "possible", [field.base, other])
    monkeypatch.setattr(Field, "_follows", lambda self, scored: False)
    monkeypatch.setattr(Field, "behind", lambda self, scored: 0.0 if scored is other else TIE + 1)
    assert field._follows_motion() is missing
    assert field.winner() is (other if choices == 2 else field.base)


def test_of_those_not_told_apart_a_law_of_three_parameters_is_no_simpler_than_two_of_one(
    friction, monkeypatch
):
    """Each effect counts, and each parameter of its law; among as simple ones the likeliest wins."""
    _, field = friction
    by_name = {s.model.effects: s for s in field.scored}
    assert {names: s.choices for names, s in by_name.items()} == {
        (): 0, ("coulomb",): 2, ("quadratic-damping",): 2, ("stribeck",): 4,
    }  # fmt: skip
    rich = by_name["stribeck",]
    pair = replace(by_name["quadratic-damping",], extra=2, choices=4, score=rich.score + 1.0)
    monkeypatch.setattr(Field, "behind", lambda self, scored: 0.0)
    monkeypatch.setattr(Field, "explained", lambda self, scored: 1.0)
    for changes, winner in (({}, 1), ({"score": rich.score - 1.0}, 0), ({"choices": 3}, 1)):
        pair = replace(pair, **changes)
        monkeypatch.setattr(field, "possible", [rich, pair])
        assert field.winner() is (rich, pair)[winner]


@pytest.mark.parametrize(
    ("choices", "moved", "winner"), [(5, 0, 0), (5, 1, 1), (6, 1, 0), (7, 1, 0)], ids=str
)
def test_what_the_record_must_be_wrong_for_is_one_effect_more(friction, monkeypatch, choices, moved, winner):
    """Two effects beside a rest angle that moved are no simpler than two with one parameter more."""
    _, field = friction
    one = replace(field.best, extra=2, choices=4)
    other = replace(field.base, extra=2, choices=choices, score=one.score + 1.0)
    monkeypatch.setattr(Field, "behind", lambda self, scored: 0.0)
    monkeypatch.setattr(Field, "explained", lambda self, scored: 1.0)
    monkeypatch.setattr("sysid.diagnosis.judgement.odds", lambda scored: 0.0)
    monkeypatch.setattr(field, "possible", [one, other])
    assert field.winner(lambda model: moved * (model is one.model)) is (one, other)[winner]


@pytest.mark.parametrize(
    ("beaten", "shares", "winner"), [(True, (0.5, 0.9), 2), (True, (0.5, 0.7), 1), (False, (0.5, 0.9), 0)]
)
def test_where_something_is_missing_what_does_not_explain_it_is_no_answer(
    friction, monkeypatch, beaten, shares, winner
):
    """If anything does: a bent spring is simpler than a stop, and takes half of the error away."""
    _, field = friction
    models = [field.base, *(replace(field.best, extra=1, choices=choices) for choices in (2, 4))]
    explained = {id(model): share for model, share in zip(models, (0.0, *shares), strict=True)}
    monkeypatch.setattr(field, "possible", models)
    monkeypatch.setattr(Field, "explained", lambda self, scored: explained[id(scored)])
    monkeypatch.setattr(
        Field, "behind", lambda self, scored: TIE + 1 if beaten and scored is self.base else 0.0
    )
    assert field.winner() is models[winner]


def test_what_looks_the_same_is_held_against_the_record_itself(friction, monkeypatch):
    """A rest angle that moved is named beside the effects that ask for it, and beside no others."""
    search, field = friction
    chosen = next(s for s in field.scored if s.model.effects == ("stribeck",))
    rival = next(s for s in field.scored if s.model.effects == ("coulomb",))
    monkeypatch.setattr(Field, "near", lambda self, scored: [chosen, rival])
    monkeypatch.setattr(
        "sysid.diagnosis.diagnose.record_deviation",
        lambda model, board, look_at_linear: Deviation(("offset",) if model.effects == ("stribeck",) else ()),
    )
    board = load_board(shipped_data() / "boards" / "pink.toml")
    size = importance(chosen.model, ("stribeck",), field.base.model)
    verdict, _ = _missing(search, field, chosen, size, (), board, frozenset())
    assert verdict.effects == ("stribeck", "offset")
    assert verdict.indistinguishable_from == (("coulomb",),)


@pytest.mark.parametrize(
    ("gap", "limit", "head", "hint"),
    [
        (TIE - 1, 0.0, "Nothing is missing beyond doubt.", "may be there, and would matter (score better by"),
        (
            TIE - 1,
            1.0,
            "Nothing is missing that matters.",
            "may be there, too weak to matter (score better by",
        ),
        (TIE + 1, 1.0, "Nothing is missing that matters.", "is seen, too weak to matter (score better by"),
    ],
)
def test_what_is_not_named_is_said_to_be_unsure_or_too_weak_to_matter(
    friction, monkeypatch, gap, limit, head, hint
):
    """A hint that would matter, if it is there, leaves open whether something is missing."""
    search, field = friction
    monkeypatch.setattr(Field, "gap", lambda self, one, other: gap)
    for size in ("TORQUE", "ENERGY", "AMPLITUDE", "SIGNAL"):
        monkeypatch.setattr(f"sysid.diagnosis.importance.{size}", limit)
    hints = _hints(search, field, field.base, None)
    board = load_board(shipped_data() / "boards" / "pink.toml")
    verdict, _ = _nothing(search, field, field.base, None, hints, board)
    assert verdict.explanation.startswith(head)
    assert hint in verdict.explanation
    assert {"coulomb"} <= {name for hint in verdict.hints for name in hint.effects}


def test_a_pair_that_is_left_unnamed_is_said_to_be_weak_or_to_explain_little(friction):
    search, field = friction
    board = load_board(shipped_data() / "boards" / "pink.toml")
    size = importance(field.best.model, ("coulomb",), field.base.model)
    verdict, _ = _nothing(search, field, field.best, size, (), board)
    assert "'coulomb' (dry friction) takes away only 1" in verdict.explanation  # of this log nearly all
    verdict, _ = _nothing(
        search,
        field,
        field.best,
        replace(size, torque_share=1e-3, energy_share=0.0, amplitude_after_10_periods=0.0, signal_share=0.0),
        (),
        board,
    )
    assert "'coulomb' (dry friction) is seen, too weak to matter. Coulomb peaks at" in verdict.explanation


def test_a_parameter_pays_more_on_a_long_log(friction):
    """Half the log of the periods from eight on: 1 nat before."""
    _, field = friction
    linear = next(s for s in field.scored if s.extra == 0)
    assert linear.errors.log_likelihood - linear.score == pytest.approx(linear.model.size * field.gain)
    assert field.gain == pytest.approx(0.5 * np.log(len(field.blocks.cuts)))
    few = Field([s.model for s in field.scored], (), 1e3, NOISE)
    assert few.gain == 1.0


def test_what_explains_nothing_cannot_win_where_something_is_missing(friction, monkeypatch):
    """Even if the data told nothing from anything, the joint without friction leaves too much."""
    _, field = friction
    monkeypatch.setattr(Field, "behind", lambda self, scored: 0.0)
    assert field.winner().model.effects == ("coulomb",)


def test_what_does_not_fade_with_the_motion_is_the_sensors_noise():
    """A fit of the noise's five sizes takes some of it for the mark of another law."""
    _, field = tried(LAW.with_effect("coulomb", 0.08), ("coulomb",), lasting)
    assert field.noise == pytest.approx(field.best.model.heldout_rmse)
    assert field.explained(field.winner()) == pytest.approx(1.0, abs=0.02)


def test_noise_that_lasts_is_neither_a_law_nor_a_model_that_is_not_exact(friction):
    """It does not fade with the motion, and no model predicts it."""
    _, field = tried(LAW, ("coulomb", "quadratic-damping"), lasting)
    assert field.base.model.rmse > INEXACT * NOISE
    assert not field.inexact
    assert not field.surely_missing
    assert field.winner() is field.base
    assert friction[1].surely_missing


@pytest.mark.parametrize(
    ("worse", "best", "told"), [(0.0106, 0.0026, True), (0.0115, 0.009, False), (0.04, 0.03, False)]
)
def test_where_no_model_is_exact_what_the_best_leaves_does_not_matter(
    friction, monkeypatch, worse, best, told
):
    """Four times the error is four times the error, though it is a hundredth of the motion."""
    _, field = friction
    left = {field.base.model.effects: worse, field.best.model.effects: best}
    monkeypatch.setattr(field, "inexact", True)
    monkeypatch.setattr(Field, "excess", lambda self, scored: (left[scored.model.effects] * self.motion) ** 2)
    assert (field.gap(field.best, field.base) > TIE) is told


def test_a_law_that_nobody_has_met_is_a_rival_by_what_is_left_where_no_model_is_exact(friction, monkeypatch):
    _, field = friction
    assert field.unmet(field.best) == 0.0
    monkeypatch.setattr(field, "inexact", True)

    def odds_if_left(share, scored=field.best):
        monkeypatch.setattr(Field, "excess", lambda self, scored: (share * self.motion) ** 2)
        return field.unmet(scored)

    assert odds_if_left(0.0) == pytest.approx(np.exp(-UNMET + PRICE * (field.best.choices - 2)))
    # Of a percent, a dozen values say two to one, six times the half of log 2, against one in twenty.
    assert odds_if_left(0.01) / odds_if_left(0.0) == pytest.approx(2**3)
    assert odds_if_left(0.001) < odds_if_left(0.01) < 1 < odds_if_left(0.03)
    assert odds_if_left(0.01, replace(field.best, choices=field.best.choices + 1)) > odds_if_left(0.01)


@pytest.mark.parametrize("calm", [True, False])
def test_noise_that_lasts_shows_at_rest_too(friction, calm):
    """Else what a model misses of the motion, and of where a deck sticks, would be the sensor's."""
    search, field = friction
    model, period = field.best.model, 2 * np.pi / search.scales.frequency
    rng, time = np.random.default_rng(1), np.arange(0.0, 2.4, 4e-3)
    ends = white(rng, len(time)) if calm else lasting(rng, len(time))
    signal = np.where(time < 0.8, 0.15 * np.cos(40 * time), 0.01) + ends

    def still(part):
        record = replace(model.problem.records[0], time=time[part], signal=signal[part])
        return still_noise(replace(model, problem=model.problem.with_(records=[record])), period)

    noise = still(slice(None))
    assert noise == pytest.approx(NOISE, rel=0.1) if calm else noise > 2 * NOISE
    assert still(slice(0, 200)) == np.inf  # it still swings where the log ends


def test_a_stop_as_soft_as_a_stop_may_be_is_no_candidate(friction):
    """Its bound keeps it from being any bend of the spring: the data ask for that bend."""
    search, field = friction
    stop = search.single(("end-stop",))
    assert not stop.at_edge
    low = stop.problem.bounds()[0]
    point = np.where(
        [name == "end-stop.stiffness" for name in stop.problem.names], low[: len(stop.problem.names)], 0.5
    )
    full = np.r_[point, stop.minimum.point[len(point) :]]
    soft = search.predicted(replace(stop, minimum=replace(stop.minimum, point=full)))
    assert soft.at_edge
    models = [*(s.model for s in field.scored), soft]
    assert all(
        s.model is not soft for s in Field(models, (), 2 * np.pi / search.scales.frequency, NOISE).possible
    )


def test_a_soft_stop_that_leaves_more_than_noise_is_a_bend_of_the_spring(friction):
    """Below a tenth of the spring it is one only where nothing else is left."""
    search, _ = friction
    stop = search.single(("end-stop",))
    point = stop.minimum.point.copy()
    point[stop.problem.names.index("end-stop.stiffness")] = 0.05
    point[stop.problem.names.index("end-stop.angle")] = 0.5
    soft = replace(stop, minimum=replace(stop.minimum, point=point))
    for error, edge in ((1.1, False), (2.0, True)):
        with patch.object(Candidate, "rmse", error * NOISE):
            assert soft.at_edge is edge


def test_what_ends_at_a_bound_is_not_told_to_be_added(friction):
    """A stop without loss is one; one whose angle is that of the widest swing is none."""
    search, _ = friction
    stop = search.single(("end-stop",))
    for name, ends in (("end-stop.damping", False), ("end-stop.angle", True)):
        at_bound = np.zeros_like(stop.minimum.at_bound)
        at_bound[stop.problem.names.index(name)] = True
        best = replace(stop, minimum=replace(stop.minimum, at_bound=at_bound))
        assert Diagnosis.ends_at_bound.__get__(SimpleNamespace(best=best)) is ends


def test_a_soft_stop_that_leaves_but_noise_that_lasts_is_one(friction):
    """How large that noise is, the judgement knows; what jumps from sample to sample is less."""
    search, _ = friction
    stop = search.single(("end-stop",))
    point = stop.minimum.point.copy()
    point[stop.problem.names.index("end-stop.stiffness")] = 0.05
    point[stop.problem.names.index("end-stop.angle")] = 0.5
    soft = replace(stop, minimum=replace(stop.minimum, point=point))
    with patch.object(Candidate, "rmse", 3 * NOISE):
        assert soft.at_edge
        assert not soft.edged(INEXACT * 3 * NOISE)


@pytest.mark.parametrize(("behind", "explains"), [(TIE - 1, True), (TIE + 1, False)])
def test_what_is_not_told_from_what_stands_in_for_it_explains_a_log(friction, monkeypatch, behind, explains):
    """An idle effect at its edge may bring noise that lasts just under what counts as noise."""
    _, field = friction
    chosen = field.winner()
    monkeypatch.setattr(Field, "is_stood_in_for", True)
    monkeypatch.setattr(field, "exact", 0.9 * chosen.model.rmse)
    monkeypatch.setattr(field, "gap", lambda one, other: behind)
    assert field.explains(chosen) is explains


@pytest.mark.parametrize("edge", [False, True])
def test_noise_that_a_model_at_an_edge_found_is_not_believed(friction, edge):
    _, field = friction
    with patch.object(Field, "_noise", lambda _: 3 * NOISE), patch.object(Candidate, "at_edge", edge):
        again = Field([s.model for s in field.scored], (), 0.15, NOISE)
    assert again.exact == pytest.approx(INEXACT * NOISE * (1 if edge else 3))


def test_a_filter_takes_the_reading_from_the_roll_by_its_lag():
    """By frequency times time constant of the motion, though a decay that lags decays all the same."""
    _, field = tried(LAW.with_effect("lowpass", 3e-3), ("lowpass",))
    (lagging,) = (s.model for s in field.scored if s.model.effects)
    assert reading_share(lagging, ["lowpass"]) == pytest.approx(41.1 * 3e-3, rel=0.15)
    assert reading_share(field.base.model, []) == 0.0


def test_a_filter_is_never_named_without_the_hand_that_does_the_same(monkeypatch):
    """No law that is fitted lets go slowly, so none is its rival."""
    search, field = tried(LAW.with_effect("lowpass", 3e-3), ("lowpass",))
    (lagging,) = (s for s in field.scored if s.model.effects)
    monkeypatch.setattr(Field, "rivals", lambda self, one: [])
    board = load_board(shipped_data() / "boards" / "pink.toml")
    assert "a hand that lets go slowly. Compare the first" in _experiment(search, field, lagging, board)
    assert _experiment(search, field, field.base, board) == ""


@pytest.mark.parametrize(("choices", "status"), [(5, "missing"), (2, "none-missing")])
def test_a_lag_is_the_readings_if_nothing_as_simple_does_as_well(monkeypatch, choices, status):
    """What is richer may always be made to do as well."""
    search, field = tried(LAW.with_effect("lowpass", 3e-3), ("lowpass", "cubic-damping"))
    by_name = {s.model.effects: s for s in field.scored}
    chosen, other = by_name["lowpass",], replace(by_name["cubic-damping",], choices=choices)
    monkeypatch.setattr(Field, "near", lambda self, one: [chosen, other])
    for size in ("TORQUE", "ENERGY", "AMPLITUDE"):
        monkeypatch.setattr(f"sysid.diagnosis.importance.{size}", 1.0)
    monkeypatch.setattr("sysid.diagnosis.importance.SIGNAL", 0.03)
    board = load_board(shipped_data() / "boards" / "pink.toml")
    verdict, *_ = _judged(search, field, chosen.model, board, frozenset())
    assert verdict.status == status


@pytest.mark.parametrize(
    ("hidden", "named"),
    [
        (("exact", "noise"), {"coulomb"}),
        (("noise",), {"coulomb", "end-stop"}),
        (("exact",), {"coulomb", "end-stop"}),
    ],
    ids=["in neither", "in single samples", "in their means"],
)
def test_what_lifts_the_error_out_of_the_noise_is_noticed(monkeypatch, hidden, named):
    """However little of the motion it is, where one model is at the noise and one without it is not; else the one stays without which more is missed."""
    law = LAW.with_effect("coulomb", 0.05).with_effect("end-stop", 0.12, 30.0, 0.0)
    board = load_board(shipped_data() / "boards" / "pink.toml")
    records = make_records(releases_of(law, white), NOISE, rate=False)
    search = Search(records=records, scales=scales_of(records, board), bias="shared")
    linear = search.single(())
    one, other = (search.single((name,), linear) for name in ("coulomb", "end-stop"))
    final = search.foretold(search.finalists([linear, one, other, search.union(one, other)]))
    field = Field(final, (), 2 * np.pi / search.scales.frequency, NOISE)
    monkeypatch.setattr("sysid.diagnosis.diagnose.UNNOTICED", 1.0)
    monkeypatch.setattr("sysid.diagnosis.diagnose.MATERIAL", 1.0)
    for level in hidden:
        monkeypatch.setattr(field, level, 1.0)
    winner, _, idle = _material(search, field, final, board)
    assert set(winner.effects) == named
    assert idle == (set() if len(named) == 2 else {"stop"})


def test_what_a_decay_of_many_swings_is_missed_by_matters_however_small_its_torque():
    """What changes its frequency by little is out of step in the end."""
    law = replace(LAW, damping=0.004).with_effect("cubic-stiffness", 4.5)
    _, field = tried(law, ("cubic-stiffness",))
    (bent,) = (s.model for s in field.scored if s.model.effects)
    size = importance(bent, ["cubic-stiffness"], field.base.model)
    assert max(size.torque_share, size.amplitude_after_10_periods) < 0.01 < size.signal_share
    assert size.matters
    assert "it makes" in size_in_words(size)


def test_the_likeliest_families_are_those_that_are_there(friction):
    _, field = friction
    assert field.confidence(frozenset({"friction"})) > 0.99
    assert sum(field.likely().values()) == pytest.approx(1.0)


def test_what_next_to_nothing_of_few_periods_is_made_of_is_not_told(friction, monkeypatch):
    """Unless a model reaches the floor, or the periods are enough for a law to come back."""
    _, field = friction
    monkeypatch.setattr(Field, "left", lambda self, scored: 0.9 * NEGLIGIBLE)
    assert not field.slight
    monkeypatch.setattr(field, "floor", 0.5 * NOISE)
    assert len(field.blocks.cuts) >= FEWEST_BLOCKS
    assert not field.slight
    few = replace(field.blocks, cuts=field.blocks.cuts[: FEWEST_BLOCKS - 1])
    monkeypatch.setattr(field, "blocks", few)
    assert field.slight
    monkeypatch.setattr(field, "floor", NOISE)
    assert not field.slight
    monkeypatch.setattr(field, "floor", 0.5 * NOISE)
    monkeypatch.setattr(Field, "left", lambda self, scored: 1.1 * NEGLIGIBLE)
    assert not field.slight


def test_what_is_there_explains_all_and_is_certain(friction):
    _, field = friction
    assert field.explained(field.winner()) > 0.97
    assert field.chance_explained(field.winner(), 0.8, 0.05) > 0.99
    assert field.confidence(frozenset({"friction"})) > 0.99
    assert field.explained(field.base) == 0.0


def test_a_clean_log_names_nothing():
    _, field = tried(LAW, ("coulomb", "quadratic-damping"))
    assert field.winner() is field.base
    assert field.confidence(frozenset()) > 0.8


def test_families_are_those_beyond_the_record(friction):
    _, field = friction
    assert families_of(field.winner().model, ()) == {"friction"}
    assert families_of(field.winner().model, ("coulomb",)) == frozenset()


def test_importance_by_hand(friction):
    """Coulomb 0.08 N*m against a spring of 14.684 N*m/rad at 0.17 rad."""
    _, field = friction
    size = importance(field.winner().model, ["coulomb"], field.base.model)
    assert size.torque_share == pytest.approx(0.08 / (14.684 * 0.17), rel=0.05)
    assert 0.1 < size.energy_share < 0.9
    assert size.matters


def test_what_is_weak_does_not_matter():
    _, field = tried(LAW.with_effect("coulomb", 0.0008), ("coulomb",))
    coulomb = next(s for s in field.scored if s.model.effects == ("coulomb",))
    assert not importance(coulomb.model, ["coulomb"], field.base.model).matters


def test_a_rival_that_is_ruled_out_is_none(friction, monkeypatch):
    """Of a log with nothing but dry friction no other family is left; were nothing ever ruled out, some would be."""
    _, field = friction
    chosen = field.winner()
    assert field.rivals(chosen) == []
    monkeypatch.setattr(field, "possible", field.scored)
    assert field.rivals(chosen) == []
    monkeypatch.setattr("sysid.diagnosis.judgement.RULED_OUT", np.inf)
    rivals = field.rivals(chosen)
    assert ("quadratic-damping",) in [s.model.effects for s in rivals]
    assert families_of(chosen.model, ()) not in [families_of(s.model, ()) for s in rivals]
    assert [field.weight(s) for s in rivals] == sorted(map(field.weight, rivals), reverse=True)


def test_what_has_something_beside_what_was_chosen_is_no_rival(friction, monkeypatch):
    """Nor has another law of the same family."""
    _, field = friction
    chosen = field.winner()
    other = next(s for s in field.scored if s.model.effects == ("quadratic-damping",))
    pairs = [
        replace(other, model=replace(other.model, effects=("quadratic-damping", law)), score=chosen.score)
        for law in ("coulomb", "stribeck")
    ]
    monkeypatch.setattr(field, "possible", [chosen, other, *pairs])
    monkeypatch.setattr("sysid.diagnosis.judgement.RULED_OUT", np.inf)
    assert field.rivals(chosen) == [other]
    assert [field.adds_to(pair, chosen) for pair in pairs] == [True, True]
    assert [field.adds_to(pair, other) for pair in pairs] == [True, True]
    assert not field.adds_to(other, chosen)


@pytest.mark.parametrize(("known", "times"), [(math.pi, 1.0), (1e-3, 1.0), (1.2, 1.2), (3.0, 1.5)])
def test_a_deck_is_let_go_from_no_farther_than_it_is_known_to_go(friction, known, times):
    """Half a turn is no range that anybody measured; one that is narrower than what the log shows is wrong."""
    _, field = friction
    model = field.winner().model
    seen = model.problem.scales.amplitude
    board = load_board(shipped_data() / "boards" / "pink.toml")
    known = known if known == math.pi else known * seen
    board = board.with_tilt(range=Quantity(known, 0.0, "rad"))
    assert widest(model, board) == pytest.approx(times * seen)


def test_the_experiment_is_the_smallest_that_decides(friction):
    """Where the noise is larger than any swing, none decides, or a wider one, or more of them."""
    _, field = friction
    rival = next(s for s in field.scored if s.model.effects == ("quadratic-damping",))
    loud, quiet = (
        deciding(field.winner().model, rival.model, Fitted(0.0, noise, 0.0, 0.0, 0.0, np.zeros(1)), 0.2)
        for noise in (300 * NOISE, NOISE)
    )
    assert quiet is not None
    assert 0.25 * 0.17 < abs(quiet.angle) < 0.2
    assert loud is None or abs(loud.angle) > abs(quiet.angle) or loud.number > quiet.number
    assert pytest.approx(np.log(19.0)) == DECIDED


def test_what_would_be_seen_of_an_experiment_is_what_no_other_start_makes_and_counted_once(friction):
    """Two laws that differ by when the deck is let go are not told apart; means of samples are as few as they are."""
    _, field = friction
    model = field.winner().model
    clear = Fitted(0.0, 1e-4, 0.0, 0.0, 0.0, np.zeros(1))
    rival = next(s for s in field.scored if s.model.effects == ("quadratic-damping",)).model
    assert deciding(model, rival, clear, 0.2) is not None
    with patch("sysid.diagnosis.experiment.simulate") as path:
        for moved, differs in ((1e-4, False), (0.0, True)):
            calls = []

            def drawn(law, time, angle, moved=moved, calls=calls):
                calls.append(len(time))
                other = len(calls) % 2 == 0
                roll = np.cos(10 * (time + moved * other)) + (
                    0 if moved or not other else 2e-4 * np.sin(23 * time)
                )
                return SimpleNamespace(roll=roll, rate=np.gradient(roll, time))

            path.side_effect = drawn
            assert (deciding(model, rival, clear, 0.2) is not None) is differs
            assert calls[0] == pytest.approx(1.6 / 4e-3 / model.problem.average, abs=1)


def test_a_law_outside_is_said_in_the_place_of_nothing_only_if_it_is_worth_its_numbers(friction, monkeypatch):
    """A spring and a damper of its own in each of five releases of a clean log did better by 23, and by less than they cost."""
    _, field = friction
    outside = replace(field.best, model=replace(field.best.model, shape="k d"))
    many = replace(outside, choices=1000)
    for law, said in ((outside, True), (many, False)):
        monkeypatch.setattr(field, "scored", [field.base, law])
        assert (_outside(field, field.base, named=False) is law) is said


def test_a_law_outside_wins_where_no_effect_of_the_catalogue_may_be_true(friction, monkeypatch):
    _, field = friction
    coulomb = next(s for s in field.scored if s.model.effects == ("coulomb",))
    outside = replace(coulomb, model=replace(coulomb.model, shape="magnet"))
    monkeypatch.setattr(field, "scored", [coulomb, outside])
    monkeypatch.setattr(field, "possible", [outside])
    assert _outside(field, coulomb, named=True) is outside
    monkeypatch.setattr(field, "possible", [coulomb, outside])
    assert _outside(field, coulomb, named=True) is None
    pair = replace(coulomb, choices=coulomb.choices + 3)
    monkeypatch.setattr(field, "possible", [pair, outside])
    assert _outside(field, pair, named=True) is outside, (
        "several effects are no likelier than one law that nobody has met"
    )


@pytest.mark.parametrize("angle", [0.17, -0.17])
def test_what_depends_on_the_tilt_alone_takes_no_energy(angle):
    law, time = replace(LAW, stiffness=8.0).with_effect("bilinear-stiffness", 0.6), np.linspace(0, 0.9, 200)
    assert _energy_share(law, [time], [(angle, 0.0)], ["bilinear-stiffness"]) == pytest.approx(0.0, abs=1e-12)


def test_friction_of_a_pendulum_takes_its_share_of_energy_and_swing():
    """Its weight is known, and gives back what it takes."""
    law = JointLaw(inertia=0.01225, stiffness=0.0, damping=0.0012).with_effect(
        "weight", 1.0, 0.0, -0.7355, 0.0, 0.0, 0.0, 0.0, 0.0
    )
    law = law.with_effect("coulomb", 0.006)
    share = _amplitude_share(law, [(1.1, 0.0)], ["coulomb"])
    assert share == pytest.approx(10 * 4 * 0.006 / 0.7355 / 1.1, rel=0.3)  # 4 F / k a swing
    assert 0.2 < _energy_share(law, [np.linspace(0, 8, 800)], [(1.1, 0.0)], ["coulomb"]) < 0.8
