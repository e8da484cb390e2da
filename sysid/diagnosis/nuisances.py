"""Columns without a name: a torque g of angle and rate, and what the sensor adds."""

import numpy as np

from sysid.diagnosis.motion import Motion
from sysid.diagnosis.smoother import Smoothed
from sysid.roll import Array

FINE, COARSE = 17, 6
"""Radial functions of g along angle and along rate, and on each side of a grid over both."""
SENSOR = 0.005
"""Prior deviation of each quadratic and cubic term of the sensor's own distortion, over the widest swing: a lens or an encoder."""
LAGS = (0.1, 0.3)
"""Lags of a sensor that filters [rad of swing]."""
DRIFT = 0.006
"""Random walk of the sensor's zero in the square root of a period, over the widest swing."""
WANDERS = 8
"""Karhunen-Loève functions of that walk in each release."""


def nameless(motion: Motion, smoothed: Smoothed, linear: float, damping: float) -> Array:
    """Return the functions of g [1], each of the size of its prior deviation at τ = 1, shape (n, m).

    Gaussian functions of angle, of rate, and of both, and a slow drift of stiffness and damping, within and between releases. They are
    orthogonal to spring, damper, constant, x², x³, v|v|, v³ and sgn v, so that g cannot take a torque that has a name.

    Args:
        motion: The log.
        smoothed: Its motion.
        linear: RMS torque of the spring.
        damping: d: torques of the rate are smaller than the spring's by about 2 d.
    """
    inside = motion.inside
    x, v = smoothed.angle[inside], smoothed.rate[inside]
    u = v / np.abs(v).max()
    fine, coarse = np.linspace(-1, 1, FINE), np.linspace(-1, 1, COARSE)
    near, far = 2 / (FINE - 1), 2 / (COARSE - 1)  # as wide as they are apart
    of_angle = [np.exp(-0.5 * ((x - c) / near) ** 2) for c in fine]
    of_rate = [np.exp(-0.5 * ((u - c) / near) ** 2) for c in fine]
    of_both = [
        np.exp(-0.5 * (((x - a) / far) ** 2 + ((u - b) / far) ** 2))
        for a in coarse for b in coarse if a * a + b * b < 1.5
    ]  # fmt: skip
    within = np.broadcast_to(np.linspace(-0.5, 0.5, inside.shape[1]), inside.shape)[inside]
    between = np.broadcast_to(np.linspace(-0.5, 0.5, len(inside))[:, None], inside.shape)[inside]
    drift = [within * x, between * x, within * v, between * v]
    table = np.column_stack([*of_angle, *of_rate, *of_both, *drift])
    named = named_functions(x, v)
    table = table - named @ np.linalg.lstsq(named, table, rcond=None)[0]
    size = linear / np.maximum(np.sqrt(np.mean(table**2, axis=0)), 1e-2)
    loss = min(1.0, 4 * damping)
    bumps = len(table.T) - len(drift)
    size[:bumps] /= np.sqrt(bumps / 10)  # about a tenth of them act on one sample
    size[FINE:bumps] *= loss
    size[-2:] *= loss
    return table * size


def named_functions(x: Array, v: Array) -> Array:
    """Return the torques of spring, damper, constant, x², x³, v|v|, v³ and sgn v [1], shape (n, 8), of angle and rate, (n,) each."""
    return np.column_stack([x, v, np.ones_like(x), x * x, x**3, v * np.abs(v), v**3, np.tanh(v / 0.02)])


HATS = 16
"""Hat functions of a hand's torque in a period."""


def hand(motion: Motion) -> Array:
    """Return torques of a hand that lets go slowly, or pushes [1], shape (n, h): hat functions over one period, the first of all rows first.

    A hand is as strong as the spring at the release.
    """
    after = np.arange(motion.reading.shape[1]) / motion.nodes_a_period * HATS
    rows = np.eye(len(motion.length))[:, :, None] * motion.envelope[:, :1]
    hats = [row * np.maximum(1 - np.abs(after - i), 0.0) for i in range(HATS) for row in rows]
    return np.column_stack([hat[motion.inside] for hat in hats])


def sensor(motion: Motion, smoothed: Smoothed) -> tuple[Array, Array]:
    """Return what a sensor may add to a reading [1], shape (n, s), and the prior deviation of each term, shape (s,).

    Its distortion is a polynomial of angle and rate. A filter with a lag τ follows a release late, by about τ² e^(-t/τ) of the swing
    beside its steady lag, which the joint's own motion takes up. The zero of an angle wanders as a random walk (Karhunen-Loève
    functions), that of a rate is off by a constant.
    """
    inside = motion.inside
    x, v = smoothed.angle, smoothed.rate
    bent = [a[inside] for a in (x * x, v * v, x * v, x**3, x * x * v, x * v * v)]
    walks = [np.ones(len(bent[0]))] if motion.is_rate else []
    for row, n in enumerate([] if motion.is_rate else motion.length):
        waves = [(i + 0.5) * np.pi for i in range(WANDERS)]
        shapes = [np.sqrt(2) * np.sin(w * np.arange(n) / n) / w for w in waves]
        for shape in [
            *shapes,
            *([np.ones(n)] if row else []),
        ]:  # where a release starts, the zero has wandered as long already
            walk = np.zeros_like(x)
            walk[row, :n] = np.sqrt(n / motion.nodes_a_period) * shape
            walks.append(walk[inside])
    rows, time = np.arange(len(inside))[:, None], np.arange(inside.shape[1]) * motion.step
    fading = [np.where(rows == row, np.exp(-time / lag), 0.0)[inside] for row in rows[:, 0] for lag in LAGS]
    deviations = [*[SENSOR] * len(bent), *[lag**2 for lag in LAGS] * len(rows), *[DRIFT] * len(walks)]
    return np.column_stack([*bent, *fading, *walks]), np.array(deviations)


BENDS, BEND = 4, 0.05
"""No law is exact: functions that bend a law, and the prior deviation of each as a share of the law's strength."""
TENTH = BEND * float(np.sqrt(BENDS))
"""All of them together."""


def bends(motion: Motion, smoothed: Smoothed) -> Array:
    """Return functions of angle and rate by which a law may be off [1], shape (n, BENDS): Chebyshev polynomials of degree 1 and 2."""
    x, v = smoothed.angle[motion.inside], smoothed.rate[motion.inside]
    v = v / np.abs(v).max()
    return np.column_stack([x, 2 * x * x - 1, v, 2 * v * v - 1])
