"""Any log or film to roll."""

from sysid.logs.read import LogOptions, read_roll

__all__ = ["LogOptions", "read_roll"]
