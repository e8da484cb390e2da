"""Frequency response of the identified joint: how far the deck tilts under a rider's torque, and how late."""

from typing import TYPE_CHECKING

import numpy as np

from reports.figures.palette import SIM
from sysid.board import Board
from sysid.fitting.bootstrap import FEWEST_DRAWS
from sysid.text import display

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def bode_figure(board: Board, width: float) -> "Figure":
    """Draw tilt over torque of the joint's linear part, 1/(I s² + d s + k), with its 95 % band, so wide [inch]."""
    import control
    from matplotlib.figure import Figure
    from matplotlib.ticker import StrMethodFormatter

    natural = np.sqrt(board.stiffness / board.inertia.value)
    omega = np.geomspace(natural / 30, natural * 10, 200)
    rng = np.random.default_rng(0)
    parts = (board.inertia, board.tilt["damping"], board.tilt["stiffness"])
    nominal = np.array([part.value for part in parts])
    spread = np.array([part.std if np.isfinite(part.std) else 0.0 for part in parts])
    draws = np.vstack([nominal, np.abs(nominal + spread * rng.standard_normal((2 * FEWEST_DRAWS, 3)))])
    responses = np.array(
        [control.TransferFunction([1.0], coefficients)(1j * omega) for coefficients in draws]
    )
    figure = Figure(figsize=(width, 3.6), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    show = display(is_rate=False, slides=board.slides)
    gain = f"{show.name} [{show.unit.strip()}/{'N' if board.slides else '(N·m)'}]"
    curves = (show.scale * np.abs(responses), np.degrees(np.angle(responses)))
    for panel, values, label in zip(axes, curves, (gain, "phase [°]"), strict=True):
        low, high = np.quantile(values[1:], (0.025, 0.975), axis=0)
        panel.fill_between(omega / (2 * np.pi), low, high, color=SIM, alpha=0.25, lw=0)
        panel.plot(omega / (2 * np.pi), values[0], color=SIM, lw=1.2)
        panel.set_ylabel(label)
    axes[0].set(xscale="log", yscale="log")
    for axis in (axes[0].yaxis, axes[1].xaxis):
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes[1].set(xlabel="frequency [Hz]", yticks=(-180, -90, 0))
    figure.align_ylabels()
    return figure
