"""Where a policy's errors come from: by pushing stretch, command, time within a stretch, and foot.

Each `Table` asks one question of recorded rides. Its cells are sums and numbers of steps, so that the
tables of many rides add up to the table of all.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from policy_runtime.evaluation.metrics import Flags, Rides, wrong_in_pushing, wrong_in_steering
from sim.skate.arrays import wrap_angle
from sim.skate.cycle.clock import CONTROL_PERIOD, Clock
from sysid.errors import SysidError
from sysid.roll import Array

SPEED_EDGES = (0.1, 0.4, 0.8, 1.2, 1.5)
"""Edges of the classes of commanded speed [m/s]."""
TURN_EDGES = (0.0, 0.2, 0.4, 0.6, 0.8)
"""Edges of the classes of commanded turn, its size [rad]."""
PARTS = 8
"""Parts of equal length that a stretch is divided into."""
CLOSE = 0.1
"""Heading error that counts as having arrived [rad]."""

Cell = tuple[float, int]
"""Sum over steps, and how many steps."""


@dataclass(frozen=True, slots=True)
class Table:
    """One table of means over steps."""

    title: str
    columns: tuple[str, ...]
    rows: dict[str, tuple[Cell, ...]]
    """One cell for each column."""

    def __add__(self, other: "Table") -> "Table":
        """Return the table of the rides of both.

        Raises:
            SysidError: They do not ask the same question.
        """
        if (self.title, self.columns) != (other.title, other.columns):
            raise SysidError(f"tables '{self.title}' and '{other.title}' do not add up.")
        nothing = ((0.0, 0),) * len(self.columns)
        labels = {**self.rows, **other.rows}
        return Table(
            self.title,
            self.columns,
            {
                label: tuple(
                    (a + c, b + d)
                    for (a, b), (c, d) in zip(
                        self.rows.get(label, nothing), other.rows.get(label, nothing), strict=True
                    )
                )
                for label in labels
            },
        )

    def mean(self, row: str, column: str) -> float:
        """Return the mean of one cell; NaN where no step falls into it."""
        total, count = self.rows[row][self.columns.index(column)]
        return total / count if count else float("nan")

    def to_json(self) -> dict[str, Any]:
        """Return the table for machines: means, null where there are none, and numbers of steps."""
        means = {
            label: {
                column: total / count if count else None
                for column, (total, count) in zip(self.columns, cells, strict=True)
            }
            for label, cells in self.rows.items()
        }
        return {
            "title": self.title,
            "rows": means,
            "steps": {label: cells[0][1] for label, cells in self.rows.items()},
        }

    def texts(self) -> list[tuple[str, ...]]:
        """Return head and rows as texts; the last column is the number of steps of the first one."""
        body = [
            (
                label,
                *("–" if np.isnan(v := self.mean(label, column)) else f"{v:.4f}" for column in self.columns),
                str(cells[0][1]),
            )
            for label, cells in self.rows.items()
            if any(count for _, count in cells)
        ]
        return [("", *self.columns, "steps"), *body]


def add_up(parts: list[tuple[Table, ...]]) -> tuple[Table, ...]:
    """Return the tables of all rides from those of each part."""
    total = parts[0]
    for part in parts[1:]:
        total = tuple(a + b for a, b in zip(total, part, strict=True))
    return total


def break_down(rides: Rides, clock: Clock | None = None) -> tuple[Table, ...]:
    """Return every table.

    Args:
        clock: Lengths of the stretches that the rides were timed by.
    """
    clock = clock or Clock()
    push = _Stretches(rides.pushing & rides.alive, clock.push)
    steer = _Stretches(rides.steering & rides.alive, clock.steer)
    return (
        _speed_by_stretch(rides, push),
        _speed_by_command(rides, push),
        _speed_by_time(rides, push, "first", push.number == 0),
        _speed_by_time(rides, push, "later", push.number > 0),
        _feet_by_stretch(rides, push),
        _feet_by_time(rides, push, "pushing", wrong_in_pushing(rides)),
        _feet_by_time(rides, steer, "steering", wrong_in_steering(rides)),
        _heading_by_stretch(rides, steer),
        _heading_by_command(rides, steer),
        _heading_by_time(rides, steer),
    )


class _Stretches:
    """Which stretch of its episode a step belongs to, and how far into it it is."""

    def __init__(self, inside: Flags, length: int) -> None:
        self.inside, self.length = inside, length
        before = np.vstack([np.zeros((1, inside.shape[1]), dtype=bool), inside[:-1]])
        starts = inside & ~before
        self.number = np.where(inside, starts.cumsum(axis=0) - 1, -1)
        steps = np.arange(len(inside))[:, None]
        self.begin = np.maximum.accumulate(np.where(starts, steps, 0), axis=0)
        """First step of the stretch that a step is in, (t, n)."""
        self.place = np.where(inside, steps - self.begin, -1)

    def parts(self) -> Iterator[tuple[str, Flags]]:
        """Yield equal parts of the stretch in time, labelled in seconds since its begin."""
        edges = np.linspace(0, self.length, PARTS + 1)
        for low, high in pairwise(edges):
            where = self.inside & (self.place >= low) & (self.place < high)
            yield f"{low * CONTROL_PERIOD:.2f}-{high * CONTROL_PERIOD:.2f} s", where

    def stretches(self) -> Iterator[tuple[str, Flags]]:
        """Yield the first, second, ... stretch of the episodes."""
        for number in range(int(self.number.max(initial=-1)) + 1):
            yield f"stretch {number + 1}", self.number == number


def _classes(values: Array, edges: tuple[float, ...], unit: str) -> list[tuple[str, Flags]]:
    return [
        (f"{low:g}-{high:g} {unit}", (values >= low) & ((values < high) | (high == edges[-1])))
        for low, high in pairwise(edges)
    ]


def _cell(values: Any, where: Flags) -> Cell:
    return float(values[where].sum()), int(where.sum())


_SPEED = ("|v-v_cmd|", "v-v_cmd", "v", "v_cmd")


def _speed_row(rides: Rides, where: Flags) -> tuple[Cell, ...]:
    error = rides.speed - rides.commanded_speed
    values = (np.abs(error), error, rides.speed, rides.commanded_speed)
    return tuple(_cell(value, where) for value in values)


def _speed_by_stretch(rides: Rides, push: _Stretches) -> Table:
    rows = {label: _speed_row(rides, where) for label, where in push.stretches()}
    return Table("speed by pushing stretch, m/s", _SPEED, {"all": _speed_row(rides, push.inside), **rows})


def _speed_by_command(rides: Rides, push: _Stretches) -> Table:
    rows: dict[str, tuple[Cell, ...]] = {}
    for label, of_class in _classes(rides.commanded_speed, SPEED_EDGES, "m/s"):
        rows[f"{label}, first"] = _speed_row(rides, (push.number == 0) & of_class)
        rows[f"{label}, later"] = _speed_row(rides, (push.number > 0) & of_class)
    return Table("speed by command, in the first and in later pushing stretches, m/s", _SPEED, rows)


def _speed_by_time(rides: Rides, push: _Stretches, which: str, chosen: Flags) -> Table:
    error = rides.speed - rides.commanded_speed
    classes = [
        ("all", push.inside),
        *((f"v_cmd {label}", flags) for label, flags in _classes(rides.commanded_speed, SPEED_EDGES, "m/s")),
    ]
    rows = {
        part: tuple(_cell(error, where & chosen & of_class) for _, of_class in classes)
        for part, where in push.parts()
    }
    title = f"v-v_cmd by time in the {which} pushing stretch, m/s"
    return Table(title, tuple(label for label, _ in classes), rows)


_FEET = ("wrong", "right off deck", "left on deck", "right on ground", "left off deck", "left on ground")


def _feet_row(rides: Rides, where: Flags, wrong: Flags) -> tuple[Cell, ...]:
    ground, deck = rides.foot_on_ground, rides.foot_on_deck
    flags = (wrong, ~deck[..., 1], deck[..., 0], ground[..., 1], ~deck[..., 0], ground[..., 0])
    return tuple(_cell(flag, where) for flag in flags)


def _feet_by_stretch(rides: Rides, push: _Stretches) -> Table:
    wrong = wrong_in_pushing(rides)
    rows = {"all": _feet_row(rides, push.inside, wrong)}
    for label, where in push.stretches():
        rows[label] = _feet_row(rides, where, wrong)
    for label, of_class in _classes(rides.commanded_speed, SPEED_EDGES, "m/s"):
        rows[label] = _feet_row(rides, push.inside & of_class, wrong)
    return Table("feet in pushing, shares of steps, by stretch and by command", _FEET, rows)


def _feet_by_time(rides: Rides, stretches: _Stretches, name: str, wrong: Flags) -> Table:
    rows = {part: _feet_row(rides, where, wrong) for part, where in stretches.parts()}
    return Table(f"feet by time in {name}, shares of steps", _FEET, rows)


_HEADING = ("|error|", "error along the turn", f"beyond {CLOSE:g} rad", "v")
"""An error along the turn is positive where the board has turned too far."""


def _heading_row(rides: Rides, where: Flags, turn: Array) -> tuple[Cell, ...]:
    error = wrap_angle(rides.heading - rides.target_heading)
    values = (np.abs(error), error * np.sign(turn), np.abs(error) > CLOSE, rides.speed)
    return tuple(_cell(value, where) for value in values)


def _turn(rides: Rides, steer: _Stretches) -> Array:
    """Return the turn asked for in each stretch [rad], (t, n): the error at its first step."""
    start = np.take_along_axis(rides.heading, steer.begin, axis=0)
    return np.where(steer.inside, wrap_angle(rides.target_heading - start), 0.0)


def _heading_by_stretch(rides: Rides, steer: _Stretches) -> Table:
    turn = _turn(rides, steer)
    rows = {"all": _heading_row(rides, steer.inside, turn)}
    for label, where in steer.stretches():
        rows[label] = _heading_row(rides, where, turn)
    for label, of_class in _classes(rides.commanded_speed, SPEED_EDGES, "m/s"):
        rows[label] = _heading_row(rides, steer.inside & of_class, turn)
    return Table("heading by steering stretch and by commanded speed, rad, m/s", _HEADING, rows)


def _heading_by_command(rides: Rides, steer: _Stretches) -> Table:
    turn = _turn(rides, steer)
    last = steer.inside & (steer.place == steer.length - 1)
    rows: dict[str, tuple[Cell, ...]] = {}
    sides = [("left", turn > 0), ("right", turn < 0)]
    for label, of_class in [*_classes(np.abs(turn), TURN_EDGES, "rad"), *sides]:
        rows[label] = _heading_row(rides, steer.inside & of_class, turn)
        rows[f"{label}, at the end"] = _heading_row(rides, last & of_class, turn)
    return Table("heading by turn asked for, rad, m/s", _HEADING, rows)


def _heading_by_time(rides: Rides, steer: _Stretches) -> Table:
    turn = _turn(rides, steer)
    error = wrap_angle(rides.heading - rides.target_heading)
    along, large = error * np.sign(turn), np.abs(turn) >= 0.4
    rows = {
        part: (
            _cell(np.abs(error), where),
            _cell(along, where),
            _cell(np.abs(error), where & large),
            _cell(along, where & large),
            _cell(np.abs(error), where & ~large),
            _cell(along, where & ~large),
        )
        for part, where in steer.parts()
    }
    columns = tuple(
        f"{kind}{which}" for which in ("", ", turn > 0.4", ", turn < 0.4") for kind in ("|error|", "along")
    )
    return Table("heading error by time in steering, rad", columns, rows)
