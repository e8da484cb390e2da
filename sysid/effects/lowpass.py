"""A first-order low-pass filter between deck and log."""

from sysid.effects._algebra import Algebra, Numbers, States, Value, Values
from sysid.effects._base import JointState, LinearJoint, Parameter, Reading, SensorEffect, State, at_tilt


def reading_rate(m: Algebra, motion: JointState, states: States, parameters: Values) -> Value:
    """Return (φ - reading)/T [rad/s]."""
    return (motion.roll - states[0]) / m.maximum(parameters["time_constant"], 1e-6)


def observe(m: Algebra, reading: Reading, parameters: Values, states: States) -> Reading:
    """Return the filter's output and its rate."""
    time_constant = m.maximum(parameters["time_constant"], 1e-6)
    return Reading(states[0], (reading.angle - states[0]) / time_constant, reading.time)


def at_release(
    m: Algebra, roll: Value, rate: Value, hold: Value, joint: LinearJoint, parameters: Values
) -> Value:
    """Return the reading of the filter at the start of a record [rad].

    A filter hides the first milliseconds after a hold, so the release is detected late, by δ = v/α. With a constant acceleration α
    the reading is `φ - α T² (u - 1 + e^-u)`, u = δ/T. Amid the linear decay `I φ̈ = -k x - d φ̇`, without a hold, it is
    `φ - T (I φ̇ + T k x) / (I - T d + T² k)`, the solution of `T ṁ = φ - m` that decays with φ.
    """
    time_constant, tilt = m.maximum(parameters["time_constant"], 1e-6), roll - joint.rest_angle
    pull = -joint.stiffness * tilt / joint.inertia
    u = m.maximum(rate * pull / (time_constant * (pull**2 + 1e-9)), -1.0)
    late = roll - pull * time_constant**2 * (u - 1.0 + m.exp(-u))
    time_constant = parameters["time_constant"]
    square = time_constant * joint.stiffness
    behind = time_constant * (joint.inertia * rate + square * tilt)
    moving = roll - behind / (joint.inertia - time_constant * joint.damping + time_constant * square)
    return m.where(hold > 0, late, moving)


def detection_delay(acceleration: float, noise: float, parameters: Numbers) -> float:
    """Return the time after which the reading has moved by its noise [s]; it moves as α t³/6T, to first order."""
    return float((6 * max(parameters["time_constant"], 0.0) * noise / max(acceleration, 1e-9)) ** (1 / 3))


EFFECT = SensorEffect(
    name="lowpass",
    title="a filter in the sensor",
    family="lowpass",
    also_called=("filter", "low-pass"),
    parameters=(Parameter("time_constant", "s", low=0.0, high=3.0, starts=(0.1, 0.5)),),
    law="T ṁ = φ - m, and m is measured",
    source="first-order lag",
    does="The start is rounded off; afterwards the decay is only late and a little smaller.",
    look_alikes=("a delay of the sensor", "a hand that lets go slowly"),
    experiment="Compare the first 20 ms after release with a film, or with a second sensor.",
    example=(0.01,),
    observe=observe,
    excludes=("sensor-drift",),
    states=(
        State(
            name="reading",
            start=at_tilt,
            size=lambda s: s.amplitude,
            rate=reading_rate,
            sensed=at_release,
            detection_delay=detection_delay,
        ),
    ),
)
