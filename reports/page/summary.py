"""A board and its comparison in Markdown, for a recording."""

from pathlib import Path

from reports.evidence import Evidence
from sysid.board import Board
from sysid.effects import effect
from sysid.free_decay import FreeDecay
from sysid.joint import JointLaw
from sysid.quantity import Quantity


def board_summary(evidence: Evidence) -> str:
    """Return verdict, law, parameters, errors and logs."""
    board, result = evidence.board, evidence.comparison
    mark = "✓ within" if result.passed else "✗ beyond"
    lines = [
        f"# {board.name}",
        board.description,
        "",
        f"**{mark} tolerance**: error over the RMS motion {result.verdict()}",
        "",
        result.summary,
        "",
        f"`{law_text(board)}`",
        "",
        "| quantity | value ± 95 % |",
        "|---|---|",
        *(f"| {name} | {pretty(str(quantity))} |" for name, quantity in parameters(board).items()),
        "",
        "| release | error | error / noise |",
        "|---|---|---|",
    ]
    for release in result.releases:
        lines.append(
            f"| {Path(release.log).name} {release.number} | {result.show(release.rmse, 3)} | {release.rmse / result.noise.std:.2f} |"
        )
    if len(evidence.ladder) > 1:
        lines += ["", "| model, fitted | error / noise |", "|---|---|"]
        lines += [f"| {rung.label} | {rung.rmse / result.noise.std:.3f} |" for rung in evidence.ladder]
    if any(file.truth for file in evidence.files):
        lines += ["", "Logs are **synthetic**: made with a known truth; nothing was measured."]
    lines += ["", *(f"- ⚠ {warning}" for warning in evidence.warnings)]
    return "\n".join(lines) + "\n"


def decay_summary(board: str, decay: FreeDecay) -> str:
    """Return the numbers and warnings of a free decay."""
    lines = [
        f"# {board}: free decay",
        f"`{decay.releases[0].log}`",
        "",
        "| quantity | value ± 95 % |",
        "|---|---|",
    ]
    lines += [
        f"| {name.replace('_', ' ')} | {pretty(str(quantity))} |" for name, quantity in decay.numbers.items()
    ]
    lines += ["", *(f"- ⚠ {warning}" for warning in decay.warnings)]
    return "\n".join(lines) + "\n"


def title(board: Board) -> str:
    """Return the title of a board, or of a joint without a deck."""
    return f"{'Board' if board.geometry else 'Joint'} {board.name}"


def parameters(board: Board) -> dict[str, Quantity]:
    """Return inertia, stiffness, damping, rest angle and all effects' parameters."""
    own = {"roll inertia": board.inertia}
    own |= {name.replace("_", " "): board.tilt[name] for name in ("stiffness", "damping", "rest_angle")}
    for part in board.effects:
        own |= {
            f"{part.name}: {name.replace('_', ' ')}": value
            for name, value in part.parameters.items()
            if value.value or not effect(part.name).is_known
        }
    return own


def law_text(board: Board) -> str:
    """Return the identified law, as it would be written on a board."""
    return str(JointLaw.from_board(board))


def pretty(text: str) -> str:
    """Return a text with the powers of its units set high."""
    return text.replace("^2", "²").replace("^3", "³")


def effect_lines(board: Board) -> list[tuple[str, str, str]]:
    """Return name, law and consequence of each effect of a board."""
    return [(part.name, effect(part.name).law, effect(part.name).does) for part in board.effects]
