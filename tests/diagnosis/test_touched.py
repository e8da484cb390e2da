"""What a hand has touched is left out: ends, beginnings, or a release; a board that changed, or a law that nobody knows, is not."""

import pickle
import re
from dataclasses import replace
from itertools import zip_longest

import numpy as np
import pytest
from decay_truth import Recipe, make_roll

from sysid.board import load_board
from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.judgement import Field
from sysid.diagnosis.search import Search
from sysid.diagnosis.surrogates import nearest_outside
from sysid.diagnosis.touched import _begun, _refitted, seen_by_hands, untouched
from sysid.diagnosis.workers import WorkerPool
from sysid.fitting.records import make_records
from sysid.fitting.search import scales_of
from sysid.joint import JointLaw, simulate
from sysid.recording import Recording
from sysid.roll import Release, Signal
from sysid.workspace import shipped_data

NOISE = 1e-3
TIME = np.arange(0.0, 1.0, 5e-3)
LAW = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.05)


class Sending(WorkerPool):
    """Takes what another process would be sent."""

    def begin(self, function, *arguments):
        return super().begin(*pickle.loads(pickle.dumps((function, *arguments))))


def decay(angle, law=LAW):
    return simulate(law, TIME, angle).roll


def caught(angle):
    """A hand takes it in the third swing, and brings it aside."""
    return np.where(TIME < 0.4, decay(angle), 0.05 * np.minimum((TIME - 0.4) / 0.3, 1.0))


def searched(*rolls, hold=1.0, effect="coulomb", ends=()):
    rng = np.random.default_rng(3)
    releases = [
        Release(
            log="x", number=n, time=TIME, roll=roll + NOISE * rng.standard_normal(len(TIME)), rest=0.0, hold=hold,
            std=np.full(len(TIME), NOISE), origin="angle", end=end,
        )
        for n, (roll, end) in enumerate(zip_longest(rolls, ends, fillvalue="log"), start=1)
    ]  # fmt: skip
    board = load_board(shipped_data() / "boards" / "pink.toml")
    records = make_records(releases, NOISE, rate=False)
    search = Search(records=records, scales=scales_of(records, board), bias="shared")
    return search, [search.single(()), search.single((effect,))]


def touched(*rolls, outside=False, **options):
    search, models = searched(*rolls, **options)
    return untouched(
        [*models, *([nearest_outside(search, models[1])] if outside else [])], (), Sending(1), 1.0
    )


FREE, WIDE = decay(-0.14), decay(0.17)
STIFFER = decay(0.12, replace(LAW, stiffness=18.0))


def taken_home(angle):
    """A hand is on it from the start, and takes it home."""
    return angle * np.cos(np.pi * np.minimum(TIME / 0.8, 1.0)) * np.exp(-3 * TIME)


def pushed(angle):
    """Moved on its way for a tenth of a second before it is free."""
    return np.where(TIME < 0.03, angle, np.interp(TIME - 0.03, TIME, decay(angle)))


def grown(angle, damping=0.05):
    """A spring of the fifth power, which no effect is."""
    time = np.linspace(0, TIME[-1], 20001)
    step, x, v, roll = time[1], angle, 0.0, np.empty_like(time)
    for i in range(len(time)):
        roll[i] = x
        v -= step * (14.684 * x * (1 + 2e3 * x**4) + damping * v) / 8.7e-3
        x += step * v
    return np.interp(TIME, time, roll)


@pytest.mark.parametrize(
    ("rolls", "left"),
    [
        ((WIDE, taken_home(0.12), FREE), "release 2"),
        ((WIDE, caught(0.12), caught(-0.14)), "the ends"),
        ((caught(0.17), caught(-0.14)), "the ends"),
        ((pushed(0.17), pushed(-0.14)), "the beginnings"),
        ((WIDE, FREE, decay(0.1)), None),
        ((WIDE, FREE, STIFFER), None),
        ((grown(0.18), grown(-0.15)), None),
    ],
    ids=[
        "one of three",
        "one end",
        "the ends",
        "the beginnings",
        "none",
        "a spring that changed",
        "an unknown law",
    ],
)
def test_what_no_law_follows_is_left_out_where_one_follows_the_rest(rolls, left):
    found = touched(*rolls)
    assert (found is None) == (left is None)
    if found is not None:
        releases, text = found
        assert text.startswith(left)
        assert len(releases) == len(rolls) - left.startswith("release")
        touched_until = 0.03 if left == "the beginnings" else 0.0
        assert all(release.time[0] >= touched_until for release in releases)
        assert all(
            release.time[-1] < 0.6 for release in releases if left == "the ends" and release.number != 1
        )


def test_so_little_that_any_law_follows_it_shows_no_hand():
    """Of three laws at once; two of others, with six numbers, follow the first swing of each release."""
    parts = (("coulomb", (0.1,)), ("cubic-stiffness", (400.0,)), ("hysteresis", (6.0, 0.2)))
    law = JointLaw(inertia=8.7e-3, stiffness=9.0, damping=0.05, effects=parts)
    search, _ = searched(*(decay(angle, law) for angle in (0.24, -0.21, 0.16)))
    models = [search.single(()), search.single(("cubic-stiffness", "dahl"))]
    assert untouched(models, (), Sending(1), 1.0) is None


def test_a_law_outside_the_catalogue_is_asked_in_this_process():
    search, models = searched(decay(0.17), decay(-0.14))
    model = nearest_outside(search, models[1])
    assert _begun(Sending(1), _refitted, model, [0])() == pytest.approx(_refitted(model, [0]))
    assert _begun(Sending(1), _refitted, models[1], [0])() == pytest.approx(_refitted(models[1], [0]))


@pytest.mark.parametrize(("outside", "left"), [(False, True), (True, False)])
def test_what_a_law_outside_the_catalogue_holds_for_was_touched_by_no_hand(outside, left):
    """After the first swing the deck is back where x⁵ is nothing, as if a hand had been on it before."""
    assert (touched(grown(0.19, damping=0.25), outside=outside) is not None) is left


@pytest.mark.parametrize(("effect", "size"), [("coulomb", (0.1,)), ("end-stop", (0.14, 60.0, 0.0))])
def test_where_a_law_holds_for_all_no_hand_is_blamed_for_what_the_beginnings_ask_for(effect, size):
    """A stop may be met in the first swings only; that no hold is seen says nothing against it."""
    law = LAW.with_effect(effect, *size)
    assert touched(decay(0.17, law), decay(-0.14, law), hold=0.0, effect=effect) is None


@pytest.mark.parametrize(
    ("stiffness", "gap", "angles", "push"),
    [(14.684, 0.05, (0.17, -0.14), 0.045), (26.0, 0.06, (0.125, -0.097), 0.03)],
)
def test_a_law_that_was_fitted_to_a_push_too_comes_back_into_step_without_it(stiffness, gap, angles, push):
    """A gap makes the pace follow the amplitude: what is off by a little at first is half a swing off soon."""
    law = replace(LAW, stiffness=stiffness).with_effect("freeplay", gap)
    rolls = [np.interp(TIME - push, TIME, decay(angle, law)) for angle in angles]
    found = touched(*rolls, effect="freeplay")
    assert found is not None
    releases, text = found
    assert text.startswith("the beginnings of")
    assert len(releases) == len(rolls)


def test_a_law_that_changes_where_swings_are_small_is_no_hands_work():
    """An eddy brake's drag falls beyond a rate: its small swings fade as no law of the wide ones has it, in releases that nobody caught."""
    recipe = Recipe(
        amplitudes=(0.25, -0.35, -0.2), sampling=125, noise=7e-4, free=6.0,
        law=lambda x, v: -180 * 0.35 * np.tanh(x / 0.35) - 0.2 * v - 3.2 * v / (1 + (v / 0.8) ** 2),
    )  # fmt: skip
    board = load_board(shipped_data() / "boards" / "pink.toml")
    found = diagnose(Recording.of(make_roll(recipe)), board)
    assert found.verdict.status == "unexplained"
    assert not any("hand" in doubt for doubt in found.doubts)


def test_of_decks_that_stop_within_two_swings_a_short_push_takes_no_more_than_it_touched():
    sticks = replace(LAW, stiffness=1.5).with_effect("coulomb", 0.075)

    def flicked(angle):
        begin = np.interp(TIME, [0.0, 0.02, 0.04], [angle, angle, 1.25 * angle])
        free = simulate(sticks, TIME, 1.25 * angle, 4 * angle).roll
        return np.where(TIME < 0.04, begin, np.interp(TIME - 0.04, TIME, free))

    kept = touched(*(flicked(angle) for angle in (0.14, -0.12, 0.11)))
    assert kept is not None
    assert "beginnings" in kept[1]
    assert [release.time[0] < 0.1 for release in kept[0]] == [True] * 3


def carried(angle, seconds=0.04):
    """A hand lets it go on its way at a third of its top rate."""
    rate = -0.3 * angle * np.sqrt(LAW.stiffness / LAW.inertia)
    begin = angle + rate * TIME * 0.5 * np.minimum(TIME / seconds, 1.0)
    free = simulate(LAW, TIME, float(np.interp(seconds, TIME, begin)), rate).roll
    return np.where(seconds > TIME, begin, np.interp(TIME - seconds, TIME, free))


def named(*rolls, effect, hold=0.0, ends=()):
    search, models = searched(*rolls, hold=hold, effect=effect, ends=ends)
    asked = search.foretold(search.finalists(models))[::-1]
    tried = Field(asked, (), 2 * np.pi / search.scales.frequency, NOISE)
    assert tried.winner().model.effects == (effect,)
    return seen_by_hands(search, asked, tried)


@pytest.mark.parametrize("rolls", [(carried(0.12),), (WIDE, FREE, carried(0.12))], ids=["one", "three"])
def test_what_shows_in_the_beginnings_only_is_a_hands(rolls):
    """A body that hung still or not when it was let go follows any push, to the noise."""
    found = named(*rolls, effect="hanging-body")
    assert found is not None
    kept, text = found
    assert text.startswith("the beginnings of")
    assert [release.time[0] > 0.04 for release in kept] == [True] * len(rolls)
    given = [float(time) for time in re.findall(r"--release (\S+)", text)]
    assert all(0 <= time - one.start <= 1e-3 for time, one in zip(given, kept, strict=True))


def test_what_is_likelier_by_the_rest_of_the_motion_too_is_no_hands(monkeypatch):
    monkeypatch.setattr("sysid.diagnosis.touched.odds", lambda scored: len(scored.model.effects))
    assert named(WIDE, FREE, carried(0.12), effect="hanging-body") is None


@pytest.mark.parametrize(
    ("effect", "size"),
    [("coulomb", (0.02,)), ("one-sided-stop", (0.12, 60.0, 0.0)), ("hanging-body", (5e-4, 36.0, 0.05))],
)
def test_what_the_joint_has_shows_after_a_hand_can_have_been_there_too(effect, size):
    """Weak friction, a stop that only the first swing of one release meets, and a light body."""
    law = LAW.with_effect(effect, *size)
    assert named(decay(-0.17, law), decay(0.14, law), effect=effect) is None


def test_of_a_deck_that_stops_within_a_swing_the_beginnings_are_all_there_is():
    """A stiffening spring beside a damper of half the critical one: what is left after them tells nothing."""
    law = replace(LAW, damping=0.36).with_effect("cubic-stiffness", 150.0)
    assert named(decay(0.17, law), decay(-0.14, law), effect="cubic-stiffness") is None


@pytest.mark.parametrize("angles", [(0.19,), (0.19, 0.185, 0.18)], ids=["one", "three"])
def test_what_has_no_number_of_its_own_in_each_release_follows_no_push(angles):
    """A stop that only the beginnings meet."""
    law = LAW.with_effect("one-sided-stop", 0.16, 200.0, 0.0)
    rolls = [decay(angle, law) for angle in angles]
    assert named(*rolls, effect="one-sided-stop") is None


def stopped(angle, law=LAW):
    """A hand stops it beside its rest when it hardly swings any more."""
    roll, turn = decay(angle, law), int(np.searchsorted(TIME, 0.7))
    return np.where(TIME[turn] > TIME, roll, roll[turn])


@pytest.mark.parametrize(
    ("friction", "others", "left"), [(0.0, "caught", True), (0.0, "log", False), (0.03, "caught", False)]
)
def test_friction_that_only_one_stop_shows_is_a_hands_where_a_hand_has_caught_another(friction, others, left):
    """Else nobody is known to have caught anything; and friction shows in the swings before it, too."""
    law = LAW.with_effect("coulomb", friction)
    found = named(
        decay(0.17, law),
        stopped(-0.14, law),
        decay(0.12, law),
        effect="coulomb",
        hold=1.0,
        ends=(others, "rest", others),
    )
    assert (found is not None) == left
    if found is not None:
        kept, text = found
        assert text.startswith("where the deck came to rest")
        assert [len(release.time) < len(TIME) for release in kept] == [False, True, False]


def halted(angle):
    """A hand stops it within a sample, aside, and holds it there."""
    roll, turn = decay(angle), int(np.searchsorted(TIME, 0.43))
    return np.where(TIME[turn] > TIME, roll, roll[turn] + 0.02)


@pytest.mark.parametrize("known", [True, False])
def test_the_noise_that_lasts_is_known_by_what_is_read_while_a_deck_is_held(known):
    """Without the hands a law holds, but leaves twice the noise that shows from sample to sample."""
    rng = np.random.default_rng(6)

    def lasting():
        smoothed = np.convolve(rng.standard_normal(len(TIME) + 7), np.full(8, 8**-0.5), "valid")
        return NOISE * (2 * smoothed + rng.standard_normal(len(TIME)))

    releases: list[Release] = []
    for number, roll in enumerate((halted(0.17), halted(-0.14)), start=1):
        time, std = TIME + 10 * number, np.full(len(TIME), NOISE)
        held = Signal(log="x", time=time - 2, roll=roll[0] + lasting(), std=std, origin="angle")
        part = replace(held, time=time, roll=roll + lasting())
        releases.append(
            Release.of(part, number=number, rest=0.0, hold=1.0, end="log", held=held if known else None)
        )
    found = diagnose(releases, load_board(shipped_data() / "boards" / "pink.toml"))
    assert found.verdict.status == ("none-missing" if known else "unexplained")
