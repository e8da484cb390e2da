"""`husky-sysid coast-down`: rake and rolling resistance from a board that rolls by itself."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sysid.cli.console import BoardName, Common, Printer
from sysid.errors import SysidError
from sysid.files import regular

if TYPE_CHECKING:
    from sysid.experiments.roll_out import RollOut
    from sysid.roll import Array

FILM = ("time_s", "x_m", "y_m", "roll_rad")
IMU = ("time_s", "forward_m_s2", "yaw_rate_rad_s", "roll_rad")
"""Columns of the two kinds of log."""


def coast_down(
    *log: Path,
    board: BoardName,
    slope_deg: float = 0.0,
    rest: float = 1.0,
    free: float = 2.0,
    save: bool = False,
    common: Common = Common(),
) -> None:
    """Measure rake and rolling resistance of a whole board that rolls by itself, after a push or on a slope.

    Args:
        log: CSV files. From above (film, motion capture): time_s,x_m,y_m,roll_rad of the free motion. y is left of x, roll
            is positive with the right edge down. From an IMU on the board, which stands still at first:
            time_s,forward_m_s2,yaw_rate_rad_s,roll_rad, left turns positive.
        board: The board; its wheelbase is used.
        slope_deg: Gradient of the ground along the way, uphill positive, as in `evaluate` [degrees].
        rest: IMU: duration of the rest at the beginning [s].
        free: IMU: time from which the board rolls freely [s].
        save: Save both in the board's record, for scene and training.
    """
    from sysid.experiments.roll_out import roll_out

    printer = Printer(common)
    printer.keep(log)
    if not log:
        raise SysidError("no log of a roll-out. Give one or several CSV files.")
    if not abs(slope_deg) < 30:
        raise SysidError(f"--slope-deg {slope_deg:g}: must be within ±30 degrees.")
    record = common.space.load_board(board)
    runs = [_read(path, rest, free) for path in log]
    found = roll_out(runs, record.geometry["wheelbase"], math.radians(slope_deg))
    rows = [(f"loss of speed at {found.at_speed:.2g} m/s", found.deceleration)]
    if found.rake is None:
        printer.warn(
            "the board turned too little to tell the rake; tilt its deck more, by a weight beside the axis."
        )
    else:
        rows.insert(0, ("rake", found.rake))
    printer.quantities(rows, f"{record.name}: {len(runs)} roll-out{'s' * (len(runs) > 1)}")
    saved = {"saved": printer.saved(found.board(record), record)} if save else {}
    numbers = {"rake": found.rake, "deceleration": found.deceleration, "at_speed": found.at_speed}
    printer.result({**numbers, **saved})


def _read(path: Path, rest: float, free: float) -> "RollOut":
    from sysid.experiments.roll_out import from_imu, from_path

    columns = _columns(path)
    if all(name in columns for name in FILM):
        time, x, y, roll = (columns[name] for name in FILM)
        return from_path(time, np.column_stack([x, y]), roll)
    if all(name in columns for name in IMU):
        return from_imu(*(columns[name] for name in IMU), rest=rest, free=free)
    raise SysidError(
        f"{path}: has columns {', '.join(columns)}; expected {','.join(FILM)} or {','.join(IMU)}."
    )


def _columns(path: Path) -> "dict[str, Array]":
    try:
        with regular(path).open(encoding="utf-8") as file:
            names = [name.strip() for name in file.readline().split(",")]
            numbers = np.loadtxt(file, delimiter=",", ndmin=2)
    except (OSError, ValueError) as error:
        raise SysidError(f"{path}: cannot be read as numbers under a line of names ({error}).") from error
    if numbers.shape[1] != len(names) or not np.all(np.isfinite(numbers)):
        raise SysidError(f"{path}: expected a finite number for each of {', '.join(names)} in every line.")
    return dict(zip(names, numbers.T, strict=True))
