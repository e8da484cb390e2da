"""A fitted joint in a copy of the user's file: only that joint changes, and the copy compiles to what was fitted."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import robots

from sim.model.patch import patch
from sim.model.setup import Setup
from sim.model.subject import board_of
from sysid.board import Board, BoardEffect
from sysid.errors import SysidError
from sysid.quantity import Quantity


def with_effects(board: Board, **effects: dict[str, tuple[float, str]]) -> Board:
    new = tuple(
        BoardEffect(
            name.replace("_", "-"),
            {key: Quantity(value, 0.0, unit) for key, (value, unit) in parameters.items()},
        )
        for name, parameters in effects.items()
    )
    names = {part.name for part in new}
    return replace(board, effects=(*(part for part in board.effects if part.name not in names), *new))


def knee(folder) -> tuple[Setup, Board]:
    setup = Setup(file=robots.write(folder)["arm"], joint="knee")
    board = board_of(setup)[0].with_tilt(damping=Quantity(0.034, 0.001, "N*m*s/rad"))
    return setup, with_effects(
        board, coulomb={"torque": (0.021, "N*m")}, armature={"inertia": (0.002, "kg*m^2")}
    )


def test_only_the_joint_changes_and_the_copy_compiles_to_what_was_fitted(tmp_path):
    setup, board = knee(tmp_path)
    made = patch(setup, board)
    main, part = made.save(tmp_path / "mended.xml")
    assert (main.name, part.name) == ("mended.xml", "mended_link.xml")
    assert main.read_text() == robots.ARM.replace("parts/link.xml", "parts/mended_link.xml")
    before, after = robots.LINK.splitlines(), part.read_text().splitlines()
    changed = [(old, new) for old, new in zip(before, after, strict=True) if old != new]
    assert len(changed) == 1
    old, new = changed[0]
    assert new.startswith(old.removesuffix("/>"))
    assert new.strip().removeprefix('range="-150 150" ') == (
        'damping="0.034" armature="0.003" frictionloss="0.021" solreffriction="0.002 1" '
        'solimpfriction="0.9999 0.9999 0.001 0.5 2"/>'
    )
    assert f"-{old}\n+{new}\n" in made.diff
    assert (tmp_path / "parts" / "link.xml").read_text() == robots.LINK
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "mended.xml"))
    assert model.dof_armature.tolist() == [0.003, 0.0]
    assert model.dof_damping.tolist() == [0.034, 0.02]
    assert model.dof_frictionloss.tolist() == [0.021, 0.0]
    again = board_of(Setup(file=tmp_path / "mended.xml", joint="knee"))[0]
    assert again.inertia.value == pytest.approx(board.inertia.value + 0.002)
    assert again.damping == pytest.approx(board.damping)


def test_a_spring_that_rests_beyond_the_range_is_told(tmp_path):
    """A log whose zero is not the model's: MuJoCo would hold the joint at its limit."""
    setup, board = knee(tmp_path)  # which ends at 150 degrees
    for rest, leans in ((0.1, False), (3.0, True)):
        tilt = {"stiffness": Quantity(2.0, 0.01, "N*m/rad"), "rest_angle": Quantity(rest, 0.001, "rad")}
        said = " ".join(patch(setup, board.with_tilt(**tilt)).remarks)
        assert ("rests against the end of its range at 150°" in said) is leans


def test_degrees_stay_degrees(tmp_path):
    setup, board = knee(tmp_path)
    board = board.with_tilt(stiffness=Quantity(2.0, 0.0, "N*m/rad"), rest_angle=Quantity(0.1, 0.0, "rad"))
    patch(setup, board).save(tmp_path / "mended.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "mended.xml"))
    assert float(model.qpos_spring[0]) == pytest.approx(0.1)
    assert 'springref="5.729578"' in (tmp_path / "parts" / "mended_link.xml").read_text()


def test_what_an_effect_adds_becomes_a_section_of_its_own(tmp_path):
    setup, board = knee(tmp_path)
    board = with_effects(
        board, end_stop={"angle": (0.6, "rad"), "stiffness": (8.0, "N*m/rad"), "damping": (0.0, "N*m*s/rad")}
    )
    patch(setup, board).save(tmp_path / "mended.xml")
    text = (tmp_path / "mended.xml").read_text()
    assert text.startswith(
        robots.ARM.removesuffix("</mujoco>\n").replace("parts/link.xml", "parts/mended_link.xml")
    )
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "mended.xml"))
    assert model.ntendon == 1
    assert model.tendon_lengthspring[0] == pytest.approx(np.array([-0.6, 0.6]) + board.rest_angle, abs=1e-5)


def with_mesh(folder) -> tuple[Setup, Board]:
    """Return the knee in a model with a mesh, which an include of an include names."""
    setup, board = knee(folder)
    (folder / "parts" / "mesh.xml").write_text(
        '<mujocoinclude><asset><mesh file="t.obj"/></asset></mujocoinclude>'
    )
    (folder / "parts" / "more.xml").write_text(
        '<mujocoinclude><include file="parts/mesh.xml"/></mujocoinclude>'
    )
    (folder / "meshes").mkdir()
    corners, faces = ("0 0 0", "1 0 0", "0 1 0", "0 0 1"), ("1 3 2", "1 2 4", "1 4 3", "2 3 4")
    lines = [*(f"v {one}" for one in corners), *(f"f {one}" for one in faces)]
    (folder / "meshes" / "t.obj").write_text("\n".join(lines))
    text = setup.file.read_text().replace('angle="degree"', 'angle="degree" meshdir="meshes"')
    setup.file.write_text(text.replace("</mujoco>", '<include file="parts/more.xml"/></mujoco>'))
    return setup, board


def test_a_copy_in_another_folder_finds_meshes_and_includes(tmp_path):
    setup, board = with_mesh(tmp_path / "model")
    stood = {path for path in (tmp_path / "model").rglob("*") if path.is_file()}
    first, *others = patch(setup, board).save(tmp_path / "elsewhere" / "mended.xml")
    model = mujoco.MjModel.from_xml_path(str(first))
    assert (model.nmesh, model.dof_damping[0]) == (1, 0.034)
    assert {path.parent for path in (first, *others)} == {tmp_path / "elsewhere"}
    assert stood == {path for path in (tmp_path / "model").rglob("*") if path.is_file()}


@pytest.mark.parametrize("own", ["", '<mujoco><compiler meshdir="meshes" strippath="true"/></mujoco>'])
def test_a_urdf_in_another_folder_finds_its_meshes(tmp_path, own):
    with_mesh(tmp_path / "model")
    file = "package://arm/meshes/t.obj" if own else "meshes/t.obj"
    mesh = f'<collision><geometry><mesh filename="{file}"/></geometry></collision>'
    inertial = '<inertial><origin xyz="0 0 -.1"/><mass value=".5"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>'
    joint = '<joint name="h" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint>'
    urdf = tmp_path / "model" / "arm.urdf"
    urdf.write_text(
        f'<robot name="r">{own}<link name="a"/><link name="b">{inertial}{mesh}</link>{joint}</robot>'
    )
    setup = Setup(file=urdf, joint="h")
    board = board_of(setup)[0].with_tilt(damping=Quantity(0.034, 0.001, "N*m*s/rad"))
    (copy,) = patch(setup, board).save(tmp_path / "elsewhere" / "mended.urdf")
    model = mujoco.MjModel.from_xml_path(str(copy))
    assert (model.nmesh, model.dof_damping[0]) == (1, 0.034)


def test_a_joint_from_elsewhere_is_refused(tmp_path):
    robots.write(tmp_path)
    (tmp_path / "two.xml").write_text(
        '<mujoco><asset><model name="s" file="slider.xml"/></asset><worldbody><frame>'
        '<attach model="s" body="cart" prefix="left_"/></frame></worldbody></mujoco>'
    )
    setup = Setup(file=tmp_path / "two.xml", joint="left_lift")
    with (
        pytest.warns(UserWarning, match="Attach conflict"),
        pytest.raises(SysidError, match="attached or replicated"),
    ):
        patch(setup, board_of(setup)[0])
