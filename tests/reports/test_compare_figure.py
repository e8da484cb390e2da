"""Pictures of a comparison and of a frequency response name their units and show the computed numbers."""

import numpy as np

from reports.figures.bode import bode_figure
from reports.figures.compare import compare_figure
from reports.figures.decay import decay_figure
from sysid.comparison.compare import compare
from sysid.free_decay import fit_decay
from sysid.recording import Recording
from sysid.workspace import shipped_data

LOG = shipped_data() / "decays" / "pink_hidden.csv"


def test_a_response_has_the_joints_stiffness_and_a_quarter_turn_at_its_natural_frequency(pink):
    magnitude, phase = bode_figure(pink, 9.0).axes
    frequency, tilt = magnitude.lines[0].get_data()
    assert np.isclose(np.radians(tilt[0]), 1 / pink.stiffness, rtol=5e-3)
    natural = np.sqrt(pink.stiffness / pink.inertia.value) / (2 * np.pi)
    assert np.isclose(np.interp(natural, frequency, phase.lines[0].get_ydata()), -90, atol=0.5)


def test_panels_have_units_and_none_is_empty(pink):
    result = compare(Recording.read(LOG), pink)
    figure = compare_figure(result, "a title")
    missing = [axes for axes in figure.axes if axes.get_ylabel() == "missing torque [N·m]"]
    by_label = {axes.get_xlabel(): axes for axes in missing}
    assert set(by_label) == {"rate [rad/s]", "angle [°]"}
    drawn = by_label["rate [rad/s]"].lines[-1].get_xydata()
    profile = result.missing.over(result.missing.rate)
    assert (drawn == list(zip(profile.at, profile.torque, strict=True))).all()
    assert "sim - real [°]" in [axes.get_ylabel() for axes in figure.axes]
    assert all(axes.has_data() for axes in figure.axes)
    # An overdamped board has no backbone, and no panel for one.
    assert not len(result.measured_backbone.amplitude)


def labels(figure):
    each = [(axes.get_xlabel(), axes.get_ylabel(), axes.get_title(loc="left")) for axes in figure.axes]
    return {text for texts in each for text in texts} | {figure.get_suptitle()}


def test_a_slide_is_drawn_in_lengths_and_forces(pink):
    slide, hinge = pink.of_slide(), Recording.read(LOG).roll
    recorded = Recording.from_arrays(hinge.time, angle=hinge.roll, unit="m")
    result, decay = compare(recorded, slide), fit_decay(recorded, board=slide)
    drawn = labels(compare_figure(result, "")) | labels(decay_figure([recorded.roll], decay, ""))
    wanted = {"position [mm]", "speed [m/s]", "missing force [N]", "sim - real [mm]"}
    assert wanted | {"position about rest [mm]"} <= drawn
    assert not [text for text in drawn if "°" in text or "[rad" in text or "N·m" in text]
    assert decay.numbers.stiffness.unit == "N/m"
    assert decay.numbers.omega_n.unit == "rad/s"
    assert "°" not in decay.report()
