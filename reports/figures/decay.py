"""The picture of a free-decay identification: the log, the decays with their fit, residual and peaks."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from reports.figures.palette import BAD, NOISE, REAL, SIM
from reports.figures.style import MOST_ROWS, styled
from reports.figures.svg import thin
from sysid.decay.linear_fit import FittedTrace
from sysid.free_decay import FreeDecay
from sysid.roll import Array, Roll

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEFT = 0.095
"""Margin as a share of the figure, wide enough for a label beside ticks of five figures."""
MOST_MARKED = 12
"""Releases numbered in the overview; more would overlap."""


def decay_figure(rolls: Sequence[Roll], decay: FreeDecay, title: str) -> "Figure":
    """Draw the first few whole logs, the aligned decays with their fit, the residual, and ln(amplitude)."""
    # Fixed margins: finding them by trial would draw everything twice.
    sides = {"left": LEFT, "right": 0.985}
    below = {"top": 0.585, "bottom": 0.065, "hspace": 0.2, "wspace": 0.2}
    with styled(9.0, 7.2, layout=None) as figure:
        shown = rolls[:MOST_ROWS]
        upper = figure.add_gridspec(1, len(shown), **sides, top=0.93, bottom=0.71)
        lower = figure.add_gridspec(2, 2, **sides, **below, height_ratios=(1.6, 1), width_ratios=(1.75, 1))
        figure.suptitle(title, x=0.01, y=0.985, ha="left", fontsize=11)
        for column, roll in enumerate(shown):
            axes = draw_log(figure.add_subplot(upper[0, column]), roll, decay)
            axes.set_ylabel("" if column else decay.position.axis)
        trace = figure.add_subplot(lower[0, 0])
        draw_traces(trace, decay)
        residual = figure.add_subplot(lower[1, 0], sharex=trace)
        draw_residual(residual, decay)
        trace.tick_params(labelbottom=False)
        draw_peak_line(figure.add_subplot(lower[:, 1]), decay)
    return figure


def draw_log(axes: "Axes", roll: Roll, decay: FreeDecay) -> "Axes":
    """Draw the roll of the whole log, with every free decay shaded and its peaks marked."""
    time, angle = thin(roll.time, decay.position.scale * roll.roll)
    axes.plot(time, angle, color=REAL, lw=1.0, label="measured")
    mine = [(r, group) for r, group in zip(decay.releases, decay.peaks, strict=True) if r.log == roll.log]
    for release, group in mine:
        axes.axvspan(release.start, float(release.time[-1]), color=SIM, alpha=0.08, lw=0)
        if len(mine) <= MOST_MARKED:
            corner: Any = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
            at = (release.start, 1.0)
            axes.annotate(str(release.number), at, (2, 2), **corner, fontsize=7.5, color=SIM)
        at = [peak.time for peak in group]
        level = decay.position.scale * np.interp(at, roll.time, roll.roll)
        axes.plot(at, level, "o", ms=3.8, mfc="white", mec=REAL, mew=0.9)
    axes.set(xlabel="time [s]", ylabel=decay.position.axis, xlim=(roll.time[0], roll.time[-1]))
    return axes


def draw_traces(axes: "Axes", decay: FreeDecay) -> None:
    """Draw every decay from its release on, with the fitted linear decay and its envelope."""
    scale, unit = decay.show.scale, decay.show.unit.strip()
    decay_rate = decay.trace.decay_rate
    shown, height = _shown(decay), 0.0
    largest = max(decay.trace.releases, key=lambda fitted: float(np.ptp(fitted.modelled)))
    # Rest levels that differ are the sign of friction, and not to be hidden by shifting each to zero.
    common = None if decay.linear else float(np.median([fitted.level for fitted in decay.trace.releases]))
    for i, (release, fitted) in enumerate(zip(decay.releases, decay.trace.releases, strict=True)):
        whole = release.roll if decay.trace.signal == "roll" or release.rate is None else release.rate
        level = fitted.level if common is None else common
        measured = scale * (whole - level)
        height = max(height, float(np.abs(measured[release.time - release.start <= shown]).max()))
        axes.plot(
            *thin(release.time - release.start, measured), color=REAL, lw=2.2, label=None if i else "measured"
        )
        since = fitted.trace.time - release.start
        modelled = scale * (fitted.modelled - level)
        axes.plot(*thin(since, modelled), color=SIM, lw=0.9, label=None if i else "linear decay")
        if fitted is largest:
            reach = scale * envelope(fitted, since, decay_rate)
            middle = scale * (fitted.level - level)
            axes.plot(*thin(since, middle + reach), color=NOISE, lw=0.8, ls=(0, (4, 3)), label="envelope")
            axes.plot(*thin(since, middle - reach), color=NOISE, lw=0.8, ls=(0, (4, 3)))
    about = " about rest" if decay.trace.signal == "roll" else ""
    axes.set(ylabel=f"{decay.show.name}{about} [{unit}]", xlim=(0, shown))
    axes.set_ylim(-1.15 * height, 1.15 * height)
    axes.legend(loc="upper right", ncols=3, handlelength=1.6, columnspacing=1.2)
    numbers = decay.numbers
    known = {"ωₙ": numbers.omega_n, "ζ": numbers.damping_ratio} | dict(
        zip(("k/d",), decay.others.values(), strict=False)
    )
    if decay.linear:
        axes.set_title("    ".join(f"{name} = {q}" for name, q in known.items() if math.isfinite(q.value)))
    else:
        axes.set_title(f"✗ {decay.status}: the line is the nearest linear decay", color=BAD)


def draw_residual(axes: "Axes", decay: FreeDecay) -> None:
    """Draw fitted minus measured, over the ±2σ band of the sensor noise."""
    from matplotlib.ticker import StrMethodFormatter

    scale, unit = decay.show.scale, decay.show.unit.strip()
    for release, fitted in zip(decay.releases, decay.trace.releases, strict=True):
        axes.plot(*thin(fitted.trace.time - release.start, -scale * fitted.residual), color=SIM, lw=0.7)
    band = 2 * decay.floor.std * scale
    axes.axhspan(-band, band, color=NOISE, alpha=0.3, lw=0)
    axes.axhline(0, color=REAL, lw=0.9)
    axes.set(xlabel="time since release [s]", ylabel=f"sim - real [{unit}]")
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    gap = "" if unit == "°" else " "
    axes.set_title(
        f"residual {decay.trace.noise * scale:.2g}{gap}{unit}, sensor noise {decay.floor.std * scale:.2g}{gap}{unit} (grey: ±2σ)"
    )


def draw_peak_line(axes: "Axes", decay: FreeDecay) -> None:
    """Draw ln(amplitude) of every usable peak against its number, the line through them, and the trace's slope."""
    from matplotlib.ticker import MaxNLocator

    used = [(i, group) for i, group in enumerate(decay.peaks) if group]
    if not used:
        empty = "no peak stands clear of the noise"
        axes.text(0.5, 0.5, empty, ha="center", transform=axes.transAxes, color=NOISE)
        axes.set_axis_off()
        return
    scale = decay.position.scale
    slope = -decay.numbers.log_decrement.value / 2
    for i, group in used:
        number = np.array([peak.number for peak in group])
        amplitude = scale * np.array([peak.amplitude for peak in group])
        std = scale * np.array([math.hypot(peak.std, decay.rest_angles[i].std) for peak in group])
        error = np.minimum(2 * std, 0.98 * amplitude)
        label = "peaks ±2σ" if i == used[0][0] else None
        axes.errorbar(number, amplitude, yerr=error, fmt="o", ms=3.5, color=REAL, elinewidth=0.8, label=label)
        # The trace gives the slope, and the widest peak, which noise moves least, the height.
        line = amplitude[0] * np.exp(slope * (number - number[0]))
        axes.plot(number, line, color=SIM, lw=1.0, label=label and "fitted decay")
    axes.set_yscale("log")
    smallest = min(peak.amplitude for _, group in used for peak in group)
    axes.set_ylim(bottom=max(axes.get_ylim()[0], scale * smallest / 3))
    _readable_log_axis(axes)
    unit = decay.position.unit.strip()
    axes.set(xlabel="half-cycles since release", ylabel=f"amplitude about rest [{unit}]")
    axes.set_xlim(-0.25, max(1, *(peak.number for _, group in used for peak in group)) + 0.25)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    lines = [f"δ = {decay.numbers.log_decrement}  whole trace"]
    lines += [] if decay.two_peaks is None else [f"δ = {decay.two_peaks}  two peaks"]
    axes.set_title("\n".join(lines))
    axes.legend(loc="lower left" if len(used[0][1]) > 2 else "upper right")


def _readable_log_axis(axes: "Axes") -> None:
    """Label a logarithmic axis with plain numbers, even if it spans less than a decade."""
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

    low, high = axes.get_ylim()
    if high / low < 8:
        axes.yaxis.set_major_locator(MaxNLocator(6))
    else:
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high / low < 100 else (1.0,)))
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def envelope(fitted: FittedTrace, since: Array, rate: float) -> Array:
    """Return the exponential that touches the fitted decay, from its largest excursions on."""
    swing = np.abs(fitted.modelled - fitted.level) * np.exp(rate * (since - since[0]))
    early = since - since[0] < 4.0 / max(rate, 1e-9)
    return float(swing[early].max()) * np.exp(-rate * (since - since[0]))


def _shown(decay: FreeDecay) -> float:
    """Return how long after the release there is something to see [s]."""
    longest = max(float(release.time[-1]) - release.start for release in decay.releases)
    ring = 6.0 / max(decay.trace.decay_rate, 1e-9)
    return min(longest, max(ring, 2 * math.pi / decay.trace.omega_n))
