"""From posterior and fits to a verdict: odds of exact fits, deviations from the record, what is named."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sysid.board import load_board
from sysid.diagnosis.evidence import log_odds
from sysid.diagnosis.exact import is_possible, sizes_of, weigh
from sysid.diagnosis.experiment import deciding, in_words
from sysid.diagnosis.posterior import Found, Size
from sysid.diagnosis.record import record_deviation
from sysid.diagnosis.verdict import decide, matters
from sysid.fitting.joint import fit_joint
from sysid.joint.law import JointLaw
from sysid.joint.trajectory import simulate as move
from sysid.quantity import Quantity
from sysid.roll import Release
from sysid.synth.law import Modes, TrueLaw
from sysid.synth.motion import Condition, simulate
from sysid.workspace import shipped_data

NOISE = 1e-3
LARGE, SMALL = (
    Size(torque_share=t, torque_std=t / 10, energy_share=t, energy_std=t / 10) for t in (0.1, 0.002)
)
LAWS = {"friction": "coulomb", "drag": "quadratic-damping", "rest": "offset", "stop": "end-stop"}


def found(probability, *families):
    return Found(
        families=families, effects=tuple(LAWS[f] for f in families), probability=probability, parameters={}
    )


def fit(rmse, parameters, samples=400):
    problem = SimpleNamespace(samples=samples, names=["x"] * parameters)
    return SimpleNamespace(rmse=rmse, noise=SimpleNamespace(highest=1.1), problem=problem)


def posterior(*sets, sizes=None, nameless=0.0, named=0.1, share=0.005):
    inclusion = {f: sum(s.probability for s in sets if f in s.families) for f in LAWS}
    return SimpleNamespace(
        sets=sets,
        sizes=sizes or {},
        nameless=nameless,
        named=named,
        share=share,
        by_cycles=False,
        inclusion=inclusion,
    )


def test_exact_fits_are_weighed_by_chi_square_and_the_price_of_parameters():
    fits = [
        (found(0, "friction"), fit(1.0, 5)),
        (found(0, "friction", "drag"), fit(0.998, 6)),
        (found(0), fit(1.05, 4)),
    ]
    chances = weigh(fits, [one.rmse for _, one in fits])
    n, noise = 400, 0.998
    logs = [
        -0.5 * n * (r / noise) ** 2 - 0.5 * p * np.log(n) + prior
        for r, p, prior in ((1, 5, log_odds("friction")), (0.998, 6, 2 * log_odds("drag")), (1.05, 4, 0))
    ]
    expected = np.exp(np.array(logs) - max(logs))
    np.testing.assert_allclose(chances, expected / expected.sum())
    assert np.argmax(chances) == 0


def test_a_large_effect_is_named_with_its_probability():
    verdict = decide(
        posterior(found(0.9, "friction"), found(0.1, "drag"), sizes={"friction": LARGE}),
        left=0.1,
        explained=0.99,
    )
    assert (verdict.status, verdict.effects, verdict.families) == ("missing", ("coulomb",), ("friction",))
    assert verdict.confidence == pytest.approx(0.9)
    assert verdict.indistinguishable_from == (("quadratic-damping",),)


def test_an_effect_whose_absence_is_likely_needs_to_explain():
    sets = found(0.8, "friction"), found(0.2)
    cases = {
        (0.02, 0.2): "none-missing",
        (0.1, 0.2): "unexplained",
        (0.02, 0.9): "none-missing",
        (0.1, 0.9): "missing",
    }
    for (left, explained), status in cases.items():
        verdict = decide(posterior(*sets, sizes={"friction": LARGE}), left=left**2, explained=explained)
        assert verdict.status == status


def test_what_is_certain_but_small_is_a_hint():
    verdict = decide(
        posterior(found(1.0, "friction"), sizes={"friction": SMALL}), left=0.0, explained=0.0, exact=False
    )
    assert (verdict.status, verdict.effects) == ("none-missing", ())
    assert [(h.effects, h.size) for h in verdict.hints] == [(("coulomb",), SMALL)]
    assert matters("drag", LARGE)
    assert not matters("drag", SMALL)
    assert not matters("rest", replace(LARGE, torque_share=0.02))


@pytest.mark.parametrize(
    ("nameless", "left", "explained", "status"),
    [
        (0.2, 0.1, 0.5, "unexplained"),
        (0.2, 0.1, 0.999, "missing"),
        (0.2, 1e-4, 0.0, "missing"),
        (0.01, 0.1, 0.6, "missing"),
    ],
)
def test_a_torque_without_a_name_is_unexplained_while_the_fit_leaves_it(nameless, left, explained, status):
    sets = posterior(found(0.99, "friction"), sizes={"friction": LARGE}, nameless=nameless)
    assert decide(sets, left=left, explained=explained).status == status


def releases(inertia=8.7e-3, stiffness=14.677, damping=0.04, friction=0.0):
    law = TrueLaw(
        inertia=inertia,
        stiffness=stiffness,
        damping=damping,
        gravity=0.0,
        static_friction=friction,
        friction=friction,
    )
    time, rng, made = np.arange(0.0, 1.5, 2e-3), np.random.default_rng(2), []
    for number, angle in enumerate((0.19, -0.15, 0.11), start=1):
        start = Condition(np.array([angle, 0.0, 0.0, 0.0, 0.0]), Modes().regions(law, angle))
        samples, _ = simulate(law, start, 0.0, float(time[-1]), time)
        roll = samples[:, 0] + NOISE * rng.standard_normal(len(time))
        std = np.full(len(time), NOISE)
        made.append(
            Release(
                log="made",
                number=number,
                time=time,
                roll=roll,
                std=std,
                origin="angle",
                rest=0.0,
                hold=1.0,
                end="log",
            )
        )
    return made


@pytest.fixture(scope="module")
def light():
    pink = load_board(shipped_data() / "boards" / "pink.toml")
    return pink.with_tilt(damping=Quantity(0.04, 2e-4, "N*m*s/rad"))


@pytest.mark.parametrize(("inertia", "change"), [(1.2, "-16.7 %"), (0.9, "+11.1 %")])
def test_another_inertia_shows_as_the_same_change_of_stiffness_and_damping(light, inertia, change):
    deviation = record_deviation(fit_joint(releases(inertia * 8.7e-3), light), light, linear=True)
    assert "inertia" in {name for group in (deviation.effects, *deviation.alike) for name in group}
    assert change[:4] in deviation.text


def test_a_stiffer_spring_with_less_damping_has_no_single_cause(light):
    changed = fit_joint(releases(stiffness=17.0, damping=0.02), light)
    deviation = record_deviation(changed, light, linear=True)
    assert deviation.effects == ()
    assert "brings the record up to date" in deviation.text
    assert record_deviation(changed, light, linear=False).text == ""
    assert record_deviation(fit_joint(releases(), light), light, linear=True).text == ""


def test_size_and_deciding_release_of_dry_friction(light):
    friction = 0.03
    logs = releases(friction=friction)
    rubbing, plain = (fit_joint(logs, light, names) for names in (("coulomb",), ()))
    size = sizes_of(rubbing, ["coulomb"])["friction"]
    assert size.torque_share == pytest.approx(friction / (14.677 * 0.19), rel=0.1)
    law = rubbing.law
    lost = 0.5 * law.stiffness * sum(a**2 for a in (0.19, 0.15, 0.11))  # all energy, to the rest
    path = 0.0
    for record, (angle, rate) in zip(rubbing.records, rubbing.starts, strict=True):
        path += np.abs(np.diff(move(law, record.time, angle, rate).roll)).sum()
    assert size.energy_share == pytest.approx(friction * path / lost, rel=0.1)
    step = deciding(rubbing, plain, light)
    assert step is not None
    assert step.number == 1
    assert in_words(step, "coulomb", "nothing", light).startswith("Release once from ")
    assert in_words(None, "a", "b", light) == "No release of up to 5 decides between a and b."


def test_torques_that_cancel_each_other_are_impossible(light):
    fitted = fit_joint(releases(), light)
    tenfold = 10 * 14.677  # a pendulum and a negative spring: together they are the joint's own spring
    for moment, possible in ((0.5 * 14.677, True), (tenfold, False)):
        law = JointLaw(
            inertia=8.7e-3, stiffness=14.677 - moment, damping=0.04, effects=(("gravity", (moment,)),)
        )  # fmt: skip
        assert is_possible(replace(fitted, law=law), ["gravity"]) == possible


def test_another_rest_angle_is_named_where_its_absence_is_unlikely():
    for moved, effects in ((0.7, ()), (0.99, ("offset",))):
        sets = found(moved, "rest"), found(1 - moved)
        verdict = decide(posterior(*sets, sizes={"rest": LARGE}), left=0.0, explained=0.0)
        assert verdict.effects == effects
        assert verdict.confidence == pytest.approx(1.0 if not effects else moved)
