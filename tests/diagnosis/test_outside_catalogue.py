"""Laws outside the catalogue, tried in the place of what was to be named."""

from dataclasses import replace

import hidden_truths as truths
import numpy as np
import pytest

from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.outside_catalogue import UNNAMED, unnamed_model, unnamed_torques
from sysid.diagnosis.score_statistic import SHAPES
from sysid.diagnosis.search import Searcher
from sysid.fitting.records import make_records
from sysid.fitting.search import scales_of
from sysid.noise.floor import noise_floor

BY_NAME = {truth.name: truth for truth in truths.TRUTHS}
SEED = 60


def searched(name, effects, folder, **changes):
    truth = replace(BY_NAME[name], **{"rates": (500.0,), "noises": (0.1,), **changes})
    releases = truths.make(truth, SEED, folder)
    records = make_records(releases, noise_floor(releases).std, rate=False)
    searcher = Searcher(records=records, scales=scales_of(records, truths.board_of(truth)), bias="shared")
    model = searcher.alone(effects[:1])
    for name in effects[1:]:
        model = searcher.joined(model, searcher.alone((name,)))
    return searcher, searcher.polished(model)


@pytest.mark.parametrize(
    ("name", "effects", "shape"),
    [
        ("stiffness of the fifth power", ("cubic-stiffness", "end-stop"), "x⁵"),
        ("spring that loosens", ("second-mode",), "t x"),
    ],
)
def test_what_mimics_a_law_outside_the_catalogue_is_no_better_than_that_law(name, effects, shape, tmp_path):
    searcher, model = searched(name, effects, tmp_path)
    assert model.rmse < 1.03 * model.problem.records[0].std, "it does not mimic, so this log tests nothing"
    found = {u.replaced: u for u in unnamed_torques(searcher, model)}
    assert set(found) == {effects, *((e,) for e in effects)}
    whole = found[effects]
    assert (whole.shape, whole.kept) == (shape, ())
    assert whole.chi2 < model.chi2 + 4.0
    assert whole.size < model.size


@pytest.mark.parametrize(
    ("name", "effects"), [("quadratic-damping 0.03", ("quadratic-damping",)), ("coulomb 0.1", ("coulomb",))]
)
def test_no_law_outside_the_catalogue_does_what_a_hidden_effect_does(name, effects, tmp_path):
    searcher, model = searched(name, effects, tmp_path)
    (best,) = unnamed_torques(searcher, model)
    assert best.chi2 > model.chi2 + 50.0
    assert best.size >= model.size


def test_a_law_outside_the_catalogue_is_refined_from_averages_to_samples(tmp_path):
    searcher, model = searched("damping by the tilt", ("quadratic-damping",), tmp_path, rates=(1000.0,))
    rough = unnamed_model(searcher, model, (), "|x| v")
    fine = unnamed_model(searcher, model, (), "|x| v", begin=rough)
    assert rough.problem.samples < fine.problem.samples == fine.samples
    strength = fine.parameters["unnamed.strength_0"]
    scales = searcher.scales  # 0.6 |x| v was hidden
    assert strength == pytest.approx(0.6 * scales.amplitude * scales.rate, rel=0.1)
    assert fine.chi2 == pytest.approx(fine.samples, abs=4 * np.sqrt(2 * fine.samples))


def test_no_shape_in_words_is_an_effect_of_the_catalogue():
    assert set(UNNAMED) == set(SHAPES) - {"x²", "x³", "v³", "v|v|"}


@pytest.mark.slow
def test_a_spring_that_loosens_is_not_called_a_second_mode(tmp_path):
    truth = BY_NAME["spring that loosens"]
    verdict = diagnose(truths.make(truth, SEED, tmp_path), truths.board_of(truth)).verdict
    assert (verdict.status, verdict.effects) == ("unexplained", ()), verdict
