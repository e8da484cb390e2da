"""First-order propagation of independent uncertainties, and who contributes what."""

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from sysid.quantity import Quantity


def propagate(formula: Callable[..., float], inputs: Sequence[Quantity], unit: str, method: str) -> Quantity:
    """Return formula(*values) with its standard deviation, by central differences in every input.

    Args:
        formula: Of the inputs' values, in their order.
        inputs: Independent quantities.
        unit: Of the result.
        method: Of the result, for people.
    """
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

    Inputs that the caller left to `method`'s defaults (gravity, say) are named too.
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
