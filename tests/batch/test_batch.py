"""A batch finds what the commands find, goes on where it was broken off, and runs on a cluster too."""

import csv
import json

import pytest
from command_line import husky

import sysid
from sysid.batch.jobs import COLUMNS
from sysid.batch.manifest import read_manifest
from sysid.batch.runner import read_rows
from sysid.synth import SynthOptions, synthesise
from sysid.workspace import Workspace

STIFFNESS = {"pink": 14.684, "black": 34.85}


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Two short logs of each board, and a file that is none."""
    folder = tmp_path_factory.mktemp("logs")
    for name in STIFFNESS:
        board = Workspace(folder).load_board(name)
        for seed in (1, 2):
            options = SynthOptions(angles=(0.17, -0.12), rate=400.0, duration=0.8, seed=seed)
            _, truth = synthesise(board, {}, options).save(folder / f"{name}-{seed}.csv")
            truth.unlink()
    (folder / "notes.csv").write_text("nothing,here\n")
    return folder


BOTH = """[[job]]
name = "both"
board = "black"
logs = ["black-1.csv", "black-2.csv"]
together = true
"""


def manifest(folder, text, name="week.toml"):
    path = folder / name
    path.write_text(text)
    return path


def both(folder):
    pink = '[defaults]\ntask = "decay"\n[[job]]\nboard = "pink"\nlogs = ["pink-*.csv"]\n'
    return manifest(folder, f'{pink}{BOTH}[[job]]\nname = "broken"\nlogs = ["notes.csv"]\n')


def test_one_table_and_one_page(logs, tmp_path):
    done = husky("batch", both(logs), "--workspace", tmp_path, "--workers", 2)
    assert done.returncode == 1, done.stderr
    assert "broken: " in done.stderr
    assert "3 of 4 jobs done, 1 failed" in done.stdout
    folder = tmp_path / "reports/batch/week"
    with (folder / "table.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert [row["job"] for row in rows] == ["pink-1.csv", "pink-2.csv", "both", "broken"]
    for row in rows[:3]:
        low, high = float(row["stiffness_low_nm_rad"]), float(row["stiffness_high_nm_rad"])
        middle, half = (low + high) / 2, (high - low) / 2
        assert abs(middle - STIFFNESS[row["board"]]) < 2 * half
    assert rows[3]["state"] == "failed"
    alone = sysid.fit_decay(sysid.Recording.read(logs / "pink-1.csv"), board=sysid.Board.load("pink"))
    assert alone.numbers.stiffness.value == pytest.approx(float(rows[0]["stiffness_nm_rad"]))
    page = (folder / "page.html").read_text()
    assert page.count("<svg") == 2
    assert "3 of 4 jobs done" in page
    assert not (tmp_path / "data").exists()  # no record is changed


def test_a_missing_log_fails_its_own_job_only(logs, tmp_path):
    jobs = "".join(f'[[job]]\nlogs = ["{log}.csv"]\n' for log in ("none", "none-*", "pink-1"))
    path = manifest(logs, jobs, "missing.toml")
    done = husky("batch", path, "--workspace", tmp_path, "--workers", 1)
    assert done.returncode == 1
    assert "1 of 3 jobs done, 2 failed" in done.stdout
    assert done.stderr.count("none.csv: there is no such file.") == 1
    rows = json.loads((tmp_path / "reports/batch/missing/table.json").read_text())
    assert [row["state"] for row in rows] == ["failed", "failed", "done"]
    assert "there is no such file" in rows[1]["message"]


def test_what_was_done_is_not_done_again(logs, tmp_path):
    path = both(logs)
    husky("batch", path, "--workspace", tmp_path, "--workers", 1)
    file = tmp_path / "reports/batch/week/rows.jsonl"
    lines = file.read_text().splitlines(keepends=True)
    file.write_text("".join(lines[:1]) + lines[1][:40])  # killed amid a line
    done = husky("batch", path, "--workspace", tmp_path, "--workers", 1)
    assert "4 jobs, 1 of them done before" in done.stderr
    assert len(read_rows(file)) == 4
    again = husky("batch", path, "--workspace", tmp_path, "--workers", 1)
    assert "3 of them done before" in again.stderr  # what failed is tried again


@pytest.mark.parametrize(
    ("task", "columns"),
    [
        ("fit", {"stiffness_nm_rad", "rmse_rad"}),
        ("compare", {"nrmse", "verdict"}),
        pytest.param("diagnose", {"verdict", "confidence"}, marks=pytest.mark.slow),
    ],
)
def test_every_task_fills_its_columns(logs, tmp_path, task, columns):
    job = f'[[job]]\nboard = "pink"\ntask = "{task}"\nlogs = ["pink-1.csv"]\n'
    path = manifest(logs, job, f"{task}.toml")
    assert husky("batch", path, "--workspace", tmp_path, "--workers", 1).returncode == 0
    row = json.loads((tmp_path / f"reports/batch/{task}/table.json").read_text())[0]
    assert columns <= set(row)


def test_a_table_of_jobs_says_the_same_as_toml(logs):
    rows = "name,board,logs,together,release\nboth,black,black-1.csv;black-2.csv,yes,1.5;3.2\n"
    table = manifest(logs, rows, "week.csv")
    assert read_manifest(table) == read_manifest(manifest(logs, f"{BOTH}release = [1.5, 3.2]\n"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no job"),
        ("[[jobs]]\n", "Did you mean 'job'"),
        ('[[job]]\nlog = "x"\n', "Did you mean 'logs'"),
        ("[[job]]\n", "names no log"),
        ('[[job]]\nlogs = ["pink-1.csv"]\ntask = "fitt"\n', "Did you mean 'fit'"),
        ('[[job]]\nlogs = ["pink-1.csv"]\ntask = "fit"\n', "needs the board"),
        ('[[job]]\nlogs = ["pink-1.csv"]\nrate = "fast"\n', "expected a number"),
        ('[[job]]\nlogs = ["pink-1.csv"]\neffects = ["coulomb"]\n', "by 'fit' only"),
        ('[[job]]\nlogs = ["pink-1.csv"]\n[[job]]\nlogs = ["pink-1.csv"]\n', "two jobs are called"),
        ("[[job]\n", "cannot be read as a manifest"),
    ],
)
def test_a_faulty_manifest_is_one_line(logs, tmp_path, text, message):
    done = husky("batch", manifest(logs, text, "bad.toml"), "--workspace", tmp_path)
    assert done.returncode == 1
    assert message in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_cluster_of_two_workers_does_the_same(logs, tmp_path):
    distributed = pytest.importorskip("distributed")
    path = both(logs)
    here, there = tmp_path / "here", tmp_path / "there"
    husky("batch", path, "--workspace", here, "--workers", 1)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, local_directory=str(tmp_path / "dask")
    ) as cluster:
        done = husky("batch", path, "--workspace", there, "--cluster", cluster.scheduler_address)
    assert "3 of 4 jobs done" in done.stdout, done.stderr
    tables = [json.loads((w / "reports/batch/week/table.json").read_text()) for w in (here, there)]
    for one, other in zip(*tables, strict=True):
        assert {**one, "seconds": 0} == {**other, "seconds": 0}
