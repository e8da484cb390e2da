"""A phone's sensors over the network, by the remote access of the app phyphox.

`GET /get?gyrX=T|gyr_time&...` answers with the values of a buffer from where another one passes T, as JSON, and
`GET /control?cmd=start` begins the measurement (phyphox wiki, 'Remote-interface communication'). What comes is at once
appended to tables as the app itself exports them, so that the log is there whatever happens.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.parse import quote
from urllib.request import ProxyHandler, build_opener

import numpy as np

from sysid.errors import SysidError
from sysid.roll import Array

PATIENCE = 3.0
"""For an answer [s]."""
_TABLES = {
    "Gyroscope": ("rad/s", (("gyr_time", "gyrX", "gyrY", "gyrZ"), ("gyro_time", "gyroX", "gyroY", "gyroZ"))),
    "Accelerometer": ("m/s^2", (("acc_time", "accX", "accY", "accZ"),)),
}
"""For each sensor its unit, and what its buffers are called in the app's experiments: time, x, y, z."""
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
    """Where its log is kept, one table a sensor."""
    samples: int = 0
    _sensors: list[_Sensor] = field(default_factory=list["_Sensor"])

    def connect(self) -> None:
        """Ask what the phone measures, begin a log, and start the measurement.

        Raises:
            SysidError: Nothing answers there, or it has no gyroscope.
        """
        listed = self._get("/config")
        names = {str(buffer.get("name")) for buffer in listed.get("buffers", [])}
        for name, (unit, known) in _TABLES.items():
            buffers = next((group for group in known if names.issuperset(group)), None)
            if buffers is None:
                continue
            self._sensors.append(_Sensor(name, buffers))
            heads = ('"Time (s)"', *(f'"{_HEADS[name]} {axis} ({unit})"' for axis in "xyz"))
            self.folder.mkdir(parents=True, exist_ok=True)
            (self.folder / f"{name}.csv").write_text(",".join(heads) + "\n", encoding="utf-8")
        if not any(sensor.name == "Gyroscope" for sensor in self._sensors):
            raise SysidError(
                f"{self.address}: the experiment that is open on the phone has no gyroscope (buffers: "
                f"{', '.join(sorted(names)) or 'none'}). Open one with gyroscope and accelerometer, and allow remote access."
            )
        self._get("/control?cmd=start")

    def poll(self) -> Array:
        """Fetch what is new, keep it, and return the gyroscope's part, shape (n, 4): time [s] and rates of rotation [rad/s].

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
            rows = self._new(sensor, [answer["buffer"][name]["buffer"] for name in sensor.buffers])
            if sensor.name == "Gyroscope":
                turned = rows
        return turned

    def _new(self, sensor: _Sensor, columns: Sequence[Sequence[float | None]]) -> Array:
        """Append a sensor's new rows to its table; a row that has not arrived whole comes with the next answer."""
        count = min(map(len, columns))
        rows = np.array([column[:count] for column in columns], dtype=float).T.reshape(-1, len(columns))
        rows = rows[np.isfinite(rows).all(axis=1)]
        rows = rows[rows[:, 0] > sensor.last]
        if len(rows):
            with (self.folder / f"{sensor.name}.csv").open("a", encoding="utf-8") as table:
                np.savetxt(table, rows, "%.9E", ",")
            sensor.last = float(rows[-1, 0])
            self.samples += len(rows)
        return rows

    def _get(self, path: str) -> dict[str, Any]:
        address = self.address if "//" in self.address else f"http://{self.address}"
        try:
            # A phone is beside us: no proxy. The app wants a connection for each question.
            with build_opener(ProxyHandler({})).open(address.rstrip("/") + path, timeout=PATIENCE) as answer:
                content: Any = json.load(answer)
        except (URLError, OSError, ValueError) as error:
            raise SysidError(
                f"{self.address}: no phone answers there ({getattr(error, 'reason', error)}). In phyphox, open an experiment "
                "with gyroscope and accelerometer, allow remote access in its menu, and type the address that it shows."
            ) from error
        return content if isinstance(content, dict) else {}
