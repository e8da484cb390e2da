"""A sensor with a constant bias."""

from dataclasses import replace

from sysid.effects._algebra import Algebra, States, Values
from sysid.effects._base import Parameter, Reading, SensorEffect


def observe(m: Algebra, reading: Reading, parameters: Values, states: States) -> Reading:
    """Return φ + b."""
    return replace(reading, angle=reading.angle + parameters["angle"])


EFFECT = SensorEffect(
    name="sensor-bias",
    title="angle sensor off by a constant",
    family="rest",
    also_called=("bias", "gyro bias"),
    parameters=(Parameter("angle", "rad", low=-100.0, high=100.0, starts=(0.01,)),),
    law="measured = φ + b",
    source="definition",
    does="The whole decay moves up or down by a constant; its shape stays.",
    look_alikes=("offset", "preload"),
    experiment="Turn the sensor round on the joint and repeat: a sensor bias changes sign, a real offset not.",
    example=(0.02,),
    observe=observe,
    same_as=("rest_angle", "offset", "preload"),
)
