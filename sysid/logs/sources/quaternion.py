"""Roll from an orientation quaternion."""

from collections.abc import Sequence

import numpy as np

from sysid.errors import SysidError
from sysid.logs.sources.axis import find_roll_axis, plane_about
from sysid.logs.sources.registry import Reading, Source
from sysid.logs.table.choose import Choice, chosen, triple
from sysid.logs.table.names import Column
from sysid.logs.table.noise import noise_of
from sysid.logs.table.remarks import note
from sysid.roll import Roll


def find_quaternion(columns: Sequence[Column], axis: str, sign: float) -> list[Choice]:
    """Return the columns w, x, y, z of one orientation."""
    kinds = "quaternion", "angle", "unknown"
    found = next((four for kind in kinds if (four := triple(columns, kind, "wxyz"))), None)
    if found is None:
        return []
    return [chosen(found, axis, sign, f"from the orientation '{found[0].name}'..., taken as sensor to earth")]


def roll_from_quaternion(reading: Reading) -> Roll:
    """Return the swing of an orientation about its roll axis; the orientation turns sensor into earth axes.

    Raises:
        SysidError: The rows are no orientation.
    """
    from scipy.spatial.transform import Rotation

    choice, quaternion = reading.choice, np.stack(reading.signals, axis=1)
    norm = np.linalg.norm(quaternion, axis=1)
    usual = float(np.median(norm))
    off = np.count_nonzero(~(np.abs(norm - usual) < 0.1 * usual))
    if off:
        raise SysidError(
            f"{', '.join(map(repr, choice.columns))}: {off} rows are no orientation (their norm is not that of the "
            "others). Is the order w, x, y, z and the file whole? A joint among them is named with --column."
        )
    attitude = Rotation.from_quat(quaternion[:, [1, 2, 3, 0]])
    turned = (attitude[:-1].inv() * attitude[1:]).as_rotvec()
    rates = turned / np.diff(reading.time)[:, None]
    rates = np.concatenate((rates[:1], 0.5 * (rates[1:] + rates[:-1]), rates[-1:]))
    axis, remarks = find_roll_axis(rates, choice)
    up = attitude.as_matrix()[:, 2, :]
    plane = plane_about(axis, up)
    if plane is None:  # the axis stands upright: the sum of the turns is all there is
        roll = np.concatenate(([0.0], np.cumsum(turned @ axis)))
        remarks += note("zero", "at the first sample: the roll axis stands upright")
    else:
        roll, remarks = np.unwrap(np.angle(plane.of(up))), remarks + plane.zero
    noise = noise_of(reading.time, roll)
    remarks += note("noise", f"{np.rad2deg(noise.std):.3g}° from the whole signal")
    return reading.as_roll(roll, np.full(roll.size, noise.std), "quaternion", remarks, zero="constant")


SOURCE = Source(name="quaternion", order=3, quantity=None, find=find_quaternion, to_roll=roll_from_quaternion)
