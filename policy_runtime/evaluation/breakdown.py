"""A policy's errors by phase of the ride, time within a phase, command, and foot.

Each `Table` asks one question of recorded rides. Its cells are sums and numbers of steps, so that the
tables of many rides add up to the table of all.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from policy_runtime.evaluation.metrics import Flags, Rides, wrong_in_pushing, wrong_in_steering
from policy_runtime.loop.commands import SPEED_RANGE, TURN_RANGE
from sim.skate.arrays import wrap_angle
from sim.skate.cycle.clock import CONTROL_PERIOD, Clock
from sysid.roll import Array

PARTS = 5
"""Equal parts of a phase's time, and of the range of each command."""

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
        """Return the table of the rides of both; they ask the same question."""
        nothing = ((0.0, 0),) * len(self.columns)
        rows = {
            label: zip(self.rows.get(label, nothing), other.rows.get(label, nothing), strict=True)
            for label in {**self.rows, **other.rows}
        }
        added = {label: tuple((a + c, b + d) for (a, b), (c, d) in cells) for label, cells in rows.items()}
        return Table(self.title, self.columns, added)

    def mean(self, row: str, column: str) -> float:
        """Return the mean of one cell; NaN without a step in it."""
        total, count = self.rows[row][self.columns.index(column)]
        return total / count if count else float("nan")

    def to_json(self) -> dict[str, Any]:
        """Return the table for machines: means, null for empty cells, and numbers of steps."""
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


def add_up(parts: list[tuple[Table, ...]]) -> tuple[Table, ...]:
    """Return the tables of all rides from those of each part."""
    total = parts[0]
    for part in parts[1:]:
        total = tuple(a + b for a, b in zip(total, part, strict=True))
    return total


def break_down(rides: Rides, clock: Clock | None = None) -> tuple[Table, ...]:
    """Return every table; the clock has the lengths of the phases that the rides were timed by."""
    clock = clock or Clock()
    push = _Phases(rides.pushing & rides.alive, clock.push)
    steer = _Phases(rides.steering & rides.alive, clock.steer)
    slowness = rides.board_speed - rides.commanded_speed
    error = wrap_angle(rides.board_heading - rides.target_heading)
    turn = wrap_angle(rides.target_heading - steer.at_begin(rides.board_heading))
    speeds = _classes(rides.commanded_speed, SPEED_RANGE, "m/s")
    turns = _classes(turn, TURN_RANGE, "rad")
    return (
        push.table(
            "speed while pushing, m/s",
            {
                "|v-v_cmd|": np.abs(slowness),
                "v-v_cmd": slowness,
                "turned to the left since its begin, rad": wrap_angle(
                    rides.board_heading - push.at_begin(rides.board_heading)
                ),
            },
            speeds,
        ),
        push.table("feet while pushing, shares of steps", _feet(rides, wrong_in_pushing(rides)), speeds),
        steer.table(
            "heading while steering, rad",
            {
                "|error|": np.abs(error),
                "error along the turn": error * np.sign(turn),
                "v, m/s": rides.board_speed,
            },
            turns,
        ),
        steer.table("feet while steering, shares of steps", _feet(rides, wrong_in_steering(rides)), turns),
    )


class _Phases:
    """Which phase of its episode a step belongs to, and how far into it it is."""

    def __init__(self, inside: Flags, length: int) -> None:
        self._inside, self._length = inside, length
        before = np.vstack([np.zeros((1, inside.shape[1]), dtype=bool), inside[:-1]])
        starts = inside & ~before
        self._number = starts.cumsum(axis=0)
        steps = np.arange(len(inside))[:, None]
        self._begin = np.maximum.accumulate(np.where(starts, steps, 0), axis=0)
        self._place = steps - self._begin

    def at_begin(self, values: Array) -> Array:
        """Return values, (t, n), at the first step of the phase of each step."""
        return np.take_along_axis(values, self._begin, axis=0)

    def table(self, title: str, columns: Mapping[str, Array], classes: Mapping[str, Flags]) -> Table:
        """Return the means of some columns, (t, n) each."""
        return Table(
            title,
            tuple(columns),
            {
                label: tuple((float(v[where].sum()), int(where.sum())) for v in columns.values())
                for label, where in self._rows(classes)
            },
        )

    def _rows(self, classes: Mapping[str, Flags]) -> Iterator[tuple[str, Flags]]:
        """Yield the label and flags of all steps, of each phase, each part of its time, its last step, and each class."""
        inside = self._inside
        yield "all", inside
        for number in range(1, int(self._number.max(initial=0)) + 1):
            yield f"phase {number}", inside & (self._number == number)
        for low, high in pairwise(np.linspace(0, self._length, PARTS + 1)):
            where = inside & (self._place >= low) & (self._place < high)
            yield f"{low * CONTROL_PERIOD:.2f}-{high * CONTROL_PERIOD:.2f} s", where
        yield "last step", inside & (self._place == self._length - 1)
        for label, of_class in classes.items():
            yield label, inside & of_class


def _classes(values: Array, between: tuple[float, float], unit: str) -> dict[str, Flags]:
    """Return equal parts of a range, by label; the last one has its upper end."""
    return {
        f"{low:.2g} to {high:.2g} {unit}": (values >= low) & ((values < high) | (high == between[1]))
        for low, high in pairwise(np.linspace(*between, PARTS + 1))
    }


def _feet(rides: Rides, wrong: Flags) -> dict[str, Any]:
    ground, deck = rides.foot_on_ground, rides.foot_on_deck
    return {
        "wrong": wrong, "right off deck": ~deck[..., 1], "left on deck": deck[..., 0],
        "right on ground": ground[..., 1], "left off deck": ~deck[..., 0], "left on ground": ground[..., 0],
    }  # fmt: skip
