"""The results and failures of a batch on one page."""

from collections.abc import Mapping, Sequence
from datetime import date
from typing import Any

from reports.figures.batch import batch_figure
from reports.figures.svg import figure_to_svg, page_style
from reports.page.page import Page, figure, paragraph, table, verdict, warning_list
from sysid.batch.jobs import QUANTITIES, column, failure, with_interval

SHOWN = {
    **{name: name for name in ("job", "board", "task")},
    "stiffness_nm_rad": "k [N·m/rad]",
    "damping_nms_rad": "d [N·m·s/rad]",
    "omega_n_rad_s": "ω_n [rad/s]",
    "damping_ratio": "ζ",
    "nrmse": "NRMSE",
    **{name: name for name in ("verdict", "effects", "confidence", "warnings")},
}
"""Columns of the page's table, and their heads; empty ones are left out."""
CAPTION = "With 95 % intervals, by board; hollow: the decay is not linear, so there is no one value."


def batch_page(name: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the page of a batch as HTML, from rows of its table, by `sysid.batch.jobs.COLUMNS`."""
    done = [row for row in rows if row["state"] == "done"]
    failed = [failure(row) for row in rows if row["state"] != "done"]
    page = Page(title=f"Batch {name}", subtitle=f"{len(rows)} jobs, {date.today().isoformat()}")
    result = f"{len(done)} of {len(rows)} jobs done, {len(failed)} failed."
    page.section("Result", verdict(result, good=not failed))
    with page_style():
        for title, key in (("Stiffness", "stiffness"), ("Damping", "damping")):
            found = [row for row in done if column(key) in row]
            if found:
                page.section(title, figure(figure_to_svg(batch_figure(found, key), key, title), CAPTION))
    columns = {key: head for key, head in SHOWN.items() if any(key in row for row in done)}
    measured = {column(name): name for name in QUANTITIES}

    def cell(row: Mapping[str, Any], key: str) -> str:
        value = with_interval(row, measured[key]) if key in measured else row.get(key, "")
        return f"{value:.4g}" if isinstance(value, float) else str(value)

    cells = [[cell(row, key) for key in columns] for row in done]
    page.section("Table", table(list(columns.values()), cells) if done else paragraph("Nothing was done."))
    page.section("Failed", warning_list(failed))
    return page.render()
