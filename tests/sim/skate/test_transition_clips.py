"""Clips of mounting and dismounting: what they are made from, and that a robot could do them on a board."""

import runpy

import numpy as np
import pytest
from transition_check import transition_facts

from policy_runtime.motion.motions import load_motions, transition_folder
from sim.skate.cycle.clock import CONTROL_PERIOD, Clock
from sim.skate.robot.poses import load_poses

pytestmark = pytest.mark.train

CLIPS = {clip.name: clip for clip in load_motions([transition_folder()])}


@pytest.fixture(scope="module")
def facts(model):
    return {name: transition_facts(clip, model) for name, clip in CLIPS.items()}


@pytest.mark.parametrize("name", CLIPS)
def test_it_goes_from_one_canonical_pose_to_the_other_in_the_time_of_the_cycle(facts, name):
    fact, poses = facts[name], load_poses()
    mounts = name.startswith("mount")
    start, end = ("push", "steer") if mounts else ("steer", "push")
    np.testing.assert_allclose(fact.first, poses[start][7:], atol=1e-3)
    np.testing.assert_allclose(fact.last, poses[end][7:], atol=1e-3)
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


def test_files_are_what_the_script_makes(model):
    script = runpy.run_path(str(transition_folder().parent / "make_transitions.py"))
    styles = script["STYLES"]
    assert {style.name for style in styles} == set(CLIPS)
    for style in (styles[0], styles[-1]):
        made, stored = script["make"](style), CLIPS[style.name]
        np.testing.assert_allclose(made.joints, stored.joints, atol=2e-3)
