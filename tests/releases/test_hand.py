"""A hand is cut off both ends of a decay, whatever the joint's law, and nothing that is no hand is."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from decay_truth import DEGREE, Recipe, integrated_decay, lift, linear_decay, make_roll
from scipy.integrate import solve_ivp

from sysid.decay.linear_fit import fit_traces
from sysid.releases import find_releases
from sysid.releases.extrema import smooth_signal

from sysid.roll import Roll

OMEGA = 41.0
PERIOD = 2 * np.pi / OMEGA
LAWS = {
    "linear": lambda x, v: -(OMEGA**2) * x - 2 * 0.04 * OMEGA * v,
    "softening": lambda x, v: -(OMEGA**2) * x * (1 - 8 * x * x) - 2 * 0.04 * OMEGA * v,
    "drag": lambda x, v: -(OMEGA**2) * x - 0.5 * v * abs(v) - 0.02 * OMEGA * v,
    "friction": lambda x, v: -(OMEGA**2) * x - OMEGA**2 * 0.0025 * np.tanh(v / 0.02) - 0.04 * OMEGA * v,
}


def handled(law, *, push, swings, seed=1, noise=0.03 * DEGREE, rate=500.0, speed_share=0.3):
    """Three decays of a deck that a hand pushes on its way for `push` seconds and catches after `swings` periods.

    Returns the log and from when until when nobody touched the deck.
    """
    now, free, pieces = 0.5, [], [np.zeros(int(0.5 * rate))]
    angle = 0.0
    for start in (0.18, -0.16, 0.14):

        def add(values):
            nonlocal now, angle
            pieces.append(values)
            now, angle = now + len(values) / rate, float(values[-1])

        since = np.arange(0, 1.2, 1 / rate)
        add(angle + (start - angle) * lift(since, 0.5))
        share = np.arange(0, 1, 1 / (push * rate)) if push else np.zeros(0)
        speed = -speed_share * OMEGA * start
        if push:  # from rest to a share of the free deck's top speed, as u³
            add(start + speed * push * share**3 / 3)
        begin = now
        since = np.arange(0, swings * PERIOD, 1 / rate)
        roll, rates = integrated_decay(since, law, angle, speed if push else 0.0)
        add(roll)
        free.append((begin, now))
        since = np.arange(1 / rate, 0.4, 1 / rate)
        add(roll[-1] + rates[-1] * 0.03 * (1 - np.exp(-since / 0.03)))
    pieces.append(angle * (1 - lift(np.arange(0, 1, 1 / rate), 0.3)))
    roll = np.concatenate(pieces)
    time = np.arange(len(roll)) / rate
    noisy = roll + noise * np.random.default_rng(seed).standard_normal(len(roll))
    return Roll(log="made.csv", time=time, roll=noisy, std=np.full(len(roll), noise), origin="angle"), free


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("push", [0.0, 0.06])
def test_a_decay_is_what_lies_between_the_hand_that_lets_go_and_the_one_that_catches(law, push):
    roll, free = handled(LAWS[law], push=push, swings=4.6)
    found = find_releases(roll)
    assert len(found) == len(free)
    for release, (begin, end) in zip(found, free, strict=True):
        assert -0.05 < (release.start - begin) / PERIOD < 0.15
        assert -0.6 < (release.time[-1] - end) / PERIOD < 0.05
        assert release.end == "caught"
        assert (release.hold > 0) == (push == 0)


@pytest.mark.parametrize("friction", [0.01, 0.02, 0.06])
@pytest.mark.parametrize("push", [0.0, 0.06])
def test_a_push_is_cut_where_dry_friction_leaves_a_swing_or_two_to_tell_it_from(friction, push):
    roll, free = handled(
        lambda x, v: -(OMEGA**2) * (x + friction * np.tanh(v / 0.05)) - 1.6 * v, push=push, swings=9.0
    )
    found = find_releases(roll)
    assert len(found) == len(free)
    for release, (begin, _) in zip(found, free, strict=True):
        assert -0.05 < (release.start - begin) / PERIOD < 0.15
        assert (release.hold > 0) == (push == 0)


@pytest.mark.parametrize(("gap", "friction"), [(0.03, 0.06), (0.04, 0.06), (0.06, 0.03)])
def test_a_hand_that_pushes_harder_than_a_loose_joint_pulls_is_cut_as_long_as_where_it_is_seen(gap, friction):
    """In a narrow release gap and friction leave the joint less pull than the hand has, so that its push looks like the joint's."""

    def law(x, v):
        return -(OMEGA**2) * (x - np.clip(x, -gap, gap) + friction * np.tanh(v / 0.05)) - 1.6 * v

    roll, free = handled(law, push=0.06, swings=9.0)
    for release in find_releases(roll):
        begin = min((begin for begin, _ in free), key=lambda begin: abs(release.start - begin))
        assert -0.05 < (release.start - begin) / PERIOD < 0.15


def test_a_push_is_counted_from_where_the_deck_is_last_seen_in_its_hold():
    """And not from an onset that is extrapolated from the way that follows, which a push may make late."""
    roll, free = handled(LAWS["linear"], push=0.06, swings=9.0)
    late = (0.0, 0.04, 0.0)
    spans = [
        Span(begin - 0.06 + shift, end, 0.0, level)
        for (begin, end), shift, level in zip(free, late, (0.18, -0.16, 0.14), strict=True)
    ]
    found = _let_go(smooth_signal(roll.time, roll.roll, float(roll.std[0])), spans, PERIOD)
    assert found == pytest.approx([begin for begin, _ in free], abs=0.12 * PERIOD)


@pytest.mark.parametrize("push", [0.0, 0.06])
def test_a_push_is_told_from_a_hold_under_noise(push):
    roll, free = handled(LAWS["linear"], push=push, swings=9.0, noise=0.25 * DEGREE)
    found = find_releases(roll)
    assert [release.hold > 0 for release in found] == [push == 0] * 3
    for release, (begin, _) in zip(found, free, strict=True):
        assert -0.05 < (release.start - begin) / PERIOD < 0.25


def test_a_weak_push_is_told_from_a_hold():
    roll, _ = handled(LAWS["linear"], push=0.06, swings=9.0, speed_share=0.07)
    assert [release.hold for release in find_releases(roll)] == [0.0] * 3


def test_a_deck_that_dry_friction_stops_at_once_is_a_release_like_the_others():
    roll, free = handled(
        lambda x, v: -(OMEGA**2) * (x + 0.06 * np.tanh(v / 0.05)) - 1.6 * v,
        push=0.0,
        swings=9.0,
        noise=0.1 * DEGREE,
    )
    found = find_releases(roll)
    assert [r.start for r in found] == pytest.approx([begin for begin, _ in free], abs=0.1 * PERIOD)
    assert all(release.time[-1] - release.start > PERIOD for release in found)


@pytest.mark.parametrize(("gap", "friction"), [(0.0, 0.05), (0.05, 0.06), (0.06, 0.05), (0.08, 0.03)])
def test_decks_that_stick_far_from_one_another_are_of_one_joint(gap, friction):
    """Gap and friction hold a deck anywhere between the two sides; a hand's lift leads to where nothing would hold it."""
    roll, free = handled(
        lambda x, v: -(OMEGA**2) * (x - np.clip(x, -gap, gap) + friction * np.tanh(v / 0.05)) - 1.6 * v,
        push=0.0,
        swings=9.0,
    )
    found = find_releases(roll)
    assert [r.start for r in found] == pytest.approx([begin for begin, _ in free], abs=0.1 * PERIOD)


@pytest.mark.parametrize("push", [0.0, 0.06])
def test_between_two_hands_a_linear_decay_is_linear_to_the_noise(push):
    roll, _ = handled(LAWS["linear"], push=push, swings=6.3)
    fit = fit_traces(find_releases(roll))
    assert fit.noise < 1.05 * 0.03 * DEGREE
    assert fit.omega_n == pytest.approx(OMEGA, rel=5e-4)
    assert fit.damping_ratio == pytest.approx(0.04, rel=0.02)


def arm(time, stiffness, memory):
    """Roll of a joint with a Maxwell arm, let go where the arm had come to rest."""

    def law(_, state):
        x, v, pull = state
        return v, -(OMEGA**2) * (x + pull) - 2 * 0.03 * OMEGA * v, stiffness * v - pull / memory

    return solve_ivp(law, (0, time[-1]), (0.18, 0.0, 0.0), "DOP853", time, rtol=1e-9, atol=1e-11).y[0]


def filtered(time, lag):
    """Roll of a linear joint behind a first-order low-pass, by exact steps of a signal that is linear between samples."""
    roll, _ = linear_decay(time, OMEGA, 0.05, 0.18)
    out, keep = np.empty_like(roll), np.exp(-(time[1] - time[0]) / lag)
    out[0] = roll[0]
    for i in range(1, len(roll)):
        out[i] = keep * out[i - 1] + (1 - keep) * (roll[i] + roll[i - 1]) / 2
    return out


STOP = lambda x, v: -(OMEGA**2) * (x + 2 * max(x - 0.17, 0.0)) - 0.1 * OMEGA * v  # noqa: E731
NO_HAND = {
    "linear": lambda time: linear_decay(time, OMEGA, 0.05, 0.2)[0],
    "a stop that it leaned on": lambda time: integrated_decay(time, STOP, 0.2)[0],
    "filter": lambda time: filtered(time, 0.008),
    "softening": lambda time: integrated_decay(
        time, lambda x, v: -(OMEGA**2) * x * (1 - 8 * x * x) - 3 * v, 0.2
    )[0],
    "hardly a swing": lambda time: linear_decay(time, OMEGA, 0.5, 0.2)[0],
    "quick arm": lambda time: arm(time, 0.3, 0.02),
    "slow arm": lambda time: arm(time, 0.3, 0.2),
}


@pytest.mark.parametrize("joint", NO_HAND)
def test_what_is_no_hand_keeps_its_beginning(joint):
    time = np.arange(0, 4.0, 1 / 500)
    decay = NO_HAND[joint](time[time >= 1.0] - 1.0)
    clean = np.concatenate([np.full(np.count_nonzero(time < 1.0), decay[0]), decay])
    noise = 0.05 * DEGREE
    for seed in range(3):
        roll = clean + noise * np.random.default_rng(seed).standard_normal(len(time))
        (release,) = find_releases(
            Roll(log="x", time=time, roll=roll, std=np.full(len(time), noise), origin="angle")
        )
        assert release.hold > 0.9
        assert release.start == pytest.approx(1.0, abs=0.1 * PERIOD)


def test_a_decay_and_its_mirror_are_cut_alike():
    roll, _ = handled(LAWS["drag"], push=0.06, swings=5.2)
    one, other = find_releases(roll), find_releases(replace(roll, roll=-roll.roll))
    assert [(r.start, r.time[-1], r.end) for r in one] == [(r.start, r.time[-1], r.end) for r in other]


def test_a_push_is_cut_though_the_deck_then_swings_to_rest():
    recipe = Recipe(zeta=0.05, sampling=500, free=2.0, noise=0.05 * DEGREE, seed=4)
    roll = make_roll(recipe)
    begin, hand = recipe.truth[0], 0.05
    since = roll.time - begin - hand
    share = np.clip(1 + since / hand, 0, 1)
    way = 0.05 * share**3 * (1 - 0.2 * share)
    free, _ = linear_decay(np.maximum(since, 0), recipe.omega, recipe.zeta, 0.16, -0.05 * 2.2 / hand)
    clean = make_roll(replace(recipe, noise=0.0, truth=[], holds=[]))
    truth = np.where(since >= 0, free, np.where(since >= -hand, 0.2 - way, clean.roll))
    (release,) = find_releases(replace(roll, roll=truth + roll.roll - clean.roll))
    assert (release.hold, release.end) == (0, "rest")
    assert -0.02 < (release.start - begin - hand) / PERIOD < 0.15
    assert fit_traces([release]).noise < 1.1 * recipe.noise


def test_a_hand_that_holds_a_damped_deck_ends_its_decay():
    """Most of what a law could be learned from hardly moves, and none follows the whole; one of the wide swings has seen the hand."""
    roll, free = handled(
        lambda x, v: -(OMEGA**2) * x - 0.2 * OMEGA * v, push=0.0, swings=4.2, noise=0.2 * DEGREE
    )
    for release, (_, end) in zip(find_releases(roll), free, strict=True):
        assert -0.6 < (release.time[-1] - end) / PERIOD < 0.6


def test_what_swings_after_a_hand_is_a_decay_of_its_own():
    """A hand stops the deck at a turn and lets it go from there: its turning points are those of one decay."""
    caught, again = 0.6 + 4 * PERIOD, 2.2
    time = np.arange(0, 3.4, 1 / 500)
    first = linear_decay(np.maximum(time - 0.6, 0), OMEGA, 0.02, 0.11)[0]
    stop = linear_decay(np.array([caught - 0.6]), OMEGA, 0.02, 0.11)[0][0]
    second = linear_decay(np.maximum(time - again, 0), OMEGA, 0.02, stop)[0]
    clean = np.where(time < caught, first, np.where(time < again, stop, second))
    roll = clean + 5e-4 * np.random.default_rng(2).standard_normal(len(time))
    found = find_releases(Roll(log="x", time=time, roll=roll, std=np.full(len(time), 5e-4), origin="angle"))
    assert [r.start for r in found] == pytest.approx([0.6, again], abs=0.1 * PERIOD)
    assert found[0].end == "caught"
    assert -0.6 < (found[0].time[-1] - caught) / PERIOD < 0.05


@pytest.mark.parametrize(("share", "loss"), [(0.05, 0.03), (0.08, 0.03), (0.05, 0.01)])
def test_a_decay_that_fades_and_swells_again_by_itself_is_one(share, loss):
    """A body of the deck's own frequency hangs on it: it takes the swing, and gives it back, the slower the less is lost meanwhile."""

    def law(_, y):
        pull = share * (OMEGA**2 * (y[0] - y[2]) + 2 * loss * OMEGA * (y[1] - y[3]))
        return y[1], -(OMEGA**2) * y[0] - loss * OMEGA * y[1] - pull, y[3], pull / share

    time = np.arange(0, 4, 1 / 500)
    free = solve_ivp(law, (0, 3), (0.18, 0.0, 0.18, 0.0), "DOP853", time[time < 3.0], rtol=1e-9).y[0]
    roll = np.concatenate([np.full(500, 0.18), free]) + 3e-4 * np.random.default_rng(3).standard_normal(2000)
    (release,) = find_releases(Roll(log="x", time=time, roll=roll, std=np.full(2000, 3e-4), origin="angle"))
    assert release.start == pytest.approx(1.0, abs=0.05 * PERIOD)
    assert release.time[-1] - release.start > 8 * PERIOD


@pytest.mark.parametrize("drift", [-0.025, 0.1])
def test_a_sensor_that_drifts_loses_no_release(drift):
    """The larger drift moves the rest angle by more than the widest swing from one release to the next."""
    roll, free = handled(LAWS["linear"], push=0.0, swings=9.0)
    found = find_releases(replace(roll, roll=roll.roll + drift * roll.time))
    assert [r.start for r in found] == pytest.approx([begin for begin, _ in free], abs=0.1 * PERIOD)


def test_a_slider_that_yields_once_and_then_holds_more_than_doubles_the_pace():
    """It gives way in the first swing, which is slow, and is a spring in all that follow, which are a sixth as wide."""
    k, slider, most = 8.0 / 8.7e-3, 44.0 / 8.7e-3, 0.009

    def law(_, y):
        return y[1], -k * y[0] - slider * y[2] - 5.4 * y[1], y[1] * (abs(y[2]) < most or y[1] * y[2] < 0)

    angle, begins, pieces = 0.0, [], [np.zeros(160)]
    rng, free, lifted = np.random.default_rng(4), np.arange(0, 2, 5e-3), np.arange(0, 1.2, 5e-3)
    for start in (0.112, -0.089, 0.065):
        pieces.append(angle + (start - angle) * lift(lifted, 0.4))
        begins.append(5e-3 * sum(map(len, pieces)))
        held = (start, 0.0, np.copysign(most, start))
        pieces.append(solve_ivp(law, (0, 2), held, t_eval=free, rtol=1e-8, max_step=1e-3).y[0])
        angle = pieces[-1][-1]
    roll = np.concatenate(pieces) + 2.5e-4 * rng.standard_normal(sum(map(len, pieces)))
    time, std = 5e-3 * np.arange(len(roll)), np.full(len(roll), 2.5e-4)
    found = find_releases(Roll(log="x", time=time, roll=roll, std=std, origin="angle"))
    assert [r.start for r in found] == pytest.approx(begins, abs=0.02)


def test_a_first_swing_that_lasts_nearly_three_times_as_long_as_the_next_is_of_the_decay():
    """Half a cosine from the hold, then swings at the pace of a slider that holds; its short turning points are no hold."""
    slow, quick, time = 0.087, 0.03, np.arange(0, 4, 1 / 500)
    since = np.maximum(time - 1.0, 0.0)
    first = 0.1 - 0.056 * (1 - np.cos(np.pi * np.minimum(since / slow, 1.0)))
    later = np.maximum(since - slow, 0.0)
    roll = first + 0.016 * (1 - np.exp(-4 * later) * np.cos(np.pi * later / quick))
    roll += 3e-4 * np.random.default_rng(2).standard_normal(len(time))
    (release,) = find_releases(
        Roll(log="x", time=time, roll=roll, std=np.full(len(time), 3e-4), origin="angle")
    )
    assert release.start == pytest.approx(1.0, abs=0.02)
    assert release.hold > 0.5


def test_what_a_hand_takes_home_from_where_it_stopped_the_deck_is_no_release():
    """It carries the swing on, holds the deck, and takes it to rest as quickly as it swings."""
    caught, held, slow = 0.6 + 3.9 * PERIOD, 0.12, 0.6 * PERIOD
    time = np.arange(0, 3.4, 1 / 500)
    free = linear_decay(np.maximum(time - 0.6, 0), OMEGA, 0.01, 0.16)[0]
    angle, rate = (float(np.interp(caught, time, y)) for y in (free, np.gradient(free, time)))
    since = np.maximum(time - caught, 0)
    stop = angle + 0.03 * rate * (1 - np.exp(-since / 0.03))
    clean = np.where(time < caught, free, stop * (1 - lift(np.maximum(since - held, 0), slow)))
    roll = clean + 5e-4 * np.random.default_rng(2).standard_normal(len(time))
    (release,) = find_releases(
        Roll(log="x", time=time, roll=roll, std=np.full(len(time), 5e-4), origin="angle")
    )
    assert -0.6 < (release.time[-1] - caught) / PERIOD < 0.05


def test_what_a_hand_takes_home_from_where_friction_held_the_deck_is_no_release():
    """It stays where it stopped after a swing or two, until a hand takes it to its rest, as quickly as it swings."""
    roll, free = handled(
        lambda x, v: -(OMEGA**2) * (x - np.clip(x, -0.05, 0.05) + 0.06 * np.tanh(v / 0.05)) - 1.6 * v,
        push=0.0,
        swings=9.0,
    )
    until = int(np.searchsorted(roll.time, free[-1][1]))
    stuck, since = float(np.mean(roll.roll[until - 50 : until])), roll.time[until:] - roll.time[until]
    assert abs(stuck) > 0.02
    noise = 0.03 * DEGREE * np.random.default_rng(2).standard_normal(len(since))
    home = stuck * (1 - lift(np.maximum(since - 0.4, 0), 0.8 * PERIOD)) + noise
    found = find_releases(replace(roll, roll=np.concatenate([roll.roll[:until], home])))
    assert [r.start for r in found] == pytest.approx([begin for begin, _ in free], abs=0.1 * PERIOD)


@pytest.mark.parametrize("off", [0.0, 0.01])
@pytest.mark.parametrize(
    ("swings", "grows", "on"), [(0, 1, False), (3, 1, False), (4, 0.8, True), (4, 0.3, False), (4, 2, False)]
)
@pytest.mark.parametrize(("periods", "seen"), [(3, True), (8, False)])
def test_a_law_that_is_a_little_off_everywhere_hides_no_hand(off, swings, grows, on, periods, seen):
    """Time runs backward: first a third of the swing's torque, then a law that is surer of itself than right.

    What lasts for many periods is no hand but a joint that is loose near its rest, unless the law holds everywhere else and the deck
    does not swing on, for a hand stops it, or drives it.
    """
    time = np.arange(0.0, 4.0, 0.01)
    swing = np.full(len(time), 0.1)
    torque = np.where(time < periods * 0.2, 0.03, off * swing)
    law = SimpleNamespace(beyond=lambda w, n: (torque, np.full(len(time), 1e-4)), about=lambda w, n: swing)
    windows = SimpleNamespace(time=time, width=0.1, period=20)
    after = [(end, 0.1 * grows) for end in np.linspace(-1.5, -1.0, swings)]
    found = _hand(windows, law, 0, 3.8, [(-3.0, 0.1), *after])
    if seen or not (off or on):
        assert found == pytest.approx(periods * 0.2, abs=0.02)
    else:
        assert found is None


@pytest.mark.parametrize(("left", "seen"), [(0.8, False), (0.3, True), (1.3, True)])
def test_a_deck_that_loses_as_much_after_as_before_was_caught_by_no_hand(left, seen):
    """Time runs backward. Rubber that creeps back moves the middle of the swings, and is as far from any law of tilt and rate as a hand."""
    time = np.arange(0.0, 4.0, 0.01)
    torque = np.where(time < 0.6, 0.03, 0.0)
    law = SimpleNamespace(
        beyond=lambda w, n: (torque, np.full(len(time), 1e-4)), about=lambda w, n: np.full(len(time), 0.1)
    )
    windows = SimpleNamespace(time=time, width=0.1, period=20)
    swings = [(-0.9, 0.125), (-0.8, 0.1), (-0.7, 0.08)] + [
        (-0.5 + 0.1 * i, 0.08 * left ** (i + 1)) for i in range(4)
    ]
    assert (_hand(windows, law, 0, 3.8, swings) is not None) == seen
