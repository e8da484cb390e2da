"""`mjcf --usd`: a board as OpenUSD where that can hold its physics, a refusal where it cannot."""

import importlib.util

import mujoco
import pytest
from command_line import husky

from sim.usd import lost_in_usd

POLE = '<mujoco>{0}<worldbody><body><joint name="j" damping="{1}" stiffness="{2}"/><geom size=".1"/></body></worldbody></mujoco>'
NUMBERS = '<custom><numeric name="n" data="1"/></custom>'


@pytest.mark.parametrize(
    ("numbers", "lost"),
    [
        (("", "0.1", "2"), []),
        (("", "0.1 0.02", "2"), ["damping polynomial of 'j'"]),
        (("", "0.1", "2 0 30"), ["stiffness polynomial of 'j'"]),
        ((NUMBERS, "0.1", "2"), ["custom numbers 'n' of a learned torque"]),
    ],
)
def test_physics_that_usd_drops_is_named(numbers, lost):
    assert lost_in_usd(mujoco.MjSpec.from_string(POLE.format(*numbers))) == lost


def mjcf(folder, *options: str):
    return husky("mjcf", "--board", "pink", "--bench", "--usd", "--workspace", folder, *options)


def test_a_board_becomes_usd_or_the_extra_is_named(tmp_path):
    done = mjcf(tmp_path, "-o", tmp_path / "pink.usda")
    if importlib.util.find_spec("mujoco_usd_converter") is None:
        assert done.returncode == 1
        assert "[usd]" in done.stderr
        assert not (tmp_path / "pink.usda").exists()
        return
    assert done.returncode == 0, done.stderr
    assert "newton:damping" in (tmp_path / "pink.usda").read_text()


def test_another_ending_is_refused(tmp_path):
    done = mjcf(tmp_path, "-o", tmp_path / "pink.xml")
    assert done.returncode == 1
    assert "a USD file ends in .usd" in done.stderr
