"""The search: a richer model is never worse than what it contains."""

import itertools
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.board import load_board
from sysid.diagnosis.search import (
    Candidate,
    Search,
    _freed,
    best_families,
    best_of,
    completed,
    frugality,
    inherited,
    inside,
    leaders,
)
from sysid.effects import catalogue
from sysid.effects._base import Scales
from sysid.fitting.cross_validation import _without
from sysid.fitting.problem import Problem, Record
from sysid.fitting.search import followed, scouts
from sysid.joint import JointLaw, simulate
from sysid.roll import Release
from sysid.workspace import shipped_data

LAW = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.15).with_effect("coulomb", 0.05)
NOISE = 5e-4


def record_of(angle, seed, law=LAW, hold=1e3):
    time = np.arange(0.0, 0.35, 4e-3)
    roll = simulate(law, time, angle, hold=hold).roll + NOISE * np.random.default_rng(seed).standard_normal(
        len(time)
    )
    release = Release(
        log="x", number=1, time=time, roll=roll, std=np.full(len(time), NOISE), origin="angle", rest=0.0, hold=1.0, end="log",
    )  # fmt: skip
    return Record(release=release, time=time, signal=roll, is_rate=False, std=NOISE)


@pytest.fixture(scope="module")
def search():
    scales = Scales(inertia=8.7e-3, stiffness=14.684, damping=0.2, amplitude=0.16, duration=0.35)
    return Search(records=(record_of(0.15, 1), record_of(-0.13, 2)), scales=scales, bias="shared")


def test_a_rate_hides_no_torque(search):
    """A slider's decays end at levels that move, as a drift's do; a rate's free zero takes the drift, not the slider."""
    rates = tuple(replace(record, is_rate=True) for record in search.records)
    hidden = {*search.names()} - {*replace(search, records=rates).names()}
    assert {catalogue()[name].role for name in hidden} == {"measurement"}
    assert "sensor-drift" in hidden


@pytest.mark.parametrize(("hold", "freed"), [(1e3, False), (0.01, True)])
def test_what_a_hand_moved_last_begins_anywhere(search, hold, freed):
    """The log says that the deck was held for a second before both releases."""
    law = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.15).with_effect("viscoelastic", 8.0, 1.0)
    records = (record_of(0.15, 1, law), record_of(-0.13, 2, law, hold))
    rubber = replace(search, records=records)
    model = rubber.fine(rubber.single(("viscoelastic",)))
    assert model.problem.free_states is freed
    assert model.rmse < 1.1 * NOISE


def test_states_that_promise_nothing_are_not_freed(search):
    law = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.15).with_effect("viscoelastic", 8.0, 1.0)
    rubber = replace(search, records=(record_of(0.15, 1, law), record_of(-0.13, 2, law)))
    model = rubber.fine(rubber.single(("viscoelastic",)))
    with patch.object(Problem, "normal", autospec=True, side_effect=Problem.normal) as evaluated:
        assert _freed(model) is model
    assert evaluated.call_count == 1


def test_a_stop_may_be_much_softer_than_the_spring(search):
    """A thirtieth of it matters, where the deck goes far beyond."""
    law = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.02).with_effect(
        "one-sided-stop", -0.08, 0.5, 0.0
    )
    records = tuple(record_of(angle, seed, law) for seed, angle in enumerate((0.1, -0.16, 0.15)))
    model = replace(search, records=records).single(("one-sided-stop",))
    assert not model.at_edge
    assert model.parameters["one-sided-stop.stiffness"] == pytest.approx(0.5, rel=0.5)


def test_what_starts_cost_keeps_nothing_from_being_predicted(search):
    """No prediction is charged for a start that is too fast."""
    linear = search.single(())
    friction, drag = (search.single((name,), linear) for name in ("coulomb", "quadratic-damping"))
    with (
        patch("sysid.diagnosis.search.BEATEN", 1),
        patch.object(Search, "fine", lambda self, model, *_, **__: model),
        patch.object(Candidate, "misfit", 0.0),
    ):
        found = search.finalists([linear, friction, drag])
    assert len(found) == 3


@pytest.mark.slow
def test_no_pair_of_the_catalogue_is_worse_than_its_halves(search):
    """Every pair starts at the optima of both its halves, so adding an effect never makes the error larger."""
    names = [n for n, e in catalogue().items() if e.role == "torque"]
    linear = search.single(())
    singles = {name: search.single((name,), linear) for name in names}
    for one, other in itertools.combinations(names, 2):
        pair = search.union(singles[one], singles[other])
        best = min(singles[one].cost, singles[other].cost)
        assert pair.cost <= best * (1 + 1e-6), (one, other)


def test_a_motion_that_runs_away_costs_without_end_and_in_silence_also_where_samples_are_hidden(search):
    problem = search.single(("cubic-stiffness",)).problem
    values = {name: 0.0 for name in problem.names} | {"stiffness": 15.0, "cubic-stiffness.coefficient": -3e3}
    unknowns = problem.start(values)
    for weights in (None, [np.zeros(len(o)) for o in problem.observed]):
        assert problem.with_(weights=weights).normal(unknowns).cost == np.inf


def test_without_a_release_the_normal_equations_of_the_others_are_left(search):
    problem = search.problem(("cubic-stiffness",))
    point = problem.start(completed(problem, {"stiffness": 15.0, "damping": 0.2, "rest_angle": 0.0}))
    held, own = problem.of([0], point)
    left = _without(problem.normal(point), held.normal(own), problem.places[0][0], len(problem.names))
    others, own = problem.of([1], point)
    alone = others.normal(own)
    assert left.cost == pytest.approx(alone.cost)
    np.testing.assert_allclose(left.gradient, alone.gradient, rtol=1e-6)
    np.testing.assert_allclose(left.hessian, alone.hessian, rtol=1e-6, atol=1e-9 * alone.hessian.max())


def test_a_single_effect_is_no_worse_than_the_joint_without_it(search):
    linear = search.single(())
    for name in ("end-stop", "hysteresis", "cubic-stiffness"):
        assert search.single((name,), linear).cost <= linear.cost * (1 + 1e-6), name


def test_a_slider_takes_its_share_of_the_spring(search):
    """Wide swings drag it along, small ones are carried by it: a linear joint has the spring of both."""
    law = JointLaw(inertia=8.7e-3, stiffness=18.1, damping=0.013).with_effect("hysteresis", 29.1, 1.08)
    record = record_of(0.13, 1, law)
    coarse = replace(record, time=record.time[::3], signal=record.signal[::3])
    scales = Scales(inertia=8.7e-3, stiffness=46.8, damping=0.055, amplitude=0.12, duration=0.35)
    model = replace(search, records=(coarse,), scales=scales).single(("hysteresis",))
    assert model.parameters["hysteresis.torque"] == pytest.approx(1.08, rel=0.05)


def test_a_law_is_also_sought_where_its_richer_kin_was_found(search):
    """Dahl's friction is Bouc and Wen's hysteresis that unloads as it loads: where the one was found, the other is."""
    law = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.05).with_effect("dahl", 0.2, 0.018)
    rubbed = replace(search, records=(record_of(0.15, 1, law), record_of(-0.13, 2, law)))
    linear, rich = rubbed.single(()), rubbed.single(("bouc-wen",))
    stuck = rubbed.without(linear, ("dahl",), [{"dahl.torque": 0.0}])
    stuck = replace(stuck, minimum=stuck.problem.fitted(inherited(stuck.problem, linear), 0))
    found = {m.effects: m for m in rubbed.simplified([rich], [linear, stuck, rich])}
    again = found["dahl",]
    assert again.cost < rich.cost + 10 < stuck.cost
    assert again.parameters["dahl.reach"] == pytest.approx(0.018, rel=0.3)
    assert not again.at_edge, "more than a tenth of the swing"
    assert rubbed.simplified([rich], [linear, replace(rich, effects=("dahl",)), replace(rich, effects=("hysteresis",))])[1].problem is rich.problem, "nothing to win"  # fmt: skip


def test_the_best_are_those_with_the_least_error_and_the_most_frugal(search):
    linear, coulomb = search.single(()), search.single(("coulomb",))
    assert best_of([linear, coulomb], 1) == [coulomb]
    assert {m.effects for m in best_of([linear, coulomb], 2)} == {(), ("coulomb",)}


def test_parents_of_pairs_are_of_different_families(search):
    """Friction has three variants that fit this log better than anything else: their pairs alone would leave nothing for others."""
    linear = search.single(())
    names = ("coulomb", "stribeck", "dahl", "cubic-damping")
    models = [search.single((name,), linear) for name in names]
    chosen = leaders(models)
    assert [m.families for m in chosen] == [{"friction"}, {"drag"}]
    assert chosen[0].cost == min(m.cost for m in models[:3])
    assert {m.families for m in best_families(models, 2)} == {frozenset({"friction"}), frozenset({"drag"})}
    assert [m.effects for m in leaders(models[:2], frugality)] == [("coulomb",)], "it is all that is there"


def test_what_stands_in_for_another_law_keeps_nobody_out(search):
    """Dahl's or Stribeck's friction at the edge of what it is, is dry friction; and whatever is best shows what can be reached."""
    linear = search.single(())
    names = ("coulomb", "stribeck", "dahl", "cubic-damping")
    singles = [search.single((name,), linear) for name in names]
    edged, own = ([m for m in singles if m.at_edge is edge] for edge in (True, False))
    assert edged
    assert singles[0] in own
    assert inside(edged) == edged
    best = min(singles, key=lambda m: m.cost)
    assert {m.effects for m in best_families(singles, 2)} == {m.effects for m in (*own, best)}


def test_of_many_records_valleys_are_sought_in_three_and_followed_through_all(search):
    """The widest, the smallest and one between; what was found there goes to its place."""
    records = tuple(record_of(angle, n) for n, angle in enumerate((0.05, -0.1, 0.15, 0.02, -0.12)))
    many = replace(search, records=records)
    kept = scouts(records)
    assert kept == [1, 2, 3]
    problem = many.problem(("coulomb",))
    whole = problem.start({"stiffness": 10.0, "damping": 0.1, "rest_angle": 0.0, "coulomb.torque": 0.0})
    some, point = problem.of(kept, whole + 1.0)
    found = followed(problem, whole, kept, point)
    assert problem.parameters(found) == some.parameters(point)
    moved = problem.own(found) - problem.own(whole)
    assert moved[:, 0] == pytest.approx([0.0, 1.0, 1.0, 1.0, 0.0])
    with patch.object(Problem, "fitted", autospec=True, side_effect=Problem.fitted) as fits:
        many.single(("coulomb",))
    counts = [len(call.args[0].records) for call in fits.call_args_list]
    assert (counts[0], counts[-1]) == (3, 5)


def test_what_is_far_from_the_best_is_not_predicted(search):
    """Of more models than are always predicted."""
    law = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.02).with_effect("asymmetric-stiffness", 40.0)
    bent = replace(search, records=(record_of(0.15, 1, law), record_of(-0.13, 2, law)))
    names = ("asymmetric-stiffness", "bilinear-stiffness", "cubic-stiffness", "quadratic-damping", "cubic-damping", "coulomb", "viscoelastic")  # fmt: skip
    models = {m.effects: m for m in (bent.single((name,) if name else ()) for name in ("", *names))}
    running = {m.effects: m.cost for m in bent.finalists(models.values())}
    left = {*models} - {*running}
    assert left
    assert not left & {(), ("asymmetric-stiffness",), ("bilinear-stiffness",)}
    assert min(models[one].cost for one in left) >= max(cost for names, cost in running.items() if names)


def test_what_the_best_model_holds_is_predicted(search):
    """However many richer ones are nearer to a log whose noise lasts."""
    law = LAW.with_effect("quadratic-damping", 0.01)
    both = replace(search, records=(record_of(0.15, 1, law), record_of(-0.13, 2, law)))
    linear = both.single(())
    friction, drag = (both.single((name,), linear) for name in ("coulomb", "quadratic-damping"))
    module = "sysid.diagnosis.search"
    with (
        patch(f"{module}.BEATEN", 1),
        patch(f"{module}._hopeless", lambda models: min(m.misfit for m in models)),
    ):
        found = both.finalists([linear, friction, drag, both.union(friction, drag)])
    assert len(found) == 4


def test_a_pendulum_is_searched_without_a_spring():
    """Of a swing of 70° the sine shows; then gravity alone does as well as gravity and a spring, in the record or not."""
    board = load_board(shipped_data() / "boards" / "pink.toml")
    law = JointLaw(inertia=board.inertia.value, stiffness=0.0, damping=0.01).with_effect("gravity", 0.6)
    time = np.arange(0.0, 4.0, 0.01)
    roll = 0.05 + simulate(law, time, 1.2).roll + NOISE * np.random.default_rng(0).standard_normal(len(time))
    release = Release(
        log="x", number=1, time=time, roll=roll, std=np.full(len(time), NOISE), origin="angle", rest=0.05, hold=0.0, end="log",
    )  # fmt: skip
    record = Record(release=release, time=time, signal=roll, is_rate=False, std=NOISE)
    scales = Scales(inertia=board.inertia.value, stiffness=0.55, damping=0.01, amplitude=1.2, duration=4.0)
    search = Search(records=(record,), scales=scales, bias="shared")
    linear = search.single(())
    other, (_, gravity) = search.hung([linear, search.single(("gravity",), linear)])
    assert other.hangs
    assert "stiffness" not in gravity.problem.names
    assert gravity.parameters["gravity.moment"] == pytest.approx(0.6, rel=1e-3)
    assert gravity.parameters["sensor-bias.angle"] == pytest.approx(0.05, abs=1e-3)

    known = replace(search, base=("gravity",))
    with patch.object(Search, "names", return_value=["coulomb"]):
        other, (hung, coulomb) = known.hung(known.singles())
    assert other.hangs
    assert (hung.effects, coulomb.effects) == (("gravity",), ("coulomb", "gravity"))
    assert hung.parameters["gravity.moment"] == pytest.approx(0.6, rel=1e-3)
    assert not {"stiffness"} & {*hung.problem.names, *coulomb.problem.names}


def test_a_gap_beside_friction_is_searched_anew(search):
    """Both with what they are alone, friction beside which the gap does nothing is all that a union finds."""
    law = JointLaw(inertia=8.7e-3, stiffness=33.0, damping=0.026)
    law = law.with_effect("coulomb", 0.71).with_effect("freeplay", 0.0334)
    both = replace(search, records=(record_of(0.108, 1, law), record_of(-0.085, 2, law)))
    singles = [
        both.single(()),
        *(both.single((name,)) for name in ("coulomb", "cubic-stiffness", "freeplay")),
    ]
    found = both.kinked(singles, None)
    assert [model.effects for model in found] == [("coulomb", "freeplay")]
    assert found[0].rmse < 1.2 * NOISE
    rich = both.single(("stribeck",))
    with patch.object(Search, "single", lambda self, effects, known: replace(known, effects=effects)):
        assert [model.effects for model in both.kinked(singles, rich)] == [("coulomb", "freeplay")]
        assert both.kinked(singles, singles[1]) == [], "what is at the noise is simpler"


def later(record, begin):
    """What is recorded from an instant on, with no hold before it."""
    inside = record.time >= begin
    time, roll = record.time[inside] - begin, record.signal[inside]
    release = replace(record.release, time=time, roll=roll, std=record.release.std[inside], hold=0.0)
    return replace(record, release=release, time=time, signal=roll)


def test_a_filter_has_followed_a_decay_whose_beginning_is_not_judged(search):
    law = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.05).with_effect("lowpass", 0.012)
    whole = [record_of(angle, seed, law) for seed, angle in enumerate((0.15, -0.13))]
    records = (*whole, *(later(record, 0.1) for record in whole))
    model = replace(search, records=records).single(("lowpass",))
    assert model.parameters["lowpass.time_constant"] == pytest.approx(0.012, rel=0.02)
    assert model.rmse < 1.05 * NOISE


def test_a_slider_is_found_from_starts_that_never_slip_or_always(search):
    """Where the deck is moving already it may be stretched by anything: from there a search soon leaves it out."""
    law = JointLaw(inertia=8.7e-3, stiffness=13.5, damping=0.017).with_effect("hysteresis", 1.5, 0.135)
    whole = [record_of(angle, seed, law) for seed, angle in enumerate((0.143, -0.113, 0.073))]
    records = (*whole, later(whole[0], 0.15))
    scales = replace(search.scales, stiffness=16.4, damping=0.02)
    model = replace(search, records=records, scales=scales).single(("hysteresis",))
    assert model.parameters["hysteresis.torque"] == pytest.approx(0.135, rel=0.1)
    assert model.rmse < 1.1 * NOISE


def test_of_a_log_at_the_noise_pairs_that_are_as_simple_are_fitted_too(search, monkeypatch):
    """A hysteresis with three parameters is no simpler than a drag and a bent spring."""
    linear = search.single(())
    singles = [
        linear,
        *(
            search.single((name,), linear)
            for name in ("bouc-wen", "cubic-stiffness", "dahl", "quadratic-damping", "viscoelastic")
        ),
    ]
    monkeypatch.setattr("sysid.diagnosis.search.FEW", 1)
    monkeypatch.setattr(
        Search,
        "unions",
        lambda self, wanted, begin, end: [tuple(sorted({*a.effects, *b.effects})) for a, b in wanted],
    )
    monkeypatch.setattr(
        "sysid.diagnosis.search.best_of",
        lambda models, count: [
            m for name in ("bouc-wen", "cubic-stiffness", "dahl") for m in singles if m.effects == (name,)
        ],
    )
    pairs = search.pairs(singles, singles[1])
    assert ("cubic-stiffness", "quadratic-damping") in pairs
    assert ("dahl", "quadratic-damping") not in pairs
    assert ("bouc-wen", "viscoelastic") in pairs
    assert ("dahl", "quadratic-damping") in search.pairs(singles, None)


def test_pairs_as_simple_as_what_mimics_them_are_fitted_whatever_their_halves_are_alone(search):
    """Drag beside a softening spring is a loop, and a loop's three numbers come nearer than drag or the spring alone."""
    law = (
        replace(LAW, effects=()).with_effect("quadratic-damping", 0.02).with_effect("cubic-stiffness", -250.0)
    )
    other = replace(search, records=(record_of(0.15, 1, law), record_of(-0.13, 2, law)))
    linear = other.single(())
    names = ("bouc-wen", "cubic-stiffness", "quadratic-damping", "viscoelastic")
    singles = [linear, *(other.single((name,), linear) for name in names)]
    with (
        patch("sysid.diagnosis.search.PARENTS", 1),
        patch.object(Search, "unions", lambda self, wanted, begin, end: [{*a.effects, *b.effects} for a, b in wanted]),
    ):  # fmt: skip
        pairs = other.pairs(singles, None)
    assert {"cubic-stiffness", "quadratic-damping"} in pairs
    assert {"cubic-stiffness", "viscoelastic"} not in pairs


def test_noise_that_lasts_sets_no_state_free(search):
    """It is told from the floor by what is left: many times that, and the same for many samples."""
    rng, keep = np.random.default_rng(0), np.exp(-0.2)
    coloured: list[Record] = []
    for seed, angle in enumerate((0.15, -0.13, 0.1)):
        record = record_of(angle, seed)
        jumps = 5 * NOISE * np.sqrt(1 - keep**2) * rng.standard_normal(len(record.time))
        coloured.append(replace(record, signal=record.signal + lfilter([1.0], [1.0, -keep], jumps)))
    noisy = replace(search, records=tuple(coloured))
    assert not noisy.fine(noisy.single(("hanging-body",))).problem.free_states


def test_what_unloads_by_the_line_that_it_was_loaded_by_is_no_hysteresis():
    unloading = next(p for p in catalogue()["bouc-wen"].parameters if p.name == "unloading")
    ratio = next(p for p in catalogue()["hanging-body"].parameters if p.name == "damping_ratio")
    assert [unloading.edged(value, exact=True) for value in (unloading.low, 0.3, 1.0)] == [True, False, False]
    assert not any(ratio.edged(value, exact=True) for value in (0.0, 1.0))
    static, velocity = catalogue()["stribeck"].parameters[1:]
    assert [one.edged(one.high, exact=False) for one in (static, velocity)] == [False, True]
