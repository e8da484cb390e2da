"""A growing log gives each release once, a hand that holds the deck none, and the next step follows from what there is."""

from dataclasses import replace

import numpy as np
import pytest
from decay_truth import Recipe, make_roll

from sysid.errors import SysidError
from sysid.live.session import EACH_SIDE, Session, next_release
from sysid.recording import Recording
from sysid.releases import find_releases

AMPLITUDES = (0.2, -0.15, 0.05)


@pytest.fixture(scope="module")
def roll():
    return make_roll(Recipe(amplitudes=AMPLITUDES, sampling=200, noise=3e-4))


def until(roll, time):
    part = roll[roll.time <= time]
    return Recording(roll=part, releases=tuple(find_releases(part)))


def test_numbers_come_with_each_release_and_their_intervals_shrink(pink, roll):
    session = Session(pink)
    starts = [release.start for release in find_releases(roll)]
    seen = []
    for number, start in enumerate(starts, start=1):
        assert session.take([until(roll, start + 0.6)])
        assert not session.take([until(roll, start + 0.8)])  # the same releases again
        assert len(session.releases) == number
        seen.append(session.decay.numbers.stiffness.ci95)
    first, second, (low, high) = seen
    assert high - low < np.ptp(second) < np.ptp(first)
    assert low < 14.68 < high


def test_a_hand_that_tilts_the_deck_and_holds_it_is_no_release(pink, roll):
    """A smooth hand is told by its slow start; a quick one looks like a release until the deck is let go."""
    let_go = find_releases(roll)[0].start
    with pytest.raises(SysidError, match="no stretch swings freely"):
        until(roll, let_go - 0.05)
    ramp = np.clip((roll.time - roll.time[0] - 0.8) / 0.1, 0, 1)
    held = until(replace(roll, roll=0.2 * ramp), let_go - 0.05)
    assert held.releases
    assert not Session(pink).take([held])


def release(roll, degrees):
    """A release from some degrees, the right edge down where they are positive."""
    first = find_releases(roll)[0]
    return replace(first, roll=first.roll * np.radians(degrees) / first.roll[0])


@pytest.mark.parametrize(
    ("angles", "words"),
    [
        ((), "Hold the deck still at 10°"),
        ((10,), "Three more from the left, from 3°."),
        ((10, -9, 9), "Two more from the left, from 3°."),
        ((53,), "Three more from the left, from 20°."),
        ((10, -9, 9, -9, -3), "One more from the right, from 10°."),
        ((10, -9, 9, -9, 8, -8), "One more from 3°"),
        ((10, -9, 9, -9, 8, -2), "Enough"),
    ],
)
def test_the_next_release_is_the_one_that_helps_most(pink, roll, angles, words):
    assert words in next_release([release(roll, angle) for angle in angles], pink)
    assert EACH_SIDE == 3
