"""Each effect of the catalogue: one law in two languages, the same motion in MuJoCo, honest texts."""

import mujoco
import numpy as np
import pytest

from sysid.effects import catalogue, effect, parameters_from
from sysid.effects._algebra import NUMPY
from sysid.effects._base import JointState, Scales
from sysid.errors import SysidError
from sysid.joint import JointLaw, simulate

SCALES = Scales(inertia=8.7e-3, stiffness=14.7, damping=0.4, amplitude=0.2)
BASE = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.05)
NAMES = tuple(catalogue())
DESIGN = {
    "coulomb", "stribeck", "quadratic-damping", "cubic-damping", "cubic-stiffness", "asymmetric-stiffness",
    "gravity", "end-stop", "freeplay", "preload", "offset", "viscoelastic", "hysteresis", "second-mode",
    "inertia", "discretisation", "sensor-bias", "sensor-drift", "clock", "lowpass", "bilinear-stiffness", "bouc-wen", "armature",
    "linkage", "linked-spring", "payload", "weight",
    "learned", "learned-memory", "dahl", "load-friction", "one-sided-stop", "hanging-body",
}  # fmt: skip


def test_catalogue_holds_every_effect_and_files_are_named_after_them():
    assert set(NAMES) == DESIGN
    for name in NAMES:
        assert effect(name).name == name


def test_an_unknown_effect_is_refused_with_the_nearest_name():
    with pytest.raises(SysidError, match="Did you mean 'coulomb'"):
        effect("colomb")


@pytest.mark.parametrize("name", NAMES)
def test_texts_units_and_bounds(name):
    part = effect(name)
    assert part.does.endswith(".")
    assert part.experiment.endswith(".")
    assert part.law
    assert part.source
    assert len(part.example) == len(part.parameters)
    for parameter, value in zip(part.parameters, part.example, strict=True):
        low, high = parameter.bounds(SCALES)
        assert low <= value <= high, parameter.name
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


def test_an_effect_says_itself_that_it_is_nonsmooth():
    """A joint is as sharp as its sharpest effect, and nonsmooth if one is."""
    from sysid.joint.structure import structure_of

    assert not structure_of(("coulomb", "cubic-stiffness")).nonsmooth
    joint = structure_of(("coulomb", "freeplay"))
    assert joint.nonsmooth
    assert joint.sharpness == effect("freeplay").sharpness > structure_of(()).sharpness == 1.0


def test_parameters_come_in_order_and_defaults_fill_the_end():
    assert parameters_from("end-stop", (0.1, 50.0)) == {"angle": 0.1, "stiffness": 50.0, "damping": 0.0}
    with pytest.raises(SysidError, match="half_width \\[rad\\]"):
        parameters_from("freeplay", (0.1, 2.0))


@pytest.mark.parametrize(
    ("name", "values", "tilt", "rate", "torque"),
    [
        ("cubic-stiffness", (200.0,), 0.1, 3.0, -0.2),
        ("asymmetric-stiffness", (25.0,), -0.2, 0.0, -1.0),
        ("quadratic-damping", (0.06,), 0.0, -2.0, 0.24),
        ("cubic-damping", (0.02,), 0.0, 2.0, -0.16),
        ("preload", (0.3,), 0.1, 1.0, 0.3),
        ("end-stop", (0.1, 60.0, 0.5), 0.15, 2.0, -4.0),
        ("end-stop", (0.1, 60.0, 0.5), 0.05, 2.0, 0.0),
        ("one-sided-stop", (0.1, 60.0, 0.5), 0.15, 2.0, -4.0),
        ("one-sided-stop", (0.1, 60.0, 0.5), -0.15, 2.0, 0.0),
        ("one-sided-stop", (-0.1, 60.0, 0.5), -0.15, 2.0, 2.0),
        ("one-sided-stop", (-0.1, 60.0, 0.5), 0.15, 2.0, 0.0),
        ("one-sided-stop", (0.0, 60.0, 0.5), 0.15, 2.0, 0.0),
        ("one-sided-stop", (-1e-6, 60.0, 0.5), -0.15, 2.0, 7.99994),
        ("bilinear-stiffness", (3.0,), 0.1, 0.0, -0.3),
        ("bilinear-stiffness", (3.0,), -0.1, 0.0, -0.3),
        ("freeplay", (0.02,), 0.15, 0.0, 14.684 * 0.02),
        ("freeplay", (0.02,), 0.01, 0.0, 14.684 * 0.01),
    ],
)
def test_torque_laws_by_hand(name, values, tilt, rate, torque):
    motion = JointState(tilt, rate, tilt, 14.684)
    got = effect(name).torque(NUMPY, motion, parameters_from(name, values), ())
    assert got == pytest.approx(torque, abs=1e-12)


def rig(law: JointLaw, timestep: float = 2e-5) -> mujoco.MjModel:
    """Return the bench with one effect, written as the exporter writes it."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    body = spec.worldbody.add_body(name="deck")
    body.explicitinertial = True
    body.mass = 2.584
    body.inertia = [law.inertia] * 3
    joint = body.add_joint(name="board_tilt_joint", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[1, 0, 0])
    joint.stiffness[0], joint.damping[0], joint.springref = law.stiffness, law.damping, law.rest_angle
    for name, values in law.effects:
        lines = effect(name).to_mjcf(spec, joint, parameters_from(name, values))
        assert all(name.split("-")[0] in line for line in lines)
    spec.option.timestep = timestep
    return spec.compile()


@pytest.mark.parametrize(
    "name",
    [
        n
        for n in NAMES
        if effect(n).role in ("torque", "learned", "support", "shift") and effect(n).mujoco.since
    ],
)
def test_mujoco_moves_as_the_law_does(name):
    """At a tiny step the written MJCF and the continuous law are the same motion."""
    law = BASE.with_effect(name, *effect(name).example)
    model = rig(law)
    data = mujoco.MjData(model)
    data.qpos[0] = 0.15
    if name == "second-mode":  # the support starts where both springs carry the same
        data.qpos[1] = 0.15 * law.stiffness / (law.stiffness + effect(name).example[1])
    if name == "dahl":  # its bristles bent as far as they go
        data.act[0] = effect(name).example[1]
    if name == "hysteresis":  # the slider as far as its spring lets the deck drag it
        data.qpos[1] = effect(name).example[1] / effect(name).example[0]
    time, roll = [], []
    while data.time < 0.3:
        time.append(data.time)
        roll.append(data.qpos[0])
        for _ in range(50):
            mujoco.mj_step(model, data)
    path = simulate(law, np.array(time), 0.15)
    plain = simulate(BASE, np.array(time), 0.15)
    error = np.sqrt(np.mean((path.roll - np.array(roll)) ** 2))
    size = np.sqrt(np.mean((path.roll - plain.roll) ** 2))
    # MuJoCo's dry friction is a stiff constraint, not a sign: a few per cent of the effect differ.
    share = 0.06 if effect(name).slides or name == "hysteresis" else 0.02
    assert error < max(share * size, 5e-5), (error, size)


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


def test_gravity_that_the_inertia_cannot_hold_is_refused():
    law = BASE.with_effect("gravity", 8.0)
    with pytest.raises(SysidError, match="more than the roll inertia"):
        rig(law)


def test_the_page_of_effects_is_what_the_catalogue_says():
    """docs/effects.md is generated; after a change run docs/make_effect_pictures.py."""
    import runpy
    from pathlib import Path

    docs = Path(__file__).parents[2] / "docs"
    page = runpy.run_path(str(docs / "make_effect_pictures.py"))["page"]()
    assert (docs / "effects.md").read_text(encoding="utf-8") == page
    for name in NAMES:
        assert (docs / "effects" / f"{name}.png").is_file()


def test_round_hysteresis_starts_steeply_and_yields():
    """Dragged slowly from rest the torque of Bouc and Wen is T (1 - exp(-x/a)); back again its slope is T/a."""
    part = effect("bouc-wen")
    values = parameters_from("bouc-wen", (0.3, 0.02, 0.5))
    m, share = NUMPY, part.states[0]
    for tilt in (0.005, 0.02, 0.1):
        z = share.start(m, tilt, 1.0, 14.684, values)
        assert z == pytest.approx(1 - np.exp(-tilt / 0.02))
        assert part.torque(m, JointState(tilt, 0.0, tilt, 14.684), values, (z,)) == pytest.approx(-0.3 * z)
    assert share.start(m, -0.1, 1.0, 14.684, values) == pytest.approx(-(1 - np.exp(-5)))
    away, back = (share.rate(m, JointState(0.1, rate, 0.1, 14.684), (0.9,), values) for rate in (1.0, -1.0))
    assert away == pytest.approx((1 - 0.9) / 0.02)
    assert back == pytest.approx(-1.0 / 0.02)


def test_every_effect_belongs_to_a_family_of_things_that_look_the_same():
    for name in NAMES:
        kin = [other for other in NAMES if effect(other).family == effect(name).family]
        assert name in kin
    assert effect("bilinear-stiffness").family == effect("asymmetric-stiffness").family == "asymmetry"
    assert effect("bouc-wen").family == effect("hysteresis").family == "hysteresis"


@pytest.mark.parametrize(("name", "side"), [("end-stop", 1), ("one-sided-stop", 1), ("one-sided-stop", -1)])
def test_a_stop_takes_the_impulse_of_a_damper_that_sets_in_at_once(name: str, side: int):
    """Over the range in which it sets in, it takes what the sharp law takes beyond the angle; no more before, no less after."""
    from sysid.effects.end_stop import RAMP

    angle, damping = 0.12, 0.4
    reach = np.linspace(0.0, 0.2, 20001)
    tilt = side * reach
    parameters = {"angle": side * angle, "stiffness": 0.0, "damping": damping}
    motion = JointState(tilt, np.ones_like(tilt), tilt, 14.7)
    torque = effect(name).torque(NUMPY, motion, parameters, ())
    assert np.trapezoid(torque, reach) == pytest.approx(-damping * (0.2 - angle), rel=1e-3)
    assert np.all(torque[reach < angle * (1 - RAMP)] == 0)
    width = RAMP * angle
    assert np.abs(np.diff(torque)).max() < 1.01 * damping * reach[1] / width, "no jump"


def test_an_experiment_on_a_slide_goes_no_farther_than_it_was_moved():
    """A model without limits leaves its range open."""
    from dataclasses import replace

    from sysid.board import Board

    board = Board.load("pink").of_slide()
    board = replace(board, tilt={**board.tilt, "range": replace(board.tilt["range"], value=0.05)})
    far = replace(board, tilt={**board.tilt, "range": replace(board.tilt["range"], value=3.0)})
    assert far.experiment("quadratic-damping", 0.05) == board.experiment("quadratic-damping", 0.05)
    assert far.experiment("quadratic-damping") != board.experiment("quadratic-damping", 0.05)
