"""Detection of a deck that has come to rest, from its rates as they arrive."""

from dataclasses import dataclass

import numpy as np

from sysid.roll import Array

REST_TIMES = (0.25, 0.4, 0.7)
"""After how much stillness the log is read: a decay may take a while to be known as ended, and reading costs [s]."""
MAX_REST_RATE = 0.06
"""Rate of rotation below which a deck counts as still, beside the phone's offset [rad/s]."""


@dataclass(slots=True)
class Rest:
    """Knows by the phone's own clock when its log is worth reading: how late the samples arrive does not matter."""

    moved: float = 0.0
    """When it last moved [s]."""
    looks: int = len(REST_TIMES)
    """How often the log was read since."""

    def has_come(self, rows: Array) -> bool:
        """Return whether it is time to read the log.

        Args:
            rows: New samples, shape (n, 4): time [s] and rates of rotation [rad/s].
        """
        if not len(rows):
            return False
        time, rates = rows[:, 0], rows[:, 1:]
        moves = np.abs(rates - np.median(rates, axis=0)).max(axis=1) > MAX_REST_RATE
        if moves.any():
            self.moved, self.looks = float(time[moves][-1]), 0
        if self.looks == len(REST_TIMES) or time[-1] - self.moved < REST_TIMES[self.looks]:
            return False
        self.looks += 1
        return True
