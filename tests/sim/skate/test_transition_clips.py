"""Clips of mounting and dismounting: what they are made from, and that a robot could do them on a board."""

import importlib.util
from dataclasses import replace

import numpy as np
import pytest
from transition_check import transition_facts

from policy_runtime.learning.style_reference import PHASES, style_reference, transition_folder
from policy_runtime.motion.motions import load_motions
from sim.skate.cycle.clock import CONTROL_PERIOD, Clock
from sim.skate.options import SkateOptions
from sim.skate.robot import g1
from sim.skate.robot.poses import load_poses

pytestmark = pytest.mark.train

CLIPS = {clip.name: clip for clip in load_motions([transition_folder()])}


@pytest.fixture(scope="module")
def facts(model):
    return {name: transition_facts(clip, model) for name, clip in CLIPS.items()}


def test_there_are_both_kinds():
    assert sum(name.startswith("mount") for name in CLIPS) >= 3
    assert sum(name.startswith("dismount") for name in CLIPS) >= 3


@pytest.mark.parametrize("name", CLIPS)
def test_it_goes_from_one_canonical_pose_to_the_other_in_the_time_of_the_cycle(facts, name):
    fact, poses = facts[name], load_poses()
    mounts = name.startswith("mount")
    start, end = ("push", "steer") if mounts else ("steer", "push")
    np.testing.assert_allclose(fact.first, poses[start].joints, atol=1e-3)
    np.testing.assert_allclose(fact.last, poses[end].joints, atol=1e-3)
    steps = Clock().mount if mounts else Clock().dismount
    assert fact.duration == pytest.approx(steps * CONTROL_PERIOD)


@pytest.mark.parametrize("name", CLIPS)
def test_feet_respect_deck_and_ground(facts, name):
    fact = facts[name]
    assert fact.right_height < 1e-3  # it carries throughout, and turns on its sole
    assert fact.clearance > -2e-3  # over the deck's edge, nothing is cut
    assert fact.slide < 0.2  # where it lands it stays; touching down takes one frame
    landed = fact.left_stands if name.startswith("mount") else fact.left_stands[::-1]
    assert landed[-1]
    assert not landed[: len(landed) // 3].any()
    assert np.all(np.diff(landed.astype(int)) >= 0)  # once on the deck it stays there
    assert fact.self_contacts == 0


@pytest.mark.parametrize("name", CLIPS)
def test_robot_can_do_it(facts, name):
    fact = facts[name]
    assert fact.limit_margin > 0.015
    assert fact.peak_speed < 15.0  # the knee motor turns at up to 20 rad/s
    # For the moment in which the left foot leaves or lands, the balance is a dynamic one.
    assert fact.support_margin > -0.015


def test_faults_are_measured(model):
    clip = CLIPS["mount-plain"]
    sunk = clip.position - np.array([0.0, 0.0, 0.02])
    low = transition_facts(replace(clip, position=sunk), model)
    assert low.clearance < -0.015
    assert low.right_height == pytest.approx(0.02, abs=1e-3)
    turned = replace(clip, joints=clip.joints.copy())
    turned.joints[:, g1.JOINTS.index("right_ankle_roll_joint")] += 0.2  # tips the robot off its foot
    assert transition_facts(turned, model).right_height > 2e-3
    still = replace(clip, joints=np.tile(clip.joints[-1], (len(clip.joints), 1)))
    assert transition_facts(still, model).peak_speed == 0


def test_files_are_what_the_script_makes(model):
    path = transition_folder().parent / "make_transitions.py"
    spec = importlib.util.spec_from_file_location("make_transitions", path)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    assert {style.name for style in script.STYLES} == set(CLIPS)
    for style in (script.STYLES[0], script.STYLES[-1]):
        made, stored = script.make(style), CLIPS[style.name]
        np.testing.assert_allclose(made.joints, stored.joints, atol=2e-3)


def test_reference_windows_say_their_phase_where_more_than_one_is_taught_by_style():
    plain = style_reference(SkateOptions())
    assert plain.shape[1] == 115
    both = style_reference(SkateOptions(transition="style"))
    assert both.shape[1] == 118
    np.testing.assert_array_equal(both[: len(plain), :115], plain)
    of = [PHASES[i] for i in both[:, 115:].argmax(axis=1)]
    assert of == sorted(of, key=PHASES.index)  # grouped, as the learner samples them
    np.testing.assert_array_equal(both[:, 115:].sum(axis=1), 1)
    lengths = {name: len(clip.joints) - 4 for name, clip in CLIPS.items()}
    for phase in ("mount", "dismount"):
        assert of.count(phase) == sum(n for name, n in lengths.items() if name.startswith(phase))
    alone = style_reference(SkateOptions(pushing="gait", transition="style"))
    assert set(alone[:, 115:].argmax(axis=1)) == {1, 2}
