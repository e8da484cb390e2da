"""Files other than plain text: each holds one decay and is read without an option; damaged, huge and foreign ones get one line."""

import bz2
import gzip
import json
import lzma
import struct
import sys
import zipfile
from datetime import datetime, timedelta

import numpy as np
import pandas as pd
import pytest
from rocking import ACCEL, GYRO, MOTION, ROLL, TIME, right, rocking

from sysid.errors import SysidError
from sysid.logs import LogOptions, read_roll
from sysid.releases import find_releases

UP = 9.81 * np.stack((np.zeros(len(TIME)), np.sin(MOTION[0]), np.cos(MOTION[0])), axis=1)
EPOCH = 1_700_000_000_000_000_000
COLUMNS = {"time_s": TIME, "roll_rad": ROLL}


def table(names, *columns, sep=",", decimal="."):
    lines = [sep.join(f'"{name}"' for name in names)]
    for row in zip(*columns, strict=True):
        cells = [cell if isinstance(cell, str) else f"{cell:.9g}".replace(".", decimal) for cell in row]
        lines.append(sep.join(cells))
    return "\n".join(lines) + "\n"


def axes(sensor, unit):
    return [f"{sensor} {axis} ({unit})" for axis in "xyz"]


def archive(path, files):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in files.items():
            packed.writestr(name, content)


def phyphox(sep=",", decimal="."):
    """The accelerometer at half the rate, on a clock of its own."""
    late = np.maximum(TIME[::2] - 1e-3, 0.0)
    accel = [np.interp(late, TIME, column) for column in ACCEL.T]
    gyro = table(("Time (s)", *axes("Gyroscope", "rad/s")), TIME, *GYRO.T, sep=sep, decimal=decimal)
    felt = table(("Time (s)", *axes("Acceleration", "m/s^2")), late, *accel, sep=sep, decimal=decimal)
    meta = {"meta/time.csv": '"event","experiment time"\n"START",0\n', "meta/device.csv": "property,value\n"}
    return {"Gyroscope.csv": gyro, "Accelerometer.csv": felt, **meta}


def matlab_mobile():
    """Bare axes, stamps with the month in letters, and a gyro called angular velocity."""
    start = datetime(2026, 5, 12, 14, 5, 12)
    stamps = [f"{start + timedelta(seconds=float(t)):%d-%b-%Y %H:%M:%S.%f}"[:-3] for t in TIME]
    sensors = {"Acceleration": ACCEL, "AngularVelocity": GYRO}
    return {
        f"{name}.csv": table(("Timestamp", *"XYZ"), stamps, *values.T) for name, values in sensors.items()
    }


def sensor_logger(**sensors):
    """Axes backwards, beside stamps since the epoch; orientations fused by the phone, and tables without a motion."""
    stamps = [str(EPOCH + round(1e9 * t)) for t in TIME]
    own = ("time", "seconds_elapsed")
    files = {f"{name}.csv": table((*own, *"zyx"), stamps, TIME, *v.T[::-1]) for name, v in sensors.items()}
    half, still = MOTION[0] / 2, 0 * TIME
    fused = (still, still, np.sin(half), np.cos(half), MOTION[0], still, still)
    names = (*own, "qz", "qy", "qx", "qw", "roll", "pitch", "yaw")
    files["Orientation.csv"] = table(names, stamps, TIME, *fused)
    return files | {"Metadata.csv": "version,device\n3,phone\n", "Annotation.csv": "time,text\n"}


ARCHIVES = {
    "phyphox": phyphox(),
    "phyphox, tabs": phyphox(sep="\t"),
    "phyphox, decimal comma": phyphox(sep=";", decimal=","),
    "MATLAB Mobile": matlab_mobile(),
    "Sensor Logger": sensor_logger(Gyroscope=GYRO, Accelerometer=ACCEL - UP, TotalAcceleration=ACCEL),
    "Sensor Logger, gravity apart": sensor_logger(Gyroscope=GYRO, Accelerometer=ACCEL - UP, Gravity=UP),
    "Sensor Logger, uncalibrated": sensor_logger(Gyroscope=GYRO, AccelerometerUncalibrated=ACCEL / 9.81),
}


def write_parquet(path):
    pytest.importorskip("pyarrow")
    pd.DataFrame({**COLUMNS, "junk": "a"}).to_parquet(path)


def write_dated_parquet(path):
    pytest.importorskip("pyarrow")
    pd.DataFrame({"time": pd.to_datetime(EPOCH + TIME * 1e9), "roll_deg": np.degrees(ROLL)}).to_parquet(path)


def write_matlab(path):
    pytest.importorskip("scipy.io").savemat(path, {**COLUMNS, "name": "pink", "gain": 3.0})


def write_matlab_struct(path):
    pytest.importorskip("scipy.io").savemat(path, {"data": COLUMNS})


def write_hdf5(path, prefix=""):
    with pytest.importorskip("h5py").File(path, "w") as file:
        for name, values in COLUMNS.items():
            file[prefix + name] = values


def write_hdf5_group(path):
    write_hdf5(path, "run 1/")


def write_hdf5_table(path):
    with pytest.importorskip("h5py").File(path, "w") as file:
        file["log"] = np.rec.fromarrays(list(COLUMNS.values()), names=list(COLUMNS))


def write_workbook(path):
    """As phyphox writes .xls: a sheet a sensor, and sheets of notes beside them."""
    pytest.importorskip("python_calamine")
    with pytest.importorskip("xlsxwriter").Workbook(path) as book:
        for name, values, unit in (("Gyroscope", GYRO, "rad/s"), ("Accelerometer", ACCEL, "m/s^2")):
            sheet = book.add_worksheet(name)
            for row, cells in enumerate([("Time (s)", *axes(name, unit)), *np.column_stack((TIME, values))]):
                sheet.write_row(row, 0, cells)
        book.add_worksheet("Metadata Device").write_row(0, 0, ("property", "value"))


def write_bag(path):
    rosbag1 = pytest.importorskip("rosbags.rosbag1")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    kind = {
        name.rsplit("/", 1)[-1]: made for name, made in store.types.items() if name != "std_msgs/msg/Time"
    }
    with rosbag1.Writer(path) as bag:
        topic = bag.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        for number, (t, w, a) in enumerate(zip(TIME, GYRO, ACCEL, strict=True)):
            stamp, nine = EPOCH + round(1e9 * t), np.zeros(9)
            header = kind["Header"](number, kind["Time"](stamp // 10**9, stamp % 10**9), "imu")
            vectors = nine, kind["Vector3"](*map(float, w)), nine, kind["Vector3"](*map(float, a)), nine
            message = kind["Imu"](header, kind["Quaternion"](0.0, 0.0, 0.0, 1.0), *vectors)
            bag.write(topic, stamp, store.serialize_ros1(message, "sensor_msgs/msg/Imu"))


def write_mcap(path):
    writer_module = pytest.importorskip("mcap_ros2.writer", reason="the mcap extra is not installed")
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
        for t, g, a in zip(TIME, GYRO, ACCEL, strict=True):
            stamp, late = EPOCH + round(1e9 * t), EPOCH + round(1e9 * t) + 10**9
            message = {
                "header": {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": "imu"},
                "angular_velocity": dict(zip("xyz", g.tolist(), strict=True)),
                "linear_acceleration": dict(zip("xyz", a.tolist(), strict=True)),
                "angular_velocity_covariance": [0.0] * 9,
            }
            writer.write_message("/imu/data", schema, message, log_time=late, publish_time=late)
        writer.finish()


def write_json_mcap(path):
    module = pytest.importorskip("mcap.writer", reason="the mcap extra is not installed")
    with path.open("wb") as file:
        writer = module.Writer(file)
        writer.start()
        schema = writer.register_schema("JointState", "jsonschema", b"{}")
        channel = writer.register_channel("/joint_states", "json", schema)
        for t, angle in zip(TIME, ROLL, strict=True):
            content, stamp = {"name": ["board_tilt"], "position": [angle]}, EPOCH + round(1e9 * t)
            writer.add_message(channel, stamp, json.dumps(content).encode(), stamp)
        writer.finish()


FILES = {
    "log.parquet": write_parquet, "dated.pq": write_dated_parquet, "log.mat": write_matlab, "struct.mat": write_matlab_struct,
    "log.h5": write_hdf5, "group.h5": write_hdf5_group, "table.h5": write_hdf5_table, "log.xlsx": write_workbook,
    "log.bag": write_bag, "log.mcap": write_mcap, "json.mcap": write_json_mcap,
    **{
        f"log.csv.{name}": lambda path, pack=pack: path.write_bytes(pack(table(COLUMNS, TIME, ROLL).encode()))
        for name, pack in (("gz", gzip.compress), ("bz2", bz2.compress), ("xz", lzma.compress))
    },
    "export.zip": lambda path: archive(path, ARCHIVES["phyphox"]),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_formats_are_read_and_damage_is_one_line(tmp_path, name):
    path = tmp_path / name
    FILES[name](path)
    right(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 3 // 5])
    with pytest.raises(SysidError, match=name.replace(".", r"\.")) as refused:
        read_roll(path)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("kind", ARCHIVES)
def test_exports_of_phones(tmp_path, kind):
    archive(tmp_path / "export.zip", ARCHIVES[kind])
    roll = right(tmp_path / "export.zip")
    assert roll.origin == "imu"
    assert np.abs(roll.roll - rocking(roll.time)[0]).max() < np.radians(1.0)
    if "Orientation.csv" in ARCHIVES[kind]:
        for source in ("quaternion", "angle"):
            fused = read_roll(tmp_path / "export.zip", LogOptions(source=source))
            np.testing.assert_allclose(fused.roll, rocking(fused.time)[0], atol=1e-4)


def test_an_export_may_be_unpacked(tmp_path):
    for name, content in ARCHIVES["Sensor Logger"].items():
        (tmp_path / name).write_text(content)
    assert right(tmp_path).origin == "imu"


@pytest.mark.parametrize("place", [60, 1660, 3660])
def test_one_bad_byte_is_said(tmp_path, place):
    path = tmp_path / "export.zip"
    archive(path, ARCHIVES["Sensor Logger"])
    data = bytearray(path.read_bytes())
    data[place] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(SysidError, match=r"export\.zip"):
        read_roll(path)


def test_what_is_not_needed_is_not_unpacked(tmp_path):
    """A microphone beside the sensors; then a table that says that it has two gigabytes."""
    path = tmp_path / "export.zip"
    archive(path, {**ARCHIVES["phyphox"], "Microphone.csv": "0" * (64 << 20)})
    assert read_roll(path).origin == "imu"
    bomb = bytearray(path.read_bytes())
    place = bomb.rindex(b"PK\x01\x02", 0, bomb.rindex(b"Accelerometer.csv"))
    struct.pack_into("<I", bomb, place + 24, 2_000_000_000)
    path.write_bytes(bomb)
    with pytest.raises(SysidError, match="more than 1 GiB"):
        read_roll(path)


def test_archives_without_a_table_say_so(tmp_path):
    archive(tmp_path / "b.zip", {"letter.doc": "hello"})
    (tmp_path / "empty").mkdir()
    for path in tmp_path.iterdir():
        with pytest.raises(SysidError, match="no table"):
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


# Several clocks, several files


def files_of_vectors(tmp_path):
    h5py = pytest.importorskip("h5py")
    from scipy.io import savemat

    fast = np.arange(0, 6, 1e-3)
    content = {"imu": {"time_s": fast, "temp": 20 + 0 * fast}, "joint": COLUMNS}
    savemat(tmp_path / "log.mat", {**content, "audio": np.sin(np.arange(9000.0))})
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for group, columns in content.items():
            for name, values in columns.items():
                file[f"{group}/{name}"] = values
        file["audio"] = np.sin(np.arange(9000.0))
    return (tmp_path / "log.mat", "joint.roll_rad"), (tmp_path / "log.h5", "joint/roll_rad")


def test_vectors_at_several_rates_beside_a_longer_one(tmp_path):
    for path, name in files_of_vectors(tmp_path):
        assert right(path).time.size == len(TIME)
        assert right(path, column=name).time.size == len(TIME)
        assert read_roll(path, LogOptions(column="audio", unit="rad", rate=1e3)).time.size == 9000
        with pytest.raises(SysidError, match=r"'audio' has no time of its own.*--rate"):
            read_roll(path, LogOptions(column="audio", unit="rad"))


def test_the_clock_of_a_group_is_known_by_its_last_word(tmp_path):
    with pytest.importorskip("h5py").File(tmp_path / "log.h5", "w") as file:
        for group, time in (("cam", TIME + 0.003), ("enc", TIME)):
            file[f"{group}/t"] = time
        file["cam/brightness"], file["enc/q"] = np.cos(TIME), ROLL
    assert right(tmp_path / "log.h5").time[0] == TIME[0]


def test_notes_and_stray_cells_in_a_sheet(tmp_path):
    pytest.importorskip("python_calamine")
    with pytest.importorskip("xlsxwriter").Workbook(tmp_path / "log.xlsx") as book:
        sheet = book.add_worksheet()
        sheet.write(0, 0, "my experiment")
        for row, cells in enumerate([("time_s", "roll_rad"), *zip(TIME, ROLL, strict=True)], 4):
            sheet.write_row(row, 3, cells)
        sheet.write(6, 7, "checked by hand")
        sheet.write(900, 12, 42.0)
    right(tmp_path / "log.xlsx")


def test_the_rows_left_of_a_frame_are_no_clock(tmp_path):
    pd, _ = pytest.importorskip("pandas"), pytest.importorskip("pyarrow")
    frame = pd.DataFrame({"episode": 0, "timestamp": TIME, "roll_rad": ROLL})
    pd.concat([frame.assign(episode=1), frame])[lambda rows: rows.episode == 0].to_parquet(
        tmp_path / "log.parquet"
    )
    right(tmp_path / "log.parquet")


def test_a_lerobot_data_set_is_one_log_of_its_episodes(tmp_path):
    """One file an episode, the state as a list, element names in info.json."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    still, folder = 10 + np.random.default_rng(0).normal(0, 0.05, len(TIME)), tmp_path / "set"
    for episode in range(3):
        elbow = np.degrees(ROLL) * (1 - 0.15 * episode)
        state = list(np.column_stack((still, elbow)).astype(np.float32))
        path = folder / f"data/chunk-000/episode_{episode:06d}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        lists = {
            "action": pa.array(state, pa.list_(pa.float32())),
            "observation.state": pa.array(state, pa.list_(pa.float32())),
        }
        pq.write_table(
            pa.table({**lists, "timestamp": TIME.astype(np.float32), "frame_index": np.arange(len(TIME))}),
            path,
        )
    (folder / "meta").mkdir()
    names = {"names": ["shoulder.pos", "elbow.pos"]}
    features = {"features": {"action": names, "observation.state": names}}
    (folder / "meta/info.json").write_text(json.dumps(features))
    roll = right(path, swing=0.7 * MOTION[0])
    assert any("'observation.state.elbow.pos'" in text for text in (*roll.notes, *roll.warnings))
    right(path, swing=0.7 * MOTION[0], column="observation.state.elbow.pos", unit="deg")
    assert len(find_releases(right(folder))) == 3


# Files of a few kilobytes that ask for gigabytes, and one whose reader would end the process


def write_matlab_bomb(path):
    write_matlab(path)
    data = bytearray(path.read_bytes())
    struct.pack_into("<II", data, 160, 1, 1 << 30)  # the array's size, behind its tag and flags
    path.write_bytes(data)


def write_parquet_bomb(path):
    """A billion equal rows."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    part = pa.table({"flag": pa.DictionaryArray.from_arrays(np.zeros(1 << 21, np.int8), ["x"])})
    with pq.ParquetWriter(path, part.schema) as writer:
        for _ in range(70):
            writer.write_table(part)


def write_hdf5_bomb(path):
    """A data set that was never filled."""
    with pytest.importorskip("h5py").File(path, "w") as file:
        file.create_dataset("roll_rad", shape=(1 << 40,), dtype="f8", chunks=(1 << 16,), compression="gzip")


def write_mcap_bomb(path):
    """A chunk that says it is huge."""
    pytest.importorskip("mcap")
    body = struct.pack("<QQQIIQ", 0, 0, 1 << 40, 0, 0, 4) + bytes(4)
    path.write_bytes(b"\x89MCAP0\r\n" + b"\x06" + struct.pack("<Q", len(body)) + body)


def write_far_cell(path):
    pytest.importorskip("python_calamine")
    with pytest.importorskip("xlsxwriter").Workbook(path) as book:
        sheet = book.add_worksheet()
        sheet.write_row(0, 0, ("time_s", "roll_rad"))
        sheet.write(1048575, 16383, 1.0)


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("log.mat", write_matlab_bomb), ("log.parquet", write_parquet_bomb), ("log.h5", write_hdf5_bomb),
        ("log.mcap", write_mcap_bomb), ("log.xlsx", write_far_cell),
    ],
)  # fmt: skip
def test_small_files_that_ask_for_gigabytes_are_refused(tmp_path, name, write):
    write(tmp_path / name)
    assert (tmp_path / name).stat().st_size < 1 << 20
    with pytest.raises(
        SysidError,
        match=r"unpacks to more than 1 GiB|a cell far from the others \(column 16384, row 1048576\)",
    ):
        read_roll(tmp_path / name)
