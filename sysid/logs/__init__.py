"""Any log or film to roll."""

from sysid.logs.read import read_roll
from sysid.logs.table.options import LogOptions

__all__ = ["LogOptions", "read_roll"]
