"""The four questions of a hurried reader: does the model match, what is missing, how sure, what to do next."""

import shlex
from collections.abc import Sequence

from reports.evidence import Evidence, LastDiagnosis, LogFile
from reports.story import times
from sysid.board import Board
from sysid.effects import effect
from sysid.quantity import Quantity
from sysid.text import percent

MOST_NAMED = 2
"""Logs written out in a command."""


def four_answers(
    board: Board, evidence: Evidence | None, diagnosis: LastDiagnosis | None, files: Sequence[LogFile]
) -> list[tuple[str, str, str]]:
    """Return question, answer and mark ('good', 'bad' or '') of each.

    Args:
        board: The record.
        evidence: What its logs say; None where they are gone.
        diagnosis: Its last one.
        files: The logs.
    """
    missing, mark = _missing(board, diagnosis)
    return [
        ("Does the model match?", *_match(evidence)),
        ("What is missing?", missing, mark),
        ("How sure is that?", _sure(board, diagnosis), ""),
        ("What to do next?", next_step(board, evidence, diagnosis, files), ""),
    ]


def _match(evidence: Evidence | None) -> tuple[str, str]:
    if evidence is None:
        return "Not known: none of the logs is there any more.", ""
    result = evidence.comparison
    word = "Yes" if result.passed else "No"
    text = f"{word}: error {times(result.rmse / result.noise.std)} × the noise; {result.verdict()}."
    return text, "good" if result.passed else "bad"


def _missing(board: Board, diagnosis: LastDiagnosis | None) -> tuple[str, str]:
    if diagnosis is None:
        return "Not asked yet.", ""
    found = diagnosis.content["verdict"]
    names = titled(found["effects"])
    if not diagnosis.is_current:
        own = {part.name for part in board.effects}
        added = bool(found["effects"]) and own.issuperset(found["effects"])
        before = f"; it named {names}{', since added' if added else ''}" if found["effects"] else ""
        return f"Not asked since the record was last changed: the diagnosis was made before that{before}.", ""
    match found["status"]:
        case "none-missing":
            return "Nothing that matters.", "good"
        case "missing":
            return f"{names}.", "bad"
        case _:
            nearest = f" Nearest: {names}." if names else ""
            return f"Something that no effect of the catalogue explains.{nearest}", "bad"


def titled(names: Sequence[str]) -> str:
    """Return effects as 'coulomb (dry friction) and …'."""
    return " and ".join(f"{name} ({effect(name).title})" for name in names)


def _sure(board: Board, diagnosis: LastDiagnosis | None) -> str:
    parts = []
    if diagnosis is not None and diagnosis.is_current:
        parts.append(f"confidence {percent(diagnosis.content['verdict']['confidence'])}")
    known = {"k": board.tilt["stiffness"], "d": board.tilt["damping"]}
    known |= {
        part.name: next(iter(part.parameters.values()))
        for part in board.effects
        if not effect(part.name).is_known
    }
    shares = [f"{name} to {_share(quantity)}" for name, quantity in known.items() if quantity.value]
    return "; ".join([*parts, *([f"{', '.join(shares)}, 95 %"] if shares else [])]) + "."


def _share(quantity: Quantity) -> str:
    """Return the half width of an interval as a share of its value."""
    low, high = quantity.ci95
    return f"±{50 * (high - low) / abs(quantity.value):.2g} %"


def next_step(
    board: Board, evidence: Evidence | None, diagnosis: LastDiagnosis | None, files: Sequence[LogFile]
) -> str:
    """Return the command or the experiment that brings this board on."""
    found = [file.path for file in files if file.found is not None]
    logs = shlex.join(found) if 0 < len(found) <= MOST_NAMED else "LOG..."
    end = f"{logs} --board {board.name}"
    if evidence is None:
        return f"Name logs that are there: husky-sysid report LOG... --board {board.name}"
    if diagnosis is None or not diagnosis.is_current:
        return f"Ask what is missing: husky-sysid diagnose {end}"
    verdict = diagnosis.content["verdict"]
    if verdict["status"] == "missing":
        fitted = [name for name in verdict["effects"] if effect(name).identifiable_from_decay]
        if fitted:
            flags = [f"--effect {name}" for name in fitted]
            hangs = diagnosis.content["best"]["parameters"].get("stiffness", {}).get("value") == 0
            return f"Add it: husky-sysid fit {end} {' '.join(flags + ['--fix stiffness=0'] * hangs)}"
    if verdict["status"] != "none-missing" and verdict["next_experiment"]:
        return verdict["next_experiment"]
    if not evidence.comparison.passed:
        return f"Refit stiffness and damping: husky-sysid fit {end}"
    if not board.passed:
        where = "the scene that policies train in" if board.geometry else "it in MuJoCo"
        return f"Check {where}: husky-sysid check {end}"
    if board.model:
        return f"It is ready: {board.model['file']}"
    train = f", or husky-sysid train --board {board.name}" if board.geometry else ""
    return f"It is ready: husky-sysid mjcf --board {board.name}{train}"
