"""Units are what their definitions say, whatever they are called."""

from math import pi

import numpy as np
import pytest
from rocking import write_csv

from sysid.errors import SysidError
from sysid.logs import LogOptions, read_roll
from sysid.logs.table import names

TIME = np.arange(0, 4, 0.01)
STANDARD_GRAVITY = 9.80665
"""Third General Conference on Weights and Measures, 1901 [m/s²]."""


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("rad", 1.0), ("mrad", 0.001), ("deg", pi / 180), ("°", pi / 180), ("turn", 2 * pi), ("rev", 2 * pi),
        ("rad/s", 1.0), ("mrad/s", 0.001), ("deg/s", pi / 180), ("dps", pi / 180), ("mdeg/s", pi / 180 / 1000),
        ("mdps", pi / 180 / 1000), ("rpm", 2 * pi / 60), ("m/s^2", 1.0), ("m/s²", 1.0), ("g", STANDARD_GRAVITY),
        ("mg", STANDARD_GRAVITY / 1000), ("s", 1.0), ("ms", 1e-3), ("µs", 1e-6), ("ns", 1e-9), ("min", 60.0),
        ("h", 3600.0), ("cs", 1e-2), ("100 ns", 1e-7),
    ],
)  # fmt: skip
def test_size_of_a_unit(text, size):
    tables = (names.ANGLE_UNITS, names.RATE_UNITS, names.ACCEL_UNITS, names.TIME_UNITS)
    unit = names.parse_unit(text)
    (found,) = (table[unit] for table in tables if unit in table)
    assert found == pytest.approx(size, rel=1e-12)


def test_a_speed_is_no_position(tmp_path):
    log = write_csv(tmp_path / "slide.csv", ("time_s", "v_mm_s"), TIME, 100 * np.cos(5 * TIME))
    roll = read_roll(log, LogOptions(column="v_mm_s"))
    assert np.ptp(roll.roll) == pytest.approx(0.2 / 5, rel=0.01)
    with pytest.raises(SysidError, match="not a unit of a rotation rate"):
        read_roll(log, LogOptions(column="v_mm_s", unit="kg"))


@pytest.mark.parametrize(
    ("column", "unit", "size"),
    [
        ("x_mm", None, 1e-3),
        ("distance (m)", None, 1.0),
        ("position_m", None, 1.0),
        ("pos [cm]", None, 1e-2),
        ("q", "mm", 1e-3),
    ],
)
def test_a_slide_is_found_without_naming_its_column(tmp_path, column, unit, size):
    """By the length in a name, or by the user's unit where one column only can have it; degrees and rad are no lengths."""
    log = write_csv(tmp_path / "slide.csv", ("time_s", column), TIME, 100 * np.cos(5 * TIME))
    roll = read_roll(log, LogOptions(unit=unit))
    assert roll.origin == "position"
    assert np.ptp(roll.roll) == pytest.approx(200 * size, rel=1e-3)


def test_a_length_beside_an_angle_is_not_taken(tmp_path):
    columns = TIME, 100 * np.cos(3 * TIME), 0.1 * np.cos(5 * TIME)
    log = write_csv(tmp_path / "both.csv", ("time_s", "x_mm", "roll_rad"), *columns)
    assert np.ptp(read_roll(log).roll) == pytest.approx(0.2, rel=1e-3)
    with pytest.raises(SysidError, match=r"lie on no circle.*--pivot X Y"):
        read_roll(write_csv(log, ("time_s", "x_mm", "y_mm"), *columns))


def test_a_position_is_no_angle_of_a_board(tmp_path):
    from sysid.board import Board
    from sysid.decay.plausibility import amplitude_warnings
    from sysid.recording import Recording

    time = np.arange(0, 6, 0.005)
    moved = np.where(time < 1, 10.0, 10 * np.exp(-2 * (time - 1)) * np.cos(20 * (time - 1)))
    board, releases = Board.load("pink"), {}
    for name, size in (("x_mm", 1.0), ("angle", 0.01)):
        log = write_csv(tmp_path / f"{name}.csv", ("time_s", name), time, size * moved)
        releases[name] = Recording.read(log).releases
    with pytest.raises(SysidError, match="position of a slide, but the joint of board 'pink' turns"):
        amplitude_warnings(releases["x_mm"], board)
    assert amplitude_warnings(releases["x_mm"], board.of_slide()) == []
    (said,) = amplitude_warnings(releases["angle"], board.of_slide())
    assert "the joint slides" in said
    assert amplitude_warnings(releases["angle"], board) == []


@pytest.mark.parametrize("name", ["encoder_ticks", "position [counts]", "enc_pulses"])
def test_what_its_name_calls_counts_is_not_taken_for_degrees_however_small(tmp_path, name):
    counts = np.round(17 + 60 * np.exp(-0.5 * TIME) * np.cos(7 * TIME))
    log = write_csv(tmp_path / "counts.csv", ("time_s", name), TIME, counts)
    with pytest.raises(SysidError, match=r"look like counts of an encoder.*--unit 0\.0015"):
        read_roll(log)
    assert np.ptp(read_roll(log, LogOptions(unit="0.01")).roll) == pytest.approx(0.01 * np.ptp(counts))
