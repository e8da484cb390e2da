"""The four questions of a hurried reader: match, missing effect, certainty, next step."""

from collections.abc import Callable, Sequence
from pathlib import Path

from reports.evidence import Evidence, LastDiagnosis
from reports.log_files import LogFile
from reports.story import times
from sysid.board import Board
from sysid.effects import effect
from sysid.quantity import Quantity
from sysid.text import percent
from sysid.workspace import Workspace


def four_answers(
    board: Board,
    evidence: Evidence | None,
    diagnosis: LastDiagnosis | None,
    files: Sequence[LogFile],
    space: Workspace,
) -> list[tuple[str, str, str]]:
    """Return question, answer and mark ('good', 'bad' or '') of each; without evidence the logs are gone."""
    missing, mark = _missing(board, evidence, diagnosis)
    return [
        ("Does the model match?", *_match(board, evidence)),
        ("What is missing?", missing, mark),
        ("How sure is that?", how_sure(board, diagnosis), ""),
        ("What to do next?", next_step(board, evidence, diagnosis, files, space), ""),
    ]


def _match(board: Board, evidence: Evidence | None) -> tuple[str, str]:
    if evidence is None:
        return "Unknown: the logs are gone.", ""
    result = evidence.comparison
    fits = f"error {times(result.rmse / result.noise.std)} × the noise; {result.verdict()}"
    if result.passed and _fails(board):
        return (
            f"The law fits the logs ({fits}), but the MuJoCo scene does not: the check failed with an NRMSE of "
            f"{100 * board.last_check['nrmse']:.2f} %."
        ), "bad"
    return (f"Yes: {fits}.", "good") if result.passed else (f"No: {fits}.", "bad")


def _fails(board: Board) -> bool:
    """Whether the current record failed the check of its scene."""
    return bool(board.last_check) and not board.check_is_stale and not board.passed


def _is_added(board: Board, evidence: Evidence | None, diagnosis: LastDiagnosis | None) -> bool:
    """Whether the effects of a diagnosis were added since, and the error is within the tolerance."""
    if diagnosis is None or diagnosis.is_current or evidence is None or not evidence.comparison.passed:
        return False
    named = diagnosis.content["verdict"]["effects"]
    own = {part.name for part in board.effects}
    # Every fit finds the rest angle, so another one is no effect of the record.
    return bool(named) and all(name in own or effect(name).role == "shift" for name in named)


def _missing(board: Board, evidence: Evidence | None, diagnosis: LastDiagnosis | None) -> tuple[str, str]:
    if diagnosis is None:
        return "Not asked yet.", ""
    found = diagnosis.content["verdict"]
    names = titled(found["effects"])
    if evidence is not None and _is_added(board, evidence, diagnosis):
        noise = evidence.comparison.noise
        rest = "above the noise" if evidence.comparison.rmse <= noise.highest else "beyond the tolerance"
        return f"{names} added; nothing is left {rest}.", "good"
    if not diagnosis.is_current:
        before = f"; it named {names}" if found["effects"] else ""
        return f"Not asked since the record was last changed: the diagnosis was made before that{before}.", ""
    match found["status"]:
        case "none-missing":
            return "Nothing that matters.", "good"
        case "missing":
            return f"{names}.", "bad"
        case _:
            nearest = f" Nearest: {names}." if names else ""
            return f"A torque without a name in the catalogue.{nearest}", "bad"


UNSURE = "Not known: the record's numbers come without intervals; a fit finds them."


def titled(names: Sequence[str]) -> str:
    """Return effects as 'coulomb (dry friction) and …'."""
    return " and ".join(f"{name} ({effect(name).title})" for name in names)


def how_sure(board: Board, diagnosis: LastDiagnosis | None) -> str:
    """Return the confidence of a current diagnosis, and the 95 % intervals of the record's numbers that have one."""
    parts = []
    if diagnosis is not None and diagnosis.is_current:
        parts.append(f"confidence {percent(diagnosis.content['verdict']['confidence'])}")
    known = {"k": board.tilt["stiffness"], "d": board.tilt["damping"]}
    known |= {
        part.name: next(iter(part.parameters.values()))
        for part in board.effects
        if not effect(part.name).is_known
    }
    shares = [f"{name} to {_share(q)}" for name, q in known.items() if q.value and q.ci95[0] < q.ci95[1]]
    parts += [f"95 % intervals: {', '.join(shares)}"] if shares else []
    return f"{'; '.join(parts)}." if parts else UNSURE


def _share(quantity: Quantity) -> str:
    """Return the half width of an interval as a share of its value."""
    low, high = quantity.ci95
    return f"±{50 * (high - low) / abs(quantity.value):.2g} %"


def next_step(
    board: Board,
    evidence: Evidence | None,
    diagnosis: LastDiagnosis | None,
    files: Sequence[LogFile],
    space: Workspace,
) -> str:
    """Return the command or the experiment that brings this board on."""
    found = [file.found for file in files if file.found is not None]

    def command(name: str, *options: str, logs: Sequence[Path] | None = found) -> str:
        return space.command(name, *board.options, *options, logs=logs)

    if evidence is None:
        return f"Name logs that are there: {command('report', logs=())}"
    where = "the scene that policies train in" if board.geometry else "it in MuJoCo"
    check = f"{'See why the scene fails' if _fails(board) else f'Check {where}'}: {command('check')}"
    if _is_added(board, evidence, diagnosis):
        return _ready(board, command) if board.passed else check
    if diagnosis is None or not diagnosis.is_current:
        if evidence.comparison.passed and _fails(board):
            return check
        return f"Find the missing effect: {command('diagnose')}"
    verdict = diagnosis.content["verdict"]
    if verdict["status"] == "missing":
        fitted = [name for name in verdict["effects"] if effect(name).identifiable_from_decay]
        if fitted:
            added = [word for name in fitted for word in ("--effect", name)]
            hangs = diagnosis.content["best"]["parameters"].get("stiffness", {}).get("value") == 0
            return f"Add it: {command('fit', *added, *['--fix', 'stiffness=0'] * hangs)}"
    if verdict["status"] != "none-missing" and verdict["next_experiment"]:
        return verdict["next_experiment"]
    if not evidence.comparison.passed:
        return f"Refit stiffness and damping: {command('fit')}"
    return _ready(board, command) if board.passed else check


def _ready(board: Board, command: Callable[..., str]) -> str:
    """Return the next step of a board that has passed its check."""
    if board.model:
        return f"It is ready: {board.model['file']}"
    train = f", or {command('train', logs=None)}" if board.geometry else ""
    return f"It is ready: {command('mjcf', logs=None)}{train}"
