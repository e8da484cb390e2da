"""Parameters and quantities on the command line: NAME=VALUE, NAME=LOW:HIGH, or a result file."""

import json
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from cyclopts import Parameter

from sysid.errors import SysidError
from sysid.files import regular
from sysid.quantity import Quantity, parse_quantity

SHORT = {"rest": "rest_angle"}
"""Short names for the user."""


def parse_fixed(texts: Sequence[str], option: str = "--fix") -> dict[str, float]:
    """Return names and values of '--fix NAME=VALUE', or of another option of that shape."""
    return {name: _number(value, f"{option} {name}") for name, value in _pairs(texts, option, "VALUE")}


def parse_bounds(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Return parameters and ends of '--bound NAME=LOW:HIGH'."""
    found: dict[str, tuple[float, float]] = {}
    for name, value in _pairs(texts, "--bound", "LOW:HIGH"):
        low, colon, high = value.partition(":")
        if not colon:
            raise SysidError(f"--bound {name}={value} has no ':'; expected --bound {name}=LOW:HIGH.")
        found[name] = (_number(low, f"--bound {name}"), _number(high, f"--bound {name}"))
    return found


def measured(unit: str, *, key: str = "", positive: bool = True) -> Parameter:
    """Return an option for a quantity in a unit; with a key also for a result file that has the quantity under it."""

    def read(_: Any, tokens: Sequence[Any]) -> Quantity:
        token = tokens[0]
        if key:
            return parse_or_read(token.value, key, unit, token.keyword)
        return parse_quantity(token.value, unit, token.keyword, positive=positive)

    return Parameter(
        converter=read, n_tokens=1, accepts_keys=False, allow_leading_hyphen=True, show_default=False
    )


def parse_or_read(text: str, key: str, unit: str, where: str) -> Quantity:
    """Return a typed positive quantity, or the one under a key of a result file (.json)."""
    if not text.endswith(".json"):
        return parse_quantity(text, unit, where)
    try:
        content = json.loads(regular(Path(text)).read_text(encoding="utf-8"))[key]
        value, std, found = float(content["value"]), float(content["std"]), content["unit"]
    except OSError as error:
        raise SysidError(f"{text}: cannot read it ({error.strerror}).") from error
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise SysidError(
            f"{text}: holds no quantity '{key}' with a value and a std; give a result file."
        ) from error
    if found != unit:
        raise SysidError(f"{text}: '{key}' is in {found!r}; expected {unit!r}.")
    return Quantity(value, std, unit, text)


def parse_fields(
    where: str, text: str, units: Sequence[str], needed: int, any_sign: Collection[int]
) -> list[Quantity]:
    """Return quantities between commas: at least `needed`, positive but for the places in `any_sign`."""
    fields = text.split(",")
    if not needed <= len(fields) <= len(units):
        count = f"{needed}" if needed == len(units) else f"{needed} or {len(units)}"
        raise SysidError(
            f"{where}: number of fields is {len(fields)}; expected {count}, with commas between."
        )
    return [
        parse_quantity(field, unit, f"{where}, field {place + 1}", positive=place not in any_sign)
        for place, (field, unit) in enumerate(zip(fields, units, strict=False))
    ]


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
