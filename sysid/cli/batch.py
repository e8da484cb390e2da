"""`husky-sysid batch`: many logs of many boards, into one table and one page."""

import csv
import io
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter, validators

from sysid.cli.console import Common, Output, Printer
from sysid.files import locked, write_atomically, write_json
from sysid.text import count


def batch(
    manifest: Path,
    /,
    *,
    output: Output | None = None,
    workers: Annotated[int | None, Parameter(validator=validators.Number(gte=1))] = None,
    cluster: str | None = None,
    common: Common = Common(),
) -> int:
    """Run many jobs in parallel, and put their results into one table and one page.

    Args:
        manifest: The jobs, TOML or CSV.
        output: Folder for table.csv, table.json, page.html and rows.jsonl; reports/batch/MANIFEST of the workspace if
            left out.
        workers: Processes; one a core if left out.
        cluster: Address of a Dask scheduler (tcp://HOST:8786) or a Ray cluster (ray://HOST:10001) that runs the jobs
            instead; it must see the logs under the same paths.
    """
    from reports.page.batch import batch_page
    from sysid.batch.jobs import COLUMNS, failure, run_job, table_row, unfinished
    from sysid.batch.manifest import read_manifest
    from sysid.batch.runner import read_rows, run_all
    from sysid.cli.bars import bar

    printer = Printer(common)
    printer.keep([manifest])
    jobs = read_manifest(manifest)
    folder = output or common.workspace / "reports" / "batch" / manifest.stem
    file = folder / "rows.jsonl"
    root = common.workspace.resolve()
    with locked(file):
        waiting, rows = unfinished(jobs, root, read_rows(file))
        printer.note(f"{count(len(jobs), 'job')}, {len(rows)} of them done before")
        with bar(printer) as progress:
            task = progress.add_task("jobs", total=len(waiting))
            for row in run_all(run_job, waiting, file, workers=workers or -1, cluster=cluster):
                rows.append(dict(row))
                progress.advance(task)
                if row["state"] == "failed":
                    printer.warn(failure(row))
    place = {job.name: number for number, job in enumerate(jobs)}
    rows.sort(key=lambda row: place[row["job"]])
    table = [table_row(row) for row in rows]
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(table)
    write_atomically(folder / "table.csv", text.getvalue())
    write_json(folder / "table.json", table)
    write_atomically(folder / "page.html", batch_page(manifest.name, table))
    head = ("job", "task", "board", "k [N·m/rad]", "d [N·m·s/rad]", "f [Hz]", "verdict")
    printer.table(head, [_shown(row) for row in table])
    failed = sum(row["state"] == "failed" for row in table)
    printer.say(f"{len(table) - failed} of {count(len(table), 'job')} done, {failed} failed")
    written = [folder / name for name in ("table.csv", "table.json", "page.html")]
    printer.result({"jobs": table, "failed": failed, "table": written[0]}, *written)
    return int(failed > 0)


def _shown(row: Mapping[str, Any]) -> tuple[str, ...]:
    from sysid.batch.jobs import with_interval

    frequency = f"{row['omega_n_rad_s'] / math.tau:.3g}" if "omega_n_rad_s" in row else "-"
    verdict = "fitted with" if row["task"] == "fit" and row.get("effects") else row.get("verdict")
    said = " ".join(filter(None, (verdict, row.get("effects")))) or row["state"]
    measured = (with_interval(row, name) for name in ("stiffness", "damping"))
    return (
        *(row["job"], row["task"], row.get("board", "-"), *measured, frequency),
        said if row["state"] == "done" else "failed",
    )
