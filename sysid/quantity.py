"""A number with uncertainty and unit: printed, parsed, propagated."""

import inspect
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

from sysid.errors import SysidError

Z95 = 1.959963984540054
"""Half-width of a 95 % interval of a normal variable, in standard deviations."""
SURE = 4.0
"""Standard deviations from which a difference is certain: by chance in one of 16,000."""
_DEGREE = math.radians(1.0)
_UNITS: dict[str, dict[str, float]] = {
    "kg": {"g": 1e-3}, "m": {"cm": 1e-2, "mm": 1e-3}, "s": {"ms": 1e-3}, "rad": {"deg": _DEGREE, "°": _DEGREE},
    "rad/s": {"Hz": math.tau},
}  # fmt: skip
"""Other units of a quantity, in its SI unit."""
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_PATTERN = re.compile(rf"\s*({_NUMBER})\s*(?:(?:±|\+-|\+/-)\s*({_NUMBER}))?\s*(\S*)\s*")


def printed(unit: str) -> str:
    """Return a unit in print, e.g. 'N·m/rad'."""
    return unit.replace("*", "·").replace("^2", "²").replace("^3", "³")


@dataclass(frozen=True, slots=True)
class Quantity:
    """A value, its standard deviation and its unit."""

    value: float
    std: float
    """Standard deviation in `unit`; NaN if unknown, inf if the data leave the value open."""
    unit: str
    """SI unit in MuJoCo's spelling, e.g. 'N*m/rad'; '1' for a pure number."""
    method: str = ""
    """Source of the number, in words."""
    interval: tuple[float, float] | None = None
    """95 % interval if it is not value ± 1.96 std (asymmetric, or from few samples)."""

    @property
    def ci95(self) -> tuple[float, float]:
        """The 95 % interval in `unit`."""
        if self.interval is not None:
            return self.interval
        return self.value - Z95 * self.std, self.value + Z95 * self.std

    def with_method(self, method: str) -> Self:
        """Return the same quantity with another `method`."""
        return replace(self, method=method)

    def to_json(self) -> dict[str, object]:
        """Return `{"value", "std", "ci95", "unit"}`; non-finite numbers become None."""
        low, high = self.ci95
        return {
            "value": _finite(self.value),
            "std": _finite(self.std),
            "ci95": [_finite(low), _finite(high)],
            "unit": self.unit,
        }

    def __str__(self) -> str:
        """Return 'value ± half-width of the 95 % interval unit', rounded to the uncertainty."""
        return self.number if self.unit == "1" else f"{self.number} {self.printed_unit}"

    @property
    def printed_unit(self) -> str:
        """The unit in print."""
        return printed(self.unit)

    @property
    def number(self) -> str:
        """'value ± half-width of the 95 % interval', rounded to the uncertainty, without unit."""
        low, high = self.ci95
        half = (high - low) / 2
        if math.isfinite(low) and high == math.inf:
            return f"≥ {low:.2g}"
        if not math.isfinite(half) or half <= 0:
            return f"{self.value:.5g}"
        value, error = round_to_error(self.value, half)
        if "e" in error:  # both have the same power of ten
            (value, _), (error, power) = value.split("e"), error.split("e")
            return f"({value} ± {error})e{power}"
        return f"{value} ± {error}"


def slide_unit(unit: str) -> str:
    """Return the unit of a slide for that of a hinge, e.g. 'N/m' for 'N*m/rad'; also amid a sentence."""
    return re.sub(r"\brad\b", "m", unit.replace("N*m", "N").replace("kg*m^2", "kg"))


def round_to_error(value: float, error: float) -> tuple[str, str]:
    """Print a value and its error to the error's two leading digits.

    >>> round_to_error(14.68412, 0.0613)
    ('14.684', '0.061')
    """
    exponent = math.floor(math.log10(abs(error)))
    decimals = 1 - exponent
    size = max(abs(value), abs(error))
    if size != 0 and (size < 1e-3 or size >= 1e6):
        power = math.floor(math.log10(size))
        digits = max(0, power - exponent + 1)
        return f"{value / 10**power:.{digits}f}e{power:+d}", f"{error / 10**power:.{digits}f}e{power:+d}"
    decimals = max(0, decimals)
    return f"{value:.{decimals}f}", f"{error:.{decimals}f}"


def parse_quantity(text: str, unit: str, name: str = "the quantity", *, positive: bool = True) -> Quantity:
    """Parse a quantity; ± is the half-width of the 95 % interval, as in all output.

    Args:
        text: Such as '2.58', '2.58±0.05', '2.58+-0.05' or '20±0.2cm'.
        unit: SI unit of the result, which is also the unit of a text without one.

    Raises:
        SysidError: The text is not a quantity, or its unit is not one of `unit`'s kind.
    """
    scales = {unit: 1.0, **_UNITS.get(unit, {})}
    match = _PATTERN.fullmatch(text)
    if match is None or match[3] not in ("", *scales):
        kinds = f", in {unit}" + (f" or with {', '.join(list(scales)[1:])}" if len(scales) > 1 else "")
        raise SysidError(f"{name} is '{text}'; expected a number such as 2.58 or 2.58±0.05{kinds}.")
    scale = scales[match[3] or unit]
    value, half = float(match[1]) * scale, float(match[2] or 0.0) * scale
    if half < 0 or (positive and value <= 0) or not math.isfinite(value) or not math.isfinite(half):
        raise SysidError(f"{name} is '{text}'; expected a positive number ± a positive one.")
    return Quantity(value, half / Z95, unit)


def propagate(formula: Callable[..., float], inputs: Sequence[Quantity], unit: str, method: str) -> Quantity:
    """Return formula(*values) of independent inputs with its standard deviation, by central differences in every input."""
    values = [quantity.value for quantity in inputs]
    variance = 0.0
    for index, quantity in enumerate(inputs):
        if quantity.std > 0:
            step = min(quantity.std, 1e-4 * abs(quantity.value) or quantity.std)
            above, below = list(values), list(values)
            above[index] += step
            below[index] -= step
            variance += ((formula(*above) - formula(*below)) / (2 * step) * quantity.std) ** 2
    return Quantity(formula(*values), math.sqrt(variance), unit, method)


def error_budget(method: Callable[..., Quantity], inputs: Mapping[str, Quantity]) -> dict[str, float]:
    """Return each input's share of the variance of `method(**inputs)`, largest first; they sum to 1.

    It includes defaults of `method`, such as gravity.
    """
    defaults = {
        name: parameter.default
        for name, parameter in inspect.signature(method).parameters.items()
        if isinstance(parameter.default, Quantity)
    }
    given = {**defaults, **inputs}
    exact = {name: replace(quantity, std=0.0) for name, quantity in given.items()}
    variances = {name: method(**{**exact, name: quantity}).std ** 2 for name, quantity in given.items()}
    total = sum(variances.values())
    ranked = sorted(variances.items(), key=lambda item: -item[1])
    return {name: variance / total for name, variance in ranked if variance > 0}


def t95(degrees_of_freedom: float) -> float:
    """Half-width of a 95 % interval in standard deviations: Student's t, 1.96 for many samples.

    With t = √ν tan θ the density of θ is cos^(ν-1) θ; its running integral gives the quantile. For many degrees of
    freedom the series of Cornish and Fisher is right to 4e-5. Importing scipy would take longer than a whole fit.
    """
    nu = max(degrees_of_freedom, 1.0)
    if nu > 40:
        z = Z95
        return z + (z**3 + z) / (4 * nu) + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * nu**2)
    import numpy as np

    theta = np.linspace(0, math.pi / 2, 20_001)
    density = np.cos(theta) ** (nu - 1)
    share = np.concatenate([[0.0], np.cumsum(density[1:] + density[:-1])])
    return math.sqrt(nu) * math.tan(float(np.interp(0.95 * share[-1], share, theta)))


def _finite(number: float) -> float | None:
    return number if math.isfinite(number) else None


GRAVITY = Quantity(9.80665, 0.013, "m/s^2")
"""Standard gravity, with the standard deviation over places on Earth."""
