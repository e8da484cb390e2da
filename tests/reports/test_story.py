"""What the four panels show is right before it is drawn, and drawn as it is."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from decay_truth import Recipe, make_roll

from reports.figures.ladder import ladder_figure
from reports.figures.story import draw_candidates, panels, story_figure
from reports.figures.style import styled
from reports.story import RECORD, STOOD, Ranked, Step, law_of_candidate, ranked, tell, times
from sysid.board import load_board
from sysid.diagnosis.diagnose import diagnose
from sysid.fit_mjcf import fit
from sysid.fitting.report import report
from sysid.joint import JointLaw
from sysid.releases import find_releases
from sysid.workspace import shipped_data

STIFF, DAMP, FRICTION = 14.68, 0.06, 0.15
"""Of the truth [N*m/rad, N*m*s/rad, N*m]."""


@pytest.fixture(scope="module")
def pink():
    return load_board(shipped_data() / "boards" / "pink.toml")


@pytest.fixture(scope="module")
def data(pink):
    """Dry friction hidden in a light decay."""

    def law(angle, rate):
        return (-STIFF * angle - DAMP * rate - FRICTION * np.tanh(rate / 1e-3)) / pink.inertia.value

    return find_releases(make_roll(Recipe(law=law, sampling=500, amplitudes=(0.2, -0.15, 0.18), noise=2e-4)))


@pytest.fixture(scope="module")
def story(pink, data):
    """Its spring and damper are known."""
    before = JointLaw(inertia=pink.inertia.value, stiffness=STIFF, damping=DAMP)
    after = before.with_effect("coulomb", FRICTION)
    models = ranked([(("coulomb",), 0.0, 0.0), ((), 400.0, 30.0), (("x",), 500.0, None)], ("coulomb",))
    return tell(
        data, pink, before=before, after=after, effects=("coulomb",),
        steps=(Step("k and d refitted", 2.0, 2.1),), heldout=1.1, ranked=models,
    )  # fmt: skip


def test_the_error_falls_from_the_record_as_it_stood_to_the_noise(story):
    former, latter = story.fall
    assert former > 5
    assert latter == pytest.approx(1, abs=0.1)
    assert [step.label for step in story.steps] == [STOOD, "k and d refitted", "with coulomb"]
    assert story.steps[-1].error == latter
    assert story.steps[0].error == former
    low, high = story.noise_range
    assert low < 1 < high


def test_the_release_with_the_largest_error_is_drawn(story):
    errors = [release.rmse for release in story.before.releases]
    assert story.shown == int(np.argmax(errors))


def test_the_missing_torque_is_the_law_of_what_is_missing(story):
    for missing in (story.over_rate, story.over_angle):
        seen = missing.seen
        clear = np.abs(seen.at) > 0.15 * np.abs(seen.at).max()  # the step itself is smoothed
        off = np.abs(seen.torque - np.interp(seen.at, missing.at, missing.law))[clear]
        assert np.mean(off < 1.96 * seen.std[clear]) > 0.9
        assert 1.96 * seen.std[clear].max() < FRICTION  # the band shows the friction
    fast = np.abs(story.over_rate.at) > 0.5
    assert story.over_rate.law[fast] == pytest.approx(-FRICTION * np.sign(story.over_rate.at[fast]))
    seen = story.over_rate.seen
    moving = np.abs(seen.at) > 0.5
    assert -np.mean(seen.torque[moving] * np.sign(seen.at[moving])) == pytest.approx(FRICTION, rel=0.1)


def test_the_residual_is_white_only_with_what_was_missing(story):
    (_, before), (_, after) = story.correlations
    assert np.mean(np.abs(after) > story.white) < 0.05
    assert np.mean(np.abs(before) > story.white) > 0.5
    assert story.lags[-1] == pytest.approx(2 * np.pi / story.after.law.frequency, rel=0.05)


def test_candidates_are_those_that_were_predicted_and_the_chosen_one_is_marked(story):
    assert story.ranked == (Ranked(("coulomb",), 0.0, 0.0, True), Ranked((), 400.0, 30.0, False))
    assert story.why == "the best"
    worse = tuple(replace(model, score=model.score + 1) for model in story.ranked)
    assert "ties with the best" in replace(story, ranked=worse).why
    far = tuple(replace(model, score=model.score + 100) for model in story.ranked)
    assert "simplest of several" in replace(story, ranked=far).why


def test_what_is_drawn_is_the_story(story):
    by_name = {panel.name: panel for panel in panels(story)}
    assert list(by_name) == ["decay", "torque-rate", "torque-angle", "ladder", "candidates", "whiteness"]
    figure = story_figure(story, "a title")
    drawn = [line.get_xydata() for axes in figure.axes for line in axes.get_lines()]

    def shows(x, y):
        return any(line.shape == (len(x), 2) and np.allclose(line, np.column_stack([x, y])) for line in drawn)

    assert shows(story.over_rate.at, story.over_rate.law)
    assert shows(np.degrees(story.over_angle.seen.at), story.over_angle.seen.torque)
    assert shows(1e3 * story.lags, story.correlations[1][1])
    assert shows([step.error for step in story.steps], range(len(story.steps)))
    release = story.after.releases[story.shown]
    assert shows(release.time, np.degrees(release.measured))


def test_a_panel_without_data_is_not_drawn(story):
    bare = replace(story, over_rate=None, over_angle=None, ranked=(), before=None)
    assert [panel.name for panel in panels(bare)] == ["decay", "ladder", "whiteness"]
    assert story_figure(bare, "a title").axes


def test_a_label_names_few_effects_and_an_error_has_no_exponent(pink, data):
    law = JointLaw.from_board(pink)
    rich = law.with_effect("coulomb", 0.1).with_effect("cubic-stiffness", 1.0).with_effect("gravity", 0.1)
    told = tell(data, pink, before=law, after=rich, effects=("coulomb", "cubic-stiffness", "gravity"))
    assert told.labels == (STOOD, "with all 3 effects")
    assert [times(error) for error in (0.5, 12.34, 3456.7)] == ["0.5", "12.3", "3457"]


def test_a_record_of_other_logs_is_called_so(pink, data):
    law = JointLaw.from_board(pink)
    told = tell(
        data,
        pink,
        before=law,
        after=replace(law, damping=0.5),
        effects=(),
        steps=[Step("k and d refitted", 1.0)],
        label=RECORD,
    )
    assert [step.label for step in told.steps] == [STOOD, RECORD, "k and d refitted"]


def test_a_law_comes_back_from_the_file_of_a_diagnosis(pink):
    candidate = {
        "effects": ["coulomb"],
        "parameters": {
            name: {"value": value}
            for name, value in (("stiffness", 14.0), ("damping", 0.3), ("coulomb.torque", 0.1))
        },
    }
    law = law_of_candidate(pink, json.loads(json.dumps(candidate)))
    assert law.parameters == {
        "inertia": pink.inertia.value, "stiffness": 14.0, "damping": 0.3, "rest_angle": pink.rest_angle,
        "coulomb.torque": 0.1,
    }  # fmt: skip
    del candidate["parameters"]["coulomb.torque"]  # held by --fix
    assert law_of_candidate(pink, candidate) is None


def test_the_scores_of_candidates_stand_within_their_panel():
    """Markers and interval of the worst, and the axis's label."""
    ranked = tuple(
        Ranked(effects=effects, score=score, std=1.0, chosen=not score)
        for effects, score in ((("coulomb",), 0.0), (("coulomb", "lowpass"), 7.0), ((), 1905.0))
    )
    with styled(4.2, 3.5) as figure:
        axes = figure.subplots()
        draw_candidates(axes, ranked)
    figure.canvas.draw()
    shown = figure.get_window_extent()
    assert axes.xaxis.label.get_window_extent().x0 >= shown.x0
    assert axes.xaxis.label.get_window_extent().x1 <= shown.x1
    assert axes.get_xlim()[1] > 1.2 * 1905.0


@pytest.mark.parametrize(
    ("releases", "said"), [(1, "held out: parts of the release"), (3, "held out: releases")]
)
def test_the_ladder_says_what_was_held_out(releases, said):
    """A release alone is not left out: parts of it are."""
    figure = ladder_figure(
        [Step("record", 20.0, 30.0), Step("+ coulomb", 1.0, 1.1)], (0.9, 1.1), "title", releases
    )
    legend = figure.axes[0].get_legend()
    assert said in [text.get_text() for text in legend.get_texts()]


@pytest.mark.parametrize("kept", [1, 3])
def test_the_report_of_a_fit_says_what_was_held_out(pink, data, kept):
    found = report(fit(data[:kept], pink))
    assert ("the release's second half, predicted from its first" in found) == (kept == 1)
    assert ("releases that the fit had not seen" in found) == (kept == 3)


def test_the_report_of_a_diagnosis_is_in_the_unit_of_the_joint_and_says_what_was_held_out(pink, data):
    """The noise of 2e-4 is 0.2 mm of a slide, or 0.011 degrees."""
    for board, unit in ((pink, "°"), (pink.of_slide(), " mm")):
        found = diagnose(data[:1], board).report()
        assert re.search(rf"sensor noise 0\.[\d]+{unit},", found)
        assert "held out: error on a release that the fit did not see" in found
