"""`husky-sysid inertia METHOD`: roll inertia from dimensions, parts, swings, weights or two decays."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from sysid.cli import epilogue
from sysid.cli.console import Common, Printer
from sysid.cli.parameter_options import parse_or_read
from sysid.errors import SysidError
from sysid.quantity import Quantity, error_budget, parse_quantity

NOTES = """Quantities are written 2.58, 2.58±0.05 or 2.58+-0.05 in SI units (± is the 95 % interval), or with a unit: 20±0.2cm,
184ms, 3.1deg, 6.5Hz. Distances are from the tilt axis. Every method takes --json PATH and --workspace DIR, and
--save BOARD to put the result into the board's record."""

inertia = App(name="inertia", help_epilogue=f"{NOTES}\n\n{epilogue('inertia')}")


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Outcome(Common):
    """Options of every method."""

    save: str | None = None
    """Save the inertia in the record of this board in the workspace, and scale its stiffness, damping and torques."""


Text = Annotated[str, Parameter(negative="", allow_leading_hyphen=True)]
Texts = Annotated[tuple[str, ...], Parameter(negative="", allow_leading_hyphen=True)]
UNITS = {
    "mass": "kg", "stiffness": "N*m/rad", "period": "s", "amplitude": "rad", "bare": "rad/s",
    "loaded": "rad/s", "own": "kg*m^2", "gravity": "m/s^2",
}  # fmt: skip
"""Units of the options; all others are lengths in m."""
MAX_INERTIA = 0.5
"""Largest roll inertia without a warning of wrong units [kg m^2]: that of a plank of 10 kg and 0.7 m width."""
NATURAL_FREQUENCY = ("omega_n", "rad/s")
"""Key and unit of a natural frequency in the JSON of `decay`."""
MAY_BE_ZERO = ("distance", "amplitude")


@inertia.command
def cuboid(
    *, mass: Text, width: Text, height: Text, distance: Text = "0", outcome: Outcome = Outcome()
) -> int:
    """Uniform cuboid: m (w² + h²) / 12 + m e².

    Args:
        mass: Mass m [kg].
        width: Width w across the deck [m].
        height: Height h [m].
        distance: Distance e of its centre from the tilt axis [m].
        outcome: Use of the result.
    """
    given = {"mass": mass, "width": width, "height": height, "distance": distance}
    return _report("cuboid", given, outcome)


@inertia.command
def parts(
    *,
    cuboid: Texts = (),
    cylinder: Texts = (),
    point: Texts = (),
    body: Texts = (),
    outcome: Outcome = Outcome(),
) -> int:
    """Sum of several parts by the parallel-axis theorem.

    Args:
        cuboid: MASS,WIDTH,HEIGHT[,DISTANCE] of a cuboid; may be repeated, as all of these.
        cylinder: MASS,RADIUS,LENGTH[,DISTANCE] of a cylinder that lies across the deck (a bolt, a rail).
        point: MASS,DISTANCE of a small part (a sensor, a screw).
        body: INERTIA,MASS,DISTANCE of a part with a known inertia about its own centre.
        outcome: Use of the result.
    """
    from sysid import inertia as methods

    kinds: dict[str, tuple[tuple[str, ...], Callable[..., Quantity], tuple[str, ...], int]] = {
        "cuboid": (cuboid, methods.cuboid, ("kg", "m", "m", "m"), 3),
        "cylinder": (cylinder, methods.cylinder, ("kg", "m", "m", "m"), 3),
        "point": (point, methods.point, ("kg", "m"), 2),
        "body": (body, methods.shifted, ("kg*m^2", "kg", "m"), 3),
    }
    named: dict[str, Quantity] = {}
    for kind, (texts, method, units, needed) in kinds.items():
        for number, text in enumerate(texts, start=1):
            named[f"{kind} {number}"] = method(*_fields(f"--{kind} '{text}'", text, units, needed))
    result = methods.parts(list(named.values()))
    variance = sum(part.std**2 for part in named.values())
    budget = {name: part.std**2 / variance for name, part in named.items() if part.std > 0}
    return _finish("parts", result, outcome, inputs=named, budget=budget)


@inertia.command
def bifilar(
    *, mass: Text, separation: Text, length: Text, period: Text, distance: Text = "0",
    outcome: Outcome = Outcome(),
) -> int:  # fmt: skip
    """Twist on two parallel strings, roll axis vertical: m g s² T² / (16 π² L) + m e².

    Args:
        mass: Mass m [kg].
        separation: Distance s between the strings, the centre of mass midway [m].
        length: Length L of the strings [m].
        period: Period T of one full twist [s].
        distance: Distance e from the centre of mass to the tilt axis [m].
        outcome: Use of the result.
    """
    given = {"mass": mass, "separation": separation, "length": length, "period": period, "distance": distance}
    return _report("bifilar", given, outcome)


@inertia.command
def torsional(
    *,
    stiffness: Text,
    period: Text,
    mass: Text | None = None,
    distance: Text = "0",
    outcome: Outcome = Outcome(),
) -> int:
    """Twist on a wire or rod of known stiffness: κ T² / 4π² + m e².

    Args:
        stiffness: Torsional stiffness κ of the wire [N*m/rad].
        period: Period T [s].
        mass: Mass m; needed with --distance only [kg].
        distance: Distance e from the wire's axis to the tilt axis [m].
        outcome: Use of the result.
    """
    given = {"stiffness": stiffness, "period": period, "distance": distance}
    return _report("torsional", given | ({"mass": mass} if mass else {}), outcome)


@inertia.command
def compound(
    *, mass: Text, pivot: Text, period: Text, distance: Text = "0", amplitude: Text = "0",
    outcome: Outcome = Outcome(),
) -> int:  # fmt: skip
    """Swing as a pendulum about an axis parallel to the roll axis: m g l T² / 4π² − m l² + m e².

    Args:
        mass: Mass m [kg].
        pivot: Distance l from the pivot to the centre of mass [m].
        period: Period T [s].
        distance: Distance e from the centre of mass to the tilt axis [m].
        amplitude: Amplitude of the swing, to correct its longer period [rad].
        outcome: Use of the result.
    """
    given = {"mass": mass, "pivot": pivot, "period": period, "distance": distance, "amplitude": amplitude}
    return _report("compound", given, outcome)


@inertia.command(name="added-mass")
def added_mass(
    *, bare: Text, loaded: Text, mass: Text, offset: Text, height: Text = "0", own: Text = "0",
    outcome: Outcome = Outcome(),
) -> int:  # fmt: skip
    """Two decays, without and with a known mass: (ΔI ω₂² + m g z) / (ω₁² − ω₂²).

    Args:
        bare: Natural frequency of the deck alone [rad/s], or the JSON file of `decay --json`.
        loaded: The same with the added mass.
        mass: Total added mass [kg].
        offset: Its distance y to the side; best half to the left and half to the right [m].
        height: Its height z above the tilt axis, negative below [m].
        own: Its inertia about its own centre [kg*m^2].
        outcome: Use of the result.
    """
    from sysid import inertia as methods

    quantities = {
        "bare": parse_or_read(bare, *NATURAL_FREQUENCY, "--bare"),
        "loaded": parse_or_read(loaded, *NATURAL_FREQUENCY, "--loaded"),
    }
    for name, text in (("mass", mass), ("offset", offset), ("height", height), ("own", own)):
        positive = name in ("mass", "offset")
        quantities[name] = parse_quantity(text, UNITS.get(name, "m"), f"--{name}", positive=positive)
    result = methods.added_mass(**quantities)
    return _finish("added-mass", result, outcome, quantities, error_budget(methods.added_mass, quantities))


@inertia.command(name="static-tilt")
def static_tilt(
    *, reading: Texts, height: Text = "0", frequency: Text | None = None, outcome: Outcome = Outcome()
) -> int:
    """Known weights at known offsets give the stiffness k itself; with a decay, I = k / ω_n².

    Args:
        reading: MASS,OFFSET,ROLL of one weight, e.g. 1.00,0.08±0.001,3.1±0.1deg: kg, m to the right of the tilt axis, and roll
            with the right edge down. At least three, best to both sides.
        height: Height of the weights above the tilt axis [m].
        frequency: Natural frequency of the same deck [rad/s], or the JSON file of `decay --json`.
        outcome: Use of the result.
    """
    from sysid.experiments import static_tilt as tilt

    readings: list[tilt.Weighing] = []
    for text in reading:
        mass, offset, roll = _fields(
            f"--reading '{text}'", text, ("kg", "m", "rad"), 3, negative=("m", "rad")
        )
        readings.append(tilt.Weighing(mass=mass, offset=offset, roll=roll))
    test = tilt.static_tilt(readings, parse_quantity(height, "m", "--height", positive=False))
    printer = Printer(outcome)
    printer.quantities([("stiffness k", test.stiffness), ("rest angle", test.rest)])
    worst = max(test.residuals, key=abs)
    printer.say(f"largest distance of a reading from the line: {math.degrees(worst):+.3f} degrees")
    # 95 % quantile of χ² over its degrees of freedom (Wilson and Hilferty).
    spread = 2 / (9 * test.degrees_of_freedom)
    limit = (1 - spread + 1.645 * math.sqrt(spread)) ** 3
    if test.chi_square > limit * test.degrees_of_freedom:
        printer.warn(
            "the readings scatter more than their uncertainties allow: friction, a nonlinear spring, or too small "
            "uncertainties of the angles. The interval was widened."
        )
    content = {"stiffness": test.stiffness.to_json(), "rest_angle": test.rest.to_json()}
    if frequency is None:
        if outcome.save is not None:
            raise SysidError("k alone is no inertia; give the natural frequency of a decay with --frequency.")
        printer.note("for the inertia, add --frequency with ω_n of a decay of the same deck")
        printer.result({"method": "static-tilt", "inertia": None, **content})
        return 0
    inputs = {
        "stiffness": test.stiffness,
        "natural frequency": parse_or_read(frequency, *NATURAL_FREQUENCY, "--frequency"),
    }
    result = test.inertia(inputs["natural frequency"])
    shares = {"stiffness": 1.0, "natural frequency": 2.0}
    parts = {name: (shares[name] * q.std / q.value) ** 2 for name, q in inputs.items()}
    budget = {name: part / sum(parts.values()) for name, part in parts.items()}
    return _finish("static-tilt", result, outcome, inputs, budget, extra=content)


@inertia.command
def combine(*estimates: Text, outcome: Outcome = Outcome()) -> int:
    """Weighted mean of several methods, and whether they agree.

    Args:
        estimates: NAME=INERTIA for each method, e.g. cuboid=0.0087±0.0004 bifilar=0.0083±0.0001, or NAME=FILE with
            the JSON of a method.
        outcome: Use of the result.
    """
    from sysid import inertia as methods

    named: dict[str, Quantity] = {}
    for text in estimates:
        name, equals, value = text.partition("=")
        if not equals or name in named:
            raise SysidError(f"'{text}': expected NAME=INERTIA, each name once.")
        named[name] = parse_or_read(value, "inertia", "kg*m^2", name)
    result = methods.combine(named)
    printer = Printer(outcome)
    rows = [(name, str(q), f"{result.pulls[name]:+.1f} σ from the others") for name, q in named.items()]
    printer.table(("method", "inertia ± 95 %", "distance"), rows)
    verdict = "agree" if result.agree else "disagree"
    text = f"the methods {verdict}: χ² = {result.chi_square:.2f} for {result.degrees_of_freedom}, p = {result.p_value:.2g}"
    if not result.agree:
        odd = "two methods cannot tell which one is wrong"
        if result.odd_one:
            odd = f"'{result.odd_one}' stands out"
        printer.warn(f"{text}; {odd}. The interval was widened by the scatter.")
    else:
        printer.say(text)
    extra = {
        "chi_square": result.chi_square, "degrees_of_freedom": result.degrees_of_freedom,
        "p_value": result.p_value, "agree": result.agree, "stands_out": result.odd_one,
        "pulls": dict(result.pulls),
    }  # fmt: skip
    return _finish("combine", result.inertia, outcome, named, {}, extra=extra)


def _report(name: str, given: Mapping[str, str], outcome: Outcome) -> int:
    """Read the options, run the method of that name, print the result."""
    from sysid import inertia as methods

    method: Callable[..., Quantity] = getattr(methods, name)
    inputs = {
        key: parse_quantity(text, UNITS.get(key, "m"), f"--{key}", positive=key not in MAY_BE_ZERO)
        for key, text in given.items()
    }
    return _finish(name, method(**inputs), outcome, inputs, error_budget(method, inputs))


def _finish(
    name: str,
    result: Quantity,
    outcome: Outcome,
    inputs: Mapping[str, Quantity],
    budget: Mapping[str, float],
    extra: Mapping[str, Any] | None = None,
) -> int:
    """Print result and error budget, save it if `--save` is given, write the JSON."""
    printer = Printer(outcome)
    # The method of an input from a result file is that file's name.
    printer.keep([Path(q.method) for q in inputs.values() if q.method.endswith(".json")])
    printer.quantities([("roll inertia I", result)])
    if budget:
        ranked = sorted(budget.items(), key=lambda item: -item[1])
        shares = ", ".join(
            f"{key.replace('_', ' ')} {100 * share:.0f} %" for key, share in ranked if share >= 0.005
        )
        printer.say(f"its variance comes from: {shares}")
    elif result.std == 0:
        printer.warn(
            "no input has an uncertainty, so the inertia has none; write 2.58±0.05 where you measured."
        )
    if result.value > MAX_INERTIA:
        printer.warn(
            f"{result.value:.3g} kg·m² is far more than the inertia of a deck (about 0.01). Lengths without a unit "
            "are metres; write 20cm."
        )
    content: dict[str, Any] = {
        "method": name,
        "inertia": result.to_json(),
        "inputs": {key: quantity.to_json() for key, quantity in inputs.items()},
        "budget": dict(budget),
        **(extra or {}),
    }
    if outcome.save is not None:
        content["saved"] = _save(outcome.save, result, outcome, printer)
    printer.result(content)
    return 0


def _save(board: str, result: Quantity, outcome: Outcome, printer: Printer) -> str:
    from sysid.inertia import with_inertia

    old = outcome.space.load_board(board)
    new = with_inertia(old, result)
    path = outcome.space.save_board(new, since=old)
    for name in ("stiffness", "damping"):
        printer.note(
            f"{board}: {name} {old.tilt[name]} → {new.tilt[name]}, as the decay fixes its ratio to I"
        )
    if old.last_check:
        printer.warn(f"{board}: the check of the old record no longer counts; run it again.")
    printer.say(f"saved: {path}")
    return str(path)


def _fields(
    name: str, text: str, units: tuple[str, ...], needed: int, negative: tuple[str, ...] = ()
) -> list[Quantity]:
    fields = text.split(",")
    if not needed <= len(fields) <= len(units):
        count = f"{needed}" if needed == len(units) else f"{needed} or {len(units)}"
        raise SysidError(f"{name}: number of fields is {len(fields)}; expected {count}, with commas between.")
    return [
        # Parts may be on the axis, weights on both sides of it.
        parse_quantity(
            field, unit, f"{name}, field {number}", positive=number < needed and unit not in negative
        )
        for number, (field, unit) in enumerate(zip(fields, units, strict=False), start=1)
    ]
