"""The tutorial of the learned torque: from a log with a magnet to an MJCF that swings as it does."""

import re
import shlex
from pathlib import Path

import mujoco
import numpy as np
import pytest
from command_line import called
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from sysid.board import load_board

ROOT = Path(__file__).parents[2]
LOG = ROOT / "docs/examples/magnet.csv"


@pytest.mark.slow
def test_a_magnet_is_found_learned_checked_and_written(tmp_path, capsys):
    """The five commands of docs/learned_torque.md, in their order."""
    common = ("--board", "pink", "--workspace", tmp_path)
    called("diagnose", LOG, *common)
    told = capsys.readouterr().out
    assert "has no name in the catalogue" in " ".join(told.split())
    command = re.search("to learn the torque: husky-sysid (.*)", told)[1]
    assert "--effect learned" in command
    called(*shlex.split(command))
    assert re.search("a pull to the middle within 1.*a magnet", capsys.readouterr().out)
    assert (tmp_path / "reports/pink/learned.png").is_file()
    board = load_board(tmp_path / "data/boards/pink.toml")
    values = board.effects[0].parameters
    assert values["tilt_5"].unit == "N*m"
    assert 0.14 < values["tilt_high"].value < 0.2  # a release is cut where a hand may have been felt
    called("check", LOG, *common)
    called("mjcf", *common, "--bench", "-o", tmp_path / "pink.xml")
    assert _nrmse(tmp_path / "pink.xml") < 0.01
    called("compare", LOG, *common)
    assert float(re.search(r"within tolerance: ([\d.]+) %", capsys.readouterr().out)[1]) < 1.0


def _nrmse(file):
    """Return how far plain MuJoCo's decay is from the log's first release, its roll and rate at the start fitted."""
    table = np.loadtxt(LOG, delimiter=",", skiprows=1)
    begin = int(1.5 * 400)  # rest, drag and hold come before
    time, roll = table[begin : begin + 400, 0] - table[begin, 0], table[begin : begin + 400, 1]
    model = mujoco.MjModel.from_xml_path(str(file))

    def simulated(start):
        data = mujoco.MjData(model)
        data.qpos[0], data.qvel[0] = start
        path = [start[0]]
        while data.time < time[-1]:
            mujoco.mj_step(model, data)
            path.append(float(data.qpos[0]))
        return CubicSpline(model.opt.timestep * np.arange(len(path)), path)(time)

    found = least_squares(lambda s: simulated(s) - roll, [roll[0], 0.0], diff_step=1e-4)
    noise = np.radians(0.03)
    return np.sqrt(max(np.mean(found.fun**2) - noise**2, 0.0) / np.mean(roll**2))
