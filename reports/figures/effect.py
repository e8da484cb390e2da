"""A decay with an effect and without."""

from typing import TYPE_CHECKING

import numpy as np

from reports.figures.palette import REAL, SIM
from reports.figures.style import styled
from sysid.effects._base import Effect, TorqueEffect
from sysid.joint import JointLaw, simulate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLAIN = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.06)
"""The pink board with a sixth of its damping, so that several swings show."""
STIFF = JointLaw(inertia=7.15e-3, stiffness=34.85, damping=0.54)
"""The black board: a simulator's step shows on a strong damper only."""


def effect_figure(effect: Effect) -> "Figure":
    """Draw the decay with the effect (real, orange) and without (sim, blue)."""
    base = STIFF if isinstance(effect, TorqueEffect) and effect.timestep else PLAIN
    time = np.linspace(0.0, 0.25 if base is STIFF else 1.0, 800)
    real = simulate(base.with_effect(effect.name, *effect.example), time, 0.17)
    sim = simulate(base, time, 0.17)
    with styled(6.4, 2.5) as figure:
        axes = figure.add_subplot()
        axes.plot(time, np.degrees(real.roll), color=REAL, linewidth=2.4, label=f"with {effect.name}")
        axes.plot(time, np.degrees(sim.roll), color=SIM, linewidth=1.2, label="without")
        axes.set_xlabel("time since release [s]")
        axes.set_ylabel("angle [°]")
        values = ", ".join(
            f"{p.name} {v:g} {p.unit.replace('*', '·').removesuffix('1')}".strip()
            for p, v in zip(effect.parameters, effect.example, strict=True)
        )
        axes.set_title(f"{effect.title}: {values}" if len(effect.parameters) <= 6 else effect.title)
        axes.legend(loc="upper right")
    return figure
