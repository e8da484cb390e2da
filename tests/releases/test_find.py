"""Releases are found in logs of known truth, whatever the damping, the sensor and the hand."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from decay_truth import DEGREE, Recipe, integrated_decay, linear_decay, make_roll
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sysid.decay.linear_fit import fit_traces
from sysid.errors import SysidError
from sysid.logs import LogOptions, read_roll
from sysid.noise.sensor import estimate_noise
from sysid.recording import Recording
from sysid.releases import find_releases, log_phases
from sysid.roll import Roll
from sysid.workspace import shipped_data


def starts(recipe, **options):
    return [release.start for release in find_releases(make_roll(recipe), **options)]


@pytest.mark.parametrize(
    ("zeta", "sampling"), [(0.02, 100), (0.1, 1000), (0.3, 100), (0.5626, 1000), (0.8, 100)]
)
def test_every_release_of_both_sides_is_found(zeta, sampling):
    amplitudes, free = (0.2, -0.18, -0.15, 0.22), max(1.0, 5 / (zeta * 41))
    recipe = Recipe(zeta=zeta, sampling=sampling, amplitudes=amplitudes, free=free, seed=3)
    found = find_releases(make_roll(recipe))
    period = 2 * np.pi / recipe.omega
    np.testing.assert_allclose([r.start for r in found], recipe.truth, atol=0.1 * period + 1 / sampling)
    assert [r.side for r in found] == ["right", "left", "left", "right"]
    assert [r.end for r in found] == ["rest"] * 4
    np.testing.assert_allclose([r.amplitude for r in found], np.abs(recipe.amplitudes), rtol=0.1)
    np.testing.assert_allclose([r.hold for r in found], recipe.holds, rtol=0.35)


def test_release_time_is_right_to_one_percent_of_a_period():
    recipe = Recipe(sampling=1000, noise=0.02 * DEGREE, amplitudes=(0.2,) * 6)
    errors = np.array(starts(recipe)) - recipe.truth
    assert np.abs(errors).max() < 0.01 * 2 * np.pi / recipe.omega


@pytest.mark.slow
def test_rough_logs_are_read_nearly_always():
    """Hand tremor, 0.3° noise, 9 samples a swing, encoders, hands at the end: 60 logs, most of them hard."""
    rng = np.random.default_rng(5)
    wrong = 0
    for _ in range(60):
        zeta, omega = rng.choice([0.02, 0.1, 0.3, 0.45, 0.5626, 0.8]), rng.choice([15.0, 41.08, 69.8])
        period = 2 * np.pi / omega
        sampling = rng.choice([100.0, 400.0, 1000.0])
        recipe = Recipe(
            omega=omega,
            zeta=zeta,
            sampling=sampling if sampling * period > 9 else 200.0,
            noise=rng.choice([0.02, 0.1, 0.3]) * DEGREE,
            amplitudes=tuple(rng.uniform(0.1, 0.3, rng.integers(1, 5)) * rng.choice([-1, 1])),
            rest=rng.uniform(-0.1, 0.1),
            lift=rng.choice([0.4, 1.5]),
            free=max(period + 0.3, min(6 / (zeta * omega), 40 * period)),
            tremor=rng.choice([0, 0.01, 0.03]),
            quantum=rng.choice([0, 0.0015]),
            hand_at_end=bool(rng.random() < 0.3),
            before=rng.choice([0.0, 1.0]),
            seed=int(rng.integers(1e9)),
        )
        found = find_releases(make_roll(recipe))
        good = len(found) == len(recipe.truth) and np.allclose(
            [r.start for r in found], recipe.truth, atol=0.12 * period + 1.5 / recipe.sampling
        )
        wrong += not (good and all(r.end == "rest" for r in found))
    assert wrong <= 6


def test_the_first_sample_may_be_in_the_decay():
    time = np.arange(2000) / 500
    for start, rate in ((0.2, 0.0), (0.05, 4.0)):
        roll, _ = linear_decay(time, 41, 0.1, start, rate)
        made = Roll(log="x", time=time, roll=roll + 0.3, std=np.full(2000, 1e-4), origin="angle")
        (release,) = find_releases(made)
        assert release.start < 0.5 * 2 * np.pi / 41
        assert release.hold == 0
        assert release.held is None
        assert release.rest == pytest.approx(0.3, abs=2e-3)


def test_a_decay_cut_off_by_the_end_of_the_log():
    recipe = Recipe(zeta=0.05, amplitudes=(0.2,), free=0.5)
    roll = make_roll(recipe)
    end = recipe.truth[0] + 0.5
    (release,) = find_releases(roll, stop=end)
    assert release.end == "log"
    assert release.time[-1] == pytest.approx(end, abs=0.01)


def test_dry_friction_ends_at_rest_and_not_in_a_catch():
    law = lambda x, v: -(41**2) * x - 2 * 0.05 * 41 * v - 41**2 * 0.012 * np.tanh(v / 0.01)  # noqa: E731
    (release,) = find_releases(make_roll(Recipe(law=law, free=2.0, sampling=500)))
    assert release.end == "rest"


def test_user_says_where_to_look():
    recipe = Recipe(amplitudes=(0.2, -0.2, 0.2))
    roll = make_roll(recipe)
    (second,) = find_releases(roll, start=recipe.truth[0] + 0.6, stop=recipe.truth[1] + 1.0)
    assert second.start == pytest.approx(recipe.truth[1], abs=0.02)
    given_time = recipe.truth[2] + 0.004
    (third,) = find_releases(roll, releases=[given_time])
    assert 0 <= third.start - given_time <= 1 / recipe.sampling + 1e-9
    assert third.end == "rest"
    both = find_releases(roll, releases=[recipe.truth[1], recipe.truth[0]])
    assert [r.number for r in both] == [1, 2]
    assert both[0].time[-1] < both[1].start


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"releases": [99.0]}, "nothing moves after"),
        ({"start": 50.0}, "the log runs from 0 s"),
        ({"start": 3.0, "stop": 2.0}, "at least 8 samples"),
    ],
)
def test_times_outside_the_log_are_refused(options, text):
    with pytest.raises(SysidError, match=text):
        find_releases(make_roll(Recipe()), **options)


def test_nothing_to_find_is_said():
    time = np.arange(3000) / 500
    flat = Roll(log="flat.csv", time=time, roll=np.zeros(3000), std=np.zeros(3000), origin="angle")
    with pytest.raises(SysidError, match=r"flat.csv: nothing moves"):
        find_releases(flat)
    with pytest.raises(SysidError, match="no stretch swings freely"):
        find_releases(replace(flat, roll=0.1 * time))


def test_a_swing_of_too_few_samples_is_told_from_one_that_is_too_small():
    """5.4 Hz at 14 Hz: the noise that is seen is the swing itself."""
    time = np.arange(0, 4, 0.07)
    swing = 0.2 * np.exp(-0.1 * time) * np.cos(34 * time)
    std = np.full(time.size, estimate_noise(swing).std)
    slow = Roll(log="slow.csv", time=time, roll=swing, std=std, origin="angle")
    with pytest.raises(
        SysidError,
        match=r"nothing moves by more than .* Neighbouring samples differ .* 14\.3 Hz may be too low",
    ):
        find_releases(slow)
    flat = replace(slow, roll=np.zeros_like(slow.roll))
    with pytest.raises(SysidError, match="nothing moves") as refused:
        find_releases(flat)
    assert "too low" not in str(refused.value)


def test_phases_cover_the_log_without_gaps_and_name_what_happens():
    recipe = Recipe(amplitudes=(0.2, -0.2), hand_at_end=True)
    roll = make_roll(recipe)
    phases = log_phases(roll, find_releases(roll))
    assert [phase.kind for phase in phases] == [*["rest", "held", "free"] * 2, "rest", "held"]
    assert phases[0].start == roll.time[0]
    assert phases[-1].end == roll.time[-1]
    assert all(one.end == other.start for one, other in pairwise(phases))
    free = [phase for phase in phases if phase.kind == "free"]
    np.testing.assert_allclose([phase.start for phase in free], recipe.truth, atol=0.015)
    assert all(0.05 < phase.end - phase.start < 0.3 for phase in free)


def test_a_deck_that_friction_stops_off_zero_is_at_rest_and_not_held():
    roll = read_roll(shipped_data() / "decays" / "pink_hidden.csv", LogOptions())
    phases = log_phases(roll, find_releases(roll))
    assert [phase.kind for phase in phases] == [*["rest", "held", "free"] * 3, "rest"]
    for held in (phase for phase in phases if phase.kind == "held"):
        assert 0.9 < held.end - held.start < 1.2, "a hand takes a second; the deck lies still for two"


@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    offset=st.floats(-3, 3),
    side=st.sampled_from([-1.0, 1.0]),
    scale=st.floats(0.3, 3),
    seed=st.integers(0, 99),
)
def test_offset_mirror_and_size_change_nothing(offset, side, scale, seed):
    recipe = Recipe(amplitudes=(0.2, -0.17), seed=seed, zeta=0.3, noise=0.05 * DEGREE)
    roll = make_roll(recipe)
    plain = find_releases(roll)
    moved = find_releases(replace(roll, roll=side * scale * roll.roll + offset, std=scale * roll.std))
    np.testing.assert_allclose([r.start for r in moved], [r.start for r in plain], atol=1e-6)
    np.testing.assert_allclose([r.hold for r in moved], [r.hold for r in plain], atol=0.02)
    assert [r.side == "right" for r in moved] == [(r.side == "right") == (side > 0) for r in plain]


REAL = {
    "kvlcc2_roll_decay/run_21337.csv": (24.95, "log"),
    "kvlcc2_roll_decay/run_21338.csv": (8.1, "log"),
    "servo_passive_drop/drop_kp100.csv": (2.0, "rest"),
    "servo_passive_drop/drop_kp200.csv": (2.0, "rest"),
    "servo_passive_drop/drop_kp400.csv": (2.0, "rest"),
    "servo_passive_drop/drop_kp800.csv": (2.0, "rest"),
    "rotary_pendulum_freeswing/swing_01.csv": (0.35, "log"),
}
"""The earliest free motion [s], and the end. The trace of the pendulum has a kink where the hand lets it go."""


@pytest.mark.parametrize("name", REAL)
def test_real_logs(real_logs, name):
    from sysid.logs import read_roll

    (release,) = find_releases(read_roll(real_logs / name))
    free, end = REAL[name]
    # A joint of another law than a cubic spring's may lose its widest swings.
    assert free - 0.1 < release.start < free + (release.time[-1] - free) / 8
    assert release.end == end


@pytest.mark.parametrize("name", [name for name, (_, end) in REAL.items() if end == "log"])
def test_a_joint_without_a_hold_is_free_from_the_time_that_the_user_gives(real_logs, name):
    from sysid.logs import read_roll

    free = REAL[name][0]
    assert find_releases(read_roll(real_logs / name), releases=[free])[0].start == pytest.approx(
        free, abs=0.02
    )


# What a hand did, and what it did not


def lightly_damped(zeta, period, rate, noise, wander):
    """A decay from rest of the hand to the end of the log, on a sensor whose zero wanders."""
    omega, hold = 2 * np.pi / period, 2 * period
    time = np.arange(0, hold + 60 * period, 1 / rate)
    free = np.maximum(time - hold, 0.0)
    swing = 0.2 * np.exp(-zeta * omega * free) * np.cos(omega * np.sqrt(1 - zeta**2) * free)
    zero = wander * np.sin(2 * np.pi * time / (7 * period) + 1)
    roll = swing + zero + np.random.default_rng(1).normal(0, noise, len(time))
    return Roll(log="made", time=time, roll=roll, std=np.full(len(time), noise), origin="angle")


@pytest.mark.parametrize(
    ("zeta", "period", "rate", "wander"),
    [
        (0.002, 0.185, 50.0, 0.01),
        (0.005, 0.185, 1000.0, 0.0),
        (0.002, 1.0, 50.0, 0.0),
        (0.005, 5.0, 15.0, 0.01),
    ],
)
def test_an_untouched_decay_stays_whole(zeta, period, rate, wander):
    """Few samples a period, or a zero that wanders by a twentieth of the swing, are no hand."""
    roll = lightly_damped(zeta, period, rate, 2e-4, wander)
    (release,) = find_releases(roll)
    assert release.time[-1] - release.time[0] > 50 * period


def test_a_hand_that_adds_to_a_swing_ends_the_decay():
    roll = lightly_damped(0.005, 1.0, 200.0, 2e-4, 0.0)
    pushed = roll.roll + np.where(roll.time > 30, 0.15 * np.sin(2 * np.pi * roll.time), 0.0)
    first, *_ = find_releases(replace(roll, roll=pushed))
    assert first.time[-1] < 32
    assert first.end == "caught"


@pytest.mark.parametrize("late", [0.012, 0.05])
def test_a_release_given_late_keeps_its_decay(late):
    """The swing that it cuts is shorter than the next one, which no hand has made."""
    recipe = Recipe(zeta=0.05, sampling=500, free=2.0, noise=0.05 * DEGREE)
    (release,) = find_releases(make_roll(recipe), releases=[recipe.truth[0] + late])
    assert release.start == pytest.approx(recipe.truth[0] + late, abs=2e-3)
    assert (release.end, release.hold) == ("rest", 0)
    fit = fit_traces([release])
    assert fit.omega_n == pytest.approx(recipe.omega, rel=2e-3)


def test_a_release_of_the_fewest_samples_is_found():
    recipe = Recipe(omega=2 * np.pi, zeta=0.05, sampling=7, free=1.2, noise=1e-4)
    roll = make_roll(recipe)
    begin = float(roll.time[-8])
    (release,) = find_releases(roll, releases=[begin])
    assert len(release.time) == 8


def test_a_release_given_while_a_hand_is_on_the_deck_is_refused_or_said():
    recipe = Recipe(zeta=0.05, sampling=500, free=2.0, noise=0.05 * DEGREE)
    roll = make_roll(recipe)
    held = Recording.of(roll, release=[recipe.truth[0] - 0.3])
    assert held.releases[0].start == pytest.approx(recipe.truth[0], abs=0.01)
    assert "the deck was still held: its decay begins at 2.27 s" in held.warnings[-1]
    assert not Recording.of(roll, release=[recipe.truth[0] - 0.01]).warnings
    for lifted in (1.0, 1.4):
        with pytest.raises(SysidError, match=rf"nobody let the deck go at {lifted:g} s.*about 2\.2"):
            find_releases(roll, releases=[lifted])


@pytest.mark.parametrize(
    ("rate", "noise", "zeta"),
    [(100.0, 0.0, 0.04), (100.0, 0.1 * DEGREE, 0.4), (200.0, 0.02 * DEGREE, 0.04), (1000.0, 0.0, 0.4)],
)
def test_a_deck_that_is_lifted_between_two_samples(rate, noise, zeta):
    """At rest in one sample, held at 8° in the next: the lift is no swing, and hides none of the three decays."""
    omega, count = 2 * np.pi / 0.185, int(rate)
    later = (np.arange(2 * count) + 0.3) / rate
    decay = linear_decay(later, omega, zeta, start=8 * DEGREE)[0]
    angle = np.concatenate([np.zeros(count), *[np.full(count, 8 * DEGREE), decay] * 3])
    angle += noise * np.random.default_rng(1).standard_normal(len(angle))
    time = np.arange(len(angle)) / rate
    std = np.full(len(angle), noise)
    found = find_releases(Roll(time=time, roll=angle, std=std, log="lifted", origin="angle"))
    np.testing.assert_allclose([release.start for release in found], [2.0, 5.0, 8.0], atol=0.015)
    np.testing.assert_allclose([release.hold for release in found], 1.0, atol=0.05)


def test_a_pendulum_whose_log_begins_held():
    """Held at 30° for 2 s, let go twice; between the two it is back at 30° from one sample to the next."""
    later = np.arange(6000) / 200
    swing, _ = integrated_decay(
        later, lambda q, v: -0.2 * v - (2 * np.pi * 0.8) ** 2 * np.sin(q), start=30 * DEGREE
    )
    angle = np.concatenate([np.full(400, 30 * DEGREE), swing] * 2)
    angle += 1e-3 * np.random.default_rng(1).standard_normal(len(angle))
    time, std = np.arange(len(angle)) / 200, np.full(len(angle), 1e-3)
    found = find_releases(Roll(time=time, roll=angle, std=std, log="pendulum", origin="angle"))
    np.testing.assert_allclose([release.start for release in found], [2.0, 34.0], atol=0.02)
    np.testing.assert_allclose([release.hold for release in found], 2.0, atol=0.05)


@pytest.mark.parametrize(
    ("zeta", "angles"), [(0.95, (1.2, 0.8, 1.4)), (1.0, (1.2, 1.2, 1.2)), (1.4, (1.2, 0.8, 1.4))]
)
def test_a_joint_slower_than_the_hand_that_opens_it_rests_where_it_comes_to_most_often(zeta, angles):
    """A door with a closer: opened in a second and a half, held, and closed by itself in three times as long."""
    omega, step = 1.25, 0.02
    time = np.arange(0, 20, step)
    opened = 0.5 * (1 - np.cos(np.pi * np.clip((time - 2) / 1.5, 0, 1)))
    slow, fast = omega * (
        -zeta + np.emath.sqrt(zeta**2 - 1) * np.array([1.0, -1.0]) + np.array([1e-6, -1e-6])
    )
    after = np.maximum(time - 5, 0)
    closing = np.real((slow * np.exp(fast * after) - fast * np.exp(slow * after)) / (slow - fast))
    roll = np.concatenate([angle * opened * closing for angle in (*angles, 0.0)])
    noisy = roll + np.random.default_rng(2).normal(0, 0.2 * DEGREE, len(roll))
    std = np.full(len(roll), 0.2 * DEGREE)
    whole = Roll(log="door", time=step * np.arange(len(roll)), roll=noisy, std=std, origin="angle")
    found = find_releases(whole)
    assert [r.start for r in found] == pytest.approx([5, 25, 45], abs=0.15)
    assert [r.rest for r in found] == pytest.approx([0, 0, 0], abs=0.1)
    assert fit_traces(found).damping_ratio == pytest.approx(zeta, rel=0.06)
