"""Each effect of the catalogue: one law in two languages, the same motion in MuJoCo, honest texts."""

import mujoco
import numpy as np
import pytest

from sysid.effects import catalogue, effect, parameters_from
from sysid.effects._algebra import NUMPY
from sysid.effects._base import JointState, Scales
from sysid.errors import SysidError
from sysid.joint import JointLaw

SCALES = Scales(inertia=8.7e-3, stiffness=14.7, damping=0.4, amplitude=0.2)
BASE = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.05)
NAMES = tuple(catalogue())
DESIGN = {
    "coulomb", "stribeck", "quadratic-damping", "cubic-damping", "cubic-stiffness", "asymmetric-stiffness",
    "gravity", "end-stop", "freeplay", "preload", "offset", "viscoelastic", "hysteresis", "second-mode",
    "inertia", "discretisation", "sensor-bias", "sensor-drift", "clock", "lowpass", "bilinear-stiffness", "bouc-wen", "armature",
    "linkage", "linked-spring", "payload", "weight",
    "learned", "dahl", "load-friction", "one-sided-stop", "hanging-body",
}  # fmt: skip


def test_names_of_records_stay_known():
    assert set(NAMES) >= DESIGN
    for name in NAMES:
        assert effect(name).name == name


@pytest.mark.parametrize("name", NAMES)
def test_texts_units_and_bounds(name):
    part = effect(name)
    assert part.does.endswith(".")
    assert part.experiment.endswith(".")
    assert part.law
    assert part.source
    assert len(part.example) == len(part.parameters)
    for parameter, value in zip(part.parameters, part.example, strict=True):
        assert parameter.low <= value / parameter.size(SCALES) <= parameter.high, parameter.name
        for start in parameter.starts:
            assert parameter.low <= start <= parameter.high
    for other in part.look_alikes:
        assert other in NAMES or " " in other


@pytest.mark.parametrize("name", NAMES)
def test_experiments_are_in_the_unit_of_the_joint(name):
    """The floor and a sensor are tilted by degrees; a joint that slides is let go at mm within its range."""
    from dataclasses import replace

    from sysid.board import Board

    board = Board.load("pink")
    turns, slides = board.experiment(name), board.of_slide()
    slides = replace(slides, tilt={**slides.tilt, "range": replace(slides.tilt["range"], value=0.05)})
    assert turns == effect(name).experiment_on()
    assert "{" not in turns + slides.experiment(name)
    released = slides.experiment(name)
    assert ("mm" in released) == ("{" in effect(name).experiment)
    assert "°" not in released.split(":")[0] or "tilt the floor" in released.lower()


@pytest.mark.parametrize("name", [n for n in NAMES if effect(n).role in ("torque", "support")])
def test_steps_are_as_fine_as_the_law_is_sharp(name):
    """With the steps of a final fit the integration changes χ² of 6000 samples at 0.04° by less than chance does."""
    from sysid.fitting.joint import FitOptions
    from sysid.joint.hermite import hermite_matrix
    from sysid.joint.integrator import Rollout, build_stepper, steps_for

    law = BASE.with_effect(name, *effect(name).example)
    time = np.arange(0.0, 2.0, 1e-3)

    def roll(steps_per_period: float) -> np.ndarray:
        stepper = build_stepper(law.structure, free_states=False, sensitivities=False)
        h = 2 * np.pi / law.frequency / steps_per_period
        steps = steps_for(float(time[-1]), h)
        start = np.asarray(stepper.initial(law.vector, [0.15, 0.0], 1.0)).ravel()
        return hermite_matrix(time, h, steps) @ Rollout(stepper, steps)(start, np.append(law.vector, h))[:, 0]

    steps = FitOptions().steps_per_period * (3 if law.structure.nonsmooth else 1)
    coarse, fine = (roll(steps * factor) for factor in (1, 8))
    assert 3 * np.sum((coarse - fine) ** 2) < (10 if law.structure.nonsmooth else 1) * np.radians(0.04) ** 2


def test_parameters_come_in_order_and_defaults_fill_the_end():
    assert parameters_from("end-stop", (0.1, 50.0)) == {"angle": 0.1, "stiffness": 50.0, "damping": 0.0}
    with pytest.raises(SysidError, match="half_width \\[rad\\]"):
        parameters_from("freeplay", (0.1, 2.0))


@pytest.mark.parametrize(
    ("name", "values", "tilt", "rate", "torque"),
    [
        ("one-sided-stop", (0.1, 60.0, 0.5), 0.15, 2.0, -4.0),
        ("one-sided-stop", (0.1, 60.0, 0.5), -0.15, 2.0, 0.0),
        ("one-sided-stop", (-0.1, 60.0, 0.5), -0.15, 2.0, 2.0),
        ("one-sided-stop", (-0.1, 60.0, 0.5), 0.15, 2.0, 0.0),
        ("one-sided-stop", (0.0, 60.0, 0.5), 0.15, 2.0, 0.0),
        ("one-sided-stop", (-1e-6, 60.0, 0.5), -0.15, 2.0, 7.99994),
        ("bilinear-stiffness", (3.0,), 0.1, 0.0, -0.3),
        ("bilinear-stiffness", (3.0,), -0.1, 0.0, -0.3),
    ],
)
def test_torque_laws_by_hand(name, values, tilt, rate, torque):
    motion = JointState(tilt, rate, tilt, 14.684)
    got = effect(name).torque(NUMPY, motion, parameters_from(name, values), ())
    assert got == pytest.approx(torque, abs=1e-12)


def test_measurement_effects_are_never_written_into_the_model():
    spec = mujoco.MjSpec()
    joint = spec.worldbody.add_body().add_joint()
    before = joint.springref
    for name in NAMES:
        if effect(name).role == "measurement":
            assert effect(name).to_mjcf(spec, joint, parameters_from(name, effect(name).example)) == ()
    assert joint.springref == before
    assert not spec.tendons
    assert not spec.actuators


def test_the_page_of_effects_is_what_the_catalogue_says():
    """docs/effects.md is generated; after a change run docs/make_effect_pictures.py."""
    import runpy
    from pathlib import Path

    docs = Path(__file__).parents[2] / "docs"
    page = runpy.run_path(str(docs / "make_effect_pictures.py"))["page"]()
    assert (docs / "effects.md").read_text(encoding="utf-8") == page
    for name in NAMES:
        assert (docs / "effects" / f"{name}.png").is_file()
