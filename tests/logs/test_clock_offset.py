"""Clocks are compared by one motion that both records show, and by no other."""

import numpy as np
import pytest
from decay_truth import linear_decay

from sysid.board import load_board
from sysid.errors import SysidError
from sysid.logs import read_roll
from sysid.logs.clock_offset import clock_offset
from sysid.roll import Roll
from sysid.synth import SynthOptions, synthesise
from sysid.workspace import shipped_data

BLACK = shipped_data() / "decays" / "black.csv"


def made(folder, name, **options):
    board = load_board(shipped_data() / "boards" / "black.toml")
    log = folder / name
    synthesise(board, {}, SynthOptions(duration=1.5, **options)).save(log)
    return read_roll(log)


@pytest.mark.parametrize("angles", [(0.17, -0.15), (0.16, -0.14, 0.12)])
def test_other_releases_of_the_same_board_are_no_common_motion(tmp_path, angles):
    with pytest.raises(SysidError, match=r"do not show the same motion \(correlation 0\.[5-8]"):
        clock_offset(read_roll(BLACK), made(tmp_path, "other.csv", angles=angles))


def test_two_sensors_on_one_deck_agree(tmp_path):
    one = made(tmp_path, "angle.csv", angles=(0.17, -0.15))
    other = made(tmp_path, "gyro.csv", angles=(0.17, -0.15), dialect="gyro")
    assert abs(clock_offset(one, other).value) < 1e-3


def sensed(rng, rate, noise, lasts=0.0):
    """A deck let go twice, as a sensor sees it whose clock starts somewhere; its errors may last [s]."""
    begin = rng.uniform(0.0, 0.01)
    time = begin + np.arange(0.0, 1.5, 1 / rate)
    roll = np.where(time < 0.5, 0.35, -0.15 * (1 - np.cos(np.pi * np.clip((time - 0.6) / 0.25, 0, 1))))
    for start in (0.3, 1.0):
        free = (time >= start) & (time < start + (0.3 if start < 0.5 else 9.9))
        roll[free] = linear_decay(time[free] - start, 41.083, 0.56265, 0.35 if start < 0.5 else -0.3)[0]
    errors = rng.normal(size=len(time))
    if lasts:
        share = np.exp(-1 / (rate * lasts))
        for i in range(1, len(errors)):
            errors[i] = share * errors[i - 1] + np.sqrt(1 - share**2) * errors[i]
    std = np.full(len(time), noise)
    return Roll(log="x", time=time - begin, roll=roll + noise * errors, std=std, origin="angle"), begin


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ((1000.0, 2e-3), (1000.0, 2e-3)),  # of one rate: noise alone would have them half a sample apart
        ((60.0, 1e-3), (1000.0, 5e-4)),
        ((120.0, 1e-3, 0.02), (500.0, 5e-4)),  # a film's errors last
    ],
)
def test_the_interval_of_an_offset_holds(one, other):
    inside, scores = [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        (film, first), (log, second) = sensed(rng, *one), sensed(rng, *other)
        offset = clock_offset(film, log)
        low, high = offset.ci95
        inside.append(low <= second - first <= high)
        scores.append((offset.value - second + first) / offset.std)
    assert np.mean(inside) > 0.95 - 3 * 0.04  # of 30 logs
    assert np.std(scores) == pytest.approx(1.0, abs=0.45)


def test_the_offset_turns_over_with_the_records():
    rng = np.random.default_rng(0)
    (film, _), (log, _) = sensed(rng, 60.0, 1e-3), sensed(rng, 1000.0, 1e-3)
    there, back = clock_offset(film, log), clock_offset(log, film)
    assert there.value == -back.value
    assert there.ci95 == (-back.ci95[1], -back.ci95[0])
