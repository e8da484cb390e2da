"""From posterior and fits to a verdict: odds of exact fits, deviations from the record, what is named."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sysid.board import load_board
from sysid.diagnosis.evidence import log_odds
from sysid.diagnosis.experiment import deciding, in_words
from sysid.diagnosis.fits import Candidate, Fits, Yardstick, by_fits, is_possible, sizes_of
from sysid.diagnosis.posterior import Found, Posterior, Size
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
LAWS = {
    "friction": "coulomb", "drag": "quadratic-damping", "rest": "offset", "stop": "end-stop", "hardening": "cubic-stiffness"
}  # fmt: skip
RMS, SWING = 100.0, 50
"""RMS of the motion over the noise, and samples of a swing, of made fits."""


def found(probability, *families):
    return Found(
        families=families, effects=tuple(LAWS[f] for f in families), probability=probability, parameters={}
    )


def candidate(error, *families, length=1, wave=None, is_rate=False):
    """Return a fit of an error over the noise, whose residual is alike for some samples, or noise beside a wave of some swings."""
    rng = np.random.default_rng(3)
    residual = np.repeat(rng.standard_normal(2000 // length), length)
    if wave is not None:
        residual = residual + 3 * np.sin(2 * np.pi * np.arange(2000) / (wave * SWING))
        error = float(np.sqrt(np.mean(residual**2)))
    problem = SimpleNamespace(
        samples=2000, names=["x"] * (4 + len(families)), parameters=lambda point: {},
        linearise=lambda point: [(residual, np.zeros((2000, 6 + len(families))))],
        scales=SimpleNamespace(amplitude=np.sqrt(2) * RMS, frequency=2 * np.pi),
    )  # fmt: skip
    fit = SimpleNamespace(
        rmse=error, noise=SimpleNamespace(std=1.0, highest=1.05, counts=False), problem=problem, minimum=SimpleNamespace(point=np.zeros(6 + len(families))),
        residuals=(residual,), measured_rms=RMS, law=SimpleNamespace(frequency=2 * np.pi),
        records=[SimpleNamespace(time=np.arange(2000) / SWING, is_rate=is_rate)],
    )  # fmt: skip
    return Candidate(effects=tuple(LAWS[f] for f in families), fit=fit)


def posterior(*sets, sizes=None, nameless=0.0, share=0.0015):
    inclusion = {f: sum(s.probability for s in sets if f in s.families) for f in LAWS}
    return Posterior(
        motion=None, damping=0.1, loss=0.1, sets=sets, singles=(), inclusion=inclusion, share=share, nameless=nameless, torque=None,
        misfit=1.0, sizes=sizes or {},
    )  # fmt: skip


def weighed(judged, *candidates):
    """Return the posterior of fitted sets, the first one that of the record's law, beside that of the equations."""
    fits = Fits([], None, None, candidates[0])
    fits.made |= {c.effects: c for c in candidates}
    return by_fits(judged, fits.rivals(judged))


def test_fits_that_reach_the_noise_are_weighed_by_all_samples():
    base, best = candidate(1.05), candidate(1.0, "friction")
    measure = Yardstick.of(base, best.rmse, best.fit.residuals)
    assert measure.counted == 2000
    assert measure.samples == pytest.approx(2000, rel=0.1)
    gain = measure.log_evidence(best.effects, 1.0, 5) - measure.log_evidence(base.effects, 1.05, 4)
    explained = 0.5 * measure.samples * (1.05**2 - 1)
    assert gain == pytest.approx(explained - 0.5 * np.log(2000) + log_odds("friction"))
    result = weighed(posterior(found(0.6), found(0.4, "friction")), base, best)
    assert result.sets[0].families == ("friction",)
    assert result.sets[0].probability == pytest.approx(1 / (1 + np.exp(-gain)))


def test_a_law_that_may_be_off_by_a_tenth_needs_no_other_law_for_what_it_leaves():
    """Friction explains an error of 50 noises and leaves 1.3: a tenth of 50 may be how friction is bent."""
    base, law, richer = candidate(50.0), candidate(1.3, "friction"), candidate(1.0, "friction", "drag")
    result = weighed(posterior(found(0.5, "friction"), found(0.5)), base, law, richer)
    assert result.sets[0].families == ("friction",)
    weak = weighed(posterior(found(0.5, "friction"), found(0.5)), candidate(2.0), law, richer)
    assert weak.sets[0].families == ("friction", "drag")


def test_the_error_of_a_law_counts_once_a_swing():
    """A fit that misses the noise is wrong in the same way in each swing: ten times the samples say no more."""
    one = candidate(8.0, "friction", length=10)
    measure = Yardstick.of(candidate(20.0), one.rmse, one.fit.residuals)
    assert measure.unit == 8.0
    assert measure.samples == pytest.approx(SWING / 10, rel=0.5)
    added = weighed(
        posterior(found(0.6, "friction"), found(0.4)),
        candidate(20.0), one, candidate(7.5, "friction", "drag", length=10),
    )  # fmt: skip
    assert added.sets[0].families == ("friction",)


@pytest.mark.parametrize(
    ("sure", "part", "families"),
    [
        (0.99, 1.01, ("friction",)),  # a part of the equations' set explains as much with less
        (0.99, 1.5, ("friction", "drag")),  # the equations' own set
        (0.6, 1.01, ("hardening",)),  # the equations do not know: the best fit
    ],
)
def test_sure_equations_rule_out_other_families_but_not_a_part_of_their_set(sure, part, families):
    judged = posterior(found(sure, "friction", "drag"), found(1 - sure, "hardening"))
    fits = (
        candidate(9.0), candidate(part, "friction"), candidate(1.5, "friction", "drag"), candidate(0.98, "hardening")
    )  # fmt: skip
    result = weighed(judged, *fits)
    assert result.sets[0].families == families


@pytest.mark.parametrize(
    ("wave", "is_rate", "reaches"),
    [
        (20, False, True),  # a zero that wanders over twenty swings
        (1, False, False),  # a missing law acts in each swing
        (20, True, False),  # the zero of a rate is fitted
    ],
)
def test_a_drift_that_a_zero_may_have_is_no_error(wave, is_rate, reaches):
    fits = Fits([], None, None, candidate(9.0, wave=wave, is_rate=is_rate))
    fits.count_drift()
    assert fits.base.reaches_noise == reaches


def test_a_large_effect_is_named_with_its_probability():
    verdict = decide(
        posterior(found(0.9, "friction"), found(0.1, "drag"), sizes={"friction": LARGE}),
        candidate(1.0, "friction"), candidate(9.0),
    )  # fmt: skip
    assert (verdict.status, verdict.effects, verdict.families) == ("missing", ("coulomb",), ("friction",))
    assert verdict.confidence == pytest.approx(0.9)
    assert verdict.indistinguishable_from == (("quadratic-damping",),)


@pytest.mark.parametrize(
    ("absence", "before", "after", "status"),
    [
        (0.2, 2.0, 1.0, "none-missing"),  # its absence is likely
        (0.01, 2.0, 1.0, "missing"),
        (
            0.01,
            0.01 * RMS,
            0.015 * RMS,
            "none-missing",
        ),  # an error that does not matter, and no law explains it
        (0.2, 0.2 * RMS, 0.1 * RMS, "unexplained"),  # an error that matters
    ],
)
def test_an_effect_is_named_if_its_absence_is_unlikely_and_the_error_matters(absence, before, after, status):
    sets = posterior(found(1 - absence, "friction"), found(absence), sizes={"friction": LARGE}, share=0.015)
    assert decide(sets, candidate(after, "friction"), candidate(before)).status == status


def test_exact_equations_without_a_law_leave_the_errors_of_the_sensor():
    for share, status in ((0.0015, "none-missing"), (0.015, "unexplained")):
        sets = posterior(found(1.0), share=share)
        assert decide(sets, candidate(20.0), candidate(20.0)).status == status


def test_an_effect_that_is_certain_but_small_is_a_hint():
    verdict = decide(
        posterior(found(1.0, "friction"), sizes={"friction": SMALL}),
        candidate(1.0, "friction"),
        candidate(1.0),
    )
    assert (verdict.status, verdict.effects) == ("none-missing", ())
    assert [(h.effects, h.size) for h in verdict.hints] == [(("coulomb",), SMALL)]
    assert matters("drag", LARGE)
    assert not matters("drag", SMALL)
    assert not matters("rest", replace(LARGE, torque_share=0.02))


@pytest.mark.parametrize(
    ("nameless", "after", "status"),
    [
        (0.2, 5.0, "unexplained"),  # a torque without a name, and the fit leaves it
        (0.2, 1.0, "missing"),  # the fit reaches the noise
        (0.2, 2.0, "missing"),  # laws that are off by a tenth leave as much
        (0.0, 5.0, "missing"),  # the sensor's errors
        (0.0, 25.0, "unexplained"),  # most of the error is left
    ],
)
def test_a_remainder_is_unexplained_if_no_law_that_is_off_by_a_tenth_leaves_it(nameless, after, status):
    sets = posterior(found(0.99, "friction"), sizes={"friction": LARGE}, nameless=nameless)
    assert decide(sets, candidate(after, "friction"), candidate(40.0)).status == status


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
    size = sizes_of(Candidate(effects=("coulomb",), fit=rubbing), 0.0)["friction"]
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
        verdict = decide(posterior(*sets, sizes={"rest": LARGE}), candidate(1.0), candidate(1.0))
        assert verdict.effects == effects
        assert verdict.confidence == pytest.approx(1.0 if not effects else moved)
