"""Stamps as they come out of phones and boards: the repaired clock is the sensor's."""

import numpy as np
import pytest
from rocking import rocking, write_csv

from sysid.errors import SysidError
from sysid.logs import LogOptions, read_roll

RATE = 200.0
TRUE = np.arange(1600) / RATE


def read(tmp_path, stamps, roll, header="t_s", form="%.9f", **options):
    path = write_csv(tmp_path / "log.csv", (header, "roll_rad"), [form % s for s in stamps], roll)
    return read_roll(path, LogOptions(**options))


def noisy(time, seed=0, std=5e-4):
    return rocking(time)[0] + np.random.default_rng(seed).normal(0, std, time.size)


def clock_error(roll, true):
    """Largest difference between the clock and the truth, up to the time of the first sample [s]."""
    error = roll.time - (true - true[0])
    return float(np.abs(error - np.median(error)).max())


@pytest.mark.parametrize(
    ("unit", "size"), [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)], ids=["s", "ms", "us", "ns"]
)
@pytest.mark.parametrize(("epoch", "named"), [(0.0, False), (1.7e9, True), (1.7e9, False)])
def test_units_and_epoch_by_name_or_by_size(tmp_path, unit, size, epoch, named):
    whole = [f"{round((epoch + t) * 1e9) / (1e9 / size):.6f}" if size < 1e9 else
             str(round((epoch + t) * 1e9)) for t in TRUE]  # fmt: skip
    path = write_csv(
        tmp_path / "log.csv", (f"time_{unit}" if named else "time", "roll_rad"), whole, noisy(TRUE)
    )
    roll = read_roll(path)
    assert roll.time[0] == 0
    assert clock_error(roll, TRUE) < 2e-6
    assert any(f"in {unit}" in note for note in roll.notes)
    assert any("counted from the first sample" in note for note in roll.notes) == bool(epoch)


RNG = np.random.default_rng(1)
ROWS = np.arange(TRUE.size)
LOST = RNG.random(TRUE.size) > 0.01
GAP = (TRUE < 3.0) | (TRUE > 3.4)
COPIED = np.sort(np.concatenate((ROWS, ROWS[::7])))
SWAPPED = ROWS.copy()
SWAPPED[[500, 501, 900, 903]] = SWAPPED[[501, 500, 903, 900]]
MICRO = np.round(2**32 - 2e6 + TRUE * 1e6)
"""A counter of 32 bits that overflows after 2 s."""


def bursts(size):
    """Stamps of packets: each has the time at which its last sample is there, and a delay."""
    arrival = (ROWS // size * size + size - 1) / RATE
    return arrival + np.repeat(RNG.exponential(2e-3, TRUE.size // size), size) + ROWS % size * 1e-5


def frozen(rows, stamp):
    return np.where(np.isin(ROWS, rows), TRUE[stamp], TRUE)


def torn(stamps, row, value):
    return np.where(np.arange(len(stamps)) == ROWS[row], value, stamps)


CASES = {
    "bursts of 4": (bursts(4), ROWS, ROWS, 4e-3, "bursts"),
    "bursts of 25": (bursts(25), ROWS, ROWS, 4e-3, "bursts"),
    "late": (np.sort(TRUE + RNG.normal(0, 1.2e-3, TRUE.size)), ROWS, ROWS, 3e-4, "jitter"),
    "jitter and losses": ((TRUE + 2e-4 * np.clip(RNG.normal(size=TRUE.size), -3, 3))[LOST], ROWS[LOST], ROWS[LOST], 4e-5, "jitter"),
    "a gap": (TRUE[GAP], ROWS[GAP], ROWS[GAP], 1e-8, "1 gap in"),
    "torn at the begin": (torn(1.7e9 + TRUE, 0, 364.0), ROWS, ROWS[1:], 1e-6, "further off in time"),
    "torn at the end": (torn(1.7e9 + TRUE, -1, 1.7e10), ROWS, ROWS[:-1], 1e-6, "further off in time"),
    "copies": (TRUE[COPIED], COPIED, ROWS, 1e-8, "copies"),
    "out of order": (TRUE[SWAPPED], SWAPPED, ROWS, 1e-8, "out of order"),
    "counter of 16 bits": (np.mod(np.round(2**16 - 2e3 + TRUE * 1e3), 2**16), ROWS, ROWS, 1e-6, "overflowed 1 time"),
    "counter of 32 bits": (np.mod(MICRO, 2**32), ROWS, ROWS, 1e-6, "overflowed 1 time"),
    "counter, torn at the end": (torn(np.mod(MICRO, 2**32), -1, 3e12), ROWS, ROWS[:-1], 1e-6, "overflowed 1 time"),
    "stops": (frozen(ROWS[-700:], -700), ROWS, ROWS[:-699], 1e-6, "the clock stands still"),
    "begins late": (frozen(ROWS[:300], 299), ROWS, ROWS[299:], 1e-6, "the clock stands still"),
}  # fmt: skip
"""Stamps; which sample each row of the file is, and which of them stay; error of the repaired clock [s]; words of its remark."""


@pytest.mark.parametrize("kind", CASES)
def test_the_repaired_clock_is_that_of_the_sensor(tmp_path, kind):
    stamps, rows, kept, tolerance, words = CASES[kind]
    header = "t_us" if "32" in kind or "counter," in kind else "t_ms" if "16" in kind else "t_s"
    values = noisy(TRUE, std=1e-4)
    roll = read(tmp_path, stamps, values[rows], header=header)
    assert clock_error(roll, TRUE[kept]) < tolerance
    np.testing.assert_allclose(roll.roll, values[kept], atol=1e-8)
    assert any(words in text for text in (*roll.notes, *roll.warnings))


def test_times_for_which_a_roll_was_computed_are_kept(tmp_path):
    """Stamps that look late, but beside a deviation for each sample: `roll` has written them."""
    stamps = np.sort(TRUE + np.random.default_rng(1).normal(0, 1.2e-3, TRUE.size))
    rows = np.column_stack([stamps, noisy(TRUE), np.full(TRUE.size, 5e-4)])
    path = tmp_path / "roll.csv"
    np.savetxt(path, rows, delimiter=",", header="time_s,roll_rad,roll_std_rad", comments="", fmt="%.9f")
    assert clock_error(read_roll(path, LogOptions()), stamps) < 1e-8


def test_restarted_counter_is_said(tmp_path):
    stamps = np.concatenate((TRUE, TRUE))
    roll = read(tmp_path, stamps, np.concatenate((noisy(TRUE), noisy(TRUE, 1))))
    assert np.all(np.diff(roll.time) > 0)
    assert roll.time[TRUE.size] - roll.time[TRUE.size - 1] == pytest.approx(1.0)
    assert any("restarts 1 time, first at row 1601" in warning for warning in roll.warnings)


@pytest.mark.parametrize("rows", [600, 1600])
def test_rows_out_of_order_overflow_no_counter(tmp_path, rows):
    """Nanoseconds since the epoch fit in no counter of 32 bits, and a step back by a sample is not one by all that it counts."""
    order = np.arange(rows)
    order[[400, 401]] = order[[401, 400]]
    values = noisy(TRUE)[:rows]
    stamps = [str(1_718_100_000_000_000_000 + round(1e9 * t)) for t in TRUE[order]]
    roll = read_roll(write_csv(tmp_path / "log.csv", ("stamp_ns", "roll_rad"), stamps, values[order]))
    assert clock_error(roll, TRUE[:rows]) < 1e-6
    np.testing.assert_allclose(roll.roll, values, atol=1e-8)


def test_random_stamps_are_no_clock(tmp_path):
    stamps = np.random.default_rng(0).permutation(TRUE)
    with pytest.raises(SysidError, match=r"it is no clock.*--time-column"):
        read(tmp_path, stamps, noisy(TRUE))
    with pytest.raises(SysidError, match="never changes"):
        read(tmp_path, np.full(TRUE.size, 3.0), noisy(TRUE))


def test_without_time_the_rate_makes_it(tmp_path):
    path = write_csv(tmp_path / "log.csv", ("roll_rad",), noisy(TRUE))
    with pytest.raises(SysidError, match="--rate"):
        read_roll(path)
    roll = read_roll(path, LogOptions(rate=RATE))
    np.testing.assert_allclose(roll.time, TRUE)
    for rate in (0.0, -5.0, float("nan"), float("inf")):
        with pytest.raises(SysidError, match="expected hertz from"):
            read_roll(path, LogOptions(rate=rate))


def test_samples_repeated_by_a_slow_sensor_are_dropped(tmp_path):
    fast = np.arange(8000) / 1000
    held = np.repeat(noisy(TRUE), 5)
    roll = read(tmp_path, fast, held)
    assert roll.time.size == pytest.approx(TRUE.size, abs=3)
    assert roll.sampling_rate == pytest.approx(RATE)
    assert any("repeats each value over 5 rows" in note for note in roll.notes)


def test_a_coarse_encoder_is_not_taken_for_a_slow_sensor(tmp_path):
    step = 2 * np.pi / 4096
    fast = np.arange(8000) / 1000
    counts = np.round(rocking(fast, omega=6.0)[0] / step) * step
    roll = read(tmp_path, fast, counts)
    assert roll.time.size == fast.size
    assert roll.std.min() >= step / np.sqrt(12) * (1 - 1e-6)


def test_rows_without_numbers_leave_gaps_not_a_shift(tmp_path):
    values = noisy(TRUE)
    cells = [f"{value:.9g}" for value in values]
    for row in (*range(300, 340), 700):
        cells[row] = ""
    path = write_csv(tmp_path / "log.csv", ("roll_rad", "other"), cells, TRUE)
    keep = np.array([cell != "" for cell in cells])
    roll = read_roll(path, LogOptions(rate=RATE))
    np.testing.assert_allclose(roll.time, TRUE[keep])
    assert any("41 of 1600 rows" in warning for warning in roll.warnings)


@pytest.mark.parametrize("rate", [90.0, 2000.0])
def test_truly_uneven_samples_with_losses_keep_their_stamps(tmp_path, rate):
    """Slow or fast against the noise: the samples were taken when the stamps say."""
    rng = np.random.default_rng(5)
    steps = rng.uniform(0.5, 1.6, round(8 * rate)) / rate
    time = np.cumsum(steps)[rng.random(steps.size) > 0.03]
    roll = read(tmp_path, time, noisy(time, std=5e-3))
    assert clock_error(roll, time) < 1e-8
    assert roll.std[0] == pytest.approx(5e-3, rel=0.2)
    assert any("uneven sampling kept" in note for note in roll.notes)
