"""Effects of the user's own: one file anywhere, listed, fitted, recorded with its file, and refused in one line."""

import numpy as np
import pytest
from command_line import husky
from light_board import BOARD, NOISE, releases

import sysid.effects
from sysid.board import load_board, save_board
from sysid.effects import _own, catalogue, effect, effect_file, origin, use_file
from sysid.effects._base import Scales
from sysid.errors import SysidError
from sysid.fitting.joint import fit_joint
from sysid.fitting.record_update import updated_board
from sysid.workspace import Workspace


@pytest.fixture(autouse=True)
def fresh(monkeypatch):
    """A catalogue without files, before and after."""
    monkeypatch.setenv(_own.FILES, "")
    catalogue.cache_clear()
    yield
    catalogue.cache_clear()


@pytest.fixture
def mine(tmp_path):
    """The file that the template makes."""
    path = tmp_path / "my_effect.py"
    path.write_text(effect_file("my-effect"), encoding="utf-8")
    return path


def test_the_template_works_at_once(mine, tmp_path):
    """It is found, fitted, recorded with its file, read back and written into MuJoCo; the record says which file it needs."""
    from sim.compensation.scene import bench_scene
    from sysid.joint import JointLaw, simulate

    name = use_file(mine)
    assert name == "my-effect"
    assert origin(name) == str(mine)
    fit = fit_joint(releases(lambda t, x, v: -3000 * x**5), BOARD, [name])
    found = fit.quantities["my-effect.coefficient"]
    assert abs(found.value - 3000) < 4 * found.std < 1500
    assert fit.rmse < 1.08 * NOISE
    board = updated_board(BOARD, fit, {}, heldout=fit.rmse)
    (tmp_path / "data/boards").mkdir(parents=True)
    save_board(board, tmp_path / "data/boards/pink.toml")
    assert load_board(tmp_path / "data/boards/pink.toml").effects[0].file == str(mine)
    time = np.linspace(0, 0.5, 100)
    truth = simulate(JointLaw.from_board(board), time, 0.17).roll
    assert np.interp(time, *bench_scene(board, timestep=1e-4).swing(0.17, 0.0, 0.5)) == pytest.approx(
        truth, abs=2e-3
    )
    sysid.effects._own.os.environ[_own.FILES] = ""
    catalogue.cache_clear()
    with pytest.raises(SysidError, match=r"--effect-file .*my_effect\.py"):
        Workspace(tmp_path).load_board("pink")


def test_a_state_of_a_sensor_starts_from_the_angle_itself(tmp_path):
    """It reads the joint's angle, wherever the joint rests."""
    from sysid.joint import JointLaw, simulate

    path = tmp_path / "late.py"
    path.write_text(
        "from dataclasses import replace\nfrom sysid.effects.lowpass import EFFECT as LOWPASS\n"
        "EFFECT = replace(LOWPASS, name='late', states=(replace(LOWPASS.states[0], sensed=None),))\n"
    )
    law = JointLaw(inertia=8.7e-3, stiffness=14.7, damping=0.1, rest_angle=0.1)
    seen = simulate(law.with_effect(use_file(path), 0.01), np.linspace(0.0, 0.5, 100), 0.2).roll
    assert seen[0] == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("EFFECT = 3", "EFFECT is of type int; expected TorqueEffect"),
        ("import nothere", "line 1, ModuleNotFoundError"),
        ("x = ", "SyntaxError"),
        (effect_file("My Effect"), "expected small letters"),
        (effect_file("my-effect", law="max(x, 0.0)"), "its torque does not run"),
        (effect_file("my-effect", law='parameters["stiff"] * x'), "its torque does not run"),
        (effect_file("my-effect", law="0.0 / x"), "expected finite numbers"),
        (effect_file("coulomb"), "there is an effect 'coulomb' already"),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_wrong_file_gets_one_clear_line(text, said, tmp_path):
    path = tmp_path / "wrong.py"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SysidError) as error:
        use_file(path)
    assert said in str(error.value)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_effects_are_listed_shown_and_begun(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert husky("effects", "new", "my_effect").returncode == 0
    listed = husky("effects", "--effect-file", "my_effect.py").stdout
    assert "my_effect.py" in listed
    assert all(name in listed for name in ("coulomb", "learned", "my-effect"))
    assert "catalogue" in listed
    assert "my_effect.py: there is such a file" in husky("effects", "new", "my_effect").stderr
    shown = husky("effects", "my-effect", "--effect-file", "my_effect.py", "-o", "my-effect.png")
    assert "x⁵" in shown.stdout
    assert (tmp_path / "my-effect.png").is_file()
    assert effect("my-effect").law == "τ = -c x⁵"


def test_a_parameter_of_an_unusual_unit_needs_a_size():
    with pytest.raises(SysidError, match=r"'lumen': 'lm' has no usual size.*size=lambda"):
        sysid.effects.Parameter("lumen", "lm", low=0.0, high=1.0)
    scales = Scales(inertia=2.0, stiffness=8.0, damping=0.1, amplitude=0.5)
    assert sysid.effects.Parameter("rest", "N*m", low=0.0, high=1.0).size(scales) == 4.0
