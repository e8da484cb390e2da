"""A number that travels with its uncertainty and its unit."""

import math
from dataclasses import dataclass, replace
from typing import Self

Z95 = 1.959963984540054
"""Half-width of a 95 % interval of a normal variable, in standard deviations."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A value, its standard deviation and its unit."""

    value: float
    std: float
    """Standard deviation in `unit`; NaN where it is not known, inf where the data leave it open."""
    unit: str
    """SI unit in MuJoCo's spelling, e.g. 'N*m/rad'; '1' for a pure number."""
    method: str = ""
    """How the number was obtained, for people."""
    interval: tuple[float, float] | None = None
    """95 % interval where it is not value ± 1.96 std (asymmetric, or from few samples)."""

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
        """The unit as people write it."""
        return self.unit.replace("*", "·").replace("^2", "²").replace("^3", "³")

    @property
    def number(self) -> str:
        """'value ± half-width of the 95 % interval', rounded to the uncertainty, without unit."""
        low, high = self.ci95
        half = (high - low) / 2
        if not math.isfinite(half) or half <= 0:
            return f"{self.value:.5g}"
        value, error = round_to_error(self.value, half)
        if "e" in error:  # both have the same power of ten
            (value, _), (error, power) = value.split("e"), error.split("e")
            return f"({value} ± {error})e{power}"
        return f"{value} ± {error}"


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


def _finite(number: float) -> float | None:
    return number if math.isfinite(number) else None
