"""A sensor that reads a constant too much."""

from sysid.effects._base import Effect, MujocoSupport, Parameter, belongs_to_log

EFFECT = Effect(
    name="sensor-bias",
    title="angle sensor off by a constant",
    family="rest",
    role="measurement",
    parameters=(
        Parameter(name="angle", unit="rad", size=lambda s: s.amplitude, low=-1.0, high=1.0, starts=(0.01,)),
    ),
    law="measured = φ + b",
    source="definition",
    does="The whole decay moves up or down by a constant; its shape stays.",
    look_alikes=("offset", "preload"),
    experiment="Turn the sensor round on the deck and repeat: a sensor bias changes sign, a real offset not.",
    mujoco=MujocoSupport(means="nothing: it belongs to the log", since="", warp=False),
    to_mjcf=belongs_to_log,
    example=(0.02,),
)
