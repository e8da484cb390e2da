"""A policy's errors by pushing phase, command, time within a phase, and foot.

Each `Table` asks one question of recorded rides. Its cells are sums and numbers of steps, so that the
tables of many rides add up to the table of all.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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
"""Parts of equal length that a phase is divided into."""
ARRIVED_HEADING = 0.1
"""Heading error that counts as having arrived [rad]."""

Cell = tuple[float, int]
"""Sum over steps, and how many steps."""
Labelled = tuple[str, Flags]
"""Label of some steps, and their flags, (t, n)."""


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
    """Return every table; the clock has the lengths of the phases that the rides were timed by."""
    clock = clock or Clock()
    push = _Phases(rides.pushing & rides.alive, clock.push)
    steer = _Phases(rides.steering & rides.alive, clock.steer)
    speeds = _classes(rides.commanded_speed, SPEED_EDGES, "m/s")
    speed = _means(_speeds(rides))
    heading = _means(_headings(rides, steer))
    pushing, steering = (
        _means(_feet(rides, wrong(rides))) for wrong in (wrong_in_pushing, wrong_in_steering)
    )
    which = (("first", push.number == 0), ("later", push.number > 0))
    by_speed = [(f"{label}, {name}", chosen & one) for label, one in speeds for name, chosen in which]
    at_the_end = steer.inside & (steer.place == steer.length - 1)
    turn = _turn(rides, steer)
    turns = [*_classes(np.abs(turn), TURN_EDGES, "rad"), ("left", turn > 0), ("right", turn < 0)]
    ends = (("", steer.inside), (", at the end", at_the_end))
    by_turn = [(f"{label}{name}", chosen & one) for label, one in turns for name, chosen in ends]
    pushed = push.inside & (push.place == push.length - 1)
    turned = _means({"to the left": wrap_angle(rides.heading - _at_begin(rides.heading, push))})
    by_phase = "heading by steering phase and by commanded speed, rad, m/s"
    return (
        speed("speed by pushing phase, m/s", push.and_all()),
        speed("speed by command, in the first and in later pushing phases, m/s", by_speed),
        *(_speed_by_time(rides, push, speeds, name, chosen) for name, chosen in which),
        turned(
            "how far a pushing phase turns the board, rad",
            ((label, where & pushed) for label, where in push.and_all(speeds)),
        ),
        pushing("feet in pushing, shares of steps, by phase and by command", push.and_all(speeds)),
        pushing("feet by time in pushing, shares of steps", push.parts()),
        steering("feet by time in steering, shares of steps", steer.parts()),
        heading(by_phase, steer.and_all(speeds)),
        heading("heading by turn asked for, rad, m/s", by_turn),
        _heading_by_time(rides, steer),
    )


class _Phases:
    """Which phase of its episode a step belongs to, and how far into it it is."""

    def __init__(self, inside: Flags, length: int) -> None:
        self.inside, self.length = inside, length
        before = np.vstack([np.zeros((1, inside.shape[1]), dtype=bool), inside[:-1]])
        starts = inside & ~before
        self.number = np.where(inside, starts.cumsum(axis=0) - 1, -1)
        steps = np.arange(len(inside))[:, None]
        self.begin = np.maximum.accumulate(np.where(starts, steps, 0), axis=0)
        """First step of the phase that a step is in, (t, n)."""
        self.place = np.where(inside, steps - self.begin, -1)

    def parts(self) -> Iterator[Labelled]:
        """Yield equal parts of the phase in time, labelled in seconds since its begin."""
        edges = np.linspace(0, self.length, PARTS + 1)
        for low, high in pairwise(edges):
            where = self.inside & (self.place >= low) & (self.place < high)
            yield f"{low * CONTROL_PERIOD:.2f}-{high * CONTROL_PERIOD:.2f} s", where

    def phases(self) -> Iterator[Labelled]:
        """Yield the first, second, ... phase of the episodes."""
        for number in range(int(self.number.max(initial=-1)) + 1):
            yield f"phase {number + 1}", self.number == number

    def and_all(self, classes: Sequence[Labelled] = ()) -> Iterator[Labelled]:
        """Yield all steps, then those of each phase, then those of some classes."""
        yield "all", self.inside
        yield from self.phases()
        yield from ((label, self.inside & of_class) for label, of_class in classes)


def _classes(values: Array, edges: tuple[float, ...], unit: str) -> list[Labelled]:
    return [
        (f"{low:g}-{high:g} {unit}", (values >= low) & ((values < high) | (high == edges[-1])))
        for low, high in pairwise(edges)
    ]


def _cell(values: Any, where: Flags) -> Cell:
    return float(values[where].sum()), int(where.sum())


def _means(columns: Mapping[str, Any]) -> Callable[[str, Iterable[Labelled]], Table]:
    """Return the maker of a table with some columns, (t, n) each, and a row for the steps of each label."""

    def table(title: str, rows: Iterable[Labelled]) -> Table:
        cells = {label: tuple(_cell(values, where) for values in columns.values()) for label, where in rows}
        return Table(title, tuple(columns), cells)

    return table


def _speeds(rides: Rides) -> dict[str, Any]:
    error = rides.speed - rides.commanded_speed
    return {"|v-v_cmd|": np.abs(error), "v-v_cmd": error, "v": rides.speed, "v_cmd": rides.commanded_speed}


def _speed_by_time(
    rides: Rides, push: _Phases, speeds: Sequence[Labelled], which: str, chosen: Flags
) -> Table:
    error = rides.speed - rides.commanded_speed
    classes = {"all": push.inside} | {f"v_cmd {label}": flags for label, flags in speeds}
    rows = {
        part: tuple(_cell(error, where & chosen & of_class) for of_class in classes.values())
        for part, where in push.parts()
    }
    return Table(f"v-v_cmd by time in the {which} pushing phase, m/s", tuple(classes), rows)


def _feet(rides: Rides, wrong: Flags) -> dict[str, Any]:
    ground, deck = rides.foot_on_ground, rides.foot_on_deck
    return {
        "wrong": wrong, "right off deck": ~deck[..., 1], "left on deck": deck[..., 0],
        "right on ground": ground[..., 1], "left off deck": ~deck[..., 0], "left on ground": ground[..., 0],
    }  # fmt: skip


def _headings(rides: Rides, steer: _Phases) -> dict[str, Any]:
    """Return the columns of a heading; an error along the turn is positive where the board has turned too far."""
    error = wrap_angle(rides.heading - rides.target_heading)
    size, along = np.abs(error), error * np.sign(_turn(rides, steer))
    return {
        "|error|": size,
        "error along the turn": along,
        f"beyond {ARRIVED_HEADING:g} rad": size > ARRIVED_HEADING,
        "v": rides.speed,
    }


def _turn(rides: Rides, steer: _Phases) -> Array:
    """Return the turn asked for in each phase [rad], (t, n): the error at its first step."""
    return np.where(steer.inside, wrap_angle(rides.target_heading - _at_begin(rides.heading, steer)), 0.0)


def _at_begin(values: Array, phases: _Phases) -> Array:
    """Return values, (t, n), at the first step of the phase of each step."""
    return np.take_along_axis(values, phases.begin, axis=0)


def _heading_by_time(rides: Rides, steer: _Phases) -> Table:
    size, along, *_ = _headings(rides, steer).values()
    large = np.abs(_turn(rides, steer)) >= 0.4
    classes = {"": steer.inside, ", turn > 0.4": large, ", turn < 0.4": ~large}
    rows = {
        part: tuple(_cell(v, where & of_class) for of_class in classes.values() for v in (size, along))
        for part, where in steer.parts()
    }
    columns = tuple(f"{kind}{which}" for which in classes for kind in ("|error|", "along"))
    return Table("heading error by time in steering, rad", columns, rows)
