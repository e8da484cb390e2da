"""Options that cannot be meant are refused, and those that are not used are named."""

import os
import subprocess
import sys

import pytest
from command_line import called
from command_line import husky as in_process

from sysid.cli.log_options import VideoArguments
from sysid.effects import effect
from sysid.errors import SysidError
from sysid.workspace import shipped_data

PINK = shipped_data() / "decays" / "pink.csv"


@pytest.mark.parametrize(
    "words",
    [
        ("play", "zero", "--board", "pink", "--speed=nan"),
        ("train", "--board", "pink", "--minutes=1e999"),  # has a smallest value, which inf is not below
        ("roll", PINK, "-o", "x.csv", "--rate=-inf"),  # may be left out
        ("check", PINK, "--board", "pink", "--timestep=-0.001"),
        ("check", PINK, "--board", "pink", "--timestep=0.5"),
        ("mjcf", "--board", "pink", "-o", "pink.xml", "--timestep=0.051"),
        ("export", "--mjlab", "fit.json", "--timestep=0.5"),
        ("compare", PINK, "--board", "pink", "--tolerance=-1"),
        ("run", "zero", "--board", "pink", "--joint-margin=-1"),
        ("evaluate", "zero", "--board", "pink", "--episodes=0"),
        ("train", "--board", "pink", "--environments=0"),
    ],
)
def test_a_number_out_of_range_is_refused_with_its_option(tmp_path, words):
    """One line, as every refusal of the tool."""
    done = in_process(*words, "--workspace", tmp_path, cwd=tmp_path)
    assert done.returncode in (1, 2)
    assert words[-1].split("=")[0] in done.stderr.splitlines()[-1]
    assert done.stderr.splitlines()[-1].startswith("error: ")


def test_metres_where_centimetres_were_meant_are_doubted(capsys):
    cuboid = ("inertia", "cuboid", "--mass", "2.58±0.05")
    called(*cuboid, "--width", "20±0.2", "--height", "2±0.1")
    assert "Lengths without a unit are metres" in " ".join(capsys.readouterr().err.split())
    called(*cuboid, "--width", "20±0.2cm", "--height", "2±0.1cm")
    assert "metres" not in capsys.readouterr().err


def test_swapped_decays_are_told_from_too_little_mass():
    added = ("inertia", "added-mass", "--mass", "0.5", "--offset", "0.09")
    with pytest.raises(SysidError, match="Are --bare and --loaded swapped"):
        called(*added, "--bare", "32±0.1", "--loaded", "41±0.1")
    with pytest.raises(SysidError, match="Put more mass further out"):
        called(*added, "--bare", "41±1", "--loaded", "41.1±1")


@pytest.mark.parametrize("angle", [(95.0, 0.0), (0.0, -90.0), (float("nan"), 0.0)])
def test_options_of_a_film_that_cannot_be_meant_are_refused(tmp_path, angle):
    with pytest.raises(SysidError, match=r"--camera-angle .* ±90"):
        _ = VideoArguments(camera_angle=angle).options
    both = tmp_path / "seen.mp4"
    with pytest.raises(SysidError, match="same file"):
        called("roll", tmp_path / "film.mp4", "-o", both, "--overlay", both)


@pytest.mark.parametrize(
    "arguments",
    [["rollout", "PIPE", "--board", "pink"], ["roll", PINK, "-o", "x.csv", "--calibration", "PIPE"]],
    ids=["rollout", "calibration"],
)
def test_a_pipe_in_place_of_a_file_is_not_waited_for(tmp_path, arguments):
    pipe = tmp_path / "pipe.json"
    os.mkfifo(pipe)
    command = [sys.executable, "-m", "sysid.cli", *(str(pipe) if a == "PIPE" else a for a in arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=20, cwd=tmp_path)
    assert "Traceback" not in done.stderr


def test_a_message_is_one_line_whatever_a_cell_holds(tmp_path):
    lines = PINK.read_text().splitlines()
    lines[40] = "0.08,\x1b[2Jx\ty"
    (tmp_path / "log.csv").write_text("\n".join(lines))
    done = in_process("decay", tmp_path / "log.csv", cwd=tmp_path)
    assert len(done.stderr.splitlines()) == 1
    assert "line 41" in done.stderr
    assert "\x1b" not in done.stderr


@pytest.mark.parametrize(
    ("command", "where"),
    [("diagnose", ("--json", ".")), ("fit", ("--workspace", "a_file")), ("decay", ("--json", "a_file/x.json")),
     ("compare", ("--rerun", "a_file/x.rrd")), ("report", ("-o", "a_file/x.html"))],
)  # fmt: skip
def test_what_cannot_be_written_is_said_before_anything_is_computed(tmp_path, command, where):
    (tmp_path / "a_file").touch()
    done = in_process(command, PINK, "--board", "pink", *where, cwd=tmp_path)
    assert done.returncode == 1
    assert "cannot write there" in done.stderr
    assert "samples" not in done.stderr  # no log was read
    assert not done.stdout


@pytest.mark.parametrize(
    ("word", "meant"),
    [("friction", "'coulomb'"), ("drag", "'quadratic-damping'"), ("rubber", "'viscoelastic'"),
     ("Dry_Friction", "'coulomb'"), ("columb", "'coulomb'")],
)  # fmt: skip
def test_an_effect_is_found_by_the_words_that_people_use(word, meant):
    with pytest.raises(SysidError, match=f"Did you mean .*{meant}"):
        effect(word)


def test_an_effect_that_is_shown_writes_no_picture_unless_one_is_named(tmp_path):
    assert in_process("effects", "coulomb", cwd=tmp_path).returncode == 0
    assert list(tmp_path.iterdir()) == []
    assert in_process("effects", "coulomb", "-o", "friction.png", cwd=tmp_path).returncode == 0
    assert (tmp_path / "friction.png").read_bytes().startswith(b"\x89PNG")


def test_logs_of_the_fit_are_the_default(tmp_path, capsys):
    pink = ("--board", "pink", "--workspace", tmp_path)
    for name in ("check", "compare", "diagnose", "report"):
        with pytest.raises(SysidError, match=r"never fitted.*husky-sysid fit LOG\.\.\. --board pink"):
            called(name, *pink)
    assert list(tmp_path.iterdir()) == []
    called("fit", PINK, *pink)
    told = ("next: check it in MuJoCo: husky-sysid check", "next: ready to train: ")
    for name, text in zip(("compare", "check"), told, strict=True):
        called(name, *pink)
        printed = capsys.readouterr()
        assert ("logs of the fit: " in printed.err, text in printed.out) == (True, True)
