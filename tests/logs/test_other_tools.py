"""Files as other people's tools write them, from knowledge of their exports, with a known motion."""

import numpy as np
import pytest
from rocking import OMEGA, imu, rocking

from sysid.errors import SysidError
from sysid.free_decay import fit_decay
from sysid.logs import LogOptions, read_roll
from sysid.logs.table.names import parse_column
from sysid.releases import find_releases

TIME = np.arange(0, 6, 0.01)
N = len(TIME)
NOISE = np.random.default_rng(0)
MOTION = rocking(TIME)
ROLL = MOTION[0] + NOISE.normal(0, 5e-4, N)
GYRO, ACCEL = imu(TIME, *MOTION)
GYRO, ACCEL = GYRO + NOISE.normal(0, 4e-3, GYRO.shape), ACCEL + NOISE.normal(0, 0.02, ACCEL.shape)
DEG, DPS = np.degrees(ROLL), np.degrees(GYRO[:, 0])
PITCH = 2.0 + NOISE.normal(0, 0.03, N)


def right(path, **options):
    """Read the log; frequency and swing are those of the motion."""
    roll = read_roll(path, LogOptions(**options))
    decay = fit_decay(find_releases(roll))
    assert decay.numbers.omega_n.value == pytest.approx(OMEGA, rel=3e-3)
    assert np.ptp(roll.roll) == pytest.approx(np.ptp(MOTION[0]), rel=0.03)
    return roll


def text(tmp_path, lines, name="log.txt", encoding="utf-8"):
    path = tmp_path / name
    path.write_bytes(("\r\n".join(lines) + "\r\n").encode(encoding))
    return path


def wall(seconds):
    return f"12:{int(34 + (56.789 + seconds) // 60)}:{(56.789 + seconds) % 60:06.3f}"


# Xsens


@pytest.mark.parametrize(
    ("first", "tick", "head", "sensor"),
    [
        (41000, 1e-4, "// General information:", "imu"),
        (2**32 - 20000, 1e-6, "sep=,", "Euler_X"),
        (41000, 1e-6, "sep=,", "Roll"),
    ],
)
def test_xsens_counts_time_in_ticks_that_overflow(tmp_path, first, tick, head, sensor):
    stamps = (first + np.round(TIME / tick)).astype(np.int64) % 2**32
    if sensor == "imu":
        names = [f"{what}_{axis}" for what in ("Acc", "Gyr") for axis in "XYZ"]
        cells = [",".join(f"{value:.5f}" for value in row) for row in np.hstack((ACCEL, GYRO))]
    else:
        names, cells = [sensor], [f"{value:.4f}" for value in DEG]
    lines = [
        head,
        "// DeviceId:\t0388",
        *([] if tick == 1e-4 else ["DeviceTag:,DOT 1", "StartTime:,2021-05-18"]),
    ]
    lines += [",".join(("PacketCounter", "SampleTimeFine", *names))]
    lines += [f"{(k + 65000) % 65536},{t},{c}" for k, (t, c) in enumerate(zip(stamps, cells, strict=True))]
    assert right(text(tmp_path, lines)).sampling_rate == pytest.approx(100, rel=1e-3)


def test_a_clock_without_times_gives_way_to_another(tmp_path):
    cells = [
        ",".join((str(fixed), f"{t:.3f}", f"{v:.4f}"))
        for fixed, t, v in zip(["0"] * N, TIME, DEG, strict=True)
    ]
    right(text(tmp_path, ["GpsTime,TimeStartup (s),Roll", *cells]))
    right(text(tmp_path, ["UTC_Nano,time_s,Roll", *(cell[1:] for cell in cells)]))
    with pytest.raises(SysidError, match=r"'UTC_Nano' is empty.*--rate"):
        read_roll(text(tmp_path, ["UTC_Nano,Roll", *("," + cell.split(",")[2] for cell in cells)]))


# Serial monitors

SERIAL = {
    "arrow": lambda k: f"{wall(TIME[k])} -> roll:{DEG[k]:.2f} gyro:{DPS[k]:.2f}",
    "equals": lambda k: f"roll={DEG[k]:.2f}, t={1234 + 10 * k}",
    "tabs": lambda k: f"millis: {10 * k}\troll: {DEG[k]:.2f}\tpitch: {PITCH[k]:.2f}",
    "plotter": lambda k: f"Time:{10 * k} Roll:{DEG[k]:.2f} Pitch:{PITCH[k]:.2f}",
    "brackets": lambda k: f"[{wall(TIME[k])}] roll: {DEG[k]:.2f} deg",
    "lines": lambda k: f"time: {10 * k}\nroll: {DEG[k]:.2f} deg\ntemperature: 25 degC\n",
    "unit at the end": lambda k: f"{wall(TIME[k])} -> Rotation X: {GYRO[k, 0]:.3f}, Y: 0.00{k % 3}, Z: 0.00{k % 2} rad/s",
    "no names": lambda k: f"{wall(TIME[k])} -> {10 * k},{DEG[k]:.2f}",
}  # fmt: skip
BOOT = ["ets Jun  8 2016 00:22:57", "rst:0x1 (POWERON_RESET),boot:0x13 (SPI_FAST_FLASH_BOOT)", "mode:DIO, clock div:1",
        "load:0x3fff0030,len:1184", "entry 0x400805e4", "MPU6050 Found!"]  # fmt: skip


@pytest.mark.parametrize("kind", SERIAL)
@pytest.mark.parametrize("before", [[], BOOT, ["ll:-3.21 gyro:0.2"]], ids=["plain", "boot", "cut"])
def test_prints_of_a_microcontroller(tmp_path, kind, before):
    roll = right(text(tmp_path, [*before, *map(SERIAL[kind], range(N))]))
    assert len(roll.time) >= N - 2


# Lines between the rows


@pytest.mark.parametrize("words", ["t_ms,roll_deg", "---", "12", "error, in, bus, 3"])
def test_words_between_rows_are_dropped_with_a_warning(tmp_path, words):
    rows = [f"{10 * k},{DEG[k]:.3f}" for k in range(N)]
    roll = right(text(tmp_path, ["t_ms,roll_deg", *rows[:300], words, *rows[300:450], words, *rows[450:]]))
    assert any(f"2 of {N + 2} rows without a number" in warned for warned in roll.warnings)
    assert len(roll.time) == N


def test_a_header_between_recordings_starts_another(tmp_path):
    rows = [f"{10 * k + 300},{DEG[k]:.3f}" for k in range(N)]
    roll = right(text(tmp_path, ["ready", "t_ms,roll_deg", *rows, "ready", "t_ms,roll_deg", *rows]))
    assert len(find_releases(roll)) == 2


def test_a_number_that_is_none_is_refused_unless_the_last_row_is_cut(tmp_path):
    rows = [f"{10 * k},{DEG[k]:.3f}" for k in range(N)]
    right(text(tmp_path, ["t_ms,roll_deg", *rows, "6000,-1.x"]))
    with pytest.raises(SysidError, match=r"line 302, column 'roll_deg': '-1\.x' is not a number"):
        read_roll(text(tmp_path, ["t_ms,roll_deg", *rows[:300], "3000,-1.x", *rows[300:]]))


# Headers of several rows


def test_labview_ends_its_header_twice(tmp_path):
    head = ["LabVIEW Measurement\t", "Writer_Version\t2", "Separator\tTab", "Date\t2024/03/05", "***End_of_Header***\t",
            "\t", "Channels\t1\t\t", "Samples\t600\t\t", "Date\t2024/03/05\t\t", "X0\t0.0E+0\t\t", "Delta_X\t0.01\t\t",
            "***End_of_Header***\t\t", "X_Value\troll_deg\tComment"]  # fmt: skip
    for sign in ".,":
        rows = [f"{t:.6f}\t{v:.6f}".replace(".", sign) for t, v in zip(TIME, DEG, strict=True)]
        right(text(tmp_path, [*head, *rows], "log.lvm"))


@pytest.mark.parametrize("rotation", ["XYZ", "XYZW"])
def test_bodies_of_motion_capture_have_names_in_several_rows(tmp_path, rotation):
    from scipy.spatial.transform import Rotation

    turned = (
        Rotation.from_rotvec(ROLL[:, None] * [1, 0, 0]).as_quat()
        if len(rotation) == 4
        else np.stack((DEG, PITCH, PITCH), axis=1)
    )
    bodies = [len(rotation) + 4, len(rotation)]
    lines = ["Format Version,1.23,Capture Frame Rate,100.0", "", ",," + ",".join(["Rigid Body"] * bodies[0])]
    lines += [",," + ",".join(["deck"] * bodies[0]), ",," + ",".join(["1"] * bodies[0])]
    lines += [",," + ",".join(["Rotation"] * bodies[1] + ["Position"] * 3 + ["Mean Marker Error"])]
    lines += ["Frame,Time (Seconds)," + ",".join(rotation) + ",X,Y,Z,"]
    for k in range(N):
        lines.append(
            f"{k},{TIME[k]:.6f}," + ",".join(f"{v:.6f}" for v in turned[k]) + f",0.1{k % 3},0.2,0.3,0.0004"
        )
    right(text(tmp_path, lines))


# Names


@pytest.mark.parametrize(
    ("name", "kind", "axis", "unit"),
    [
        ("gyro_x_rads", "rate", "x", "rad/s"), ("gyro_deg", "rate", "", "deg/s"), ("omega_degs", "rate", "", "deg/s"),
        ("gyro_rad[0]", "rate", "x", "rad/s"), ("q[0]", "quaternion", "w", None), ("q[3]", "quaternion", "z", None),
        ("imu.rpy[0]", "angle", "x", None), ("joint.position[1]", "angle", "", None), ("qpos0", "angle", "", None),
        ("field.position0", "angle", "", None), ("SampleTimeFine", "time", "", "100 us"), ("X_Value", "time", "", "s"),
        ("vel_estimate [turns/s]", "rate", "", "turn/s"), ("roll_rads", "angle", "x", "rad"),
    ],
)  # fmt: skip
def test_names_of_other_tools(name, kind, axis, unit):
    column = parse_column(name)
    assert (column.kind, column.axis, column.unit) == (kind, axis, unit)
