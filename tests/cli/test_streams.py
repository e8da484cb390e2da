"""What the shell gives: streams that cannot hold every sign, are full or closed, and signals to end."""

import os
import signal
import subprocess
import sys
import time

import pytest

from sysid.workspace import shipped_data

LOG = shipped_data() / "decays" / "pink.csv"


def shell(*arguments, **options):
    command = [sys.executable, "-m", "sysid.cli", *map(str, arguments)]
    return subprocess.run(command, stderr=subprocess.PIPE, timeout=60, **options)


def test_any_encoding_of_the_output_will_do(tmp_path):
    words, ascii_only = (
        ("--board", "pink", "--workspace", tmp_path),
        {**os.environ, "PYTHONIOENCODING": "ascii"},
    )
    done = shell("decay", LOG, *words, "--no-picture", stdout=subprocess.PIPE, env=ascii_only)
    assert done.returncode == 0, done.stderr.decode()
    assert "natural frequency ?_n" in done.stdout.decode("ascii")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a device of Linux")  # noqa: PTH110
@pytest.mark.parametrize("arguments", [["boards", "--json", "-"], ["--help"]])
def test_a_full_disk_is_one_line(arguments, tmp_path):
    with open("/dev/full", "w") as full:  # noqa: PTH123
        done = shell(*arguments, stdout=full)
    assert done.returncode == 1
    assert done.stderr.decode().splitlines() == ["error: standard output: No space left on device."]


def test_a_disk_without_room_for_a_recording_is_one_line(tmp_path):
    arguments = f"view {LOG} --board pink --workspace {tmp_path} -o {tmp_path / 'view.rrd'}"
    limited = f"ulimit -f 100; {sys.executable} -m sysid.cli {arguments}"
    done = subprocess.run(["bash", "-c", limited], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith(f"error: {tmp_path / 'view.rrd'}: cannot ")
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


def test_a_closed_output_is_no_failure():
    command = f"{sys.executable} -m sysid.cli boards >&-"
    done = subprocess.run(command, shell=True, stderr=subprocess.PIPE, timeout=60)
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.parametrize("name", ["reports", "sysid"])
def test_another_projects_package_of_the_same_name_is_told(name, tmp_path):
    """One that lies nearer on the path, or that was installed over this one."""
    if name == "reports":
        (tmp_path / "reports").mkdir()
        (tmp_path / "reports" / "__init__.py").touch()
        code = "from sysid.cli import main; import sys; sys.path.insert(0, ''); main()"
    else:
        code = "import sysid; sysid.__all__ = []; from sysid.cli import main; main()"
    command = [sys.executable, "-c", code, "boards"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr.startswith(f"error: the package '{name}' that Python finds is another project's")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(("number", "code", "wait"), [(signal.SIGTERM, 143, 0.5), (signal.SIGINT, 130, None)])
def test_a_signal_ends_a_command_in_one_line_and_leaves_nothing(number, code, wait, tmp_path):
    """As soon as it has been able to listen, or amid the search."""
    workspace, temporary = tmp_path / "workspace", tmp_path / "temporary"
    temporary.mkdir()
    listening = "from sysid.cli import main; main() if not print(flush=True) else None"
    arguments = ("diagnose", LOG, "--board", "pink", "--workspace", workspace)
    command, pipe = [sys.executable, "-c", listening, *map(str, arguments)], subprocess.PIPE
    own = {**os.environ, "TMPDIR": str(temporary)}
    process = subprocess.Popen(command, stdout=pipe, stderr=pipe, env=own)
    process.stdout.readline()
    if wait is None:
        time.sleep(0.02)
    else:
        process.stderr.readline()  # the log was read
        time.sleep(wait)
    process.send_signal(number)
    error = process.communicate(timeout=30)[1].decode()
    assert process.returncode == code
    assert error.splitlines()[-1] == "error: interrupted; no file is left half-written"
    assert "Traceback" not in error
    assert not workspace.exists()
    assert not list(temporary.iterdir())
