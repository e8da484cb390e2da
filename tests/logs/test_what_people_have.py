"""Logs as people have them: glitches, stand-ins for nothing, odd cells and dates, archives, other programs' files."""

import bz2
import gzip
import io
import lzma
import struct
import sys
import zipfile

import numpy as np
import pytest
from rocking import OMEGA, imu, rocking, write_csv

from sysid.errors import SysidError
from sysid.free_decay import fit_decay
from sysid.logs import read_roll
from sysid.quantity import Quantity
from sysid.releases import find_releases

TIME = np.arange(0, 6, 1 / 200)
INERTIA = Quantity(8.7e-3, 0.0, "kg*m^2")


def swing(**motion):
    return rocking(TIME, **motion)[0] + np.random.default_rng(0).normal(0, 1e-3, len(TIME))


def right(path, tolerance=2e-3):
    """Whether a plain reading of the log finds the deck's frequency."""
    found = fit_decay(find_releases(read_roll(path)), INERTIA).numbers.omega_n.value
    assert found == pytest.approx(OMEGA, rel=tolerance)
    return read_roll(path)


def cells(tmp_path, form, *, header=("time_s", "roll_deg"), time=None, sep=","):
    times = [f"{t:.4f}" for t in TIME] if time is None else time
    return write_csv(tmp_path / "log.csv", header, times, [form(v) for v in np.degrees(swing())], sep=sep)


# Rows that are no measurements


@pytest.mark.parametrize("value", [-9999.0, 1e6])
def test_three_glitches_are_dropped_with_a_warning(tmp_path, value):
    angle = np.degrees(swing())
    angle[[150, 420, 421, 900]] = value
    roll = right(write_csv(tmp_path / "log.csv", ("time_s", "roll_deg"), TIME, angle))
    assert any("no measurement" in text or "lone samples" in text for text in roll.warnings)
    assert len(roll.time) == len(TIME) - 4


@pytest.mark.parametrize(("rate", "rest"), [(20.0, 600.0), (200.0, 0.0), (1000.0, 60.0)])
def test_a_decay_after_long_rest_is_no_glitch(tmp_path, rate, rest):
    """The deck moves in one row of a thousand, far beyond all that it did before."""
    time = np.arange(0, rest + 3, 1 / rate)
    angle = np.where(time < rest, 0.0, rocking(time - rest, release=0.5, rest=0.0)[0])
    angle = angle + np.random.default_rng(1).normal(0, 2e-4, len(time))
    roll = read_roll(write_csv(tmp_path / "log.csv", ("time_s", "roll_rad"), time, angle))
    assert len(roll.time) == len(time)


def test_imu_rows_of_their_own_are_brought_together(tmp_path):
    gyro, accel = imu(TIME, *rocking(TIME, zeta=0.05))
    blank = [""] * 3
    rows = ["t_s,gx (rad/s),gy (rad/s),gz (rad/s),ax (m/s2),ay (m/s2),az (m/s2)"]
    for t, w, a in zip(TIME, gyro, accel, strict=True):
        rows.append(",".join([f"{t:.4f}", *(f"{x:.6f}" for x in w), *blank]))
        rows.append(",".join([f"{t + 0.0025:.4f}", *blank, *(f"{x:.6f}" for x in a)]))
    path = tmp_path / "log.csv"
    path.write_text("\n".join(rows) + "\n")
    assert right(path).origin == "imu"


# Cells


def test_units_in_the_cells(tmp_path):
    path = cells(
        tmp_path, lambda v: f"{v:.3f} deg", header=("time", "roll"), time=[f"{t:.4f} sec" for t in TIME]
    )
    roll = right(path)
    assert roll.roll[0] == pytest.approx(0.32, abs=0.01)


@pytest.mark.parametrize("ending", [".zip", ".parquet"])
def test_the_name_of_a_table_says_nothing(tmp_path, ending):
    right(cells(tmp_path, lambda v: f"{v:.3f}").rename(tmp_path / f"log{ending}"))


def test_separated_thousands(tmp_path):
    """Milliseconds as a spreadsheet shows them."""
    time = [f"{1e3 * t:,.1f}" for t in TIME]
    right(cells(tmp_path, lambda v: f"{v:.3f}", header=("time_ms", "roll_deg"), time=time, sep="\t"))


def test_a_decimal_comma_of_three_places_is_no_thousand(tmp_path):
    path = cells(tmp_path, lambda v: f"{v:.3f}".replace(".", ","), sep=";")
    assert np.ptp(read_roll(path).roll) == pytest.approx(np.ptp(swing()), rel=1e-2)


@pytest.mark.parametrize(
    "form",
    ["%d.%m.%Y %H:%M:%S.%f", "%m/%d/%Y %I:%M:%S.%f %p", "%Y/%m/%d %H:%M:%S.%f", "%I:%M:%S.%f %p"],
    ids=["31.03.2024", "03/31/2024 PM", "2024/03/31", "PM"],
)
def test_dates_as_they_are_written(tmp_path, form):
    from datetime import datetime, timedelta

    begin = datetime(2024, 3, 31, 11, 59, 57)
    stamps = [(begin + timedelta(seconds=float(t))).strftime(form) for t in TIME]
    roll = right(cells(tmp_path, lambda v: f"{v:.4f}", header=("time", "roll_deg"), time=stamps))
    assert roll.time[-1] - roll.time[0] == pytest.approx(TIME[-1], abs=1e-3)


@pytest.mark.parametrize("scale", [1.0, 16384.0, 0.7])
def test_quaternions_by_number_and_of_any_length(tmp_path, scale):
    half = swing() / 2
    values = scale * np.stack((np.cos(half), np.sin(half), 0 * half, 0 * half))
    right(write_csv(tmp_path / "log.csv", ("time_s", "q0", "q1", "q2", "q3"), TIME, *values))


# Other files


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress, lzma.compress], ids=["gzip", "bzip2", "xz"])
def test_compressed_logs(tmp_path, pack):
    plain = write_csv(tmp_path / "log.csv", ("time_s", "roll_rad"), TIME, swing())
    path = tmp_path / "log.csv.z"
    path.write_bytes(pack(plain.read_bytes()))
    right(path)
    path.write_bytes(pack(plain.read_bytes())[:-200])
    with pytest.raises(SysidError, match=r"log\.csv\.z"):
        read_roll(path)


def test_matlab_files(tmp_path):
    scipy_io = pytest.importorskip("scipy.io")
    path = tmp_path / "log.mat"
    scipy_io.savemat(path, {"time_s": TIME, "roll_rad": swing(), "name": "pink", "gain": 3.0})
    right(path)
    scipy_io.savemat(path, {"data": {"time_s": TIME, "roll_rad": swing()}})
    right(path)
    path.write_bytes(path.read_bytes()[:-3000])
    with pytest.raises(SysidError, match=r"log\.mat"):
        read_roll(path)


@pytest.mark.parametrize(
    ("head", "package", "command"),
    [
        (b"\x89HDF\r\n\x1a\n", "h5py", "h5dump"),
        (b"MATLAB 7.3 MAT-file", "h5py", "save"),
        (b"\xd0\xcf\x11\xe0", "python_calamine", "libreoffice --headless --convert-to csv"),
        (b"#ROSBAG V2.0", "rosbags.highlevel", "mcap convert"),
        (b"SQLite format 3\0", "rosbags.highlevel", "mcap convert"),
        (b"PAR1", "pyarrow", r"\[parquet\]"),
    ],
)
def test_what_reads_another_format_or_converts_it_is_named(tmp_path, monkeypatch, head, package, command):
    path = tmp_path / "log.bin"
    path.write_bytes(head + bytes(500))
    with pytest.raises(SysidError, match=r"damaged|not a readable"):
        read_roll(path)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(SysidError, match=rf"pip install .*{command}|{command}"):
        read_roll(path)


@pytest.mark.parametrize("layout", ["vectors", "table", "group"])
def test_hdf5_files(tmp_path, layout):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        columns = {"time_s": TIME, "roll_rad": swing()}
        if layout == "table":
            table = np.empty(len(TIME), [(name, "f8") for name in columns])
            for name, values in columns.items():
                table[name] = values
            file["log"] = table
        else:
            for name, values in columns.items():
                file[name if layout == "vectors" else f"run 1/{name}"] = values
    right(path)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(SysidError, match=r"damaged HDF5|no vector"):
        read_roll(path)


def test_a_workbook_of_a_phone(tmp_path):
    """As phyphox writes .xls: a sheet a sensor, and what is no table beside them."""
    pytest.importorskip("python_calamine")
    writer = pytest.importorskip("xlsxwriter")
    path = tmp_path / "export.xlsx"
    gyro, accel = imu(TIME, *rocking(TIME))
    with writer.Workbook(path) as book:
        for name, values, unit in (("Gyroscope", gyro, "rad/s"), ("Accelerometer", accel, "m/s^2")):
            sheet = book.add_worksheet(name)
            sheet.write_row(0, 0, ("Time (s)", *(f"{name} {a} ({unit})" for a in "xyz")))
            for row, (t, cells) in enumerate(zip(TIME, values, strict=True), 1):
                sheet.write_row(row, 0, (t, *cells))
        book.add_worksheet("Metadata Device").write_row(0, 0, ("property", "value"))
    assert right(path).origin == "imu"


@pytest.mark.parametrize("rate", ["dq", "qd"])
def test_joints_as_roboticists_name_them(tmp_path, rate):
    roll, roll_rate = rocking(TIME)[:2]
    path = write_csv(tmp_path / "log.csv", ("t", rate, "q"), TIME, roll_rate, roll)
    assert right(path).origin == "angle"


def test_ros_1_bags(tmp_path):
    rosbag1 = pytest.importorskip("rosbags.rosbag1")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    kinds = store.types
    path = tmp_path / "log.bag"
    gyro, accel = imu(TIME, *rocking(TIME))
    with rosbag1.Writer(path) as bag:
        topic = bag.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        for number, (t, w, a) in enumerate(zip(TIME, gyro, accel, strict=True)):
            stamp = round(1e9 * (1.7e9 + t))
            vector, nine = kinds["geometry_msgs/msg/Vector3"], np.zeros(9)
            message = kinds["sensor_msgs/msg/Imu"](
                kinds["std_msgs/msg/Header"](
                    number, kinds["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9), "imu"
                ),
                kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
                *(nine, vector(*map(float, w)), nine, vector(*map(float, a)), nine),
            )
            bag.write(topic, stamp, store.serialize_ros1(message, "sensor_msgs/msg/Imu"))
    assert right(path).origin == "imu"


# Archives


def export(tmp_path, **extra):
    gyro, accel = imu(TIME, *rocking(TIME))
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values, unit in (("Gyroscope", gyro, "rad/s"), ("Accelerometer", accel, "m/s^2")):
            table = tmp_path / "table.csv"
            write_csv(table, ("Time (s)", *(f"{name} {a} ({unit})" for a in "xyz")), TIME, *values.T)
            archive.writestr(f"{name}.csv", table.read_text())
        for name, text in extra.items():
            archive.writestr(f"{name}.csv", text)
    path = tmp_path / "export.zip"
    path.write_bytes(buffer.getvalue())
    return path


@pytest.mark.parametrize("place", [60, 1660, 3660])
def test_one_bad_byte_is_said(tmp_path, place):
    path = export(tmp_path)
    data = bytearray(path.read_bytes())
    data[place] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(SysidError, match=r"export\.zip"):
        read_roll(path)


def test_what_is_not_needed_is_not_unpacked(tmp_path):
    """A gigabyte of microphone beside the sensors, packed to a megabyte."""
    path = export(tmp_path, Microphone="0" * (64 << 20))
    assert read_roll(path).origin == "imu"
    bomb = bytearray(path.read_bytes())
    place = bomb.rindex(b"PK\x01\x02", 0, bomb.rindex(b"Accelerometer.csv"))
    struct.pack_into("<I", bomb, place + 24, 2_000_000_000)
    path.write_bytes(bomb)
    with pytest.raises(SysidError, match="more than 1 GiB"):
        read_roll(path)


# Other tools' tables


def table(tmp_path, lines, name="log.csv", encoding="utf-8"):
    path = tmp_path / name
    path.write_text("\n".join(lines) + "\n", encoding=encoding)
    return path


def degrees():
    return np.degrees(swing())


@pytest.mark.parametrize(
    "parts", [("header.stamp.secs", "header.stamp.nsecs"), ("sec", "nanosec"), ("time_s", "time_us")]
)
def test_a_clock_in_two_columns_is_one(tmp_path, parts):
    """Whole seconds alone put each second's samples evenly into it: 1 % of the last one was missing."""
    stamps = np.rint((1.78e9 + 0.25 + TIME) * 1e6).astype(int)
    unit = 1 if parts[1].endswith("us") else 1000
    rows = [
        f"{t // 1_000_000},{t % 1_000_000 * unit},{v:.4f}" for t, v in zip(stamps, degrees(), strict=True)
    ]
    roll = right(table(tmp_path, [f"{parts[0]},{parts[1]},roll_deg", *rows]))
    assert any(" + ".join(parts) in text for text in roll.notes)
    np.testing.assert_allclose(roll.time - roll.time[0], TIME, atol=1e-5)


def test_two_whole_clocks_are_not_added(tmp_path):
    """Seconds and milliseconds since the same moment are two clocks."""
    rows = [f"{t:.4f},{1e3 * t:.1f},{v:.4f}" for t, v in zip(TIME, degrees(), strict=True)]
    roll = right(table(tmp_path, ["time_s,time_ms,roll_deg", *rows]))
    np.testing.assert_allclose(roll.time, TIME, atol=1e-9)


def test_labels_before_numbers_name_the_columns(tmp_path):
    rows = [f"t:{1e3 * t:.0f} roll_deg:{v:.3f}" for t, v in zip(TIME, degrees(), strict=True)]
    right(table(tmp_path, rows))
    rows[300] = rows[300].replace("roll_deg:", "error:")
    roll = right(table(tmp_path, rows))
    assert any("1 line unlike the others left out" in text for text in roll.notes)


def test_a_day_and_a_time_in_columns_of_their_own(tmp_path):
    clock = [f"03.05.2026;12:{int(34 + (56 + t) // 60)}:{(56 + t) % 60:06.3f};{v:.4f}".replace(".", ",")
             for t, v in zip(TIME, degrees(), strict=True)]  # fmt: skip
    rows = [row.replace("03,05,2026", "03.05.2026") for row in clock]
    roll = right(table(tmp_path, ["Datum;Uhrzeit;Winkel [°]", *rows], encoding="cp1252"))
    assert len(roll.time) == len(TIME)


def test_lists_of_one_number_are_numbers(tmp_path):
    rows = [
        f'{t:.4f},"[\'tilt\']","[{np.radians(v):.6f}]","[0.0]"' for t, v in zip(TIME, degrees(), strict=True)
    ]
    right(table(tmp_path, ["Time,name,position,effort", *rows]))


def test_a_table_named_after_its_sensor(tmp_path):
    """Sensor Logger's Gyroscope.csv, taken out of its archive, has bare axes."""
    _, rate, _ = rocking(TIME)
    rows = [
        f"{1.78e18 + 1e9 * t:.0f},{t:.6f},0.001,{0.0002 * (i % 7):.4f},{w:.6f}"
        for i, (t, w) in enumerate(zip(TIME, rate, strict=True))
    ]
    roll = right(table(tmp_path, ["time,seconds_elapsed,z,y,x", *rows], "Gyroscope.csv"))
    assert any("'Gyroscope x'" in text for text in roll.notes)
    with pytest.raises(SysidError, match="no column of roll"):
        read_roll(table(tmp_path, ["time,seconds_elapsed,z,y,x", *rows], "log5.csv"))


def test_counts_of_a_gyro_are_asked_for(tmp_path):
    _, rate, _ = rocking(TIME)
    rows = [f"{1e3 * t:.0f},{np.degrees(w) * 131:.0f}" for t, w in zip(TIME, rate, strict=True)]
    path = table(tmp_path, ["millis,gx", *rows])
    with pytest.raises(SysidError, match=r"look like counts of a gyro.*--unit 0\.0001332 where 16 bits"):
        read_roll(path)
