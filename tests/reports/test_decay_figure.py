"""The decay picture holds what it should, for every kind of decay."""

import numpy as np
import pytest
from decay_truth import DEGREE, Recipe, linear_decay, make_roll

from reports.figures.decay import decay_figure
from reports.figures.palette import REAL, SIM
from sysid.free_decay import fit_decay
from sysid.quantity import Quantity
from sysid.releases import find_releases
from sysid.roll import Roll

INERTIA = Quantity(8.70e-3, 1e-4, "kg*m^2")


def gyro_roll():
    time = np.arange(0, 3, 0.002)
    angle, rate = linear_decay(time, 15.0, 0.03, 0.2)
    rate = rate + np.random.default_rng(0).normal(0, 0.01, len(time))
    std = np.full(len(time), 0.01)
    gyro = {"origin": "gyro", "zero": "drifting", "measured": "rate", "rate": rate, "rate_std": std}
    return Roll(log="g", time=time, roll=angle, std=std / 100, **gyro)


ROLLS = {
    "three releases": lambda: make_roll(Recipe(sampling=500, amplitudes=(0.2, -0.18, 0.15))),
    "light": lambda: make_roll(Recipe(zeta=0.02, free=6.0)),
    "no second peak": lambda: make_roll(Recipe(zeta=0.8, sampling=1000)),
    "overdamped": lambda: make_roll(
        Recipe(zeta=1.3, sampling=1000, amplitudes=(0.2,) * 3, noise=0.02 * DEGREE)
    ),
    "gyro": gyro_roll,
}


@pytest.mark.parametrize("name", ROLLS)
def test_every_kind_of_decay_has_its_picture(name, tmp_path):
    roll = ROLLS[name]()
    decay = fit_decay(find_releases(roll), INERTIA)
    figure = decay_figure([roll], decay, "a title")
    log, trace, residual, line = figure.axes
    assert len(log.patches) == len(decay.releases)  # a shade each
    marked = sum(len(drawn.get_xdata()) for drawn in log.lines if drawn.get_marker() == "o")
    assert marked == sum(len(group) for group in decay.peaks)
    colours = [drawn.get_color() for drawn in trace.lines]
    assert colours.count(REAL) == colours.count(SIM) == len(decay.releases)
    assert len(residual.lines) == len(decay.releases) + 1
    if any(decay.peaks):
        assert line.get_yscale() == "log"
    else:
        assert "no peak" in line.texts[0].get_text()
    figure.savefig(tmp_path / "picture.png", dpi=60)
    assert (tmp_path / "picture.png").stat().st_size > 5000


def test_nothing_measured_is_cut_off_and_the_residual_is_simulated_minus_measured():
    """The deck is widest before the hand has surely left it, and there the fit has not begun."""
    roll = make_roll(Recipe(sampling=500, amplitudes=(0.35, -0.15)))
    decay = fit_decay(find_releases(roll), INERTIA)
    _, trace, residual, _ = decay_figure([roll], decay, "a title").axes
    low, high = trace.get_ylim()
    span = trace.get_xlim()[1]
    for release, fitted, drawn in zip(decay.releases, decay.trace.releases, residual.lines, strict=False):
        shown = np.rad2deg(release.roll - fitted.level)[release.time - release.start <= span]
        assert low < shown.min() < shown.max() < high
        error = np.rad2deg(fitted.modelled - fitted.trace.measured)
        np.testing.assert_allclose(drawn.get_ydata(), error, atol=1e-12)
