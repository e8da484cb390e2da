"""Any dialect of text, Parquet, phone exports, MCAP: the same roll comes out."""

import json
import math
import zipfile
from datetime import datetime, timedelta

import numpy as np
import pandas as pd
import pytest
from rocking import imu, rocking, write_csv

from sysid.errors import SysidError
from sysid.logs import LogOptions, read_roll
from sysid.logs.table.names import parse_column

TIME = np.arange(0, 4, 0.01)
ROLL = rocking(TIME)[0]


def check(path, **options):
    roll = read_roll(path, LogOptions(**options))
    np.testing.assert_allclose(roll.time, TIME, atol=1e-6)
    np.testing.assert_allclose(roll.roll, ROLL, atol=1e-6)
    return roll


@pytest.mark.parametrize(
    ("name", "kind", "axis", "unit"),
    [
        ("roll_deg", "angle", "x", "deg"),
        ("angle_rad", "angle", "", "rad"),
        ("Winkel [°]", "angle", "", "deg"),
        ("pitch", "angle", "y", None),
        ("Gyroscope x (rad/s)", "rate", "x", "rad/s"),
        ("GyroY_dps", "rate", "y", "deg/s"),
        ("gyro_integrated_x [deg]", "angle", "x", "deg"),
        ("gyroAngleX", "angle", "x", None),
        ("integrated gyro x (rad/s)", "rate", "x", "rad/s"),
        ("/imu.angular_velocity.x", "rate", "x", None),
        ("ax", "accel", "x", None),
        ("Acceleration z (m/s^2)", "accel", "z", "m/s^2"),
        ("qw", "quaternion", "w", None),
        ("Time (s)", "time", "", "s"),
        ("timestamp_ns", "time", "", "ns"),
        ("roll_std_rad", "std", "x", "rad"),
        ("heave_m", "other", "", None),
    ],
)
def test_names_tell_quantity_axis_and_unit(name, kind, axis, unit):
    column = parse_column(name)
    assert (column.kind, column.axis, column.unit) == (kind, axis, unit)


@pytest.mark.parametrize(
    ("sep", "decimal", "newline"),
    [(",", ".", "\n"), (";", ",", "\r\n"), ("\t", ",", "\n"), ("|", ".", "\r\n"), (" ", ".", "\n")],
)
def test_every_delimiter_decimal_sign_and_line_end(tmp_path, sep, decimal, newline):
    path = write_csv(
        tmp_path / "log.txt", ("t_s", "roll_rad"), TIME, ROLL, sep=sep, decimal=decimal, newline=newline
    )
    roll = check(path)
    assert any("roll_rad" in note for note in roll.notes)
    assert any("decimal comma" in note for note in roll.notes) == (decimal == ",")


def test_bom_preamble_comments_quotes_and_units_row(tmp_path):
    rows = "\n".join(f'"{t:.9g}","{r:.9g}"' for t, r in zip(TIME, np.rad2deg(ROLL), strict=True))
    path = tmp_path / "log.csv"
    path.write_bytes(
        b'\xef\xbb\xbf# recorded by hand\nBoard: pink, second try\n\n"time","roll"\n"ms","deg"\n'
        + rows.replace("\n", "\n# a remark\n", 1).encode()
        + b"\n"
    )
    roll = read_roll(path)
    np.testing.assert_allclose(roll.time, TIME * 1e-3, atol=1e-9)
    np.testing.assert_allclose(roll.roll, ROLL, atol=1e-6)


def test_utf16_and_latin_1(tmp_path):
    text = "Zeit (s)\tWinkel (°)\r\n" + "".join(
        f"{t:.9g}\t{r:.9g}\r\n" for t, r in zip(TIME, np.rad2deg(ROLL), strict=True)
    )
    for name, encoding in (("a.txt", "utf-16"), ("b.txt", "cp1252")):
        (tmp_path / name).write_bytes(text.encode(encoding))
        check(tmp_path / name)


def test_header_written_as_a_comment_and_no_header_at_all(tmp_path):
    np.savetxt(tmp_path / "a.txt", np.stack((TIME, ROLL), axis=1), header="time_s roll_rad")
    check(tmp_path / "a.txt")
    np.savetxt(tmp_path / "b.txt", np.stack((TIME, ROLL), axis=1), delimiter=",")
    roll = check(tmp_path / "b.txt", unit="rad")
    assert any("numbered" in note for note in roll.notes)


def test_without_header_time_is_found_beside_the_column_that_the_user_names(tmp_path):
    path = write_csv(tmp_path / "log.csv", None, TIME, np.cos(20 * TIME), ROLL)
    with pytest.raises(SysidError, match="--column"):
        read_roll(path)
    check(path, column="3")


def test_trailing_delimiters_and_blanks_after_commas(tmp_path):
    lines = ["t_s, roll_rad,", *(f"{t:.9g}, {r:.9g}," for t, r in zip(TIME, ROLL, strict=True))]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    check(tmp_path / "log.csv")


def test_dates_and_times_of_day_as_time(tmp_path):
    stamps = pd.to_datetime("2026-03-01T23:59:58") + pd.to_timedelta(TIME, unit="s")
    iso = [stamp.isoformat(timespec="milliseconds") for stamp in stamps]
    check(write_csv(tmp_path / "a.csv", ("timestamp", "roll_rad"), iso, ROLL))
    clock = [f"{h:02d}:{m:02d}:{s:06.3f}" for h, m, s in ((13, 0, t) for t in TIME)]
    check(write_csv(tmp_path / "b.csv", ("time", "roll_rad"), clock, ROLL))


def test_parquet_with_and_without_time_stamps(tmp_path):
    pd.DataFrame({"t_s": TIME, "junk": ["a"] * TIME.size, "roll_rad": ROLL}).to_parquet(
        tmp_path / "a.parquet"
    )
    check(tmp_path / "a.parquet")
    stamps = pd.to_datetime(1.7e18 + TIME * 1e9)
    pd.DataFrame({"time": stamps, "roll_deg": np.rad2deg(ROLL)}).to_parquet(tmp_path / "b.pq")
    check(tmp_path / "b.pq")
    (tmp_path / "c.parquet").write_bytes((tmp_path / "a.parquet").read_bytes()[:500])
    with pytest.raises(SysidError, match="Parquet"):
        read_roll(tmp_path / "c.parquet")


def sensor_files():
    rng = np.random.default_rng(3)
    time = np.arange(0, 6, 0.005)
    gyro, accel = imu(time, *rocking(time))
    gyro = gyro + rng.normal(0, 2e-3, gyro.shape) + 0.01
    return time, gyro, accel + rng.normal(0, 0.02, accel.shape)


def check_phone(path, tolerance_deg=0.3):
    roll = read_roll(path)
    assert roll.origin == "imu"
    error = roll.roll - rocking(roll.time)[0]
    assert np.rad2deg(np.abs(error).max()) < tolerance_deg
    return roll


def table(names, *columns, sep=",", decimal="."):
    lines = [sep.join(f'"{name}"' for name in names)]
    lines += [
        sep.join(f"{value:.9g}".replace(".", decimal) for value in row) for row in zip(*columns, strict=True)
    ]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(("sep", "decimal"), [(",", "."), ("\t", "."), (";", ",")])
def test_phyphox_zip(tmp_path, sep, decimal):
    time, gyro, accel = sensor_files()
    path = tmp_path / "Gyroscope and accelerometer 2026-03-01.zip"
    with zipfile.ZipFile(path, "w") as archive:
        names = [f"Gyroscope {axis} (rad/s)" for axis in "xyz"]
        archive.writestr(
            "Gyroscope.csv", table(("Time (s)", *names), time, *gyro.T, sep=sep, decimal=decimal)
        )
        names = [f"Acceleration {axis} (m/s^2)" for axis in "xyz"]
        late = np.maximum(time[::2] - 1e-3, 0.0)
        sampled = [np.interp(late, time, column) for column in accel.T]
        archive.writestr(
            "Accelerometer.csv", table(("Time (s)", *names), late, *sampled, sep=sep, decimal=decimal)
        )
        archive.writestr("meta/time.csv", '"event","experiment time"\n"START",0\n"PAUSE",6\n')
        archive.writestr("meta/device.csv", "property,value\nversion,1.1\n")
    check_phone(path)


def test_matlab_mobile_zip(tmp_path):
    """Bare axes, stamps with the month in letters, and the gyro called by what it measures."""
    time, gyro, accel = sensor_files()
    start, path = datetime(2026, 5, 12, 14, 5, 12), tmp_path / "sensorlog_20260512_140512.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for name, values in (("Acceleration", accel), ("AngularVelocity", gyro)):
            lines = ["Timestamp,X,Y,Z"]
            for t, row in zip(time, values, strict=True):
                stamp = start + timedelta(milliseconds=round(1000 * t))
                lines.append(",".join((f"{stamp:%d-%b-%Y %H:%M:%S.%f}"[:-3], *map(str, row))))
            archive.writestr(f"{name}.csv", "\n".join(lines) + "\n")
    check_phone(path)


@pytest.mark.parametrize("kind", ["total", "gravity-apart", "uncalibrated", "folder"])
def test_sensor_logger_export(tmp_path, kind):
    time, gyro, accel = sensor_files()
    epoch = 1.7e18 + np.round(time * 1e9)
    header = ("time", "seconds_elapsed", "z", "y", "x")
    roll, *_ = rocking(time)
    up = 9.81 * np.stack((np.zeros(time.size), np.sin(roll), np.cos(roll)), axis=1)

    def of(values):
        lines = [",".join(header)]
        for stamp, t, row in zip(epoch, time, values, strict=True):
            lines.append(f"{stamp:.0f},{t:.9f}," + ",".join(f"{value:.9g}" for value in row[::-1]))
        return "\n".join(lines) + "\n"

    files = {
        "Gyroscope.csv": of(gyro),
        "Metadata.csv": "version,device\n3,phone\n",
        "Annotation.csv": "time,text\n",
    }
    if kind == "uncalibrated":
        files["AccelerometerUncalibrated.csv"] = of(accel / 9.81)
    elif kind == "gravity-apart":
        files |= {"Accelerometer.csv": of(accel - up), "Gravity.csv": of(up)}
    else:
        files |= {"Accelerometer.csv": of(accel - up), "TotalAcceleration.csv": of(accel)}
    half = roll / 2
    lines = ["time,seconds_elapsed,qz,qy,qx,qw,roll,pitch,yaw"]
    lines += [f"{e:.0f},{t:.9f},0,0,{math.sin(h)},{math.cos(h)},{r:.9g},0,0"
              for e, t, h, r in zip(epoch, time, half, roll, strict=True)]  # fmt: skip
    files["Orientation.csv"] = "\n".join(lines) + "\n"
    if kind == "folder":
        path = tmp_path / "export"
        path.mkdir()
        for name, text in files.items():
            (path / name).write_text(text)
    else:
        path = tmp_path / "2026-03-01_12-00-00.zip"
        with zipfile.ZipFile(path, "w") as archive:
            for name, text in files.items():
                archive.writestr(name, text)
    check_phone(path)
    fused = read_roll(path, LogOptions(source="quaternion"))
    np.testing.assert_allclose(fused.roll, rocking(fused.time)[0], atol=1e-4)
    fused = read_roll(path, LogOptions(source="angle", unit="rad"))
    np.testing.assert_allclose(fused.roll, rocking(fused.time)[0], atol=1e-4)


def test_archives_that_are_none_say_so(tmp_path):
    (tmp_path / "a.zip").write_bytes(b"PK\x03\x04 nothing")
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
        archive.writestr("letter.doc", "hello")
    (tmp_path / "c.xlsx").write_bytes(b"PK\x03\x04 sheet")
    (tmp_path / "d.csv.gz").write_bytes(b"\x1f\x8b\x08 zipped")
    (tmp_path / "e.db3").write_bytes(b"SQLite format 3\0")
    (tmp_path / "empty").mkdir()
    for name, hint in (("a.zip", "damaged"), ("b.zip", "no table"), ("c.xlsx", "damaged"), ("d.csv.gz", "damaged"),
                       ("e.db3", "damaged"), ("empty", "no table")):  # fmt: skip
        with pytest.raises(SysidError, match=hint):
            read_roll(tmp_path / name)


def test_mcap_with_ros2_messages(tmp_path):
    writer_module = pytest.importorskip("mcap_ros2.writer", reason="the mcap extra is not installed")
    time, gyro, accel = sensor_files()
    path = tmp_path / "recording.mcap"
    vector = "geometry_msgs/Vector3 angular_velocity\ngeometry_msgs/Vector3 linear_acceleration\n"
    definition = (
        "std_msgs/Header header\n" + vector + "float64[9] angular_velocity_covariance\n"
        + "=" * 80 + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
        + "=" * 80 + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
        + "=" * 80 + "\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
    )  # fmt: skip
    with path.open("wb") as file:
        writer = writer_module.Writer(file)
        schema = writer.register_msgdef("sensor_msgs/msg/Imu", definition)
        for t, g, a in zip(time, gyro, accel, strict=True):
            stamp = round((1.7e9 + t) * 1e9)
            message = {
                "header": {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": "imu"},
                "angular_velocity": dict(zip("xyz", g.tolist(), strict=True)),
                "linear_acceleration": dict(zip("xyz", a.tolist(), strict=True)),
                "angular_velocity_covariance": [0.0] * 9,
            }
            late = stamp + 10**9
            writer.write_message("/imu/data", schema, message, log_time=late, publish_time=late)
        writer.finish()
    roll = check_phone(path)
    assert any("/imu/data" in note for note in roll.notes)
    (tmp_path / "cut.mcap").write_bytes(path.read_bytes()[:5000])
    with pytest.raises(SysidError):
        read_roll(tmp_path / "cut.mcap")


def test_mcap_with_json_messages_and_a_joint(tmp_path):
    module = pytest.importorskip("mcap.writer", reason="the mcap extra is not installed")
    path = tmp_path / "joint.mcap"
    with path.open("wb") as file:
        writer = module.Writer(file)
        writer.start()
        schema = writer.register_schema("JointState", "jsonschema", b"{}")
        channel = writer.register_channel("/joint_states", "json", schema)
        for t, angle in zip(TIME, ROLL, strict=True):
            content = {"name": ["board_tilt"], "position": [angle]}
            stamp = round((1.7e9 + t) * 1e9)
            writer.add_message(channel, stamp, json.dumps(content).encode(), stamp)
        writer.finish()
    roll = read_roll(path, LogOptions(unit="rad"))
    np.testing.assert_allclose(roll.roll, ROLL, atol=1e-9)
