"""Everything known of a board on one page."""

from dataclasses import dataclass
from html import escape
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

from reports.evidence import Evidence, LastDiagnosis
from reports.figures import board as board_figures
from reports.figures import story as story_figures
from reports.figures.bode import bode_figure
from reports.figures.svg import figure_to_svg, page_style
from reports.log_files import LogFile
from reports.page.answers import four_answers
from reports.page.page import (
    Page,
    answers,
    choices,
    figure,
    panels,
    paragraph,
    sliders,
    table,
    verdict,
    warning_list,
)
from reports.page.summary import history_table, parameters, pretty, title
from reports.playground import playground
from reports.story import release_name, story_of_board
from sysid.board import Board
from sysid.decay.report import inertia_share
from sysid.effects import effect
from sysid.joint import JointLaw
from sysid.shown import MOST_SHOWN
from sysid.text import count, display, percent
from sysid.workspace import Workspace

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

AXES = ("time", "amplitude", "velocity", "side", "phase")
"""Ways to divide an error, in the order in which they are listed."""


@dataclass(frozen=True, slots=True)
class Provenance:
    """Provenance of a page."""

    command: str
    made: str
    """Date."""
    record: str
    """Path of the board record."""
    space: Workspace
    """Where the board is."""


def board_report(
    board: Board,
    evidence: Evidence | None,
    files: "Sequence[LogFile]",
    provenance: Provenance,
    diagnosis: LastDiagnosis | None = None,
) -> str:
    """Return the page of a board as HTML; missing logs are listed too, without evidence."""
    page = Page(title=title(board), subtitle=board.description)
    page.lead = "\n".join(_lead(board, evidence, diagnosis, files, provenance.space))
    with page_style():
        if evidence is not None:
            page.section("How it came here", *_story(evidence, diagnosis))
        page.section("Warnings", _warnings(board, evidence, files))
        page.section("Parameters", _parameters(board), *_inertia_share(board))
        page.section("Identified law", *_law(board))
        if evidence is not None:
            page.section("Measured against simulated", *_releases(evidence))
            page.section("Where it fails", *_where(evidence))
        unfitted = "The record holds no fit yet: its numbers come from its source."
        page.section("Fits so far", table(*history_table(board)) if board.history else paragraph(unfitted))
        page.section("Frequency response", _frequency_response(board))
        page.section("Check in MuJoCo", _check(board, files, provenance.space))
        page.section("Provenance", *_provenance(board, files, provenance))
    return page.render()


def _lead(
    board: Board,
    evidence: Evidence | None,
    diagnosis: LastDiagnosis | None,
    files: "Sequence[LogFile]",
    space: Workspace,
) -> list[str]:
    """Return the answers, and sliders to try them."""
    parts = [answers(four_answers(board, evidence, diagnosis, files, space))]
    if any(file.synthetic for file in files):
        remark = "These logs are synthetic: made from a known truth to show and to test the tool. "
        parts.append(paragraph(remark + "Nothing on this page was measured on a real board.", "note"))
    play = None if evidence is None else playground(evidence, diagnosis)
    if play is not None:
        remark = "Each effect's slider multiplies its fitted strength; the start of each release is fitted again at once."
        if play.left_out:
            remark += f" Not on a slider: {', '.join(play.left_out)}."
        parts.append(sliders(play, remark))
    return parts


def _story(evidence: Evidence, diagnosis: LastDiagnosis | None) -> list[str]:
    story = story_of_board(evidence, diagnosis)
    drawn: list[str] = []
    for panel in story_figures.panels(story):
        figure = board_figures.small_figure()
        panel.draw(figure.subplots())
        drawn.append(_figure(figure, f"story-{panel.name}", panel.caption, panel.title))
    return [panels(drawn), *_diagnosis(diagnosis, {part.name for part in evidence.board.effects})]


def _warnings(board: Board, evidence: Evidence | None, files: "Sequence[LogFile]") -> str:
    warnings = [f"{file.path}: {file.state}" for file in files if file.found is None]
    if evidence is not None:
        warnings += map(pretty, evidence.warnings)
    if not board.last_check:
        warnings.append("not checked in MuJoCo yet (see the check below)")
    elif board.check_is_stale:
        warnings.append("the record was changed since it was checked: check it again")
    elif not board.passed:
        warnings.append("the MuJoCo scene does not decay as measured (see the check below)")
    return warning_list(warnings, "No warnings.")


def _parameters(board: Board) -> str:
    rows = [(name, pretty(str(quantity))) for name, quantity in parameters(board).items()]
    rows += [(f"{name}, as published", pretty(str(value))) for name, value in board.published.items()]
    return table(("quantity", "value ± 95 %"), rows)


def _inertia_share(board: Board) -> list[str]:
    inertia, stiffness = board.inertia, board.tilt["stiffness"]
    if not (inertia.std > 0 and stiffness.std > 0):
        return []
    share = inertia_share(inertia, stiffness)
    text = f"Inertia: {inertia.method}. A free decay fixes only k/I, d/I and torque/I"
    if share >= 0.01:
        text += f"; {100 * min(share, 1):.0f} % of the variance of the stiffness comes from the inertia"
    return [paragraph(text + ".")]


def _law(board: Board) -> list[str]:
    what = "the joint's position, with the sign of the log"
    if board.geometry:
        what = "the roll, right edge down positive"
    parts = [
        paragraph(str(JointLaw.from_board(board)), "law"),
        paragraph(f"SI units{'' if board.slides else ', radians'}; φ is {what}."),
    ]
    lines = [(part.name, effect(part.name).law, effect(part.name).does) for part in board.effects]
    if lines:
        parts.append(table(("effect", "law", "what it does"), lines))
    return parts


def _releases(evidence: Evidence) -> list[str]:
    result = evidence.comparison
    show, first = result.show, display(is_rate=False, slides=result.slides)
    drawn: list[tuple[str, str]] = []
    for i, release in enumerate(result.releases[:MOST_SHOWN]):
        name = release_name(result, i)
        caption = (
            f"{name}: error {show(release.rmse, 3)}, {release.rmse / result.noise.std:.2f} times the "
            "noise. Below, the residual over ±2σ of the sensor's noise in grey."
        )
        drawn.append((name, _figure(board_figures.release_figure(evidence, i), f"release{i + 1}", caption)))
    rows: list[tuple[str, ...]] = []
    for i, (part, release) in enumerate(zip(result.releases, evidence.releases, strict=True)):
        errors = show(part.rmse, 3), f"{part.rmse / result.noise.std:.2f}"
        place = release.side if evidence.board.geometry else {"right": "+", "left": "−"}[release.side]
        rows.append((release_name(result, i), place, first(release.amplitude, 3), *errors))
    side = "edge down" if evidence.board.geometry else "let go from"
    left = len(result.releases) - MOST_SHOWN
    return [
        choices(drawn),
        paragraph(f"{count(left, 'more release')} in the table only.") if left > 0 else "",
        table(("release", side, "first amplitude", "RMS error", "error / noise"), rows),
    ]


def _where(evidence: Evidence) -> list[str]:
    result = evidence.comparison
    if not result.where:
        return [paragraph(result.summary)]
    places = sorted(result.where, key=lambda place: (AXES.index(place.axis), place.range))
    rows = [(place.axis, place.text, f"{100 * place.share:.0f} %") for place in places]
    return [
        paragraph(result.summary),
        table(("divided by", "where", "share of the error"), rows),
        paragraph(
            "Shares of the squared error beyond the noise; each way of dividing it adds up to 100 %. A share may be "
            "negative where there is less than noise."
        ),
    ]


def _diagnosis(diagnosis: LastDiagnosis | None, own: set[str]) -> list[str]:
    """Return the last diagnosis in words; of a record before the present one, as the history that it is."""
    if diagnosis is None:
        return []
    found = diagnosis.content["verdict"]
    logs = ", ".join(Path(log).name for log in diagnosis.content.get("logs", []))
    said = f"{found['explanation']} Confidence {percent(found['confidence'])}, from {logs}."
    if not diagnosis.is_current:
        history = f"The diagnosis was made before the record was last changed, and then said: {said}"
        return [paragraph(history, "note")]
    parts = [paragraph(said)]
    if found.get("next_experiment") and not own.issuperset(found["effects"] or ["-"]):
        parts.append(paragraph(f"Next experiment: {found['next_experiment']}"))
    return parts


def _frequency_response(board: Board) -> str:
    if not board.stiffness:
        return paragraph("Not drawn: the record has no spring.")
    said = f"{'Position over force' if board.slides else 'Angle over torque'} with its 95 % band: "
    return _figure(
        bode_figure(board, board_figures.WIDTH),
        "bode",
        said + "spring, damper and inertia without other effects.",
    )


def _check(board: Board, files: "Sequence[LogFile]", space: Workspace) -> str:
    check = board.last_check
    if not check:
        found = [file.found for file in files if file.found is not None]
        command = space.command("check", *board.options, logs=found)
        scene = "the joint in its model" if board.model else "the deck in the scene that policies train in"
        return verdict(f"Not checked yet. {command} releases {scene}, and compares.", good=False)
    if board.check_is_stale:
        text = "Out of date: the record was changed since it was checked. Check it again."
        return verdict(text, good=False)
    text = (
        f"{'Passed' if board.passed else 'Failed'}: NRMSE {100 * check.get('nrmse', float('nan')):.2f} %, tolerance "
        f"{100 * check.get('tolerance', 0.02):g} %, on {check.get('date', '?')} in: {check.get('scene', '?')}."
    )
    return verdict(text, good=board.passed)


def _provenance(board: Board, files: "Sequence[LogFile]", provenance: Provenance) -> list[str]:
    rows = [(file.path, file.digest or "(a folder)", file.state) for file in files]
    return [
        table(("log", "sha256", "state"), rows) if rows else paragraph("No logs."),
        table(("what", "value"), made_of(board, provenance)),
        f"<pre>{escape(provenance.command)}</pre>",
    ]


def made_of(board: Board, provenance: Provenance) -> list[tuple[str, str]]:
    """Return where a page comes from: record, source, dates, versions."""
    fit = board.fit
    return [
        ("record", provenance.record),
        ("source", board.source),
        ("fitted", f"{fit.get('date', '?')} by husky-sysid {fit.get('version', '?')}" if fit else "never"),
        ("page made", provenance.made),
        *((name, _version(name)) for name in ("husky-sysid", "mujoco", "casadi", "numpy", "scipy")),
    ]


def _version(package: str) -> str:
    """Return a package's version; a build from source need not leave one."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"


def _figure(drawn: "Figure", identifier: str, caption: str, title: str = "") -> str:
    return figure(figure_to_svg(drawn, identifier, title or caption), caption, title)
