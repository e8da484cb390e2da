"""Whatever is done to a file, reading it gives a sound roll or one clear refusal, never a traceback."""

import io

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rocking import imu, rocking

from sysid.errors import SysidError
from sysid.logs import LogOptions, read_roll

TIME = np.arange(0, 1.2, 0.01)
SETTINGS = settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


def text_of(columns, sep=","):
    return pd.DataFrame(columns).to_csv(index=False, sep=sep, float_format="%.6g")


def seeds():
    roll, rate, acceleration = rocking(TIME, release=0.2)
    gyro, accel = imu(TIME, roll, rate, acceleration)
    yield text_of({"t_s": TIME, "roll_deg": np.rad2deg(roll)})
    yield text_of({"time": np.round(1.7e12 + TIME * 1e3), "gyro_rad_s": rate}, sep=";")
    yield text_of({"t": TIME, "gx": gyro[:, 0], "gy": gyro[:, 1], "gz": gyro[:, 2]} | dict(zip(("ax", "ay", "az"), accel.T, strict=True)), sep="\t")  # fmt: skip
    half = roll / 2
    yield text_of({"t": TIME, "qw": np.cos(half), "qx": np.sin(half), "qy": 0 * half, "qz": 0 * half})
    yield "\n".join(f"{t:.3f} {r:.5f}" for t, r in zip(TIME, roll, strict=True))


SEEDS = [seed.encode() for seed in seeds()]


def sound_or_refused(path, options=None):
    try:
        roll = read_roll(path, options)
    except SysidError as error:
        refused = str(error)
    else:
        refused, extras = "", (roll.rate, roll.rate_std)
    assert "\n" not in refused
    if refused:
        return
    assert roll.time.shape == roll.roll.shape == roll.std.shape
    assert np.all(np.isfinite(roll.time))
    assert np.all(np.diff(roll.time) > 0)
    assert np.all(np.isfinite(roll.roll))
    assert np.all(np.isfinite(roll.std))
    assert np.all(roll.std > 0)
    for extra in extras:
        assert extra is None or (extra.shape == roll.time.shape and np.all(np.isfinite(extra)))
    assert roll.notes


@st.composite
def damaged(draw):
    """A sound file after a few random injuries to bytes, lines and cells."""
    data = draw(st.sampled_from(SEEDS))
    for _ in range(draw(st.integers(1, 4))):
        kind = draw(
            st.sampled_from(["cut", "byte", "insert", "drop", "repeat", "swap", "cell", "column", "encode"])
        )
        place = draw(st.integers(0, max(0, len(data) - 1)))
        lines = data.split(b"\n")
        line = draw(st.integers(0, max(0, len(lines) - 1)))
        if kind == "cut":
            data = data[:place]
        elif kind == "byte" and data:
            data = data[:place] + bytes([draw(st.integers(0, 255))]) + data[place + 1 :]
        elif kind == "insert":
            data = data[:place] + draw(st.binary(max_size=12)) + data[place:]
        elif kind == "drop":
            data = b"\n".join(lines[:line] + lines[line + draw(st.integers(1, 60)) :])
        elif kind == "repeat":
            data = b"\n".join(lines[:line] + lines[line : line + 5] * draw(st.integers(2, 9)) + lines[line:])
        elif kind == "swap":
            data = b"\n".join(lines[:line] + lines[line:][::-1])
        elif kind == "cell":
            cells = ["", '"', "nan", "inf", "-inf", "1e308", "1e-320", "abc", "2026-03-01", "12:00", "1,5"]
            value = draw(st.sampled_from(cells)).encode()
            for separator in (b",", b";", b"\t", b" "):
                if separator in lines[line]:
                    lines[line] = lines[line].rsplit(separator, 1)[0] + separator + value
            data = b"\n".join(lines)
        elif kind == "column":
            value = draw(st.sampled_from(["0", "nan", "1e308", "1e-300", "7", "-3e5"])).encode()
            data = b"\n".join([lines[0], *(row.split(b",")[0] + b"," + value for row in lines[1:])])
        elif kind == "encode":
            data = data.decode("latin-1").encode(draw(st.sampled_from(["utf-16", "utf-8-sig", "utf-16-le"])))
    return data


@SETTINGS
@given(data=damaged())
def test_damaged_tables(tmp_path, data):
    path = tmp_path / "log.csv"
    path.write_bytes(data)
    sound_or_refused(path)


@SETTINGS
@given(data=st.binary(max_size=400), ending=st.sampled_from([".csv", ".parquet", ".mcap", ".zip", ".txt"]),
       magic=st.sampled_from([b"", b"PAR1", b"PK\x03\x04", b"\x89MCAP0\r\n", b"\xff\xfe", b"t,roll\n"]))  # fmt: skip
def test_random_bytes(tmp_path, data, ending, magic):
    path = tmp_path / f"log{ending}"
    path.write_bytes(magic + data)
    sound_or_refused(path)


@SETTINGS
@given(
    seed=st.sampled_from(SEEDS),
    options=st.builds(
        LogOptions,
        column=st.none() | st.sampled_from(["roll_deg", "1", "2", "9", "gx", "0", "-1", ""]),
        unit=st.none() | st.sampled_from(["deg", "rad/s", "1e-3", "nan", "0", "inf", "-0.5", "m", ""]),
        axis=st.none() | st.sampled_from(["x", "-y", "roll", "yaw", "", "-", "w"]),
        rate=st.none() | st.sampled_from([100.0, 1e-9, 1e12, -1.0]),
        time_column=st.none() | st.sampled_from(["t_s", "1", "2", "time"]),
        source=st.sampled_from(["auto", "angle", "gyro", "imu", "quaternion"]),
        lever_arm=st.none() | st.just((0.1, 0.0, 1e3)),
    ),
)
def test_any_options(tmp_path, seed, options):
    path = tmp_path / "log.csv"
    path.write_bytes(seed)
    sound_or_refused(path, options)


@SETTINGS
@given(data=st.data())
def test_damaged_parquet(tmp_path, data):
    frame = pd.DataFrame({"t_s": TIME, "roll_rad": rocking(TIME, release=0.2)[0]})
    buffer = io.BytesIO()
    frame.to_parquet(buffer)
    content = bytearray(buffer.getvalue())
    for _ in range(data.draw(st.integers(1, 5))):
        content[data.draw(st.integers(4, len(content) - 5))] = data.draw(st.integers(0, 255))
    path = tmp_path / "log.parquet"
    path.write_bytes(
        bytes(content[: data.draw(st.integers(8, len(content)))]) if data.draw(st.booleans()) else content
    )
    sound_or_refused(path)


@pytest.mark.parametrize(
    "stamps",
    [
        TIME * 1e300,
        TIME * 1e-300,
        TIME + 1e20,
        -TIME[::-1],
        np.cumsum(np.random.default_rng(0).pareto(0.5, TIME.size)),
        np.sort(np.random.default_rng(1).choice(TIME[:20], TIME.size)),
    ],
    ids=["huge", "tiny", "far", "negative", "heavy tails", "coarse"],
)
def test_odd_clocks(tmp_path, stamps):
    path = tmp_path / "log.csv"
    path.write_text(
        pd.DataFrame({"t_s": stamps, "roll_rad": rocking(TIME, release=0.2)[0]}).to_csv(index=False)
    )
    sound_or_refused(path)
