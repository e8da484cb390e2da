"""Where a recording was released, and until when it decays freely."""

from sysid.releases.find import find_releases
from sysid.releases.phases import Phase, log_phases, settling_time

__all__ = ["Phase", "find_releases", "log_phases", "settling_time"]
