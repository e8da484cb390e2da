"""The figures of a board's page: decays, where they part, torque, backbone, ladder, look-alikes, correlation."""

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from reports.evidence import Evidence
from reports.figures.palette import HELD_OUT, NOISE, REAL, SIM
from reports.figures.svg import thin
from sysid.comparison.compare import Comparison
from sysid.diagnosis.signatures import LookAlikes
from sysid.fitting.ladder import Rung
from sysid.joint.torques import memoryless_torque
from sysid.roll import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LADDER = ("#CC79A7", "#56B4E9", "#009E73", "#D55E00", "#8C6BB1")
WIDTH = 9.2
"""Width of a figure over the whole page [inch]."""
LEVELS = 21
"""Colours of a map."""


def release_figure(evidence: Evidence, number: int) -> "Figure":
    """Draw one release: measured, simulated and the simpler models, over the residual with the noise band."""
    result = evidence.comparison
    release, scale, unit = result.releases[number], _scale(result), "°" if not result.is_rate else "rad/s"
    figure = _figure(4.3)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 1))
    time, measured, simulated, residual = thin(
        release.time, release.measured, release.simulated, release.residual
    )
    top.plot(time, scale * measured, color=REAL, lw=2.8, gid="series:real")
    colours = [LADDER[j % len(LADDER)] for j in range(len(evidence.ladder) - 1)]
    for rung, colour in zip(evidence.ladder[:-1], colours, strict=True):
        simpler, error = rung.simulated[number], rung.simulated[number] - release.measured
        top.plot(*thin(release.time, scale * simpler), color=colour, lw=1.0, gid=f"series:{rung.label}")
        bottom.plot(
            *thin(release.time, scale * error), color=colour, lw=0.7, gid=f"series:{rung.label}@error"
        )
    top.plot(time, scale * simulated, color=SIM, lw=1.2, gid="series:sim")
    band = 2 * scale * result.noise.std
    bottom.axhspan(-band, band, color=NOISE, alpha=0.3, lw=0)
    bottom.plot(time, scale * residual, color=SIM, lw=0.8, gid="series:sim@error")
    top.set_ylabel(f"{'rate' if result.is_rate else 'roll'} [{unit}]")
    bottom.set(xlabel="time since release [s]", ylabel=f"model - real [{unit}]")
    top.set_xlim(release.time[0], release.time[-1])
    figure.align_ylabels()
    return figure


def where_figure(result: Comparison) -> "Figure":
    """Draw which share of the error beyond the noise sits where, one group of bars an axis."""
    places = sorted(result.where, key=lambda p: (_AXES.index(p.axis), p.range))
    figure = _figure(0.6 + 0.21 * len(places))
    axes = figure.subplots()
    rows = np.arange(len(places))
    axes.barh(rows, [100 * p.share for p in places], color=SIM, height=0.7)
    axes.set_yticks(rows, [p.text for p in places])
    axes.invert_yaxis()
    for row, (before, after) in enumerate(pairwise(places)):
        if before.axis != after.axis:
            axes.axhline(row + 0.5, color=NOISE, lw=0.8)
    axes.axvline(0, color=NOISE, lw=0.8)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("share of the squared error beyond the noise [%]")
    return figure


_AXES = ("time", "amplitude", "velocity", "side", "phase")


def backbone_figure(result: Comparison) -> "Figure":
    """Draw period and damping ratio of each half swing against its amplitude."""
    figure = _figure(2.7)
    for axes, what, label in zip(
        figure.subplots(1, 2), ("period", "damping_ratio"), ("period [s]", "damping ratio"), strict=True
    ):
        for backbone, colour, name, size in (
            (result.measured_backbone, REAL, "real", 7.5),
            (result.simulated_backbone, SIM, "sim", 3.5),
        ):
            axes.plot(
                np.degrees(backbone.amplitude), getattr(backbone, what), "o",
                color=colour, ms=size, mew=0, gid=f"series:{name}@{what}",
            )  # fmt: skip
        axes.set(xlabel="amplitude [°]", ylabel=label)
        axes.margins(x=0.05, y=0.25)
        low, high = axes.get_ylim()
        least = 0.1 * (low + high) / 2
        if high - low < least:  # a flat backbone must not look wild
            axes.set_ylim((low + high - least) / 2, (low + high + least) / 2)
    return figure


def missing_torque_figure(result: Comparison, size: tuple[float, float] | None = None) -> "Figure":
    """Draw the map of the torque that the model lacks, and with its default size the two cuts beside it."""
    from matplotlib.figure import Figure

    missing = result.missing
    if missing is None:
        raise ValueError("no torque was estimated")
    if size is not None:
        figure = Figure(figsize=size, layout="constrained")
        _map(figure.subplots(), result)
        return figure
    figure = _figure(2.9)
    surface, spring, damper = figure.subplots(1, 3, width_ratios=(1.25, 1, 1))
    _map(surface, result)
    angle, rate = _middles(missing.angle), _middles(missing.rate)
    _cut(spring, result, angle, np.zeros_like(angle), axis=1)
    spring.set(xlabel="tilt [°]", ylabel="restoring torque [N·m]")
    _cut(damper, result, np.zeros_like(rate), rate, axis=0)
    damper.set(xlabel="rate [rad/s]", ylabel="damping torque [N·m]")
    return figure


def _map(axes: "Axes", result: Comparison) -> None:
    import matplotlib as mpl

    missing = result.missing
    assert missing is not None
    filled = np.isfinite(missing.torque)
    largest = float(np.quantile(np.abs(missing.torque[filled]), 0.98)) if filled.any() else 1.0
    cells = axes.pcolormesh(
        np.degrees(missing.angle), missing.rate, np.ma.masked_invalid(missing.torque.T),
        cmap=mpl.colormaps["PuOr"].resampled(LEVELS), vmin=-(largest or 1.0), vmax=largest or 1.0,
    )  # fmt: skip
    axes.grid(visible=False)
    axes.set(xlabel="tilt [°]", ylabel="rate [rad/s]")
    axes.set_title("missing torque [N·m]", loc="left", fontsize=9)
    bar = axes.figure.colorbar(cells, ax=axes)
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]


def _cut(axes: "Axes", result: Comparison, tilt: Array, rate: Array, axis: int) -> None:
    """Draw the law along one axis, and what the measurement demands there: the law and the mean of what it lacks."""
    missing = result.missing
    assert missing is not None
    x = np.degrees(tilt) if axis == 1 else rate
    law = result.law
    torque = -memoryless_torque(law, law.rest_angle + tilt, rate)
    weight = np.where(np.isfinite(missing.torque), missing.count, 0.0)
    total, count = np.nansum(weight * np.nan_to_num(missing.torque), axis=axis), weight.sum(axis=axis)
    seen = count > 0
    axes.plot(
        x[seen], torque[seen] - total[seen] / count[seen], "o", color=REAL, ms=5, mew=0, gid="series:real"
    )
    fine = np.linspace(-1, 1, 201)
    widest, fastest = fine * float(np.abs(tilt).max()), fine * float(np.abs(rate).max())
    line = -memoryless_torque(law, law.rest_angle + widest, fastest)
    axes.plot(fine * float(np.abs(x).max()), line, color=SIM, lw=1.2, gid="series:sim")


def _middles(edges: Array) -> Array:
    return (edges[:-1] + edges[1:]) / 2


def ladder_figure(rungs: Sequence[Rung], result: Comparison) -> "Figure":
    """Draw the error of each model, on the fitted releases and on ones left out, over the noise floor."""
    scale, unit = _scale(result), "rad/s" if result.is_rate else "°"
    figure = _figure(2.9, width=min(WIDTH, 3.2 + 1.5 * len(rungs)))
    axes = figure.subplots()
    x = np.arange(len(rungs))
    for shift, name, colour in ((-0.18, "rmse", SIM), (0.18, "heldout_rmse", HELD_OUT)):
        values = [scale * getattr(rung, name) for rung in rungs]
        axes.bar(
            x + shift, values, 0.34, color=colour, label="fitted" if name == "rmse" else "predicted, left out"
        )
        for place, value in zip(x, values, strict=True):
            axes.annotate(
                f"{value:.3g}",
                (place + shift, value),
                (0, 3),
                textcoords="offset points",
                ha="center",
                va="bottom",
                fontsize=8,
            )
    axes.axhline(scale * result.noise.std, color=NOISE, ls="--", lw=1.2, label="noise floor", zorder=0.5)
    axes.set_xticks(x, [rung.label for rung in rungs])
    axes.set_xlim(-0.6, len(rungs) - 0.4)
    axes.set_ylabel(f"RMS error [{unit}]")
    axes.margins(y=0.3)
    axes.grid(visible=False, axis="x")
    axes.legend(loc="upper right", ncols=3, fontsize=8)
    return figure


def look_alikes_figure(alike: LookAlikes) -> "Figure":
    """Draw how alike the signatures of the effects are in these releases."""
    count = len(alike.names)
    return _matrix(alike.cosine, alike.names, "Blues", 0.0, 0.34 * count + 1.2)


def correlation_figure(names: Sequence[str], correlation: Array) -> "Figure":
    """Draw the correlation of the fitted parameters."""
    return _matrix(correlation, names, "RdBu_r", -1.0, 0.55 * len(names) + 1.0)


def _matrix(values: Array, names: Sequence[str], colours: str, low: float, height: float) -> "Figure":
    import matplotlib as mpl

    figure = _figure(height, width=min(WIDTH, height + 2.2))
    axes = figure.subplots()
    axes.pcolormesh(np.asarray(values), cmap=mpl.colormaps[colours].resampled(LEVELS), vmin=low, vmax=1.0)
    for i, j in np.ndindex(values.shape):
        strong = abs(values[i, j]) > 0.6
        text = f"{values[i, j]:.2f}".replace("-0.00", "0.00")
        ink = "light-ink" if strong else "dark-ink"
        axes.text(
            j + 0.5, i + 0.5, text, ha="center", va="center", fontsize=7.5,
            color="#ffffff" if strong else "#101010", gid=f"{ink}{i}-{j}",
        )  # fmt: skip
    ticks = np.arange(len(names)) + 0.5
    axes.set_xticks(ticks, names, rotation=40, ha="right", rotation_mode="anchor")
    axes.set_yticks(ticks, names)
    axes.invert_yaxis()
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
    return figure


def log_figure(evidence: Evidence, number: int) -> "Figure":
    """Draw one whole log with its phases shaded."""
    roll, phases = evidence.rolls[number], evidence.phases[number]
    figure = _figure(1.9)
    axes = figure.subplots()
    shades = {"free": (SIM, 0.14), "held": (REAL, 0.16), "caught": ("#CC79A7", 0.22)}
    named: set[str] = set()
    for phase in phases:
        if phase.kind in shades:
            colour, alpha = shades[phase.kind]
            label = None if phase.kind in named else phase.kind
            axes.axvspan(phase.start, phase.end, color=colour, alpha=alpha, lw=0, label=label)
            named.add(phase.kind)
    axes.plot(*thin(roll.time, np.degrees(roll.roll)), color=REAL, lw=0.9, gid="series:roll")
    axes.set(xlabel="time [s]", ylabel="roll [°]", xlim=(roll.time[0], roll.time[-1]))
    axes.margins(y=0.2)
    axes.legend(loc="upper right", ncols=3, fontsize=8)
    return figure


def _figure(height: float, width: float = WIDTH) -> "Figure":
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _scale(result: Comparison) -> float:
    return 1.0 if result.is_rate else float(np.degrees(1.0))
