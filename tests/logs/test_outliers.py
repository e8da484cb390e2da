"""Lone samples that no motion explains are left out and said; all that a deck, a hand or a stop can do is kept."""

import numpy as np
import pytest
from command_line import called
from hypothesis import example, given, settings
from hypothesis import strategies as st
from rocking import imu, rocking, write_csv

from sysid.logs import LogOptions, read_roll
from sysid.logs.table.rows import measured_motion
from sysid.noise.outliers import lone_outliers
from sysid.recording import Recording

TIME = np.arange(0, 6, 1 / 200)
SEEDS = st.integers(0, 2**32 - 1)


def decay(seed: int, *, noise: float, step: float):
    roll = rocking(TIME)[0] + np.random.default_rng(seed).normal(0, noise, len(TIME))
    return np.round(roll / step) * step if step else roll


@settings(deadline=None, max_examples=25)
@example(seed=84752506, spikes=7, noise=0.0, step=np.radians(0.1), twice=True)
@given(
    SEEDS,
    st.integers(1, 12),
    st.sampled_from([0.0, 1e-4, 1e-3]),
    st.sampled_from([0.0, np.radians(0.1)]),
    st.booleans(),
)
def test_a_decay_with_lone_spikes_reads_as_the_one_without(seed, spikes, noise, step, twice):
    """Each spike is larger than the swing: one row, or two rows in a row or near each other."""
    rng = np.random.default_rng(seed)
    clean = decay(seed, noise=noise, step=step)
    rows = 10 + 20 * rng.choice(np.arange(58), spikes, replace=False)
    if twice:
        rows = np.concatenate((rows, rows + rng.integers(1, 5, spikes)))
    spiked = clean.copy()
    spiked[rows] += rng.choice((-1, 1), len(rows)) * rng.uniform(0.3, 3.0, len(rows))
    distance = lone_outliers(TIME, spiked, rate=False)
    assert set(np.flatnonzero(distance)) == set(rows)
    np.testing.assert_allclose(distance[rows], (spiked - clean)[rows], atol=0.02)


@settings(deadline=None, max_examples=40)
@given(
    SEEDS,
    st.sampled_from([20.0, 30.0, 40.0, 100.0, 1000.0]),
    st.sampled_from([0.0, 1e-5, 1e-3]),
    st.sampled_from([0.0, np.radians(0.1)]),
    st.sampled_from(["swing", "rate", "stop", "stick", "reset"]),
    st.sampled_from([0.0, 0.02, 0.2]),
)
def test_no_motion_is_an_outlier(seed, sampling, noise, step, kind, lost):
    """Swings hardly sampled, kinks and steps of stops, of sticking and of a counter set back, with rows lost."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, 6, 1 / sampling)
    time = time[rng.uniform(size=len(time)) >= lost]
    roll, rate, _ = rocking(time, release=rng.uniform(0.5, 1.5), zeta=rng.uniform(0.005, 0.3))
    signal = {
        "swing": roll,
        "rate": rate,
        "stop": np.where(roll < 0, rate, -0.6 * rate),
        "stick": np.where(time > 2.5, roll[np.searchsorted(time, 2.5)], roll),
        "reset": roll + 0.5 * (time > 3.0),
    }[kind] + rng.normal(0, noise, len(time))
    signal = np.round(signal / step) * step if step else signal
    assert not lone_outliers(time, signal, rate=kind in ("rate", "stop")).any()
    assert measured_motion({"roll": signal}, time, "rad", rates=kind in ("rate", "stop"))[0] is None


def test_a_knock_that_rings_is_a_motion():
    knock = np.where(TIME > 2, np.exp(-150 * (TIME - 2)) * np.sin(2 * np.pi * 60 * (TIME - 2)), 0.0)
    rate = rocking(TIME)[1] + 3 * knock + np.random.default_rng(0).normal(0, 1e-3, len(TIME))
    assert not lone_outliers(TIME, rate, rate=True).any()


@pytest.fixture
def spiked(tmp_path):
    angle = np.degrees(decay(1, noise=1e-3, step=0.0))
    angle[[70, 420, 421, 900]] += 8.0
    return write_csv(tmp_path / "log.csv", ("time_s", "roll_deg"), TIME, angle)


def test_they_are_left_out_like_dropped_rows_and_said(spiked):
    roll = read_roll(spiked)
    (said,) = roll.warnings
    for text in ("4 lone samples of 'roll_deg'", "at 0.35 s", "; deg)", "--keep-outliers"):
        assert text in said
    np.testing.assert_allclose(roll.time, np.delete(TIME, [70, 420, 421, 900]))


def test_they_can_be_kept(spiked, capsys, tmp_path):
    kept = read_roll(spiked, LogOptions(keep_outliers=True))
    assert not kept.warnings
    assert len(kept.time) == len(TIME)
    assert len(Recording.read(spiked).roll.time) == len(TIME) - 4
    assert len(Recording.read(spiked, keep_outliers=True, start=4.6).roll.time) == len(TIME)
    called("roll", spiked, "-o", tmp_path / "roll.csv", "--keep-outliers")
    assert "1200 rows" in capsys.readouterr().out


def test_a_gyro_loses_its_outliers_and_an_accelerometer_keeps_its_knocks(tmp_path):
    gyro, accel = imu(TIME, *rocking(TIME, zeta=0.05))
    gyro += np.random.default_rng(0).normal(0, 1e-3, gyro.shape)
    gyro[500, 0] += 5.0
    accel[700, 1] += 2.0
    header = ("t_s", *(f"g{x} (rad/s)" for x in "xyz"), *(f"a{x} (m/s2)" for x in "xyz"))
    roll = read_roll(write_csv(tmp_path / "log.csv", header, TIME, *gyro.T, *accel.T))
    assert len(roll.time) == len(TIME) - 1
    assert [text for text in roll.warnings if "lone sample" in text and "at 2.5 s" in text]
