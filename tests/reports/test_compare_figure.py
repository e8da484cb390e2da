"""The picture of a comparison names its units, and shows where there is no data."""

from reports.figures.compare import compare_figure
from sysid.board import load_board
from sysid.comparison.compare import compare
from sysid.logs import LogOptions, read_roll
from sysid.releases import find_releases
from sysid.workspace import shipped_data


def test_residuals_have_a_unit_and_no_data_is_no_zero():
    releases = find_releases(read_roll(shipped_data() / "decays" / "pink_hidden.csv", LogOptions()))
    result = compare(releases, load_board(shipped_data() / "boards" / "pink.toml"))
    figure = compare_figure(result, "a title")
    by_label = {axes.get_ylabel(): axes for axes in figure.axes}
    assert "sim - real [°]" in by_label
    surface = by_label["rate [rad/s]"]
    zero = surface.collections[0].to_rgba([0.0])[0]
    assert tuple(zero) != surface.patch.get_facecolor()
    assert surface.patch.get_hatch()
