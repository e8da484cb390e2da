"""A failed write leaves the old file whole and no debris."""

import multiprocessing
import os
import tempfile
import threading
from pathlib import Path

import pytest

from sysid.errors import SysidError
from sysid.files import atomic_path, locked, write_atomically, write_json


def test_failure_in_the_middle_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "board.toml"
    write_atomically(path, "old")
    with pytest.raises(RuntimeError), atomic_path(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_json_refuses_nan(tmp_path):
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "x.json", {"x": float("nan")})
    assert list(tmp_path.iterdir()) == []


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "real.json").write_text("old")
    (tmp_path / "link.json").symlink_to(tmp_path / "real.json")
    write_atomically(tmp_path / "link.json", "new")
    assert (tmp_path / "link.json").is_symlink()
    assert (tmp_path / "real.json").read_text() == "new"


def test_a_pipe_is_written_through_and_stays(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: read.append(pipe.read_text()))
    read: list[str] = []
    reader.start()
    write_atomically(pipe, "through")
    reader.join(timeout=10)
    assert read == ["through"]
    assert pipe.is_fifo()


def test_a_full_device_is_an_error_and_stays_a_device():
    with pytest.raises(SysidError, match="No space left"):
        write_atomically(Path("/dev/full"), "x" * 100_000)
    assert Path("/dev/full").is_char_device()


def test_a_board_record_is_written_over_by_records_only(tmp_path):
    record = tmp_path / "data" / "boards" / "mine.toml"
    write_atomically(record, "old", is_record=True)
    with pytest.raises(SysidError, match=r"mine\.toml: holds a board's record"):
        write_json(record, {})
    assert record.read_text() == "old"


def count_up(path, times):
    for _ in range(times):
        with locked(path):
            path.write_text(str(int(path.read_text()) + 1))


def test_a_lock_that_is_taken_away_keeps_others_out_all_the_same(tmp_path, monkeypatch):
    """Its file is deleted at each release, while others wait for it."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    path = tmp_path / "count"
    path.write_text("0")
    spawned = multiprocessing.get_context("fork")
    crew = [spawned.Process(target=count_up, args=(path, 200)) for _ in range(4)]
    for process in crew:
        process.start()
    for process in crew:
        process.join()
    assert path.read_text() == "800"
    assert list(tmp_path.iterdir()) == [path]
