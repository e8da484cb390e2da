"""`husky-sysid inertia METHOD`: roll inertia from dimensions, parts, swings, weights or two decays."""

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from sysid import inertia as methods
from sysid.cli import epilogue
from sysid.cli.console import Common, Printer
from sysid.cli.parameter_options import measured, parse_fields, parse_or_read
from sysid.errors import SysidError
from sysid.inertia import AGREEMENT, ON_AXIS
from sysid.quantity import Quantity, error_budget

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


FREQUENCY = measured("rad/s", key="omega_n")
Texts = Annotated[tuple[str, ...], Parameter(allow_leading_hyphen=True)]
OPTIONS = {
    "mass": (measured("kg"), "Mass m [kg]; of an added mass its total."),
    "width": (measured("m"), "Width w across the deck [m]."),
    "height": (
        measured("m", positive=False),
        "Height h [m]; of an added mass its height z above the tilt axis.",
    ),
    "distance": (measured("m", positive=False), "Distance e of the centre of mass from the tilt axis [m]."),
    "separation": (measured("m"), "Distance s between the strings, the centre of mass midway [m]."),
    "length": (measured("m"), "Length L of the strings [m]."),
    "period": (measured("s"), "Period T of a full swing [s]."),
    "stiffness": (measured("N*m/rad"), "Torsional stiffness κ of the wire [N*m/rad]."),
    "pivot": (measured("m"), "Distance l from the pivot to the centre of mass [m]."),
    "amplitude": (
        measured("rad", positive=False),
        "Amplitude of the swing, to correct its longer period [rad].",
    ),
    "bare": (FREQUENCY, "Natural frequency of the deck alone [rad/s], or the JSON file of `decay --json`."),
    "loaded": (FREQUENCY, "The same with the added mass."),
    "offset": (measured("m"), "Its distance y to the side; best half to the left and half to the right [m]."),
    "own": (measured("kg*m^2", positive=False), "Its inertia about its own centre [kg*m^2]."),
    "gravity": (
        measured("m/s^2"),
        "Gravity g [m/s^2]; the standard value with its range on Earth if left out.",
    ),
}
"""Options of the methods that are one formula."""
FORMULAS: Mapping[Callable[..., Quantity], str] = {
    methods.cuboid: "Uniform cuboid: m (w² + h²) / 12 + m e².",
    methods.bifilar: "Twist on two parallel strings, roll axis vertical: m g s² T² / (16 π² L) + m e².",
    methods.torsional: "Twist on a wire or rod of known stiffness: κ T² / 4π² + m e².",
    methods.compound: "Swing about an axis parallel to the roll axis: m g l T² / 4π² − m l² + m e².",
    methods.added_mass: "Two decays, without and with a known mass: (ΔI ω₂² + m g z) / (ω₁² − ω₂²).",
}
"""Methods that are one formula of `sysid.inertia`, whose arguments are their options."""
MAX_INERTIA = 0.5
"""Largest roll inertia without a warning of wrong units [kg m^2]: that of a plank of 10 kg and 0.7 m width."""


def _formula_command(method: Callable[..., Quantity]) -> Callable[..., None]:
    """Return the command of a method that is one formula."""
    name = method.__name__.replace("_", "-")

    def run(outcome: Outcome = Outcome(), **inputs: Quantity | None) -> None:
        given = {key: value for key, value in inputs.items() if value is not None}
        _finish(name, method(**given), outcome, given, error_budget(method, given))

    own = [
        inspect.Parameter(
            key, inspect.Parameter.KEYWORD_ONLY, default=one.default,
            annotation=Annotated[Quantity, OPTIONS[key][0], Parameter(help=OPTIONS[key][1])],
        )
        for key, one in inspect.signature(method).parameters.items()
    ]  # fmt: skip
    shared = [one for one in inspect.signature(run).parameters.values() if one.name == "outcome"]
    signature = inspect.Signature([*shared, *own])
    run.__signature__ = signature  # pyright: ignore[reportFunctionMemberAccess]
    run.__annotations__ = {one.name: one.annotation for one in signature.parameters.values()}
    run.__doc__ = FORMULAS[method]
    return run


for _method in FORMULAS:
    inertia.command(_formula_command(_method), name=_method.__name__.replace("_", "-"))


@inertia.command
def parts(
    *,
    cuboid: Texts = (),
    cylinder: Texts = (),
    point: Texts = (),
    body: Texts = (),
    outcome: Outcome = Outcome(),
) -> None:
    """Sum of several parts by the parallel-axis theorem.

    Args:
        cuboid: MASS,WIDTH,HEIGHT[,DISTANCE] of a cuboid; may be repeated, as all of these.
        cylinder: MASS,RADIUS,LENGTH[,DISTANCE] of a cylinder that lies across the deck (a bolt, a rail).
        point: MASS,DISTANCE of a small part (a sensor, a screw).
        body: INERTIA,MASS,DISTANCE of a part with a known inertia about its own centre.
        outcome: Use of the result.
    """
    kinds: dict[str, tuple[tuple[str, ...], Callable[..., Quantity], tuple[str, ...], int]] = {
        "cuboid": (cuboid, methods.cuboid, ("kg", "m", "m", "m"), 3),
        "cylinder": (cylinder, methods.cylinder, ("kg", "m", "m", "m"), 3),
        "point": (point, methods.point, ("kg", "m"), 2),
        "body": (body, methods.shifted, ("kg*m^2", "kg", "m"), 3),
    }
    named: dict[str, Quantity] = {}
    for kind, (texts, method, units, needed) in kinds.items():
        for number, text in enumerate(texts, start=1):
            # A part may be on the axis: its last field, the distance, may be 0.
            fields = parse_fields(f"--{kind} '{text}'", text, units, needed, any_sign=range(needed - 1, 4))
            named[f"{kind} {number}"] = method(*fields)
    result = methods.parts(list(named.values()))
    budget = {name: (part.std / result.std) ** 2 for name, part in named.items() if part.std > 0}
    _finish("parts", result, outcome, inputs=named, budget=budget)


@inertia.command(name="static-tilt")
def static_tilt(
    *,
    reading: Texts,
    height: Annotated[Quantity, OPTIONS["height"][0]] = ON_AXIS,
    frequency: Annotated[Quantity | None, FREQUENCY] = None,
    outcome: Outcome = Outcome(),
) -> None:
    """Known weights at known offsets give the stiffness k itself; with a decay, I = k / ω_n².

    Args:
        reading: MASS,OFFSET,ROLL of one weight, e.g. 1.00,0.08±0.001,3.1±0.1deg: kg, m to the right of the tilt axis, and roll
            with the right edge down. At least three, best to both sides.
        height: Height of the weights above the tilt axis [m].
        frequency: Natural frequency of the same deck [rad/s], or the JSON file of `decay --json`.
        outcome: Use of the result.
    """
    from scipy.special import chdtrc

    from sysid.experiments import static_tilt as tilt

    readings: list[tilt.Weighing] = []
    for text in reading:
        fields = parse_fields(f"--reading '{text}'", text, ("kg", "m", "rad"), 3, any_sign=(1, 2))
        readings.append(tilt.Weighing(**dict(zip(("mass", "offset", "roll"), fields, strict=True))))
    test = tilt.static_tilt(readings, height)
    printer = Printer(outcome)
    printer.quantities([("stiffness k", test.stiffness), ("rest angle", test.rest)])
    worst = max(test.residuals, key=abs)
    printer.say(f"largest distance of a reading from the line: {math.degrees(worst):+.3f} degrees")
    if chdtrc(test.degrees_of_freedom, test.chi_square) < AGREEMENT:
        printer.warn(
            "the readings scatter more than their uncertainties allow: friction, a nonlinear spring, or too small "
            "uncertainties of the angles. The interval was widened."
        )
    content = {"stiffness": test.stiffness, "rest_angle": test.rest}
    if frequency is None:
        if outcome.save is not None:
            raise SysidError("k alone is no inertia; give the natural frequency of a decay with --frequency.")
        printer.note("for the inertia, add --frequency with ω_n of a decay of the same deck")
        printer.result({"method": "static-tilt", "inertia": None, **content})
        return

    def ratio(stiffness: Quantity, natural_frequency: Quantity) -> Quantity:
        return replace(test, stiffness=stiffness).inertia(natural_frequency)

    inputs = {"stiffness": test.stiffness, "natural_frequency": frequency}
    _finish("static-tilt", ratio(**inputs), outcome, inputs, error_budget(ratio, inputs), extra=content)


@inertia.command
def combine(
    *estimates: Annotated[str, Parameter(allow_leading_hyphen=True)], outcome: Outcome = Outcome()
) -> None:
    """Weighted mean of several methods, and whether they agree.

    Args:
        estimates: NAME=INERTIA for each method, e.g. cuboid=0.0087±0.0004 bifilar=0.0083±0.0001, or NAME=FILE with
            the JSON of a method.
        outcome: Use of the result.
    """
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
        "chi_square": result.chi_square,
        "degrees_of_freedom": result.degrees_of_freedom,
        "p_value": result.p_value,
        "agree": result.agree,
        "stands_out": result.odd_one,
        "pulls": result.pulls,
    }
    _finish("combine", result.inertia, outcome, named, {}, extra=extra)


def _finish(
    name: str,
    result: Quantity,
    outcome: Outcome,
    inputs: Mapping[str, Quantity],
    budget: Mapping[str, float],
    extra: Mapping[str, Any] | None = None,
) -> None:
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
    content = {"method": name, "inertia": result, "inputs": inputs, "budget": budget, **(extra or {})}
    if outcome.save is not None:
        old = outcome.space.load_board(outcome.save)
        new = methods.with_inertia(old, result)
        content["saved"] = printer.saved(new, old)
        for key in ("stiffness", "damping"):
            change = f"{key} {old.tilt[key]} → {new.tilt[key]}"
            printer.note(f"{old.name}: {change}, as the decay fixes its ratio to I")
    printer.result(content)
