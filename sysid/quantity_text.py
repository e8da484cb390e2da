"""Reading quantities as people write them: '2.58', '2.58±0.05', '3.1+-0.1deg'."""

import math
import re

from sysid.errors import HuskyError
from sysid.quantity import Z95, Quantity

_UNITS: dict[str, dict[str, float]] = {
    "kg": {"kg": 1.0, "g": 1e-3},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "s": {"s": 1.0, "ms": 1e-3},
    "rad": {"rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180},
    "rad/s": {"rad/s": 1.0, "Hz": 2 * math.pi},
}
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_PATTERN = re.compile(rf"\s*({_NUMBER})\s*(?:(?:±|\+-|\+/-)\s*({_NUMBER}))?\s*(\S*)\s*")


def parse_quantity(text: str, unit: str, name: str = "the quantity", *, positive: bool = True) -> Quantity:
    """Return the quantity that a text means; ± is the half-width of the 95 % interval, as in all output.

    Args:
        text: Such as '2.58', '2.58±0.05', '2.58+-0.05' or '20±0.2cm'.
        unit: SI unit of the result, which is also the unit of a text without one.
        name: What is being read, for messages.
        positive: Refuse zero and below.

    Raises:
        HuskyError: The text is not a quantity, or its unit is not one of `unit`'s kind.
    """
    scales = _UNITS.get(unit, {unit: 1.0})
    match = _PATTERN.fullmatch(text)
    if match is None or match[3] not in ("", *scales):
        kinds = f", in {unit}" + (f" or with {', '.join(list(scales)[1:])}" if len(scales) > 1 else "")
        raise HuskyError(f"{name} is '{text}'; expected a number such as 2.58 or 2.58±0.05{kinds}.")
    scale = scales[match[3] or unit]
    value, half = float(match[1]) * scale, float(match[2] or 0.0) * scale
    if half < 0 or (positive and value <= 0) or not math.isfinite(value) or not math.isfinite(half):
        raise HuskyError(f"{name} is '{text}'; expected a positive number ± a positive one.")
    return Quantity(value, half / Z95, unit)
