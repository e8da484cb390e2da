"""Logs in which each sensor has a clock of its own."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid.roll import Array

TIME = "time (s)"


@dataclass(frozen=True, slots=True)
class SensorTables:
    """Several sensors; what is read together comes on the clock of the first one that is asked for."""

    path: Path
    clocks: Mapping[str, Array]
    """Time of each sensor [s], shape (n_sensor,)."""
    columns: Mapping[str, tuple[str, Array]]
    """Sensor and values of each column."""
    notes: tuple[str, ...]
    has_header: bool = True

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, the common time first."""
        return (TIME, *self.columns)

    @property
    def units(self) -> tuple[str | None, ...]:
        """No units apart from the names."""
        return (None,) * len(self.names)

    def read(self, names: Sequence[str]) -> dict[str, Array]:
        """Return columns, shape (n,) each, in the log's units at the times of the first one's sensor; others are interpolated."""
        base, _ = self.columns[next(name for name in names if name != TIME)]
        clock = self.clocks[base]
        result: dict[str, Array] = {}
        for name in names:
            if name == TIME:
                result[name] = clock.copy()
                continue
            sensor, values = self.columns[name]
            if sensor != base:
                order = np.argsort(self.clocks[sensor], kind="stable")
                values = np.interp(
                    clock, self.clocks[sensor][order], values[order], left=np.nan, right=np.nan
                )
            result[name] = values
        return result
