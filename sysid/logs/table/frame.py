"""Data frames of pandas as columns of a log."""

from typing import Any

import numpy as np

from sysid.errors import SysidError
from sysid.roll import Array


def columns_of_frame(frame: Any) -> tuple[dict[str, Array], dict[str, str]]:
    """Return the columns that hold numbers or dates, shape (n,), and the units of the dates.

    An index that does not merely count rows is a column too.

    Raises:
        SysidError: No column holds numbers.
    """
    import pandas as pd

    if frame.index.name is not None or not pd.api.types.is_integer_dtype(frame.index):
        frame = frame.reset_index(names=str(frame.index.name or "time"))
    columns: dict[str, Array] = {}
    units: dict[str, str] = {}
    for label in frame.columns:
        content = frame[label]
        if pd.api.types.is_datetime64_any_dtype(content) or pd.api.types.is_timedelta64_dtype(content):
            columns[str(label)] = ((content - content.iloc[0]) / pd.Timedelta(seconds=1)).to_numpy(np.float64)
            units[str(label)] = "s"
        elif pd.api.types.is_numeric_dtype(content):
            columns[str(label)] = content.to_numpy(np.float64, na_value=np.nan)
    if not columns:
        raise SysidError(f"no column of the table holds numbers: {', '.join(map(str, frame.columns))}.")
    return columns, units
