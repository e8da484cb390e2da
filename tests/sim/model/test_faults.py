"""Models that falsify a fit: an upright zero, a powered servo, disabled physics, tendons, soft friction, URDF."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from command_line import husky

from sim.model.faults import warnings_of
from sim.model.setup import Setup
from sim.model.subject import board_of

TRUTH = {"damping": 0.02, "coulomb.torque": 0.012, "armature.inertia": 0.004}


def model_of(folder: Path, *, down: bool = True, joint: str = "", head: str = "", tail: str = "") -> Path:
    """Write a pole on a hinge, which hangs down or stands up at zero."""
    path = folder / "pole.xml"
    path.write_text(
        f'<mujoco>{head}<worldbody><body name="b" pos="0 0 1"><joint name="h" axis="0 1 0" damping=".05" {joint}/>'
        f'<geom type="capsule" fromto="0 0 0 0 0 {-0.35 if down else 0.35}" size=".02" mass=".6"/></body></worldbody>{tail}</mujoco>'
    )
    return path


def log_of(path: Path, model: Path, starts: tuple[float, ...], *, hard: bool = True, **truth: float) -> Path:
    """Release the model from these angles with another truth, in steps of 0.4 ms, and write a noisy log."""
    spec = mujoco.MjSpec.from_file(str(model))
    compiled = spec.compile()
    compiled.opt.timestep = 4e-4
    compiled.opt.disableflags = 0
    dof = int(compiled.joint("h").dofadr[0])
    compiled.dof_damping[dof] = truth["damping"]
    compiled.dof_armature[dof] = truth.get("armature.inertia", 0.0)
    compiled.dof_frictionloss[dof] = truth.get("coulomb.torque", 0.0)
    if hard:
        compiled.dof_solref[dof], compiled.dof_solimp[dof] = (8e-4, 1), (0.9999, 0.9999, 0.001, 0.5, 2)
    pieces: list[np.ndarray] = []
    for start in starts:
        data = mujoco.MjData(compiled)
        data.qpos[compiled.joint("h").qposadr[0]] = data.ctrl[:] = start
        swing = []
        for number in range(10_000):
            if number == 1:
                data.ctrl[:] = 0.0
            if number % 10 == 0:
                swing.append(float(data.joint("h").qpos[0]))
            mujoco.mj_step(compiled, data)
        share = np.linspace(0, 1, 150)
        led = 10 * share**3 - 15 * share**4 + 6 * share**5
        before = [pieces[-1][-1] + (start - pieces[-1][-1]) * led] if pieces else []
        pieces += [*before, np.full(150, start), np.array(swing)]
    angle = np.concatenate(pieces)
    angle += 1e-3 * np.random.default_rng(1).standard_normal(len(angle))
    table = np.column_stack([0.004 * np.arange(len(angle)), angle])
    np.savetxt(path, table, delimiter=",", header="time_s,angle_rad", comments="", fmt="%.6f")
    return path


def fitted(log: Path, model: Path, folder: Path, *options: str, code: int = 0):
    done = husky(
        "fit", log, "--model", model, "--joint", "h", *options, "--workspace", folder, "-o", folder / f"out{model.suffix}",
        "--json", folder / "fit.json",
    )  # fmt: skip
    assert done.returncode == code, done.stderr
    found = json.loads((folder / "fit.json").read_text())["parameters"] if code == 0 else {}
    return done, {name: (q["value"], q["std"]) for name, q in found.items()}


def assert_found(found: dict[str, tuple[float, float]], truth: dict[str, float]) -> None:
    """Each value lies within 4 % and 5 standard deviations of the truth: the log's own step costs some of it."""
    for name, value in truth.items():
        assert abs(found[name][0] - value) < 0.04 * value + 5 * found[name][1], (name, found[name])


def test_a_pole_whose_zero_is_upright_keeps_its_angles_and_gets_no_spring(tmp_path):
    model = model_of(tmp_path, down=False)
    assert board_of(Setup(file=model, joint="h"))[0].rest_angle == pytest.approx(np.pi)
    log = log_of(tmp_path / "log.csv", model, (np.pi - 1.3, np.pi + 0.9), **TRUTH)
    done, found = fitted(log, model, tmp_path, "--effect", "coulomb", "--effect", "armature")
    assert_found(found, TRUTH)
    assert "stiffness" not in found
    assert "that zero is the sensor's" not in done.stderr
    assert "stiffness=" not in (tmp_path / "out.xml").read_text()
    checked = husky(
        "check", log, "--model", tmp_path / "out.xml", "--joint", "h", "--timestep", "0.0005", "--workspace", tmp_path,
    )  # fmt: skip
    assert checked.returncode == 0, checked.stderr


@pytest.mark.parametrize("slack", ['springlength="0"', 'springlength="-.2 .3"'])
def test_a_tendon_counts_once(tmp_path, slack):
    tail = '<tendon><fixed stiffness="1.2" SLACK damping=".015" frictionloss=".004"><joint joint="h" coef="1"/></fixed></tendon>'
    model = model_of(tmp_path, tail=tail.replace("SLACK", slack))
    board, notes = board_of(Setup(file=model, joint="h"))
    assert board.damping == pytest.approx(0.05 + 0.015)
    assert any("spring 1.2 N·m/rad, damping 0.015 N·m·s/rad, dry friction 0.004" in note for note in notes)
    log = log_of(tmp_path / "log.csv", model, (0.9, -0.7), **{**TRUTH, "damping": 0.04})
    fitted(log, model, tmp_path, "--effect", "armature")
    copy = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
    assert copy.tendon_stiffness[0] == 1.2
    assert copy.jnt_stiffness[0] == 0
    assert copy.dof_damping[0] == pytest.approx(0.04, rel=0.04)
    assert copy.dof_armature[0] == pytest.approx(0.004, rel=0.04)
    assert copy.dof_frictionloss[0] == pytest.approx(0.012, rel=0.1)


def test_a_servo_that_was_on_is_named_and_no_rotor_is_negative(tmp_path):
    model = model_of(
        tmp_path, tail='<actuator><position name="arm_servo" joint="h" kp="8" kv=".1"/></actuator>'
    )
    log = log_of(tmp_path / "log.csv", model, (0.8, -0.6), damping=0.05)
    done, _ = fitted(log, model, tmp_path, "--effect", "armature", code=1)
    assert "armature (the rotor's inertia) -" in done.stderr
    assert (
        "actuator 'arm_servo' (holds with 8 N·m/rad, brakes with 0.1 N·m·s/rad) on in the measurement?"
        in done.stderr
    )
    assert not (tmp_path / "out.xml").exists()
    assert not (tmp_path / "data").exists()
    checked = husky(
        "check", log, "--model", model, "--joint", "h", "--timestep", "0.0005", "--workspace", tmp_path
    )
    assert checked.returncode == 3
    assert "with its actuators on" in checked.stderr


@pytest.mark.parametrize("hard", [True, False])
def test_soft_frictionloss_is_told_from_real_friction(tmp_path, hard):
    model = model_of(tmp_path)
    log = log_of(tmp_path / "log.csv", model, (0.5, -0.4), hard=hard, **TRUTH)
    done, found = fitted(log, model, tmp_path, "--effect", "coulomb", "--effect", "armature")
    assert ("MuJoCo's default frictionloss" in done.stderr) is not hard
    if hard:
        assert_found(found, TRUTH)


@pytest.mark.parametrize(
    ("joint", "down", "presses"),
    [
        ('range="-100 -20" limited="true"', True, True),
        ('range="-80 80" limited="true"', False, True),
        ('range="-100 20" limited="true"', True, False),
        ('range="20 100" limited="true" stiffness="30" springref="40"', True, False),
        ('range="20 100" limited="true" stiffness="3" springref="10"', True, True),
    ],
)
def test_a_rest_on_a_limit_is_told_before_the_fit(tmp_path, joint, down, presses):
    said = warnings_of(Setup(file=model_of(tmp_path, joint=joint, down=down), joint="h"))
    assert any("rests against the end of its range" in text for text in said) is presses


URDF = """<?xml version="1.0"?>
<!-- <mujoco/> -->
<robot name="arm"><link name="base"/>
<link name="l"><inertial><origin xyz="0 0 -.15"/><mass value=".5"/><inertia ixx=".004" iyy=".004" izz=".0002" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="h" type="revolute"><!-- the joint --><parent link="base"/><child link="l"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="10" velocity="10"/>DYNAMICS</joint></robot>
"""


@pytest.mark.parametrize(
    "dynamics", ["", '<dynamics damping=".05"/>', '<dynamics friction="0.0" damping="0.05" />']
)
def test_a_urdf_gets_damping_and_friction(tmp_path, dynamics):
    model = tmp_path / "arm.urdf"
    model.write_text(URDF.replace("DYNAMICS", dynamics))
    log = log_of(tmp_path / "log.csv", model, (0.9, -0.7), **TRUTH)
    done, found = fitted(log, model, tmp_path, "--effect", "coulomb", "--effect", "armature")
    assert_found(found, TRUTH)
    assert done.stderr.index("a URDF holds a joint's damping") < done.stderr.index("log.csv")
    assert 'a URDF cannot hold it: armature="0.00' in done.stderr
    copy = mujoco.MjModel.from_xml_path(str(tmp_path / "out.urdf"))
    assert copy.dof_damping[0] == pytest.approx(0.02, rel=0.05)
    assert copy.dof_frictionloss[0] == pytest.approx(0.012, rel=0.05)
    assert "<!-- the joint -->" in (tmp_path / "out.urdf").read_text()
