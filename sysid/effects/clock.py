"""A clock that runs fast or slow."""

from sysid.effects._base import Parameter, SensorEffect

EFFECT = SensorEffect(
    name="clock",
    title="the log's clock runs fast or slow",
    family="clock",
    also_called=("time scale", "slow motion"),
    parameters=(Parameter("ratio", "1", low=0.5, high=2.0, starts=(1.0,), neutral=1.0),),
    law="measured time = r × true time",
    source="definition",
    does="Every time is stretched: period and decay time change in the same proportion, ζ stays.",
    look_alikes=("inertia", "stiffness and damping of the record"),
    experiment="Record a minute against another clock; or film the joint beside a stopwatch.",
    example=(1.05,),
    clock_ratio="ratio",
    identifiable_from_decay=False,
    record_direction=(2.0, 1.0),
)
