"""JSON in the shapes that people's programs write, and tables with a row for each sensor's sample."""

import json

import numpy as np
import pytest
from rocking import OMEGA, imu, rocking

from sysid.errors import SysidError
from sysid.free_decay import fit_decay
from sysid.logs import read_roll
from sysid.releases import find_releases

TIME = np.arange(0, 6, 0.01)
MOTION = rocking(TIME)
NOISE = np.random.default_rng(0)
GYRO, ACCEL = (sensor + NOISE.normal(0, 0.01, sensor.shape) for sensor in imu(TIME, *MOTION))
DEG = [round(value, 4) for value in np.degrees(MOTION[0] + NOISE.normal(0, 5e-4, len(TIME))).tolist()]
SECONDS = [round(value, 4) for value in TIME.tolist()]
PAIRS = [list(pair) for pair in zip(SECONDS, DEG, strict=True)]
RECORDS = [{"time_s": t, "roll_deg": v} for t, v in PAIRS]
NS = [1_700_000_000_000_000_000 + round(1e9 * t) for t in SECONDS]


def right(path, source):
    roll = read_roll(path)
    assert fit_decay(find_releases(roll)).numbers.omega_n.value == pytest.approx(OMEGA, rel=3e-3)
    assert np.ptp(roll.roll) == pytest.approx(np.ptp(MOTION[0]), rel=0.04)
    assert roll.origin == source
    return roll


def xyz(row):
    return dict(zip("xyz", row.tolist(), strict=True))


def texts(row):
    return {axis: str(value) for axis, value in xyz(row).items()}


ANGLES = {
    "records": RECORDS,
    "columns": {"time_s": SECONDS, "roll_deg": DEG},
    "pandas columns": {key: {str(k): row[key] for k, row in enumerate(RECORDS)} for key in RECORDS[0]},
    "in data": {"device": "a", "rate": 100, "data": RECORDS},
    "nested": [{"ts": 1.7e9 + t, "imu": {"roll_deg": v, "ok": True}} for t, v in PAIRS],
    "dates": [{"time": f"2024-05-01T10:22:{30 + t:06.3f}Z", "roll_deg": v} for t, v in PAIRS],
    "texts": [{"time_s": str(t), "roll_deg": str(v)} for t, v in PAIRS],
}
IMU = {
    "sensors in a record": [
        {"timestamp": ns // 10**6, "gyroscope": xyz(w), "accelerometer": xyz(a)}
        for ns, w, a in zip(NS, GYRO, ACCEL, strict=True)
    ],
    "sensors apart": {
        "sensors": {
            "gyroscope": [{"time": t, "values": xyz(w)} for t, w in zip(SECONDS, GYRO, strict=True)],
            "accelerometer": [{"time": t + 0.003, "values": xyz(a)} for t, a in zip(SECONDS, ACCEL, strict=True)],
        }
    },
    "Sensor Logger": [{"sensor": "Metadata", "version": "1"}] + [
        {"sensor": name, "time": str(ns), "seconds_elapsed": str(t), **texts(row)}
        for ns, t, w, a in zip(NS, SECONDS, GYRO, ACCEL, strict=True)
        for name, row in (("Gyroscope", w), ("TotalAcceleration", a), ("Microphone", a))
    ],
}  # fmt: skip


@pytest.mark.parametrize("shape", ANGLES)
def test_shapes_of_json(tmp_path, shape):
    path = tmp_path / "log.json"
    path.write_text(json.dumps(ANGLES[shape], indent=1 if shape == "records" else None))
    assert len(right(path, "angle").time) == len(TIME)


@pytest.mark.parametrize("shape", IMU)
def test_sensors_in_json(tmp_path, shape):
    path = tmp_path / "log.json"
    path.write_text(json.dumps(IMU[shape]))
    right(path, "imu")


def test_lines_of_json_may_be_cut_at_their_end(tmp_path):
    path = tmp_path / "log.jsonl"
    lines = [json.dumps(record) for record in RECORDS]
    path.write_text("\n".join([*lines, '{"time_s": 6.0, "ro']))
    right(path, "angle")
    path.write_text("\n".join([*lines[:300], '{"time_s": 6.0, "ro', *lines[300:]]))
    with pytest.raises(SysidError, match="damaged JSON"):
        read_roll(path)


@pytest.mark.parametrize("content", [{}, [], {"a": 1}, [[1, 2]], {"a": {"b": []}}, [{"t": 1}] * 3])
def test_json_without_a_table_is_refused(tmp_path, content):
    path = tmp_path / "log.json"
    path.write_text(json.dumps(content))
    with pytest.raises(SysidError):
        read_roll(path)


@pytest.mark.parametrize("names", [("Accelerometer", "Gyroscope"), ("ACC", "GYR")])
@pytest.mark.parametrize("scale", [1, 10**9])
def test_rows_of_each_sensor(tmp_path, names, scale):
    lines = ["sensor,time,x,y,z"]
    for t, a, w in zip(SECONDS, ACCEL, GYRO, strict=True):
        for name, late, row in zip(names, (0, 0.003), (a, w), strict=True):
            stamp = (5 + t + late) * scale
            lines.append(
                f"{name},{stamp if scale == 1 else round(stamp)}," + ",".join(f"{v:.5f}" for v in row)
            )
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines))
    right(path, "imu")


@pytest.mark.parametrize("column", ["variable", "topic"])
def test_rows_of_each_quantity(tmp_path, column):
    lines = [f"time_s,{column},value"]
    for t, v in PAIRS:
        lines += [f"{t},roll_deg,{v}", f"{t},battery,12.{int(t)}"]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines))
    right(path, "angle")
