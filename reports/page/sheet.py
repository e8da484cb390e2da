"""A board on one printed page."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from reports.evidence import Evidence, LastDiagnosis
from reports.figures.one_page import one_page
from reports.log_files import LogFile
from reports.page.answers import four_answers
from reports.page.board import Provenance, made_of
from reports.page.summary import law_text, parameters, pretty, title
from reports.story import story_of_board

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def board_sheet(
    evidence: Evidence, files: Sequence[LogFile], provenance: Provenance, diagnosis: LastDiagnosis | None
) -> "Figure":
    """Draw a board's page: answers, law, parameters, story and provenance."""
    board = evidence.board
    table = [(name, pretty(str(quantity))) for name, quantity in parameters(board).items()]
    logs = [("log", f"{file.path} · sha256 {file.digest} · {file.state}") for file in files]
    return one_page(
        f"{title(board)}: {board.description}",
        four_answers(board, evidence, diagnosis, files, provenance.space),
        law_text(board),
        table,
        story_of_board(evidence, diagnosis),
        [*logs, *made_of(board, provenance)],
    )
