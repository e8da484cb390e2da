"""Experiments that the app phyphox saved with their data, as XML: buffers of numbers, and tables of them to export."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from sysid.errors import SysidError
from sysid.logs.formats.registry import Format, refuse_larger, undamaged
from sysid.logs.formats.tables import merge_logs
from sysid.logs.formats.vectors import log_of_vectors
from sysid.logs.table.file import LogFile


def open_state(path: Path) -> LogFile:
    """Open a saved experiment; its tables are those that the app itself exports.

    Raises:
        SysidError: It is damaged, or holds no data.
    """
    refuse_larger(path, 4 * path.stat().st_size)
    with undamaged(path, "phyphox experiment"):
        root = ElementTree.parse(path).getroot()
        held = {(c.text or "").strip(): c.get("init", "") for c in root.iter("container")}
        buffers = {
            name: np.array([float(cell) for cell in text.split(",")])
            for name, text in held.items()
            if "," in text
        }
    if not buffers:
        raise SysidError(
            f"{path}: the experiment was saved without data. In the app, measure, then save the state."
        )
    tables: dict[str, LogFile] = {}
    for number, table in enumerate(root.iter("set")):
        columns = {
            d.get("name", ""): buffers.get((d.text or "").strip(), np.zeros(0)) for d in table.iter("data")
        }
        count = min(map(len, columns.values()), default=0)
        if count > 1:
            name = table.get("name", f"table {number + 1}")
            tables[name] = log_of_vectors(
                path, "phyphox", {key: column[:count] for key, column in columns.items()}
            )
    return (
        merge_logs(path, tables, "phyphox experiment") if tables else log_of_vectors(path, "phyphox", buffers)
    )


FORMAT = Format(
    name="phyphox experiment", order=7, sniff=lambda path, head: head.lstrip().startswith((b"<phyphox", b"<?xml")), open=open_state
)  # fmt: skip
