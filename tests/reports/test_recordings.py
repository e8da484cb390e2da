"""Recordings hold what was computed, open as they should, and fail in clear words."""

import subprocess
import sys

import numpy as np
import pytest
from command_line import called
from decay_truth import Recipe, make_roll, write_log

from reports.page.summary import board_summary
from reports.rerun.decay import comparison_recording
from reports.rerun.stream import need_rerun
from sysid.comparison.compare import compare
from sysid.errors import SysidError
from sysid.recording import Recording

rerun_chunk = pytest.importorskip("rerun.chunk", reason="rerun-sdk is not installed")


@pytest.fixture(scope="module")
def data():
    return [Recording.of(make_roll(Recipe(sampling=500, amplitudes=(0.2, -0.15))))]


@pytest.fixture(scope="module")
def result(data, pink):
    return compare(data, pink)


@pytest.fixture(scope="module")
def compared(data, result, pink, tmp_path_factory):
    path = tmp_path_factory.mktemp("rerun") / "compare.rrd"
    comparison_recording(path, pink, data, result, board_summary(pink, [], result))
    return path


def series(path):
    """Everything on the time line in a recording: times [s] and columns by entity."""
    found = {}
    for chunk in rerun_chunk.RrdReader(path).stream():
        batch = chunk.to_record_batch()
        if "t" not in batch.schema.names:
            continue
        (name,) = [n for n in batch.schema.names if ":" in n and not n.startswith("rerun")][:1]
        time = batch.column("t").cast("int64").to_numpy() * 1e-9
        found.setdefault(str(chunk.entity_path), []).append(
            (time, [v[0] for v in batch.column(name).to_pylist()])
        )
    return {
        entity: (np.concatenate([t for t, _ in parts]), [v for _, values in parts for v in values])
        for entity, parts in found.items()
    }


def test_the_reader_finds_the_very_numbers_of_the_comparison(compared, result, data):
    logged = series(compared)
    for number, release in enumerate(result.releases, start=1):
        for entity, values in (
            ("signal/measured", release.measured),
            ("signal/simulated", release.simulated),
            ("residual/error", 1e3 * release.residual),
        ):
            time, got = logged[f"/release{number}/{entity}"]
            np.testing.assert_array_equal(got, values)
            np.testing.assert_allclose(time, release.time, atol=1e-9)
    np.testing.assert_allclose(logged["/release1/residual/noise_upper"][1], 2 * 1e3 * result.noise.std)
    time, got = logged["/log1/roll/measured"]
    np.testing.assert_array_equal(got, data[0].roll.roll)
    np.testing.assert_allclose(time, data[0].roll.time - data[0].releases[0].start, atol=1e-9)
    assert subprocess.run([sys.executable, "-m", "rerun", "rrd", "verify", str(compared)]).returncode == 0


def test_boards_move_as_simulated_and_as_measured(compared, result):
    release = result.releases[0]
    chunks = [c for c in rerun_chunk.RrdReader(compared).stream() if str(c.entity_path).endswith("/deck")]
    angles = {}
    for chunk in chunks:
        batch = chunk.to_record_batch()
        if "t" in batch.schema.names:
            column = next(n for n in batch.schema.names if n.endswith("quaternion"))
            x, y, z, w = np.array([row[0] for row in batch.column(column).to_pylist()]).T
            assert np.abs([y, z]).max() < 1e-6
            angles[str(chunk.entity_path)] = 2 * np.arctan2(x, w)
    assert len(angles) == 4  # two releases, each simulated and measured
    simulated, measured = angles["/world/simulated1/deck"], angles["/world/measured1/deck"]
    count = 40
    np.testing.assert_allclose(simulated[1 : count + 1], release.roll[:count], atol=1e-6)
    np.testing.assert_allclose(measured[1 : count + 1], release.measured[:count], atol=1e-6)
    assert simulated[0] == simulated[1]  # held until the release


@pytest.fixture
def log(tmp_path):
    return write_log(tmp_path / "rock.csv", make_roll(Recipe(sampling=300, amplitudes=(0.2, -0.15))))


def test_commands_write_recordings(log, tmp_path):
    for command, option in (("compare", "--rerun"), ("view", "-o")):
        path = tmp_path / f"{command}.rrd"
        assert called(command, log, "--board", "pink", "--workspace", tmp_path, option, path) == 0
        assert "/release2/signal/simulated" in series(path)


def test_a_missing_rerun_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(SysidError, match="pip install rerun-sdk"):
        need_rerun()
