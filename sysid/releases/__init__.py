"""Find the releases of a log, and the end of each free decay."""

from sysid.releases.find import find_releases
from sysid.releases.phases import Phase, log_phases, settling_time

__all__ = ["Phase", "find_releases", "log_phases", "settling_time"]
