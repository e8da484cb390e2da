"""Long recordings are judged by stretches of them."""

from dataclasses import replace

import numpy as np
import pytest

from sysid.diagnosis.stretches import MOST, judged_stretches
from sysid.roll import Release

PERIOD = 0.5


def release(periods, amplitude=0.2, number=1):
    time = 3.0 + np.arange(0.0, periods * PERIOD, 0.01)
    roll = amplitude * np.cos(2 * np.pi * time / PERIOD)
    return Release(
        log="x", number=number, time=time, roll=roll, std=np.full(len(time), 1e-3), origin="angle", rest=0.0,
        hold=1.0, end="rest",
    )  # fmt: skip


def lasts(releases):
    return sum(r.time[-1] - r.time[0] for r in releases) / PERIOD


def test_what_is_short_stays_as_it_is():
    releases = [release(20), release(30)]
    assert judged_stretches(releases, PERIOD) == (releases, "")


def test_a_long_decay_is_judged_where_it_is_wide_in_the_middle_and_small():
    whole = release(400)
    pieces, said = judged_stretches([whole], PERIOD)
    assert [p.number for p in pieces] == [1, 2, 3]
    assert (pieces[0].time[0], pieces[-1].time[-1]) == (
        whole.time[0],
        pytest.approx(whole.time[-1], abs=0.02),
    )
    assert [p.hold for p in pieces] == [1.0, 0.0, 0.0], "only the first was let go"
    assert lasts(pieces) <= MOST
    assert "400 periods" in said


def test_of_many_releases_the_widest_and_the_smallest_are_among_the_judged():
    angles = np.linspace(0.05, 0.2, 60)
    pieces, said = judged_stretches([release(10, a, n) for n, a in enumerate(angles, start=1)], PERIOD)
    found = [float(np.abs(p.roll).max()) for p in pieces]
    assert min(found) == pytest.approx(0.05, rel=0.01)
    assert max(found) == pytest.approx(0.2, rel=0.01)
    assert lasts(pieces) <= MOST
    assert said.startswith("5 of 60")


def test_a_deck_that_was_pushed_is_as_wide_as_it_swings():
    """It is let go near its rest, and fast."""
    pushed = replace(release(20), roll=0.3 * np.sin(2 * np.pi * release(20).time / PERIOD))
    pieces, _ = judged_stretches([pushed, *(release(20, a) for a in (0.2, 0.15, 0.1))], PERIOD)
    assert max(np.abs(p.roll).max() for p in pieces) > 0.25
