"""Parameters that a user holds at a value: `--fix NAME=VALUE`."""

from collections.abc import Sequence

from sysid.effects import effect
from sysid.errors import HuskyError, did_you_mean


def fixed_values(given: Sequence[str], effects: Sequence[str]) -> dict[str, float]:
    """Return the values that parameters are held at, by name.

    Args:
        given: 'NAME=VALUE' each.
        effects: Effects of the joint, whose parameters may be held too.

    Raises:
        HuskyError: No such parameter, no number, or a parameter twice.
    """
    known = ["stiffness", "damping", "rest_angle"]
    known += [f"{name}.{p.name}" for name in effects for p in effect(name).parameters]
    values: dict[str, float] = {}
    for text in given:
        name, _, number = text.partition("=")
        if name not in known:
            raise HuskyError(
                f"--fix {text}: no parameter '{name}'.{did_you_mean(name, known)} There are: {', '.join(known)}."
            )
        if name in values:
            raise HuskyError(f"--fix {text}: {name} is held already. Give each parameter once.")
        try:
            values[name] = float(number)
        except ValueError:
            raise HuskyError(
                f"--fix {text}: '{number}' is no number. Write --fix {name}=0.5, in SI units."
            ) from None
    return values
