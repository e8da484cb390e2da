"""Decays of a lightly damped board with a torque more, by an integrator that the fit does not have."""

import numpy as np
from made import release
from scipy.integrate import solve_ivp

from sysid.board import Board
from sysid.quantity import Quantity

NOISE = np.radians(0.04)
BOARD = Board.load("pink").with_tilt(damping=Quantity(0.06, 1e-3, "N*m*s/rad"))


def releases(torque, angles=(0.19, -0.15), seed=0, noise=NOISE):
    """Return decays of the pink board with a torque more, by an integrator that the fit does not have."""
    rng, time = np.random.default_rng(seed), np.arange(0, 1.0, 4e-3)
    found = []
    for number, angle in enumerate(angles, start=1):
        path = solve_ivp(
            lambda t, y: [y[1], (-BOARD.stiffness * y[0] - 0.06 * y[1] + torque(t, *y)) / BOARD.inertia.value],
            (0, 1.0), [angle, 0.0], t_eval=time, method="DOP853", rtol=1e-8, atol=1e-10, max_step=2e-3,
        )  # fmt: skip
        found.append(release(time, path.y[0], noise, rng=rng, number=number))
    return found


def magnet(t, x, v):
    """Return the torque of a magnet in the middle [N*m]."""
    return -12 * x / (1 + (x / 0.02) ** 2) ** 2
