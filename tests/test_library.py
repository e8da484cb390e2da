"""The library as its page, its reference and its examples show it."""

import contextlib
import importlib.util
import io
import os
import runpy
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import nbformat
import numpy as np
import pandas as pd
import pytest
from quoted import missing

import sysid

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
DECAYS = ROOT / "data" / "decays"


def script(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def ran(name, folder):
    """Return what an example prints in a folder; `test_installed_outside_the_clone` runs one by itself."""
    printed = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(printed):
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    return printed.getvalue()


def test_twelve_names_and_no_more():
    assert len(sysid.__all__) == 12
    assert set(sysid.__all__) <= set(dir(sysid))
    assert all(getattr(sysid, name).__name__ in (name, "SysidError") for name in sysid.__all__)
    with pytest.raises(AttributeError, match="it offers Board"):
        sysid.nothing  # noqa: B018


def test_the_reference_names_every_public_name():
    page = (ROOT / "docs" / "api.md").read_text()
    assert all(f"`{name}`" in page for name in sysid.__all__)


@pytest.mark.slow
def test_page_prints_what_it_says():
    """Cell by cell; numbers may differ by the noise of a processor."""
    make = script("make_library")
    text = make.TARGET.read_text()
    for kept, fresh in zip(make.CELL.finditer(text), make.CELL.finditer(make.page(text)), strict=True):
        assert bool(kept["output"]) == bool(fresh["output"]), kept["code"]
        assert missing(tuple((kept["output"] or "").splitlines()), fresh["output"] or "") == [], (
            "run docs/make_library.py"
        )


@pytest.mark.slow
def test_the_notebook_does_the_loop(tmp_path):
    """It is its script, with the outputs of a run; run again it finds the hidden effect, and the corrected model passes."""
    make = script("make_notebook")
    kept = nbformat.read(make.TARGET, as_version=4)
    fresh = make.notebook()
    assert [cell.source for cell in kept.cells] == [cell.source for cell in fresh.cells], (
        "run docs/make_notebook.py"
    )
    assert all(
        cell.outputs for cell in kept.cells[3:] if cell.cell_type == "code" and "=" not in cell.source[:8]
    )
    ran = make.run(fresh, tmp_path)
    said = "\n".join(str(output) for cell in ran.cells if cell.cell_type == "code" for output in cell.outputs)
    assert "missing coulomb" in said
    assert "passed: NRMSE" in said
    assert "not passed" not in said
    assert "image/png" in said
    assert (tmp_path / "arm_fitted.xml").is_file()
    assert (tmp_path / "arm.html").is_file()


@pytest.mark.slow
def test_twenty_lines_from_arrays_to_a_model(tmp_path):
    from sysid.synth import SynthOptions, synthesise

    code = (EXAMPLES / "arrays_to_mjcf.py").read_text()
    assert len(code.splitlines()) <= 20
    (tmp_path / "robot.xml").write_text(MODEL)
    made = synthesise(
        sysid.Joint.from_mjcf(tmp_path / "robot.xml", "knee"), {"coulomb": (0.05,)},
        SynthOptions(angles=(0.5, -0.4, 0.3), rate=400.0, duration=3.0),
    )  # fmt: skip
    table = pd.DataFrame({"time": made.time, "angle": made.channels[:, 0]})
    table.to_csv(tmp_path / "swing.csv", index=False)
    out = ran("arrays_to_mjcf.py", tmp_path)
    assert "missing: coulomb" in out
    assert "robot_fitted.xml moves as measured" in out


LOOP = """
import sysid
from sysid.synth import synthesise

pink = sysid.Joint.load("pink")
made = synthesise(pink)
log = sysid.Recording.from_arrays(made.time, angle=made.channels[:, 0])
fit = sysid.fit(log, pink)
fit.board.save("pink.toml")
print(sysid.Joint.load("pink.toml"))
sysid.report(fit.board, log, "pink.html")
"""


@pytest.mark.slow
def test_installed_outside_the_clone(tmp_path, tmp_path_factory):
    """With nothing of the clone within reach: an installed wheel and its packages only."""
    wheels, home = tmp_path_factory.mktemp("wheels"), tmp_path_factory.mktemp("home")
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", wheels, ROOT],
        check=True,
        capture_output=True,
    )
    (wheel,) = wheels.glob("*.whl")
    venv.create(home, system_site_packages=False, with_pip=False)
    packages = home / "lib" / f"python{sys.version_info.major}.{sys.version_info.minor}" / "site-packages"
    shutil.unpack_archive(wheel, packages, "zip")
    # The packages that it needs are those of this environment, behind the wheel's own.
    (packages / "here.pth").write_text("\n".join(path for path in sys.path if path.endswith("site-packages")))
    done = subprocess.run(
        [home / "bin" / "python", "-c", LOOP],
        cwd=tmp_path, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": ""},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "k = 14." in done.stdout
    where = subprocess.run(
        [home / "bin" / "python", "-I", "-c", "import sysid; print(sysid.__file__)"],
        capture_output=True, text=True, cwd=tmp_path, check=False,
    )  # fmt: skip
    assert where.stdout.startswith(str(home))


@pytest.mark.parametrize("dialect", ["gyro", "imu"])
def test_library_and_command_say_the_same(tmp_path, dialect):
    """The roll of a gyro is an integral that drifts, that of an IMU errs by more than it jumps: of both the rate is fitted."""
    import json

    from sysid.cli import build_app
    from sysid.synth import SynthOptions, synthesise

    pink, log = sysid.Board.load("pink"), tmp_path / "log.csv"
    options = SynthOptions(angles=(0.17, -0.15), rate=400.0, dialect=dialect)
    synthesise(pink, {}, options).save(log)
    recording = sysid.Recording.read(log)
    results = {
        "decay": sysid.fit_decay(recording, board=pink),
        "fit": sysid.fit(recording, pink),
        "compare": sysid.compare(recording, pink),
    }
    for command, result in results.items():
        build_app()(
            [command, str(log), "--board", "pink", "--workspace", str(tmp_path / command), "--json", str(tmp_path / "j")],
            result_action="return_value", exit_on_error=False, print_error=False,
        )  # fmt: skip
        assert json.loads((tmp_path / "j").read_text()) == json.loads(json.dumps(result.to_json())), command
    assert results["fit"].is_rate


def test_results_become_tables_and_texts(tmp_path):
    log = sysid.Recording.read(DECAYS / "pink.csv")
    decay = sysid.fit_decay(log)
    assert decay.board is None
    assert decay.to_json()["stiffness"]["value"] is None
    assert "k and d need the inertia" in decay.report()
    assert decay.to_dataframe().loc["omega_n", "low"] < 41.1 < decay.to_dataframe().loc["omega_n", "high"]
    assert len(log.to_dataframe()) == len(log.roll.time)
    assert {phase.kind for phase in log.phases} >= {"held", "free", "rest"}
    one = sysid.fit_decay(log.releases[0], board=sysid.Board.load("pink"))
    assert len(one.releases) == 1
    with pytest.raises(sysid.SysidError, match="given twice"):
        sysid.fit_decay([log, log])
    with pytest.raises(sysid.SysidError, match="no release was given"):
        sysid.fit_decay([])


@pytest.fixture(scope="module")
def swing():
    """Time [s] and angle [rad] of a log with three releases."""
    table = pd.read_csv(DECAYS / "pink.csv")
    return table["time_s"].to_numpy(), table["roll_rad"].to_numpy()


def test_arrays_and_frames_are_logs(swing):
    time, angle = swing
    pink = sysid.Joint.load("pink")
    file = sysid.fit_decay(DECAYS / "pink.csv", board=pink).numbers.stiffness
    degrees = sysid.Recording.from_arrays(time, angle=np.degrees(angle), unit="deg")
    imu = sysid.Recording.read(DECAYS / "pink_imu.csv").roll
    rate = sysid.Recording.from_arrays(imu.time, rate=imu.rate)
    frame = pd.DataFrame({"tilt_deg": np.degrees(angle)}, index=pd.to_datetime(time, unit="s"))
    dated = sysid.Recording.from_dataframe(frame, name="encoder")
    for log in (degrees, rate, dated):
        found = sysid.fit_decay(log, board=pink).numbers.stiffness
        assert abs(found.value - file.value) < 2 * (found.std + file.std)
    assert rate.roll.measured == "rate"
    assert str(dated.path) == "encoder"


def test_wrong_arguments_are_told(swing):
    time, angle = swing
    record, log = sysid.Joint.load("pink"), sysid.Recording.from_arrays(time, angle=angle)
    same = sysid.Recording.from_arrays(time, angle=angle)
    for wrong, said in (
        (lambda: sysid.Recording.from_arrays(time, angle=angle, rate=angle), "one of them"),
        (lambda: sysid.Recording.from_arrays(time[1:], angle=angle), "a time for each sample"),
        (lambda: sysid.Recording.from_arrays(time, angle=angle, unit="deg/s"), "expected rad, deg, m or mm"),
        (lambda: sysid.Recording.from_arrays(time, angle=angle[:, None]), "one dimension"),
        (lambda: sysid.Recording.from_arrays(time, angle=["x"] * len(time)), "no array of numbers"),
        (lambda: sysid.Recording.from_dataframe({"t": time}), "takes a pandas DataFrame"),
        (lambda: sysid.fit(record, log), "The log comes first"),
        (lambda: sysid.fit(log, "pink"), r"sysid.Joint.load\('pink'\)"),
        (lambda: sysid.compare([3], record), "a int is no measurement"),
        (lambda: sysid.fit([log, same], record), "given twice"),
        (lambda: sysid.fit("nowhere.csv", record), "there is no such file"),
        (lambda: sysid.Joint.new("arm", -1.0), "expected a positive number"),
        (lambda: sysid.Joint.from_mjcf("nowhere.xml", "knee"), "there is no such model"),
        (lambda: record.check(log, tolerance=2), "between 0 and 1"),
        (lambda: sysid.report(log, record), "a Recording is no joint"),
        (lambda: sysid.Recording.read("a.csv", colum="x"), "Did you mean 'column'"),
        (lambda: sysid.fit(log, record, "friction"), "Did you mean 'coulomb'"),
    ):
        with pytest.raises(sysid.SysidError, match=said):
            wrong()


MODEL = """<mujoco>
  <!-- a hinge with the wrong damping -->
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody><body name="leg"><joint name="knee" axis="0 1 0" stiffness="3" damping="0.02"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.4"/></body></worldbody>
</mujoco>"""


def test_every_result_prints_short_and_draws(swing):
    from matplotlib.figure import Figure

    time, angle = swing
    log, pink = sysid.Recording.from_arrays(time, angle=angle), sysid.Joint.load("pink")
    fit = sysid.fit(log, pink)
    results = [
        log, pink, fit, sysid.fit_decay(log, board=pink), sysid.compare(log, pink), pink.check(log),
        sysid.simulate(pink, np.linspace(0, 0.5, 50), 0.1), sysid.Joint.new("rig", 0.01), sysid.diagnose(log, pink),
    ]  # fmt: skip
    for result in results:
        axes = Figure().subplots()
        assert result.plot(axes) is axes
        assert axes.lines or axes.texts
        assert result._repr_html_().startswith("<pre>")
        assert "data:image/png" in result._repr_html_()
    for result in (*results, *log.releases, log.roll, fit.law, fit.quantities["stiffness"]):
        assert len(repr(result)) < 2000
        assert "array(" not in repr(result)
