"""Recordings hold what was computed, open as they should, and fail in clear words."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from command_line import called
from decay_truth import Recipe, make_roll, write_log

from reports.evidence import gather
from reports.page.summary import board_summary, decay_summary
from reports.rerun.decay import comparison_recording, decay_recording
from reports.rerun.film_frames import FilmFrames
from reports.rerun.stream import need_rerun
from sysid.board import Board, BoardEffect
from sysid.errors import SysidError
from sysid.fitting.ladder import PLAIN
from sysid.free_decay import fit_decay
from sysid.quantity import Quantity
from sysid.recording import Recording
from sysid.releases import find_releases

rerun_chunk = pytest.importorskip("rerun.chunk", reason="rerun-sdk is not installed")


@pytest.fixture(scope="module")
def board():
    coulomb = BoardEffect("coulomb", {"torque": Quantity(0.05, 0.01, "N*m")})
    return replace(Board.load("pink"), effects=(coulomb,))


@pytest.fixture(scope="module")
def evidence(board):
    roll = make_roll(Recipe(sampling=500, amplitudes=(0.2, -0.15)))
    return gather(board, [Recording.of(roll)], heldout=False)


@pytest.fixture(scope="module")
def film():
    import cv2

    picture = np.full((48, 64, 3), (10, 200, 90), np.uint8)
    jpeg = cv2.imencode(".jpg", picture)[1].tobytes()
    return FilmFrames(np.linspace(-0.5, 1.0, 20), tuple([jpeg] * 20))


@pytest.fixture(scope="module")
def compared(evidence, film, tmp_path_factory):
    path = tmp_path_factory.mktemp("rerun") / "compare.rrd"
    comparison_recording(path, evidence, board_summary(evidence), [film])
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


def test_the_reader_finds_the_very_numbers_of_the_comparison(compared, evidence):
    logged = series(compared)
    for number, release in enumerate(evidence.comparison.releases, start=1):
        for entity, values in (
            ("signal/measured", release.measured),
            ("signal/simulated", release.simulated),
            ("signal/model0", evidence.ladder[0].simulated[number - 1]),
            ("residual/error", 1e3 * release.residual),
        ):
            time, got = logged[f"/release{number}/{entity}"]
            np.testing.assert_array_equal(got, values)
            np.testing.assert_allclose(time, release.time, atol=1e-9)
    band = logged["/release1/residual/noise_upper"][1]
    np.testing.assert_allclose(band, 2 * 1e3 * evidence.comparison.noise.std)
    assert [rung.label for rung in evidence.ladder] == [PLAIN, "+ coulomb"]


def test_boards_move_as_simulated_and_as_measured(compared, evidence):
    release = evidence.comparison.releases[0]
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


def test_film_frames_are_on_the_same_time_line_and_rerun_verifies_the_file(compared, film):
    time, blobs = series(compared)["/film1"]
    np.testing.assert_allclose(time, film.time, atol=1e-9)
    assert bytes(blobs[0]) == film.pictures[0]
    verify = [sys.executable, "-m", "rerun", "rrd", "verify", str(compared)]
    assert subprocess.run(verify).returncode == 0


def test_the_decay_recording_holds_log_fit_and_peaks(tmp_path):
    roll = make_roll(Recipe(sampling=500, amplitudes=(0.2, -0.15)))
    decay = fit_decay(find_releases(roll), Quantity(8.7e-3, 1e-4, "kg*m^2"))
    path = tmp_path / "decay.rrd"
    decay_recording(path, roll, decay, decay_summary("pink", decay))
    logged = series(path)
    time, values = logged["/log/roll/measured"]
    np.testing.assert_array_equal(values, roll.roll)
    np.testing.assert_allclose(time, roll.time - decay.releases[0].start, atol=1e-9)
    np.testing.assert_array_equal(logged["/release2/signal/model"][1], decay.trace.releases[1].modelled)
    drawn = [entity for entity in sorted(logged) if entity.startswith("/release2/signal/m")]
    assert drawn == ["/release2/signal/measured", "/release2/signal/model"], "the later one lies on top"
    error = -1e3 * decay.trace.releases[1].residual
    np.testing.assert_allclose(
        logged["/release2/residual/error"][1], error, err_msg="sim - real, as everywhere"
    )
    np.testing.assert_array_equal(logged["/release1/signal/peaks"][1], [p.roll for p in decay.peaks[0]])
    above, below = (np.array(logged[f"/release1/signal/envelope_{side}"][1]) for side in ("above", "below"))
    modelled = decay.trace.releases[0].modelled
    assert np.all(modelled <= above + 1e-9)
    assert np.all(modelled >= below - 1e-9)


@pytest.fixture
def log(tmp_path):
    return write_log(tmp_path / "rock.csv", make_roll(Recipe(sampling=300, amplitudes=(0.2, -0.15))))


def test_commands_write_recordings(log, tmp_path):
    for command in ("decay", "compare"):
        path = tmp_path / f"{command}.rrd"
        assert called(command, log, "--board", "pink", "--workspace", tmp_path, "--rerun", path) == 0
        assert series(path)
    path = tmp_path / "view.rrd"
    assert called("view", log, "--board", "pink", "--workspace", tmp_path, "-o", path) == 0
    assert "/release2/signal/simulated" in series(path)


def test_a_recording_that_cannot_be_written_is_refused_and_nothing_is_left(evidence, tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    with pytest.raises(SysidError, match="cannot write there"):
        comparison_recording(blocked / "out.rrd", evidence, "text")
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(SysidError, match="pip install rerun-sdk"):
        need_rerun()
    assert list(tmp_path.iterdir()) == [blocked]
