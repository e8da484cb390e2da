"""Sources of the rider's commands: constants, a file, or the keyboard."""

import csv
import itertools
import os
import select
import sys
import termios
import tty
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

from sysid.errors import SysidError
from sysid.files import regular

SPEED_RANGE = (0.0, 1.5)
"""Speeds that policies are trained for [m/s]."""
TURN_RANGE = (-0.7853981633974483, 0.7853981633974483)
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

    def close(self) -> None:
        """Let go of terminal and files."""
        ...


@dataclass(frozen=True, slots=True)
class Constant:
    """The same command for ever."""

    command: Command

    def at(self, time: float) -> Command:
        """Return the command."""
        return self.command

    def close(self) -> None:
        """Do nothing."""


@dataclass(frozen=True, slots=True)
class Script:
    """Commands that change at given times; each holds until the next."""

    times: tuple[float, ...]
    commands: tuple[Command, ...]

    def at(self, time: float) -> Command:
        """Return the last command whose time has come."""
        passed = sum(start <= time + 1e-9 for start in self.times)
        return self.commands[max(passed - 1, 0)]

    def close(self) -> None:
        """Do nothing."""


COLUMNS = ("time_s", "speed_m_s", "turn_rad")
"""Of a file of commands."""


def load_script(path: Path) -> Script:
    """Read a CSV file with the columns time_s, speed_m_s, turn_rad; the first row must be at 0.

    Raises:
        SysidError: The file is missing, a column is missing, a value is not a number or out of the
            trained range, or times do not increase.
    """
    try:
        with regular(path).open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SysidError(f"{path}: cannot be read ({error}). Expected a CSV file of commands.") from error
    if not rows:
        raise SysidError(
            f"{path}: no commands. Expected columns time_s,speed_m_s,turn_rad and at least one row."
        )
    missing = [column for column in COLUMNS if column not in rows[0]]
    if missing:
        found = ", ".join(name for name in rows[0] if name)
        raise SysidError(
            f"{path}: column '{missing[0]}' is missing. Expected {','.join(COLUMNS)}; found {found}."
        )
    values = [_row(path, number, row) for number, row in enumerate(rows, start=2)]
    times = tuple(time for time, _ in values)
    if times[0] != 0 or any(later <= earlier for earlier, later in itertools.pairwise(times)):
        raise SysidError(
            f"{path}: times must start at 0 and increase; they are {', '.join(map(str, times[:6]))}."
        )
    return Script(times, tuple(command for _, command in values))


def _row(path: Path, line: int, row: dict[str, str]) -> tuple[float, Command]:
    numbers: list[float] = []
    for column in COLUMNS:
        text = row.get(column)
        try:
            numbers.append(float(text if text is not None else ""))
        except ValueError:
            raise SysidError(
                f"{path}: line {line}, column '{column}' is {text!r}; expected a number."
            ) from None
    for name, value, (low, high) in (("speed", numbers[1], SPEED_RANGE), ("turn", numbers[2], TURN_RANGE)):
        if not low <= value <= high:
            raise SysidError(
                f"{path}: line {line}: {name} {value:g} is outside the trained range, {low:g} to {high:.3g}."
            )
    return numbers[0], Command(numbers[1], numbers[2])


class Keyboard:
    """Arrow keys of the terminal: up and down change speed, left and right the turn; space stops; q ends."""

    HELP = "↑ ↓ speed ±0.1 m/s, ← → turn ±0.1 rad, 0 straight on, space stand still, q quit"

    def __init__(self, start: Command, descriptor: int | None = None) -> None:
        """Take over the terminal until `close`.

        Args:
            descriptor: File descriptor of the terminal; standard input if None.

        Raises:
            SysidError: It is not a terminal.
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
            for key in _split(keys):
                if self._command is not None:
                    self._command = pressed(self._command, key)
        return self._command

    def close(self) -> None:
        """Restore the terminal."""
        termios.tcsetattr(self._fd, termios.TCSADRAIN, self._saved)


def pressed(command: Command, key: bytes) -> Command | None:
    """Return the command after one key; None after 'q'."""
    speed, turn = command
    match key:
        case b"\x1b[A":
            speed += 0.1
        case b"\x1b[B":
            speed -= 0.1
        case b"\x1b[C":
            turn -= 0.1
        case b"\x1b[D":
            turn += 0.1
        case b"0":
            turn = 0.0
        case b" ":
            speed = 0.0
        case b"q" | b"Q":
            return None
        case _:
            pass
    return Command(
        round(min(max(speed, SPEED_RANGE[0]), SPEED_RANGE[1]), 6),
        round(min(max(turn, TURN_RANGE[0]), TURN_RANGE[1]), 6),
    )


def _split(keys: bytes) -> list[bytes]:
    """Split bytes into keys; an arrow is three bytes."""
    found: list[bytes] = []
    i = 0
    while i < len(keys):
        size = 3 if keys[i : i + 2] == b"\x1b[" else 1
        found.append(keys[i : i + size])
        i += size
    return found
