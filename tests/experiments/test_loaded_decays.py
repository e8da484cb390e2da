"""The spring under load from decays with weights, against MuJoCo's own frequencies."""

import json
import math

import mujoco
import numpy as np
import pytest
from command_line import called

from sysid.errors import SysidError
from sysid.experiments.loaded_decays import LoadedDecay, loaded_stiffness
from sysid.quantity import Quantity

INERTIA = Quantity(8.7e-3, 1e-5, "kg*m^2", "")


def exactly(value, unit, std=0.0):
    return Quantity(value, std, unit, "")


def frequency(mass, height, own, stiffness):
    """Return ω of a deck on a hinge with a weight above it [rad/s], from zero crossings of MuJoCo's motion."""
    xml = f"""<mujoco><option timestep="1e-3" integrator="RK4"/><worldbody><body>
      <joint name="tilt" type="hinge" axis="1 0 0" stiffness="{stiffness}"/>
      <inertial pos="0 0 0" mass="1e-6" diaginertia="{INERTIA.value} {INERTIA.value} {INERTIA.value}"/>
      <body name="weight" pos="0 0 {height}"><inertial pos="0 0 0" mass="{max(mass, 1e-9)}" diaginertia="{own} {own} {own}"/></body>
      </body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qpos[0] = 0.01
    times, before = [], 0.01
    while len(times) < 6:
        mujoco.mj_step(model, data)
        now = float(data.qpos[0])
        if before * now <= 0:
            times.append(data.time - 1e-3 * now / (now - before))
        before = now
    return math.pi / float(np.mean(np.diff(times)))


def reading(mass, height, stiffness, relative=1e-3, rng=None):
    own = 0.001 * mass + 1e-6
    omega = frequency(mass, height, own, stiffness)
    if rng is not None:
        omega *= 1 + relative * rng.standard_normal()
    return LoadedDecay(
        mass=exactly(mass, "kg"),
        height=exactly(height, "m"),
        own=exactly(own, "kg*m^2"),
        natural_frequency=exactly(omega, "rad/s", relative * omega),
    )


@pytest.mark.parametrize("per_newton", [0.0, 0.05])
def test_a_spring_that_stiffens_with_its_load_is_told_from_one_that_does_not(per_newton):
    rng = np.random.default_rng(1)
    masses = (0.0, 2.0, 5.0, 8.0, 10.0)
    readings = [reading(m, 0.08, 15.0 + per_newton * m * 9.81, rng=rng) for m in masses]
    found = loaded_stiffness(readings, INERTIA)
    for quantity, truth in (
        (found.bare, 15.0),
        (found.per_newton, per_newton),
        (found.under(327.0), 15 + 327 * per_newton),
    ):
        low, high = quantity.ci95
        assert low < truth < high
    assert found.per_newton.std < 0.005
    assert found.under(327.0).std > found.under(50.0).std  # far beyond the weights tried


def test_the_command_takes_readings_and_results_of_decays(tmp_path, capsys):
    words = ["loaded", "-b", "pink", "--json", tmp_path / "r.json"]
    for mass in (0.0, 3.0, 6.0):
        one = reading(mass, 0.1, 15.0)
        omega = one.natural_frequency
        text = f"{omega.value}±{2 * omega.std}"
        if mass == 3.0:
            (tmp_path / "d.json").write_text(json.dumps({"omega_n": omega.to_json()}))
            text = str(tmp_path / "d.json")
        words += ["--reading", f"{mass},{one.height.value},{text},{one.own.value}"]
    called(*words)
    said = capsys.readouterr()
    assert "the load does not change the spring significantly" in said.out
    assert "extrapolated" in said.err
    assert json.loads((tmp_path / "r.json").read_text())["bare"]["value"] == pytest.approx(15.0, rel=0.01)
    with pytest.raises(SysidError, match=r"expected MASS,HEIGHT,OMEGA"):
        called("loaded", "-b", "pink", "--reading", "1,2")
    with pytest.raises(SysidError, match=r"none.json: cannot read it"):
        called("loaded", "-b", "pink", "--reading", "1,0,none.json")


def test_what_makes_no_line_is_refused():
    one = reading(2.0, 0.05, 15.0)
    with pytest.raises(SysidError, match=r"2 decays \(--reading\); .* needs at least 3"):
        loaded_stiffness([one, one], INERTIA)
    with pytest.raises(SysidError, match="under the same weight"):
        loaded_stiffness([one, one, one], INERTIA)
