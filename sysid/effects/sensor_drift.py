"""A sensor whose zero moves, e.g. the integral of a gyro with a bias."""

from sysid.effects._base import Effect, MujocoSupport, Parameter, belongs_to_log

EFFECT = Effect(
    name="sensor-drift",
    title="angle sensor that drifts",
    role="measurement",
    parameters=(
        Parameter(
            name="rate",
            unit="rad/s",
            size=lambda s: s.amplitude / s.duration,
            low=-2.0,
            high=2.0,
            starts=(0.02,),
        ),
    ),
    law="measured = φ + r t, t on the log's clock",
    source="integral of a constant gyro bias",
    does="The middle of the decay moves at a constant rate, also at rest.",
    decay_signs=("rest drifts",),
    look_alikes=("viscoelastic",),
    experiment="Leave the deck alone for 30 s and look at the reading: a drifting sensor goes on.",
    mujoco=MujocoSupport(means="nothing: it belongs to the log", since="", warp=False),
    to_mjcf=belongs_to_log,
    example=(0.02,),
)
