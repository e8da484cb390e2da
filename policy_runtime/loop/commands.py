"""Sources of the rider's commands: constants, a file, or the keyboard."""

import csv
import itertools
import os
import re
import select
import sys
import termios
import tty
from bisect import bisect_right
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

from sim.skate.options import SkateOptions
from sysid.errors import SysidError
from sysid.files import regular

SPEED_RANGE = SkateOptions().speed
"""Speeds that policies are trained for [m/s]."""
TURN_RANGE = (-SkateOptions().turn, SkateOptions().turn)
"""Changes of heading that policies are trained for [rad]."""


class Command(NamedTuple):
    """A command of the rider."""

    speed: float
    """[m/s]; below 0.1 the robot stands still."""
    turn: float
    """Heading to reach in the next steering phase, relative to the one at its start [rad], left positive."""


class CommandSource(Protocol):
    """Gives the command of each moment; None asks for the end of the run."""

    def at(self, time: float) -> Command | None:
        """Return the command at a time since the start of the run [s]."""
        ...


@dataclass(frozen=True, slots=True)
class Script:
    """Commands that change at given times; each holds until the next."""

    times: tuple[float, ...]
    """[s], the first is 0."""
    commands: tuple[Command, ...]

    def at(self, time: float) -> Command:
        """Return the last command whose time has come."""
        return self.commands[bisect_right(self.times, time + 1e-9) - 1]


def constant(command: Command) -> Script:
    """Return the source of the same command for ever."""
    return Script((0.0,), (command,))


COLUMNS = ("time_s", "speed_m_s", "turn_rad")
"""Of a file of commands."""


def load_script(path: Path) -> Script:
    """Read a CSV file with the columns time_s, speed_m_s, turn_rad; the first row must be at 0."""
    try:
        with regular(path).open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SysidError(f"{path}: cannot be read ({error}). Expected a CSV file of commands.") from error
    if not rows or not rows[0].keys() >= set(COLUMNS):
        found = ", ".join(filter(None, rows[0])) if rows else "none"
        raise SysidError(f"{path}: expected columns {','.join(COLUMNS)} and at least one row; found {found}.")
    values = [_row(path, line, row) for line, row in enumerate(rows, start=2)]
    times = tuple(time for time, _ in values)
    if times[0] != 0 or any(later <= earlier for earlier, later in itertools.pairwise(times)):
        raise SysidError(
            f"{path}: times must start at 0 and increase; they are {', '.join(map(str, times[:6]))}."
        )
    return Script(times, tuple(command for _, command in values))


def _row(path: Path, line: int, row: dict[str, str]) -> tuple[float, Command]:
    try:
        time, speed, turn = (float(row[column] or "") for column in COLUMNS)
    except ValueError as error:
        raise SysidError(f"{path}: line {line}: {error}; expected three numbers.") from None
    for name, value, (low, high) in (("speed", speed, SPEED_RANGE), ("turn", turn, TURN_RANGE)):
        if not low <= value <= high:
            raise SysidError(
                f"{path}: line {line}: {name} {value:g} is outside the trained range, {low:g} to {high:.3g}."
            )
    return time, Command(speed, turn)


class Keyboard:
    """Arrow keys of the terminal: up and down change speed, left and right the turn; space stops; q ends."""

    HELP = "↑ ↓ speed ±0.1 m/s, ← → turn ±0.1 rad, 0 straight on, space stand still, q quit"

    def __init__(self, start: Command, descriptor: int | None = None) -> None:
        """Take over the terminal until `close`.

        Args:
            descriptor: File descriptor of the terminal; standard input if None.
        """
        self._fd = sys.stdin.fileno() if descriptor is None else descriptor
        if not os.isatty(self._fd):
            raise SysidError(
                "keyboard commands need a terminal on standard input. Use --commands FILE instead."
            )
        self._saved = termios.tcgetattr(self._fd)
        tty.setcbreak(self._fd)
        self._command: Command | None = start

    def at(self, time: float) -> Command | None:
        """Return the command after all keys pressed so far."""
        while self._command is not None and select.select([self._fd], [], [], 0)[0]:
            keys = os.read(self._fd, 64)
            if not keys:
                self._command = None
            for key in re.findall(rb"\x1b\[.|.", keys):
                if self._command is not None:
                    self._command = pressed(self._command, key)
        return self._command

    def close(self) -> None:
        """Restore the terminal."""
        termios.tcsetattr(self._fd, termios.TCSADRAIN, self._saved)


UP, DOWN, RIGHT, LEFT = (b"\x1b[A", b"\x1b[B", b"\x1b[C", b"\x1b[D")
"""Arrow keys, as a terminal sends them."""


def pressed(command: Command, key: bytes) -> Command | None:
    """Return the command after one key; None after 'q'."""
    if key in (b"q", b"Q"):
        return None
    speed = 0.0 if key == b" " else command.speed + 0.1 * ((key == UP) - (key == DOWN))
    turn = 0.0 if key == b"0" else command.turn + 0.1 * ((key == LEFT) - (key == RIGHT))
    return Command(
        round(min(max(speed, SPEED_RANGE[0]), SPEED_RANGE[1]), 6),
        round(min(max(turn, TURN_RANGE[0]), TURN_RANGE[1]), 6),
    )
