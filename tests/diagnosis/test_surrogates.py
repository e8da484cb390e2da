"""Laws outside the catalogue that an effect with a memory of its own can mimic."""

import pickle
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sysid.diagnosis.diagnose import _outside_all
from sysid.diagnosis.search import Candidate, Search, _could_begin_so, inherited
from sysid.diagnosis.surrogates import LAWS, in_words, nearest_outside, surrogate, surrogates
from sysid.diagnosis.workers import WorkerPool
from sysid.effects._base import Scales
from sysid.fitting.records import Record
from sysid.roll import Release

NOISE, INERTIA, STIFFNESS, DAMPING = 5e-4, 8.7e-3, 14.684, 0.05
BEGINS = (0.15, -0.12, 0.1)


def record_of(angle, number, stiffness=STIFFNESS, drive=lambda t: 0.0, torque=lambda x: 0.0):
    time = np.arange(0.0, 0.8, 4e-3)
    path = solve_ivp(
        lambda t, y: [y[1], (-stiffness * y[0] - DAMPING * y[1] + torque(y[0]) + drive(t + 3 * number)) / INERTIA],
        (0, 0.8), [angle, 0.0], t_eval=time, rtol=1e-9, atol=1e-11, max_step=2e-3,
    )  # fmt: skip
    roll = path.y[0] + NOISE * np.random.default_rng(number).standard_normal(len(time))
    release = Release(
        log="x", number=number, time=time, roll=roll, std=np.full(len(time), NOISE), origin="angle", rest=0.0, hold=1.0, end="log",
    )  # fmt: skip
    return Record(release=release, time=time, signal=roll, is_rate=False, std=NOISE)


def search_of(*records):
    scales = Scales(inertia=INERTIA, stiffness=STIFFNESS, damping=DAMPING, amplitude=0.15, duration=0.8)
    return Search(records=records, scales=scales, bias="shared")


@pytest.fixture(scope="module")
def changed():
    return search_of(
        *(record_of(a, i, k) for i, (a, k) in enumerate(zip(BEGINS, (14.7, 16.5, 14.7), strict=True)))
    )


@pytest.fixture(scope="module")
def driven():
    return search_of(*(record_of(a, i, drive=lambda t: 0.1 * np.sin(25 * t)) for i, a in enumerate(BEGINS)))


def test_a_spring_that_changed_between_releases_is_found_with_its_size(changed):
    model = surrogate(changed, changed.single(()), (), "k")
    shares = [float(word.rstrip(")")) for word in in_words(model).split(": ")[1].split(", ")]
    assert shares == pytest.approx([14.7 / 15.3, 16.5 / 15.3, 14.7 / 15.3], abs=0.003)
    assert model.rmse < 1.1 * NOISE


def test_a_torque_with_a_clock_of_its_own_is_found_with_its_frequency(driven):
    model = surrogate(driven, driven.single(()), (), "sin t")
    assert model.parameters["surrogate.frequency"] == pytest.approx(25.0, rel=0.002)
    assert "3.98 times a second" in in_words(model)
    assert model.parameters["surrogate.strength"] == pytest.approx(0.1, rel=0.05)
    assert model.rmse < 1.1 * NOISE


@pytest.mark.parametrize(
    ("shape", "mimic", "torque", "widths"),
    [
        ("tails", "hysteresis", lambda x: -12 * x / (1 + (x / 0.02) ** 2) ** 2, [0.02]),
        ("cogs", "cubic-stiffness", lambda x: -0.05 * np.sin(60 * x), [2 * np.pi / 60]),
        ("bumpers", "asymmetric-stiffness", lambda x: -40 * (max(x - 0.09, 0) + min(x + 0.05, 0)), [0.09, 0.05]),
    ],
)  # fmt: skip
def test_a_shape_with_a_width_is_found_from_what_mimics_it(shape, mimic, torque, widths):
    search = search_of(*(record_of(a, i, torque=torque) for i, a in enumerate(BEGINS)))
    model = surrogate(search, search.single((mimic,)), (), shape)
    found = [model.parameters[f"formula.width_{i}"] for i in range(len(widths))]
    assert found == pytest.approx(widths, rel=0.05)
    assert model.rmse < 1.1 * NOISE
    assert f"{np.degrees(found[0]):.3g}°" in in_words(model)
    assert f"{1e3 * found[0]:.3g} mm" in in_words(model, slides=True)


@pytest.mark.parametrize(("logs", "shapes"), [("changed", {"k", "k d"}), ("driven", {"sin t"})])
def test_what_mimics_it_predicts_worse(request, logs, shapes):
    search = request.getfixturevalue(logs)
    linear = search.single(())
    mimic = search.finalist(search.single(("hanging-body",), linear))
    best = min(surrogates(search, mimic), key=lambda m: m.heldout_rmse)
    assert best.shape in shapes
    assert best.heldout_rmse < mimic.heldout_rmse


class Elsewhere(WorkerPool):
    """Does each job as another process would: all that it is given and returns has travelled."""

    def __init__(self):
        super().__init__(1)
        self.count = 0

    def each(self, function, arguments):
        for job in arguments:
            self.count += 1
            there, given = pickle.loads(pickle.dumps((function, job)))
            yield pickle.loads(pickle.dumps(there(*given)))


def test_laws_outside_are_fitted_by_all_workers(driven):
    pool, linear = Elsewhere(), driven.single(())
    nearest = nearest_outside(replace(driven, pool=pool), linear)
    assert pool.count == len(LAWS)
    assert nearest.cost == pytest.approx(nearest_outside(driven, linear).cost, rel=1e-9)
    assert nearest.shape == "sin t"


def test_laws_outside_are_asked_about_a_hand_where_none_of_the_catalogue_reaches_the_noise(driven):
    linear = driven.single(())
    assert [m.shape for m in _outside_all(driven, [linear])] == ["sin t"]
    with patch.object(Candidate, "rmse", NOISE):
        assert _outside_all(driven, [linear]) == []


def test_no_release_is_predicted_by_parameters_of_its_own(changed):
    """An arm without stiffness leaves its time constant open, and each release would have its own."""
    rubber = changed.finalist(changed.single(("viscoelastic",), changed.single(())))
    for missed, together in zip(rubber.heldout, rubber.residuals, strict=True):
        assert missed @ missed >= (1 - 1e-9) * (together @ together)


def test_a_support_that_a_hold_has_settled_does_not_begin_anew(changed):
    support = changed.single(("second-mode",), changed.single(()))
    problem = support.problem.with_(free_states=True)
    point = inherited(problem, support)
    settled = replace(support, problem=problem, minimum=replace(support.minimum, point=point))
    assert _could_begin_so(settled)
    problem.own(point)[1, 3] += 1.0
    assert not _could_begin_so(settled)
