"""`husky-sysid new`: the smallest record for identifying a joint."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal, get_args

from sysid.board import Board, BoardEffect
from sysid.cli.console import Common, Printer
from sysid.cli.parameter_options import measured
from sysid.cli.subject import Subject
from sysid.effects import armature, coulomb, weight
from sysid.errors import SysidError, UsageError
from sysid.loop import Joint
from sysid.quantity import GRAVITY, Quantity, parse_quantity, propagate

Kind = Literal["board", "pendulum", "rig", "joint"]
QUESTIONS = {
    "kind": "Is it a board, a pendulum, a rig (a torsion spring or servo without weight), or the joint of a model?",
    "inertia": "Inertia about the axis in kg*m^2, e.g. 0.0087±0.0001 (docs/inertia.md tells how to measure it)",
    "mass": "Mass that swings in kg, e.g. 0.49±0.002",
    "arm": "Distance from the axis to its centre of mass in m, e.g. 0.1±0.001",
    "model": "MuJoCo model, a file",
    "joint": "Joint of it",
}
"""Questions at a terminal, for missing options."""


def new(
    name: str,
    /,
    *,
    kind: Kind | None = None,
    inertia: Annotated[Quantity | None, measured("kg*m^2")] = None,
    mass: Annotated[Quantity | None, measured("kg")] = None,
    arm: Annotated[Quantity | None, measured("m")] = None,
    subject: Subject = Subject(),
    common: Common = Common(),
) -> None:
    """Write the smallest record of a joint; a terminal asks for missing options.

    Args:
        name: Of the record, which becomes data/boards/NAME.toml of the workspace.
        kind: Kind of the joint.
        inertia: Inertia about the axis [kg*m^2], of a board or a rig; of a pendulum, that about its own centre.
        mass: Mass of a pendulum [kg].
        arm: From its axis to its centre of mass [m].
        subject: The joint of a model.
    """
    printer = Printer(common)
    if not name.strip(" .") or name.startswith(".") or Path(name).name != name or not name.isprintable():
        raise SysidError(
            f"{name!r} is no name for a record: it becomes a file's. Use letters, digits and hyphens."
        )
    if name in common.space.board_names():
        raise SysidError(
            f"there is a record '{name}' already. Choose another name, or remove {common.space.board_path(name)}."
        )
    chosen = kind or (
        "joint" if subject.model else "pendulum" if mass or arm else "rig" if inertia else _ask("kind")
    )
    if chosen == "joint":
        if subject.model is None:
            subject = replace(subject, model=Path(_ask("model")), joint=subject.joint or _ask("joint"))
        record = replace(subject.load(common, printer), name=name)
    elif chosen == "pendulum":
        record = _pendulum(
            name, mass or _ask_quantity("mass", "kg"), arm or _ask_quantity("arm", "m"), inertia
        )
    elif chosen in get_args(Kind):
        text = "a skateboard" if chosen == "board" else "a torsion rig"
        record = _record(name, text, inertia or _ask_quantity("inertia", "kg*m^2"))
    else:
        raise UsageError(f"'{chosen}' is not one of {', '.join(get_args(Kind))}.")
    _report(record, chosen, printer)


def _report(record: Board, kind: str, printer: Printer) -> None:
    """Save a record, print it and the next step."""
    from sysid.fitting.joint import known_priors, prior_in_words

    space = printer.common.space
    path = space.save_board(record)
    printer.written(path)
    printer.say(f"  inertia {record.inertia} ({record.inertia.method})")
    for known, prior in known_priors(record).items():
        printer.say(f"  {prior_in_words(record, known, prior)}")
    if kind == "board":
        printer.say(
            "  [geometry] and [mass] are left out: the scene (mjcf, train) needs them, a fit and mjcf --bench do not"
        )
    usual = (coulomb.EFFECT.name, armature.EFFECT.name) if kind in ("pendulum", "joint") else ()
    effects = tuple(word for name in usual for word in ("--effect", name))
    command = space.command("fit", "--board", record.name, *effects, logs=())
    printer.say(f"next: record a release and run: {command}")
    printer.result({"board": record.name, "record": path, "kind": kind, "inertia": record.inertia})


def _pendulum(name: str, mass: Quantity, arm: Quantity, own: Quantity | None) -> Board:
    """Return a pendulum: m l² of inertia, m g l of weight, and no spring."""
    about_centre = own or Quantity(0.0, 0.0, "kg*m^2")
    method = "m l²" + (" and about its own centre" if own else "")
    board = _record(
        name,
        "a pendulum",
        propagate(lambda m, r, own: m * r**2 + own, (mass, arm, about_centre), "kg*m^2", method),
    )
    part = weight.EFFECT
    values = {"scale": 1.0, "sine": -mass.value * GRAVITY.value * arm.value}
    pull = {p.name: Quantity(values.get(p.name, 0.0), 0.0, p.unit) for p in part.parameters}
    if mass.std or arm.std or about_centre.std:  # of weight over inertia, in which a point's mass cancels
        inputs = (mass, arm, about_centre, GRAVITY)
        ratio = propagate(lambda m, r, own, g: m * g * r / (m * r**2 + own), inputs, "1/s^2", "")
        pull["scale"] = replace(pull["scale"], std=ratio.std / ratio.value)
    return replace(board, effects=(BoardEffect(part.name, pull),))


def _record(name: str, description: str, inertia: Quantity) -> Board:
    """Return a record with an inertia only, for a first fit."""
    return replace(Joint.new(name, inertia, description=description), source="husky-sysid new")


def _ask_quantity(option: str, unit: str) -> Quantity:
    return parse_quantity(_ask(option), unit, f"--{option}")


def _ask(option: str) -> str:
    """Return the answer to a question."""
    if not sys.stdin.isatty():
        raise UsageError(f"--{option} is missing, and there is no terminal to ask at. {QUESTIONS[option]}")
    return input(f"{QUESTIONS[option]}\n> ").strip()
