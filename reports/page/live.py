"""The page of a running measurement: numbers and intervals after each release, the next step, and sliders."""

import numpy as np

from reports.evidence import Evidence
from reports.figures.board import small_figure
from reports.figures.palette import SIM
from reports.figures.svg import figure_to_svg, page_style
from reports.page.page import Page, answers, figure, panels, script, sliders, table
from reports.playground import playground
from sysid.comparison.compare import compare
from sysid.decay.report import LABELS, verdict
from sysid.errors import SysidError
from sysid.joint import JointLaw
from sysid.live.session import Session
from sysid.text import count

NAMES = {"stiffness": "k", "damping": "d"}


def live_page(session: Session, version: int, log: str) -> str:
    """Return the page as HTML; its version goes up with each page, which asks for it to know when it is old."""
    page = Page(title=f"Live: {session.board.name}", subtitle=f"kept in {log}")
    decay = session.decay
    numbers = "None yet." if decay is None else ", ".join(
        f"{letter} = {getattr(decay.numbers, name)}" for name, letter in NAMES.items()
    )  # fmt: skip
    rows = [
        ("Releases so far", count(len(session.releases), "release") + ".", ""),
        ("Stiffness and damping", session.trouble or f"{numbers} (95 %)", "bad" if session.trouble else ""),
        *([] if decay is None else [("Linear?", verdict(decay), "" if decay.linear else "bad")]),
        ("What to do next?", session.next_step, ""),
    ]
    page.lead = f'<div data-version="{version}">{answers(rows)}</div>' + _sliders(session) + script("live.js")
    if decay is not None:
        with page_style():
            page.section("Intervals shrink", panels([_shrinking(session, name) for name in NAMES]))
        page.section(
            "Numbers",
            table(("quantity", "value ± 95 %"), [(LABELS[n], str(q)) for n, q in decay.numbers.items()]),
        )
    return page.render()


def _shrinking(session: Session, name: str) -> str:
    """Draw a number with its 95 % interval after each release."""
    found = [getattr(numbers, name) for numbers in session.history]
    low, high = np.array([quantity.ci95 for quantity in found]).T
    drawn = small_figure(2.6)
    axes = drawn.subplots()
    at = [numbers.releases for numbers in session.history]
    axes.vlines(at, low, high, color=SIM, lw=2)
    axes.plot(at, [quantity.value for quantity in found], "o", color=SIM)
    axes.set(xlabel="releases", ylabel=f"{name} [{found[0].printed_unit}]", xticks=at)
    # The interval of the first release may be very wide, and would flatten the others.
    low, high = float(np.median(low)), float(np.median(high))
    axes.set_ylim(low - 1.5 * (high - low), high + 1.5 * (high - low))
    return figure(figure_to_svg(drawn, f"live-{name}", name), f"{name.capitalize()} with its 95 % interval.")


def _sliders(session: Session) -> str:
    """Return sliders that begin with the measured linear decay; '' if it cannot be simulated."""
    decay = session.decay
    if decay is None:
        return ""
    numbers, board = decay.numbers, session.board
    rests = [q.value for q in decay.rest_angles]
    found = JointLaw(
        inertia=board.inertia.value, stiffness=numbers.stiffness.value, damping=numbers.damping.value,
        rest_angle=float(np.median(rests)),
    )  # fmt: skip
    try:
        compared = compare(session.releases, board, law=found)
        stood, releases = JointLaw.from_board(board), tuple(session.releases)
        evidence = Evidence(board=board, releases=releases, comparison=compared, stood=stood)
        play = playground(evidence, None, "as measured")
    except SysidError:
        return ""
    return "" if play is None else sliders(play, "Roll and rate at each release are fitted at once.")
