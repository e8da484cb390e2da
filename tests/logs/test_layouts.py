"""Layouts of text and JSON that loggers, phones, robots, trackers and people write: each holds one decay, read without an option."""

import json
from datetime import datetime, timedelta

import numpy as np
import pytest
from rocking import ACCEL, GYRO, MOTION, ROLL, TIME, imu, right, rocking, write_csv
from scipy.spatial.transform import Rotation

from sysid.errors import SysidError
from sysid.logs import LogOptions, read_roll
from sysid.logs.table.names import parse_column
from sysid.releases import find_releases
from sysid.video.options import VideoOptions

N, DEG, RATE = len(TIME), np.degrees(ROLL), GYRO[:, 0]
DPS, MS = np.degrees(RATE), [10 * k for k in range(N)]
PITCH = 2.0 + np.random.default_rng(1).normal(0, 0.03, N)
HALF = ROLL / 2
XYZ = ",".join


def rows(form, *columns):
    """Return a line for each row of some columns."""
    return [form.format(*row) for row in zip(*columns, strict=True)]


def begin(form, start=datetime(2024, 3, 31, 11, 59, 57)):
    """Return the stamps as dates or times of day."""
    return [(start + timedelta(seconds=float(t))).strftime(form) for t in TIME]


WALL = [stamp[:-3] for stamp in begin("%H:%M:%S.%f")]
PLAIN = rows("{:.4f},{:.5f}", TIME, DEG)
COUNTED = rows("{},{:.4f}", MS, DEG)
CELLS = [",".join(f"{value:.5f}" for value in row) for row in np.hstack((ACCEL, GYRO))]
NAMES = XYZ(f"{what}_{axis}" for what in ("Acc", "Gyr") for axis in "XYZ")
MICRO = np.rint((1.78e9 + 0.25 + TIME) * 1e6).astype(int)


def ticks(first, size):
    return (first + np.round(TIME / size)).astype(np.int64) % 2**32


TABLES = {
    # dialects
    "commas": ["t_s,roll_deg", *PLAIN],
    "semicolons, decimal comma": ["t_s;roll_deg", *(row.replace(",", ";").replace(".", ",") for row in PLAIN)],
    "tabs, decimal comma": ["t_s\troll_deg", *(row.replace(",", "\t").replace(".", ",") for row in PLAIN)],
    "bars": ["t_s|roll_deg", *(row.replace(",", "|") for row in PLAIN)],
    "blanks": ["t_s roll_deg", *(row.replace(",", " ") for row in PLAIN)],
    "preamble, quotes, units": ["# by hand", "Board: pink, second try", "", '"time","roll"', '"s","deg"',
        *rows('"{:.4f}","{:.5f}"', TIME, DEG)],
    "header as a comment": ["# time_s roll_deg", *(row.replace(",", " ") for row in PLAIN)],
    "delimiter at the end": ["t_s, roll_deg,", *(f"{row}," for row in PLAIN)],
    "thousands": ["time_ms\troll_deg", *rows("{:,.1f}\t{:.3f}", 1e3 * TIME, DEG)],
    "a comma of three places": ["time_s;roll_deg", *(row.replace(".", ",") for row in rows("{:.4f};{:.3f}", TIME, DEG))],
    "units in the cells": ["time,roll", *rows("{:.4f} sec,{:.3f} deg", TIME, DEG)],
    "lists of one number": ["t,name,position,effort",
        *rows("{:.4f},\"['tilt']\",\"[{:.6f}]\",\"[0.0]\"", TIME, ROLL)],
    "cut in its last row": ["t_ms,roll_deg", *COUNTED, "6000,-1.x"],
    "newest first": ["t_s,roll_deg", *PLAIN[::-1]],
    # dates
    "31.03.2024": ["time,roll_deg", *rows("{},{:.4f}", begin("%d.%m.%Y %H:%M:%S.%f"), DEG)],
    "03/31/2024 PM": ["time,roll_deg", *rows("{},{:.4f}", begin("%m/%d/%Y %I:%M:%S.%f %p"), DEG)],
    "2024/03/31": ["time,roll_deg", *rows("{},{:.4f}", begin("%Y/%m/%d %H:%M:%S.%f"), DEG)],
    "2024-03-31": ["time,roll_deg", *rows("{},{:.4f}", begin("%Y-%m-%dT%H:%M:%S.%f"), DEG)],
    "newest date first": ["time,roll_deg", *rows("{},{:.4f}", begin("%Y-%m-%dT%H:%M:%S.%f"), DEG)[::-1]],
    "PM": ["time,roll_deg", *rows("{},{:.4f}", begin("%I:%M:%S.%f %p"), DEG)],
    "a day apart": ["Datum;Uhrzeit;Winkel [°]",
        *rows("03.05.2026;{};{}", [w.replace(".", ",") for w in WALL], [f"{v:.4f}".replace(".", ",") for v in DEG])],
    # clocks
    "ROS seconds": ["header.stamp.secs,header.stamp.nsecs,roll_deg",
        *rows("{},{},{:.4f}", MICRO // 10**6, MICRO % 10**6 * 1000, DEG)],
    "seconds and microseconds": ["time_s,time_us,roll_deg", *rows("{},{},{:.4f}", MICRO // 10**6, MICRO % 10**6, DEG)],
    "two whole clocks": ["time_s,time_ms,roll_deg", *rows("{:.4f},{:.1f},{:.4f}", TIME, 1e3 * TIME, DEG)],
    "a clock that stands": ["GpsTime,TimeStartup (s),Roll", *rows("0,{:.3f},{:.4f}", TIME, DEG)],
    "an empty clock": ["UTC_Nano,time_s,Roll", *rows(",{:.3f},{:.4f}", TIME, DEG)],
    # tools
    "Xsens tracker": ["// General information:", "// DeviceId:\t0388", f"PacketCounter,SampleTimeFine,{NAMES}",
        *rows("{},{},{}", range(N), ticks(41000, 1e-4), CELLS)],
    "Xsens DOT": ["sep=,", "DeviceTag:,DOT 1", "PacketCounter,SampleTimeFine,Euler_X",
        *rows("{},{},{:.4f}", range(N), ticks(2**32 - 20000, 1e-6), DEG)],
    "LabVIEW": ["LabVIEW Measurement\t", "Separator\tTab", "***End_of_Header***\t", "\t", "Channels\t1\t\t", "Delta_X\t0.01\t\t",
                "***End_of_Header***\t\t", "X_Value\troll_deg\tComment", *rows("{:.6f}\t{:.6f}", TIME, DEG)],
    "joints of a robot": ["t,dq,q", *rows("{:.4f},{:.6f},{:.6f}", TIME, RATE, ROLL)],
    "a table named after its sensor": ["time,seconds_elapsed,z,y,x",
        *rows("{:.0f},{:.6f},0.001,{:.4f},{:.6f}", 1.78e18 + 1e9 * TIME, TIME, 2e-4 * (np.arange(N) % 7), RATE)],
    "q0 to q3": ["time_s,q0,q1,q2,q3",
        *rows("{:.4f},{:.2f},{:.2f},0,0", TIME, 16384 * np.cos(HALF), 16384 * np.sin(HALF))],
    "rows of each quantity": ["time_s,variable,value", *(
        line for t, v in zip(TIME, DEG, strict=True) for line in (f"{t:.4f},roll_deg,{v:.4f}", f"{t:.4f},battery,12.{int(t)}")
    )],
    "rows of each sensor": ["sensor,time,x,y,z", *(
        f"{name},{round(1e9 * (5 + t + late))}," + XYZ(f"{v:.5f}" for v in row)
        for t, a, w in zip(TIME, ACCEL, GYRO, strict=True) for name, late, row in (("ACC", 0, a), ("GYR", 0.003, w))
    )],
    "IMU rows of their own": ["t_s,gx (rad/s),gy (rad/s),gz (rad/s),ax (m/s2),ay (m/s2),az (m/s2)", *(
        line for t, w, a in zip(TIME, GYRO, ACCEL, strict=True)
        for line in (f"{t:.4f},{XYZ(map(str, w))},,,", f"{t + 0.0025:.4f},,,,{XYZ(map(str, a))}")
    )],
}  # fmt: skip
for bodies, turned in (
    (3, np.stack((DEG, PITCH, PITCH), axis=1)),
    (4, Rotation.from_rotvec(ROLL[:, None] * [1, 0, 0]).as_quat()),
):
    TABLES[f"motion capture of {bodies}"] = [
        "Format Version,1.23,Capture Frame Rate,100.0", "", *(",," + ",".join([word] * (bodies + 4)) for word in ("Rigid Body", "deck")),
        ",," + ",".join(["Rotation"] * bodies + ["Position"] * 3 + ["Mean Marker Error"]),
        f"Frame,Time (Seconds),{XYZ('XYZW'[:bodies])},X,Y,Z,",
        *rows("{},{:.6f},{},0.1,0.2,0.3,0.0004", range(N), TIME, [XYZ(f"{v:.6f}" for v in row) for row in turned]),
    ]  # fmt: skip
SERIAL = {
    "arrow": rows("{} -> roll:{:.2f} gyro:{:.2f}", WALL, DEG, DPS),
    "equals": rows("roll={:.2f}, t={}", DEG, MS),
    "tabs": rows("millis: {}\troll: {:.2f}\tpitch: {:.2f}", MS, DEG, PITCH),
    "plotter": rows("Time:{} Roll:{:.2f} Pitch:{:.2f}", MS, DEG, PITCH),
    "brackets": rows("[{}] roll: {:.2f} deg", WALL, DEG),
    "lines": rows("time: {}\nroll: {:.2f} deg\ntemperature: 25 degC\n", MS, DEG),
    "unit at the end": rows(
        "{} -> Rotation X: {:.3f}, Y: 0.001, Z: 0.00{} rad/s", WALL, RATE, np.arange(N) % 2
    ),
    "no names": rows("{} -> {},{:.2f}", WALL, MS, DEG),
}
BOOT = ["ets Jun  8 2016 00:22:57", "rst:0x1 (POWERON_RESET),boot:0x13 (SPI_FAST_FLASH_BOOT)", "mode:DIO, clock div:1",
        "load:0x3fff0030,len:1184", "entry 0x400805e4", "MPU6050 Found!"]  # fmt: skip


def text(tmp_path, lines, name="log.txt", encoding="utf-8"):
    path = tmp_path / name
    path.write_bytes(("\r\n".join(lines) + "\r\n").encode(encoding))
    return path


@pytest.mark.parametrize("name", TABLES)
def test_layouts_of_tables(tmp_path, name):
    right(text(tmp_path, TABLES[name], "Gyroscope.csv" if "named after" in name else "log.csv"))


@pytest.mark.parametrize("kind", SERIAL)
@pytest.mark.parametrize("before", [[], BOOT, ["ll:-3.21 gyro:0.2"]], ids=["plain", "boot", "cut"])
def test_prints_of_a_microcontroller(tmp_path, kind, before):
    roll = right(text(tmp_path, [*before, *SERIAL[kind]]))
    assert len(roll.time) >= N - 2


@pytest.mark.parametrize("encoding", ["utf-16", "cp1252", "utf-8-sig"])
def test_encodings(tmp_path, encoding):
    lines = rows("{:.9g}\t{:.9g}", TIME, DEG)
    right(text(tmp_path, ["Zeit (s)\tWinkel (°)", *lines], encoding=encoding))


@pytest.mark.parametrize(
    ("time", "angle"),
    [
        ("tempo", "angolo [°]"), ("время", "угол [°]"), ("Zeit", "Winkel (Grad)"), ("temps", "angle (degrés)"),
        ("tiempo", "ángulo_deg"), ("czas", "kąt [°]"), ("时间", "角度(°)"), ("時間", "角度_deg"), ("시간", "각도 (deg)"),
        ("tijd", "hoek_deg"), ("süre", "açı (°)"), ("čas", "úhel [°]"), ("χρόνος", "γωνία [°]"), ("tid", "vinkel_deg"),
        ("thời gian", "góc [°]"), ("समय", "कोण_deg"),
    ],
)  # fmt: skip
def test_time_and_angle_in_other_languages(tmp_path, time, angle):
    assert not right(text(tmp_path, [f"{time},{angle}", *PLAIN])).warnings


@pytest.mark.parametrize("names", ["time,sensor1", "t,x", "seconds,Messwert"])
def test_the_only_column_that_moves_is_the_motion(tmp_path, names):
    roll = right(text(tmp_path, [names, *rows("{:.4f},{:.6f}", TIME, ROLL)]))
    assert any("only column that moves" in said for said in roll.warnings)


def test_noise_is_no_motion(tmp_path):
    held = 0.4 + np.random.default_rng(6).normal(0, 2e-3, N)
    right(text(tmp_path, ["Timestamp,shoulder,ankle", *rows("{:.4f},{:.6f},{:.6f}", TIME, held, ROLL)]))


@pytest.mark.parametrize("name", ["log.zip", "log.parquet", "log"])
def test_the_name_of_a_table_says_nothing(tmp_path, name):
    right(text(tmp_path, TABLES["commas"], name))


def test_without_header_time_is_found_and_the_motion_named(tmp_path):
    path = write_csv(tmp_path / "log.csv", None, TIME, np.cos(20 * TIME), ROLL)
    with pytest.raises(SysidError, match="--column"):
        read_roll(path)
    assert any("numbered" in note for note in right(path, column="3").notes)


@pytest.mark.parametrize("words", ["t_ms,roll_deg", "---", "12", "error, in, bus, 3"])
def test_words_between_rows_are_dropped_with_a_warning(tmp_path, words):
    lines = ["t_ms,roll_deg", *COUNTED[:300], words, *COUNTED[300:450], words, *COUNTED[450:]]
    roll = right(text(tmp_path, lines))
    assert any(f"2 of {N + 2} rows without a number" in warned for warned in roll.warnings)
    assert len(roll.time) == N


def test_a_header_between_recordings_starts_another(tmp_path):
    own = ["ready", "t_ms,roll_deg", *rows("{},{:.3f}", [300 + ms for ms in MS], DEG)]
    assert len(find_releases(right(text(tmp_path, own + own)))) == 2


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (["t_ms,roll_deg", *COUNTED[:300], "3000,-1.x", *COUNTED[300:]], r"line 302, column 'roll_deg': '-1\.x' is not a number"),
        (["UTC_Nano,Roll", *rows(",{:.4f}", DEG)], r"'UTC_Nano' is empty.*--rate"),
        (TABLES["a table named after its sensor"], "no column of roll"),
        (["millis,gx",
            *rows("{},{:.0f}", MS, 131 * DPS)], r"look like counts of a gyro.*--unit 0\.0001332 where 16 bits"),
    ],
)  # fmt: skip
def test_what_a_table_leaves_open_is_refused(tmp_path, lines, words):
    with pytest.raises(SysidError, match=words):
        read_roll(text(tmp_path, lines, "log5.csv"))


@pytest.mark.parametrize("value", [-9999.0, 1e6])
def test_glitches_are_dropped_with_a_warning(tmp_path, value):
    angle = DEG.copy()
    angle[[90, 220, 221, 500]] = value
    roll = right(write_csv(tmp_path / "log.csv", ("time_s", "roll_deg"), TIME, angle))
    assert any("no measurement" in said or "lone samples" in said for said in roll.warnings)
    assert len(roll.time) == N - 4


@pytest.mark.parametrize(("rate", "rest"), [(20.0, 600.0), (200.0, 0.0), (1000.0, 60.0)])
def test_a_decay_after_long_rest_is_no_glitch(tmp_path, rate, rest):
    """The deck moves in one row of a thousand, far beyond all that it did before."""
    time = np.arange(0, rest + 3, 1 / rate)
    angle = np.where(time < rest, 0.0, rocking(time - rest, release=0.5, rest=0.0)[0])
    angle = angle + np.random.default_rng(1).normal(0, 2e-4, len(time))
    roll = read_roll(write_csv(tmp_path / "log.csv", ("time_s", "roll_rad"), time, angle))
    assert len(roll.time) == len(time)


# JSON


def fields(row):
    return dict(zip("xyz", row.tolist(), strict=True))


RECORDS = [{"time_s": float(t), "roll_deg": float(v)} for t, v in zip(TIME, DEG, strict=True)]
SAMPLES = [
    (k, float(t), fields(w), fields(a)) for k, (t, w, a) in enumerate(zip(TIME, GYRO, ACCEL, strict=True))
]
JSON = {
    "records": RECORDS,
    "columns": {"time_s": TIME.tolist(), "roll_deg": DEG.tolist()},
    "columns of pandas": {key: {str(k): row[key] for k, row in enumerate(RECORDS)} for key in RECORDS[0]},
    "records in a field": {"device": "a", "rate": 100, "data": RECORDS},
    "nested": [{"ts": 1.7e9 + row["time_s"], "imu": {"roll_deg": row["roll_deg"], "ok": True}} for row in RECORDS],
    "dates": [{"time": stamp, "roll_deg": float(v)} for stamp, v in zip(begin("%Y-%m-%dT%H:%M:%S.%fZ"), DEG, strict=True)],
    "texts": [{key: str(value) for key, value in row.items()} for row in RECORDS],
    "a clock for each signal": {
        f"gyro.{axis}": {"time": MS, "data": values.tolist()} for axis, values in zip("xyz", GYRO.T, strict=True)
    },
    "sensors in a record": [{"timestamp": 10 * k, "gyroscope": w, "accelerometer": a} for k, _, w, a in SAMPLES],
    "sensors apart": {"sensors": {
        "gyroscope": [{"time": t, "values": w} for _, t, w, _ in SAMPLES],
        "accelerometer": [{"time": t + 0.003, "values": a} for _, t, _, a in SAMPLES],
    }},
    "Sensor Logger": [{"sensor": "Metadata", "version": "1"}] + [
        {"sensor": name, "time": str(10**7 * k), "seconds_elapsed": str(t), **{axis: str(v) for axis, v in row.items()}}
        for k, t, w, a in SAMPLES for name, row in (("Gyroscope", w), ("TotalAcceleration", a), ("Microphone", a))
    ],
}  # fmt: skip


@pytest.mark.parametrize("shape", JSON)
def test_shapes_of_json(tmp_path, shape):
    path = tmp_path / "log.json"
    path.write_text(json.dumps(JSON[shape], indent=1 if shape == "records" else None))
    assert right(path).origin == ("imu" if "ensor" in shape else "gyro" if "clock" in shape else "angle")


def test_signals_with_a_clock_each(tmp_path):
    """Of an angle beside an accelerometer; and of a gyro too fast for rad/s."""
    path, time = tmp_path / "log.json", (1e3 * TIME).tolist()
    path.write_text(
        json.dumps(
            {
                name: {"time": time, "data": list(data)}
                for name, data in (("accel.x", 0 * TIME), ("angle_deg", DEG))
            }
        )
    )
    assert right(path).origin == "angle"
    rates = {
        axis: np.degrees(data).tolist() for axis, data in (("x", MOTION[1]), ("y", 0 * TIME), ("z", 0 * TIME))
    }
    path.write_text(json.dumps({"gyroscope": {"timestamp_ms": time, **rates}}))
    assert right(path).origin == "gyro"


def test_lines_of_json_may_be_cut_at_their_end(tmp_path):
    lines, torn = [json.dumps(record) for record in RECORDS], '{"time_s": 6.0, "ro'
    right(text(tmp_path, [*lines, torn], "log.jsonl"))
    with pytest.raises(SysidError, match="damaged JSON"):
        read_roll(text(tmp_path, [*lines[:300], torn, *lines[300:]], "log.jsonl"))


@pytest.mark.parametrize("content", [{}, [], {"a": 1}, [[1, 2]], {"a": {"b": []}}, [{"t": 1}] * 3])
def test_json_without_a_table_is_refused(tmp_path, content):
    with pytest.raises(SysidError):
        read_roll(text(tmp_path, [json.dumps(content)], "log.json"))


# Names


@pytest.mark.parametrize(
    ("name", "kind", "axis", "unit"),
    [
        ("roll_deg", "angle", "x", "deg"), ("angle_rad", "angle", "", "rad"), ("Winkel [°]", "angle", "", "deg"),
        ("pitch", "angle", "y", None), ("Gyroscope x (rad/s)", "rate", "x", "rad/s"), ("GyroY_dps", "rate", "y", "deg/s"),
        ("gyro_integrated_x [deg]", "angle", "x", "deg"), ("gyroAngleX", "angle", "x", None),
        ("integrated gyro x (rad/s)", "rate", "x", "rad/s"), ("/imu.angular_velocity.x", "rate", "x", None),
        ("ax", "accel", "x", None), ("Acceleration z (m/s^2)", "accel", "z", "m/s^2"), ("qw", "quaternion", "w", None),
        ("Time (s)", "time", "", "s"), ("t_hours", "time", "", "h"), ("time (100 ns)", "time", "", "100 ns"), ("timestamp_ns", "time", "", "ns"), ("roll_std_rad", "std", "x", "rad"),
        ("heave_m", "other", "", None), ("gyro_x_rads", "rate", "x", "rad/s"), ("gyro_deg", "rate", "", "deg/s"),
        ("omega_degs", "rate", "", "deg/s"), ("gyro_rad[0]", "rate", "x", "rad/s"), ("q[0]", "quaternion", "w", None),
        ("q[3]", "quaternion", "z", None), ("imu.rpy[0]", "angle", "x", None), ("joint.position[1]", "angle", "", None),
        ("qpos0", "angle", "", None), ("field.position0", "angle", "", None), ("SampleTimeFine", "time", "", "100 us"),
        ("X_Value", "time", "", "s"), ("enc/t", "time", "", None), ("encoder/time_s", "time", "", "s"), ("encoder.ticks", "angle", "", None), ("roll_time", "time", "", None), ("vel_estimate [turns/s]", "rate", "", "turn/s"), ("roll_rads", "angle", "x", "rad"),
    ],
)  # fmt: skip
def test_names_tell_quantity_axis_and_unit(name, kind, axis, unit):
    column = parse_column(name)
    assert (column.kind, column.axis, column.unit) == (kind, axis, unit)


@pytest.mark.parametrize("ending", ["mat", "csv"])
def test_a_signal_whose_name_ends_in_s_is_no_clock(tmp_path, ending):
    """Of q and its smoothed q_s, neither rises as a clock does."""
    columns = {"q_s": ROLL, "q_rad": ROLL, "t": TIME}
    path = tmp_path / f"log.{ending}"
    if ending == "mat":
        pytest.importorskip("scipy.io").savemat(path, columns)
    else:
        write_csv(path, tuple(columns), *columns.values())
    right(path, column="q_rad")


# Points that were followed


def bob(tmp_path, *, pixels=False, noise=3e-4, centre=(0.3, 0.1), theta=ROLL, header=("t", "x", "y")):
    rng = np.random.default_rng(1)
    x = centre[0] + 0.42 * np.sin(theta) + rng.normal(0, noise, N)
    y = centre[1] - 0.42 * np.cos(theta) + rng.normal(0, noise, N)
    if pixels:
        x, y = 640 + 800 * x, 300 - 800 * y
    return text(tmp_path, ["mass_A\t\t", "\t".join(header), *rows("{:.4E}\t{:.4E}\t{:.4E}\t", TIME, x, y)])


@pytest.mark.parametrize("pixels", [False, True])
def test_a_bob_turns_about_the_centre_of_its_circle(tmp_path, pixels):
    header = ("t (s)", "x (px)", "y (px)") if pixels else ("t", "x", "y")
    roll = right(bob(tmp_path, pixels=pixels, header=header))
    assert roll.scale_std > 0
    assert np.corrcoef(roll.roll, MOTION[0])[0, 1] > 0.99


def test_a_point_beside_its_likelihood(tmp_path):
    """Three rows of names above, as pose trackers write them, and no time."""
    x, y = 640 + 300 * np.sin(ROLL), 300 + 300 * np.cos(ROLL)
    names = ["scorer,a,a,a", "bodyparts,bob,bob,bob", "coords,x,y,likelihood"]
    sure = np.random.default_rng(2).uniform(0.9, 1, N)
    right(
        text(tmp_path, [*names, *rows("{:.0f},{:.3f},{:.3f},{:.3f}", np.arange(N), x, y, sure)]), rate=100.0
    )


def test_a_pivot_may_be_given(tmp_path):
    path = bob(tmp_path, noise=2e-3, theta=0.1 * ROLL)
    with pytest.raises(SysidError, match=r"no circle of known radius.*--pivot X Y"):
        read_roll(path)
    roll = read_roll(path, LogOptions(video=VideoOptions(pivot=(0.3, 0.1))))
    assert np.median(np.abs(roll.roll - 0.1 * ROLL)) < 0.01


def test_pairs_of_a_clock_and_a_signal(tmp_path):
    slow = TIME[::4]
    rows = [f"{t:.4f};{a:.6f};" + (f"{slow[k] + 0.001:.4f};0.01{k % 7}" if k < len(slow) else ";")
            for k, (t, a) in enumerate(zip(TIME, ROLL, strict=True))]  # fmt: skip
    for header in ("t1;x1;t2;x2", "Time (s);Angle (rad);Time (s);Force (N)"):
        path = tmp_path / "log.csv"
        path.write_text("\n".join([header, *rows]) + "\n")
        assert right(path).time.size == len(TIME)


def test_a_saved_experiment_of_phyphox(tmp_path):
    gyro, accel = imu(TIME, *rocking(TIME))
    held = {"acc_time": TIME, "gyr_time": TIME, **{f"gyr{a}": c for a, c in zip("XYZ", gyro.T, strict=True)}}
    held |= {f"acc{a}": c for a, c in zip("XYZ", accel.T, strict=True)}
    data = "".join(
        f'<container size="0" init="{",".join(map(str, v))}">{k}</container>' for k, v in held.items()
    )
    sets = "".join(
        f'<set name="{name}"><data name="Time (s)">{short}_time</data>'
        + "".join(f'<data name="{name} {a} ({unit})">{short}{a.upper()}</data>' for a in "xyz") + "</set>"
        for name, short, unit in (("Gyroscope", "gyr", "rad/s"), ("Acceleration", "acc", "m/s^2"))
    )  # fmt: skip
    path = tmp_path / "state.phyphox"
    path.write_text(f"<phyphox><data-containers>{data}</data-containers><export>{sets}</export></phyphox>")
    assert right(path).origin == "imu"
    path.write_text("<phyphox><data-containers></data-containers></phyphox>")
    with pytest.raises(SysidError, match="saved without data"):
        read_roll(path)
