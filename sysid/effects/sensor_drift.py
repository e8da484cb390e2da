"""A sensor whose zero moves, e.g. the integral of a gyro with a bias."""

from sysid.effects._algebra import Algebra, States, Values
from sysid.effects._base import Parameter, Reading, SensorEffect


def observe(m: Algebra, reading: Reading, parameters: Values, states: States) -> Reading:
    """Return φ + r t, and v + r."""
    drift = parameters["rate"]
    return Reading(reading.angle + drift * reading.time, reading.rate + drift, reading.time)


EFFECT = SensorEffect(
    name="sensor-drift",
    title="angle sensor that drifts",
    family="drift",
    also_called=("drift",),
    parameters=(
        Parameter("rate", "rad/s", lambda s: s.amplitude / s.duration, low=-2.0, high=2.0, starts=(0.02,)),
    ),
    law="measured = φ + r t, t on the log's clock",
    source="integral of a constant gyro bias",
    does="The middle of the decay moves at a constant rate, also at rest.",
    look_alikes=("viscoelastic",),
    experiment="Leave the joint alone for 30 s and look at the reading: a drifting sensor goes on.",
    example=(0.02,),
    observe=observe,
    excludes=("lowpass",),
)
