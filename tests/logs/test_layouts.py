"""Layouts of tables that robots, trackers, phones and benches write."""

import json

import numpy as np
import pytest
from rocking import OMEGA, ZETA, rocking, write_csv

from sysid.errors import SysidError
from sysid.free_decay import fit_decay
from sysid.logs import LogOptions, read_roll
from sysid.releases import find_releases
from sysid.video.options import VideoOptions

TIME = np.arange(0, 6, 1 / 200)
ROLL = rocking(TIME)[0] + np.random.default_rng(0).normal(0, 1e-3, len(TIME))


def right(path, options=None, omega=OMEGA):
    roll = read_roll(path, options)
    numbers = fit_decay(find_releases(roll)).numbers
    assert numbers.omega_n.value == pytest.approx(omega, rel=3e-3)
    assert numbers.damping_ratio.value == pytest.approx(ZETA, rel=0.05)
    return roll


# Names


@pytest.mark.parametrize(
    ("time", "angle"),
    [
        ("tempo", "angolo [°]"), ("время", "угол [°]"), ("Zeit", "Winkel (Grad)"), ("temps", "angle (degrés)"),
        ("tiempo", "ángulo_deg"), ("czas", "kąt [°]"), ("时间", "角度(°)"), ("時間", "角度_deg"), ("시간", "각도 (deg)"),
        ("tijd", "hoek_deg"), ("süre", "açı (°)"), ("čas", "úhel [°]"), ("χρόνος", "γωνία [°]"), ("tid", "vinkel_deg"),
    ],
)  # fmt: skip
def test_time_and_angle_in_other_languages(tmp_path, time, angle):
    roll = right(write_csv(tmp_path / "log.csv", (time, angle), TIME, np.degrees(ROLL)))
    assert not roll.warnings
    assert np.ptp(roll.roll) == pytest.approx(np.ptp(ROLL), rel=1e-6)


@pytest.mark.parametrize("names", [("time", "sensor1"), ("t", "x"), ("seconds", "Messwert")])
def test_the_only_column_that_moves_is_the_motion(tmp_path, names):
    roll = right(write_csv(tmp_path / "log.csv", names, TIME, ROLL))
    assert any("only column that moves" in text for text in roll.warnings)


# Clocks of their own


def test_newest_row_first(tmp_path):
    stamps = [f"2024-03-31T11:59:{t:09.6f}" for t in TIME]
    for time in (TIME, 1e3 * TIME + 1.7e12, stamps):
        name = "time" if time is stamps else "time_s" if time is TIME else "t_ms"
        path = write_csv(tmp_path / "log.csv", (name, "roll_rad"), time[::-1], ROLL[::-1], form="%.15g")
        right(path)


def test_a_signal_apart_with_its_own_time(tmp_path):
    rate = rocking(TIME)[1]
    signals = {"gyro.x": rate, "gyro.y": 0 * rate, "gyro.z": 0 * rate, "temp": 20 + 0 * rate}
    stamps = (1e3 * TIME).tolist()
    content = {name: {"time": stamps, "data": values.tolist()} for name, values in signals.items()}
    path = tmp_path / "log.json"
    path.write_text(json.dumps(content))
    assert right(path).origin == "gyro"


def files_of_vectors(tmp_path):
    h5py = pytest.importorskip("h5py")
    from scipy.io import savemat

    fast = np.arange(0, 6, 1e-3)
    content = {"imu": {"time_s": fast, "temp": 20 + 0 * fast}, "joint": {"time_s": TIME, "roll_rad": ROLL}}
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
        assert right(path, LogOptions(column=name)).time.size == len(TIME)
        assert read_roll(path, LogOptions(column="audio", unit="rad", rate=1e3)).time.size == 9000
        with pytest.raises(SysidError, match=r"'audio' has no time of its own.*--rate"):
            read_roll(path, LogOptions(column="audio", unit="rad"))


@pytest.mark.parametrize("ending", ["mat", "csv"])
def test_a_signal_whose_name_ends_in_s_is_no_clock(tmp_path, ending):
    """Of q and its smoothed q_s, neither rises as a clock does."""
    columns = {"q_s": ROLL, "q_rad": ROLL, "t": TIME}
    path = tmp_path / f"log.{ending}"
    if ending == "mat":
        pytest.importorskip("scipy.io").savemat(path, columns)
    else:
        write_csv(path, tuple(columns), *columns.values())
    right(path, LogOptions(column="q_rad"))


def lerobot(folder, *, episodes=3):
    """Write a data set as LeRobot does: one file an episode, the state as a list, element names in info.json."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    rng = np.random.default_rng(0)
    for episode in range(episodes):
        elbow = np.degrees(rocking(TIME, amplitude=0.3 - 0.05 * episode)[0]) + rng.normal(0, 0.05, len(TIME))
        state = np.column_stack((10 + rng.normal(0, 0.05, len(TIME)), elbow)).astype(np.float32)
        table = pa.table({
            "action": pa.array(list(0 * state), pa.list_(pa.float32())),
            "observation.state": pa.array(list(state), pa.list_(pa.float32())),
            "timestamp": TIME.astype(np.float32),
            "frame_index": np.arange(len(TIME)), "episode_index": np.full(len(TIME), episode),
        })  # fmt: skip
        path = folder / f"data/chunk-000/episode_{episode:06d}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(table, path)
    names = ["shoulder.pos", "elbow.pos"]
    (folder / "meta").mkdir()
    features = {
        key: {"dtype": "float32", "shape": [2], "names": names} for key in ("action", "observation.state")
    }
    (folder / "meta/info.json").write_text(json.dumps({"features": features}))
    return path


def test_a_lerobot_data_set_is_one_log_of_its_episodes(tmp_path):
    path = lerobot(tmp_path / "set")
    roll = right(path)
    assert any("'observation.state.elbow.pos'" in text for text in (*roll.notes, *roll.warnings))
    right(path, LogOptions(column="observation.state.elbow.pos", unit="deg"))
    whole = right(tmp_path / "set")
    assert len(find_releases(whole)) == 3


# Points that were followed


def bob(tmp_path, *, pixels=False, noise=3e-4, centre=(0.3, 0.1), theta=ROLL, header=("t", "x", "y")):
    rng = np.random.default_rng(1)
    x = centre[0] + 0.42 * np.sin(theta) + rng.normal(0, noise, len(theta))
    y = centre[1] - 0.42 * np.cos(theta) + rng.normal(0, noise, len(theta))
    if pixels:
        x, y = 640 + 800 * x, 300 - 800 * y
    path = tmp_path / "track.txt"
    rows = ["\t".join(f"{cell:.4E}" for cell in row) + "\t" for row in zip(TIME, x, y, strict=True)]
    path.write_text("\n".join(["mass_A\t\t", "\t".join(header), *rows]) + "\n")
    return path


@pytest.mark.parametrize("pixels", [False, True])
def test_a_bob_turns_about_the_centre_of_its_circle(tmp_path, pixels):
    header = ("t (s)", "x (px)", "y (px)") if pixels else ("t", "x", "y")
    roll = right(bob(tmp_path, pixels=pixels, header=header))
    assert roll.scale_std > 0
    scale = np.ptp(roll.roll) / np.ptp(ROLL)
    assert abs(scale - 1) < 3 * roll.scale_std + 0.01
    assert np.corrcoef(roll.roll, ROLL)[0, 1] > 0.99


def test_a_pivot_may_be_given(tmp_path):
    path = bob(tmp_path, noise=2e-3, theta=0.1 * ROLL)
    with pytest.raises(SysidError, match=r"no circle of known radius.*--pivot X Y"):
        read_roll(path)
    roll = read_roll(path, LogOptions(video=VideoOptions(pivot=(0.3, 0.1))))
    assert np.median(np.abs(roll.roll - 0.1 * ROLL)) < 0.01
