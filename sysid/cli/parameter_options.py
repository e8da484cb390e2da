"""Parameters on the command line: NAME=VALUE and NAME=LOW:HIGH."""

from collections.abc import Sequence

from sysid.errors import SysidError

SHORT = {"rest": "rest_angle"}
"""Names that a user may write shorter."""


def parse_fixed(texts: Sequence[str], option: str = "--fix") -> dict[str, float]:
    """Return parameters and values of '--fix NAME=VALUE', or names and values of another option of that shape.

    Raises:
        SysidError: A text has another shape.
    """
    return {name: _number(value, f"{option} {name}") for name, value in _pairs(texts, option, "VALUE")}


def parse_bounds(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Return parameters and ends of '--bound NAME=LOW:HIGH'.

    Raises:
        SysidError: A text has another shape.
    """
    found: dict[str, tuple[float, float]] = {}
    for name, value in _pairs(texts, "--bound", "LOW:HIGH"):
        low, colon, high = value.partition(":")
        if not colon:
            raise SysidError(f"--bound {name}={value} has no ':'; expected --bound {name}=LOW:HIGH.")
        found[name] = (_number(low, f"--bound {name}"), _number(high, f"--bound {name}"))
    return found


def _pairs(texts: Sequence[str], option: str, value_shape: str) -> list[tuple[str, str]]:
    pairs: list[tuple[str, str]] = []
    for text in texts:
        name, equals, value = text.partition("=")
        if not (equals and name.strip()):
            raise SysidError(f"'{text}' is no parameter with a value; expected {option} NAME={value_shape}.")
        pairs.append((SHORT.get(name.strip(), name.strip()), value.strip()))
    return pairs


def _number(text: str, where: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise SysidError(f"{where}: '{text}' is not a number. SI units and radians are expected.") from None
