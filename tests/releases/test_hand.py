"""A hand is cut off both ends of a decay, whatever the joint's law, and nothing that is no hand is."""

from dataclasses import replace

import numpy as np
import pytest
from decay_truth import DEGREE, integrated_decay, lift, linear_decay

from sysid.decay.linear_fit import fit_traces
from sysid.releases import find_releases
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


@pytest.mark.parametrize(
    ("law", "push"),
    [(law, push) for law in LAWS for push in (0.0, 0.06) if (law, push) != ("friction", 0.06)],
)
def test_a_decay_is_what_lies_between_the_hand_that_lets_go_and_the_one_that_catches(law, push):
    roll, free = handled(LAWS[law], push=push, swings=4.6)
    found = find_releases(roll)
    assert len(found) == len(free)
    for release, (begin, end) in zip(found, free, strict=True):
        assert -0.05 < (release.start - begin) / PERIOD < 0.15
        assert -0.6 < (release.time[-1] - end) / PERIOD < 0.05
        assert release.end == "caught"
        assert (release.hold > 0) == (push == 0)


@pytest.mark.parametrize("push", [0.0, 0.06])
def test_between_two_hands_a_linear_decay_is_linear_to_the_noise(push):
    roll, _ = handled(LAWS["linear"], push=push, swings=6.3)
    fit = fit_traces(find_releases(roll))
    assert fit.noise < 1.1 * 0.03 * DEGREE
    assert fit.omega_n == pytest.approx(OMEGA, rel=5e-4)
    assert fit.damping_ratio == pytest.approx(0.04, rel=0.02)


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


@pytest.mark.parametrize("drift", [-0.025, 0.1])
def test_a_sensor_that_drifts_loses_no_release(drift):
    """The larger drift moves the rest angle by more than the widest swing from one release to the next."""
    roll, free = handled(LAWS["linear"], push=0.0, swings=9.0)
    found = find_releases(replace(roll, roll=roll.roll + drift * roll.time))
    assert [r.start for r in found] == pytest.approx([begin for begin, _ in free], abs=0.1 * PERIOD)
