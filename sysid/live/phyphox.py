"""A phone's sensors over the network, by the remote access of the app phyphox.

`GET /get?gyrX=T|gyr_time&...` answers with the values of a buffer from where another one passes T, as JSON, and
`GET /control?cmd=start` begins the measurement (phyphox wiki, 'Remote-interface communication'). New samples are
appended at once to tables as the app exports them, so that the log survives any failure.
"""

import json
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from http.client import HTTPConnection, HTTPException
from pathlib import Path
from socket import SHUT_RDWR
from typing import Any
from urllib.parse import quote, urlsplit

import numpy as np

from sysid.errors import SysidError
from sysid.roll import Array

PATIENCE = 3.0
"""Longest wait for a whole answer [s]."""
MAX_ANSWER = 1 << 24
"""Longest answer [bytes]: ten minutes of two sensors at 1 kHz."""
_TABLES = {
    "Gyroscope": ("rad/s", (("gyr_time", "gyrX", "gyrY", "gyrZ"), ("gyro_time", "gyroX", "gyroY", "gyroZ"))),
    "Accelerometer": ("m/s^2", (("acc_time", "accX", "accY", "accZ"),)),
}
"""For each sensor its unit, and the names of its buffers in the app's experiments: time, x, y, z."""
_HEADS = {"Gyroscope": "Gyroscope", "Accelerometer": "Acceleration"}


@dataclass(slots=True)
class _Sensor:
    name: str
    buffers: tuple[str, ...]
    last: float = -1.0
    """Time of its newest sample [s]."""


@dataclass(slots=True)
class Phone:
    """A phone that measures, and the log of it."""

    address: str
    """As the app shows it, such as 192.168.0.42:8080."""
    folder: Path
    """Folder of its log, one table a sensor."""
    _sensors: list[_Sensor] = field(default_factory=list["_Sensor"])

    def connect(self) -> None:
        """List the phone's sensors, begin a log, and start the measurement.

        Raises:
            SysidError: Nothing answers there, or it has no gyroscope.
        """
        listed = self._get("/config").get("buffers")
        buffers = listed if isinstance(listed, list) else []
        names = {str(buffer["name"]) for buffer in buffers if isinstance(buffer, dict) and "name" in buffer}
        for name, (unit, known) in _TABLES.items():
            group = next((group for group in known if names.issuperset(group)), None)
            if group is None:
                continue
            self._sensors.append(_Sensor(name, group))
            heads = ('"Time (s)"', *(f'"{_HEADS[name]} {axis} ({unit})"' for axis in "xyz"))
            self.folder.mkdir(parents=True, exist_ok=True)
            (self.folder / f"{name}.csv").write_text(",".join(heads) + "\n", encoding="utf-8")
        if not any(sensor.name == "Gyroscope" for sensor in self._sensors):
            some = [repr(name[:30]) for name in sorted(names)[:12]]
            raise SysidError(
                f"{self.address}: the experiment that is open on the phone has no gyroscope (buffers: "
                f"{', '.join(some) or 'none'}). Open one with gyroscope and accelerometer, and allow remote access."
            )
        self._get("/control?cmd=start")

    def poll(self) -> Array:
        """Fetch and keep new samples, and return the gyroscope's part, shape (n, 4): time [s] and rates of rotation [rad/s].

        Raises:
            SysidError: The phone does not answer.
        """
        asked = [
            f"{buffer}={sensor.last:.9g}|{sensor.buffers[0]}"
            if buffer != sensor.buffers[0]
            else f"{buffer}={sensor.last:.9g}"
            for sensor in self._sensors
            for buffer in sensor.buffers
        ]
        answer = self._get("/get?" + "&".join(quote(text, safe="=|") for text in asked))
        turned = np.zeros((0, 4))
        for sensor in self._sensors:
            try:
                columns = [np.array(answer["buffer"][name]["buffer"], np.float64) for name in sensor.buffers]
                if any(column.ndim != 1 for column in columns):
                    raise ValueError("no list of numbers")
            except (KeyError, TypeError, ValueError, OverflowError) as error:
                raise SysidError(
                    f"{self.address}: the phone answers without the {sensor.name.lower()}'s numbers "
                    f"({type(error).__name__}). Is the experiment still open on it?"
                ) from error
            rows = self._new(sensor, columns)
            if sensor.name == "Gyroscope":
                turned = rows
        return turned

    def _new(self, sensor: _Sensor, columns: Sequence[Array]) -> Array:
        """Append a sensor's new rows to its table; a row that has not arrived whole comes with the next answer."""
        count = min(map(len, columns))
        rows = np.column_stack([column[:count] for column in columns])
        rows = rows[np.isfinite(rows).all(axis=1)]
        rows = rows[rows[:, 0] > sensor.last]
        if len(rows):
            with (self.folder / f"{sensor.name}.csv").open("a", encoding="utf-8") as table:
                np.savetxt(table, rows, "%.9E", ",")
            sensor.last = float(rows[:, 0].max())
        return rows

    def _get(self, path: str) -> dict[str, Any]:
        """Return the phone's answer to a question; a connection each, without a proxy, for the phone is beside us."""
        try:
            where = urlsplit(self.address if "//" in self.address else f"//{self.address}")
            connection = HTTPConnection(where.hostname or "", where.port or 80, timeout=PATIENCE)
            connection.connect()
            opened = connection.sock

            def end() -> None:  # an answer that comes byte by byte would never time out
                with suppress(OSError):
                    opened.shutdown(SHUT_RDWR)

            alarm = threading.Timer(PATIENCE, end)
            alarm.start()
            try:
                connection.request("GET", path)
                with connection.getresponse() as answer:
                    body = answer.read(MAX_ANSWER + 1)
            finally:
                alarm.cancel()
                connection.close()
            if answer.status != 200 or len(body) > MAX_ANSWER:
                raise ValueError(
                    f"status {answer.status}" if answer.status != 200 else "its answer is too long"
                )
            content: Any = json.loads(body)
        except (HTTPException, OSError, ValueError, RecursionError) as error:
            said = repr(str(error)[:100] or type(error).__name__)
            raise SysidError(
                f"{self.address}: no phone answers there ({said}). In phyphox, open an experiment with gyroscope and "
                "accelerometer, allow remote access in its menu, and type the address that it shows."
            ) from error
        return content if isinstance(content, dict) else {}
