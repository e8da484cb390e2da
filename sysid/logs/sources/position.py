"""Roll from a point that was followed: x and y of a bob, by a video tracker, and the pivot that it turns about."""

from collections.abc import Sequence

import numpy as np

from sysid.errors import SysidError
from sysid.logs.sources.registry import Reading, Source
from sysid.logs.table.choose import Choice, chosen, triple
from sysid.logs.table.names import LENGTH_UNITS, Column
from sysid.logs.table.noise import noise_of
from sysid.logs.table.remarks import note
from sysid.noise.whiteness import correlation_length
from sysid.quantity import Z95
from sysid.roll import Array, Roll


def find_position(columns: Sequence[Column], axis: str, sign: float) -> list[Choice]:
    """Return pairs of columns x and y of one point."""
    if any(triple(columns, kind, "xyz") for kind in ("unknown", "rate", "accel")):
        return []  # bare x, y and z are a sensor's axes
    pairs: dict[tuple[str, str | None], dict[str, Column]] = {}
    for column in columns:
        if column.kind in ("length", "unknown") and column.axis in ("x", "y"):
            pairs.setdefault((column.group, column.unit), {}).setdefault(column.axis, column)
    return [
        chosen((pair["x"], pair["y"]), "", sign, f"from the point '{pair['x'].name}', '{pair['y'].name}'")
        for pair in pairs.values()
        if len(pair) == 2
    ]


def fit_circle(points: Array) -> tuple[Array, float, float, float]:
    """Fit a circle to points, shape (n, 2), by least squares of the distances from it.

    Returns:
        Its centre, shape (2,), its radius, the radius' standard deviation and that of a point, all in the points' unit.
    """
    from scipy.optimize import least_squares

    middle, size = points.mean(axis=0), float(np.ptp(points, axis=0).max())
    some = (points - middle) / size
    design = np.column_stack((2 * some, np.ones(len(some))))  # Kåsa's algebraic circle as a start
    x, y, rest = np.linalg.lstsq(design, np.sum(some**2, axis=1), rcond=None)[0]
    start = (x, y, np.sqrt(max(rest + x**2 + y**2, 1e-6)))
    fit = least_squares(lambda c: np.hypot(some[:, 0] - c[0], some[:, 1] - c[1]) - c[2], start)
    variance = 2 * fit.cost / max(len(some) - 3, 1)
    # Errors that last, of a motion that is no circle, count once for as long as they do.
    covariance = variance * correlation_length([fit.fun]) * np.linalg.pinv(fit.jac.T @ fit.jac)
    spread = float(np.sqrt(covariance[2, 2])) * size
    return fit.x[:2] * size + middle, float(fit.x[2]) * size, spread, float(np.sqrt(variance)) * size


def roll_from_position(reading: Reading) -> Roll:
    """Return the angle of a point about its pivot: the one that is given, or the centre of the circle that it moves on.

    Raises:
        SysidError: The points lie on no circle whose radius is known.
    """
    choice, points = reading.choice, np.stack(reading.signals, axis=1)
    unit = choice.unit if choice.unit in LENGTH_UNITS else ""
    given = reading.options.video.pivot if reading.options.video else None
    if given is not None:
        pivot, radius, spread = np.array(given), float(np.median(np.linalg.norm(points - given, axis=1))), 0.0
        how = "given"
    else:
        pivot, radius, spread, beside = fit_circle(points)
        half = min(float(np.linalg.norm(np.ptp(points, axis=0))) / (2 * radius), 1.0)
        height = radius * (1 - np.sqrt(1 - half**2))  # of the arc over its chord
        if not (Z95 * spread < radius and height > 3 * beside):
            raise SysidError(
                f"'{choice.columns[0]}' and '{choice.columns[1]}' lie on no circle of known radius ({radius:.3g} ± "
                f"{Z95 * spread:.2g} {unit}). For a pendulum, give its pivot: --pivot X Y. For a slide, name one of them: "
                f"--column '{choice.columns[0]}'."
            )
        how = f"centre of the circle through the points, radius {radius:.4g} ± {Z95 * spread:.2g} {unit}".rstrip()
    arm = points - pivot
    down = np.sign(np.median(arm[:, 1])) or -1.0  # in pixels y points down
    roll = np.unwrap(np.arctan2(arm[:, 0], down * arm[:, 1])) * choice.sign
    noise = noise_of(reading.time, roll)
    remarks = note("pivot", f"({pivot[0]:.4g}, {pivot[1]:.4g}) {unit}".rstrip() + f", {how}")
    remarks += note("zero", f"where the point hangs below the pivot; y points {'up' if down < 0 else 'down'}")
    remarks += note("noise", f"{np.rad2deg(noise.std):.3g}° from the whole signal")
    return reading.as_roll(
        roll, np.full(roll.size, noise.std), "angle", remarks, zero="constant", scale_std=spread / radius
    )


SOURCE = Source(
    name="position", order=5, quantity=None, find=find_position, to_roll=roll_from_position, moving=2, compared=True,
)  # fmt: skip
