"""One release, measured and simulated."""

from dataclasses import dataclass

from sysid.roll import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedRelease:
    """One release, measured and simulated."""

    log: str
    number: int
    time: Array
    """Since the release [s], shape (n,)."""
    measured: Array
    """[rad], or [rad/s] if the rate was compared."""
    simulated: Array
    roll: Array
    """Simulated roll [rad]."""
    rate: Array
    """Simulated rate [rad/s]."""
    rmse: float
    measures_rate: bool = False
    """Whether the rate was compared."""

    @property
    def residual(self) -> Array:
        """Simulated minus measured, shape (n,): [rad], or [rad/s] if the rate was compared."""
        return self.simulated - self.measured
