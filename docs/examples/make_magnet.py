"""Make magnet.csv: three releases of the pink board, little damped, with a magnet under the middle; seed 1.

python docs/examples/make_magnet.py
"""

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

INERTIA, STIFFNESS, DAMPING = 8.7e-3, 14.684, 0.06
"""[kg*m^2, N*m/rad, N*m*s/rad]."""
RATE, NOISE = 400.0, np.radians(0.03)
"""Samples a second [1/s], and the sensor's noise [rad]."""


def torque(tilt: float) -> float:
    """Return the magnet's torque [N*m]: it pulls to the middle, most at 0.7°."""
    return -12 * tilt / (1 + (tilt / 0.02) ** 2) ** 2


def main() -> None:
    """Write the log: rest, a slow drag by hand, a hold, the release, which decays to a tenth of the noise."""
    step = 1 / RATE
    parts: list[np.ndarray] = []
    for angle in (0.19, -0.16, 0.12):
        time = np.arange(0.0, 2.4, step)
        path = solve_ivp(
            lambda t, y: [y[1], (-STIFFNESS * y[0] - DAMPING * y[1] + torque(y[0])) / INERTIA],
            (0.0, time[-1]), [angle, 0.0], t_eval=time, method="DOP853", rtol=1e-9, atol=1e-11, max_step=1e-3,
        )  # fmt: skip
        drag = angle * (1 - np.cos(np.linspace(0, np.pi, int(0.5 * RATE)))) / 2
        parts += [np.zeros(int(0.5 * RATE)), drag, np.full(int(0.5 * RATE), angle), path.y[0]]
    roll = np.concatenate(parts)
    roll += NOISE * np.random.default_rng(1).standard_normal(len(roll))
    rows = (f"{i * step:.4f},{angle:.5f}\n" for i, angle in enumerate(roll))
    Path(__file__).with_name("magnet.csv").write_text("time_s,roll_rad\n" + "".join(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
