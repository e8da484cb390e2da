"""A bumper at a certain tilt."""

from sysid.effects._algebra import Algebra, Numbers, States, Value, Values
from sysid.effects._base import JointState, MjsJoint, MjSpec, MujocoSupport, Parameter, TorqueEffect
from sysid.effects._mjcf import add_tendon, rest_of

RAMP = 0.1
"""Width of the damper's ramp, over the stop's angle [1]: two integration steps of 1/128 period. A lossy stop, 40 times as stiff as
the spring, is then fitted to 1 %."""


def torque(m: Algebra, motion: JointState, parameters: Values, states: States) -> Value:
    """Return -(k_s (|x| - a) sgn x + d_s v) beyond ±a, else 0 [N*m].

    The damper rises over `RAMP` about ±a, with the same impulse as a jump, which integrators and derivatives cannot follow.
    """
    angle = parameters["angle"]
    beyond = motion.tilt - m.maximum(-angle, m.minimum(angle, motion.tilt))
    touching = m.minimum(m.maximum((m.abs(motion.tilt) / angle - 1) / RAMP + 0.5, 0.0), 1.0)
    return -parameters["stiffness"] * beyond - parameters["damping"] * motion.rate * touching


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Write a spring tendon with a dead band of ±a; MuJoCo has no damper that acts on one side only."""
    angle = parameters["angle"]
    return write_stop(spec, joint, "end-stop", parameters, (-angle, angle), f"±{angle:.6g}")


def write_stop(
    spec: MjSpec, joint: MjsJoint, name: str, parameters: Numbers, slack: tuple[float, float], beyond: str
) -> tuple[str, ...]:
    """Write a spring tendon that is slack between two tilts [rad]; `beyond` names the angle of the stop."""
    low, high = (rest_of(spec, joint) + tilt for tilt in slack)
    add_tendon(spec, joint, name.replace("-", "_"), parameters["stiffness"], (low, high))
    line = f"{name}: tendon of {parameters['stiffness']:.6g} N*m/rad beyond {beyond} rad"
    lost = f"{name}: its damping {parameters['damping']:.6g} N*m*s/rad is left out"
    return (line, lost) if parameters["damping"] else (line,)


EFFECT = TorqueEffect(
    name="end-stop",
    title="end stop or bumper",
    family="stop",
    also_called=("stop", "bumper", "limit", "hard stop"),
    parameters=(
        Parameter("angle", "rad", low=0.1, high=1.0, starts=(0.3, 0.5, 0.7, 0.85), neutral=1.0),
        Parameter("stiffness", "N*m/rad", low=0.01, high=60.0, starts=(0.4, 6.0)),
        Parameter("damping", "N*m*s/rad", low=0.0, high=5.0, default=0.0),
    ),
    law="τ = -k_s (|x| - a) sgn x - d_s v beyond ±a",
    source="piecewise linear stop, Shaw and Holmes, J. Sound and Vibration 90 (1983)",
    does="Wide swings turn round early and run fast; below the angle of the stop nothing changes.",
    look_alikes=("cubic-stiffness", "one-sided-stop"),
    experiment="Release from below and above the angle of the stop: below it the period is constant.",
    mujoco=MujocoSupport(
        means="fixed tendon with a dead band (springlength) and a stiffness (its loss is left out)",
        leaves_out="damping",
    ),
    to_mjcf=to_mjcf,
    example=(0.1, 60.0, 0.0),
    torque=torque,
    acts_during_hold=True,
    nonsmooth=True,
)
