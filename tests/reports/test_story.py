"""What the four panels show is right before it is drawn, and drawn as it is."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from decay_truth import Recipe, make_roll

from reports.figures.story import panels, story_figure
from reports.story import STOOD, Step, law_of_candidate, ranked, tell
from sysid.board import BoardEffect
from sysid.diagnosis.diagnose import diagnose
from sysid.effects.weight import EFFECT as WEIGHT
from sysid.joint import JointLaw
from sysid.quantity import Quantity
from sysid.releases import find_releases

STIFF, DAMP, FRICTION = 14.68, 0.06, 0.15
"""Of the truth [N*m/rad, N*m*s/rad, N*m]."""


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
    models = ranked([(("coulomb",), 0.0), ((), 400.0), (("x",), None)], ("coulomb",))
    steps = (Step("k and d refitted", 2.0, 2.1),)
    told = tell(data, pink, laws=(before, after), effects=("coulomb",), steps=steps, heldout=1.1)
    return replace(told, ranked=models)


def test_the_error_falls_from_the_record_as_it_stood_to_the_noise(story):
    former, latter = story.fall
    assert former > 5
    assert latter == pytest.approx(1, abs=0.1)
    assert [step.label for step in story.steps] == [STOOD, "k and d refitted", "with coulomb"]
    assert story.steps[-1].error == latter
    assert story.steps[0].error == former
    low, high = story.noise_range
    assert low < 1 < high


def test_the_missing_torque_is_the_law_of_what_is_missing(story):
    """Averages over the angle mix both signs of the rate, as many as each bin holds: friction is clear over the rate."""
    missing, seen = story.over_rate, story.over_rate.seen
    clear = np.abs(seen.at) > 0.15 * np.abs(seen.at).max()  # the step itself is smoothed
    off = np.abs(seen.torque - np.interp(seen.at, missing.at, missing.law))[clear]
    assert np.mean(off < 1.96 * seen.std[clear]) > 0.9
    # The band shows the friction; it widens at the ends of the motion.
    assert 1.96 * np.median(seen.std[clear]) < FRICTION
    middle = np.abs(story.over_angle.seen.at) < 0.1
    assert np.abs(story.over_angle.seen.torque[middle]).max() < FRICTION
    fast = np.abs(story.over_rate.at) > 0.5
    assert story.over_rate.law[fast] == pytest.approx(-FRICTION * np.sign(story.over_rate.at[fast]))
    moving = np.abs(seen.at) > 0.5
    # Logs with other noise give 0.135 to 0.165.
    assert -np.mean(seen.torque[moving] * np.sign(seen.at[moving])) == pytest.approx(FRICTION, rel=0.15)


def test_the_known_weight_of_a_model_is_not_missing(pink):
    """A pendulum with friction: only the friction is left beside its weight."""
    weight, inertia = 0.5, pink.inertia.value

    def swings(angle, rate):
        return (-weight * np.sin(angle) - 0.01 * rate - 0.01 * np.tanh(rate / 1e-3)) / inertia

    data = find_releases(make_roll(Recipe(law=swings, sampling=500, amplitudes=(0.6, -0.4, 0.5), noise=1e-3)))
    law = JointLaw(inertia=inertia, stiffness=0.0, damping=0.01).with_effect(
        "weight", 1, 0, -weight, 0, 0, 0, 0, 0
    )
    known = zip(WEIGHT.parameters, dict(law.effects)["weight"], strict=True)
    own = BoardEffect("weight", {p.name: Quantity(value, 0.0, p.unit) for p, value in known})
    told = tell(
        data,
        replace(pink, effects=(own,)),
        laws=(law, law.with_effect("coulomb", 0.01)),
        effects=("coulomb",),
    )
    seen = told.over_angle.seen
    assert np.all(np.abs(seen.torque) < 0.02 + 1.96 * seen.std)  # the weight pulls with 0.28 N*m


def test_the_residual_is_white_only_with_what_was_missing(story):
    (_, before), (_, after) = story.correlations
    assert np.mean(np.abs(after) > story.white) < 0.05
    assert np.mean(np.abs(before) > story.white) > 0.5
    assert story.lags[-1] == pytest.approx(2 * np.pi / story.after.law.frequency, rel=0.05)


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


def test_a_law_comes_back_from_the_file_of_a_diagnosis(pink):
    found = {"stiffness": 14.0, "damping": 0.3, "coulomb.torque": 0.1}
    parameters = {name: {"value": value} for name, value in found.items()}
    candidate = json.loads(json.dumps({"effects": ["coulomb"], "parameters": parameters}))
    own = {"inertia": pink.inertia.value, "rest_angle": pink.rest_angle}
    assert law_of_candidate(pink, candidate).parameters == own | found
    del candidate["parameters"]["coulomb.torque"]  # held by --fix
    assert law_of_candidate(pink, candidate) is None


def test_the_report_of_a_diagnosis_is_in_the_unit_of_the_joint_and_says_what_was_held_out(pink, data):
    """The noise of 2e-4 is 0.2 mm of a slide, or 0.011 degrees."""
    for board, unit in ((pink, "°"), (pink.of_slide(), " mm")):
        found = diagnose(data[:1], board).report()
        assert re.search(rf"sensor noise 0\.[\d]+{unit},", found)
        assert "held out: error on a release that the fit did not see" in found
