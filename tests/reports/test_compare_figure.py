"""The picture of a comparison names its units, and shows where there is no data."""

from reports.figures.compare import compare_figure
from reports.figures.decay import decay_figure
from sysid.board import load_board
from sysid.comparison.compare import compare
from sysid.free_decay import fit_decay
from sysid.logs import LogOptions, read_roll
from sysid.recording import Recording
from sysid.releases import find_releases
from sysid.workspace import shipped_data


def test_panels_have_units_and_none_is_empty():
    releases = find_releases(read_roll(shipped_data() / "decays" / "pink_hidden.csv", LogOptions()))
    result = compare(releases, load_board(shipped_data() / "boards" / "pink.toml"))
    figure = compare_figure(result, "a title")
    by_label = {
        axes.get_xlabel(): axes for axes in figure.axes if axes.get_ylabel() == "missing torque [N·m]"
    }
    assert set(by_label) == {"rate [rad/s]", "angle [°]"}
    drawn = by_label["rate [rad/s]"].lines[-1].get_xydata()
    profile = result.missing.over(result.missing.rate)
    assert (drawn == list(zip(profile.at, profile.torque, strict=True))).all()
    assert "sim - real [°]" in [axes.get_ylabel() for axes in figure.axes]
    assert all(axes.has_data() for axes in figure.axes)
    assert not len(
        result.measured_backbone.amplitude
    )  # an overdamped board has no backbone, and no panel for one


def labels(figure):
    texts = {
        text
        for axes in figure.axes
        for text in (axes.get_xlabel(), axes.get_ylabel(), axes.get_title(loc="left"))
    }
    return texts | {figure.get_suptitle()}


def test_a_slide_is_drawn_in_lengths_and_forces():
    slide = load_board(shipped_data() / "boards" / "pink.toml").of_slide()
    hinge = Recording.read(shipped_data() / "decays" / "pink_hidden.csv").roll
    recorded = Recording.from_arrays(hinge.time, angle=hinge.roll, unit="m")
    result, decay = compare(recorded, slide), fit_decay(recorded, board=slide)
    drawn = labels(compare_figure(result, "")) | labels(decay_figure([recorded.roll], decay, ""))
    assert {
        "position [mm]",
        "speed [m/s]",
        "missing force [N]",
        "sim - real [mm]",
        "position about rest [mm]",
    } <= drawn
    assert not [text for text in drawn if "°" in text or "[rad" in text or "N·m" in text]
    assert decay.numbers.stiffness.unit == "N/m"
    assert decay.numbers.omega_n.unit == "rad/s"
    assert "°" not in decay.report()
