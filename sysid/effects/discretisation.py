"""The time step of a simulator, where the log comes from one."""

from sysid.effects._algebra import Numbers
from sysid.effects._base import MjsJoint, MjSpec, MujocoSupport, Parameter, TorqueEffect


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Set that step and implicitfast, the integrator of most training scenes."""
    import mujoco

    spec.option.timestep = parameters["timestep"]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    return (f"discretisation: implicitfast at {parameters['timestep']:.6g} s",)


EFFECT = TorqueEffect(
    name="discretisation",
    title="the simulator's time step",
    family="clock",
    also_called=("discretization", "time step", "timestep", "integrator"),
    role="record",
    parameters=(Parameter("timestep", "s", lambda s: 0.1 / s.frequency, low=0.001, high=10.0),),
    law="v⁺ = (v - h k x/I) / (1 + h d/I), x⁺ = x + h v⁺",
    source="MuJoCo documentation, Computation: implicitfast",
    does="A heavily damped decay loses damping (8 % of ζ at 5 ms on a stiff board); a light one hardly any.",
    look_alikes=("stiffness and damping of the record",),
    experiment="Halve the simulator's step: the difference halves too.",
    mujoco=MujocoSupport(means="option timestep, integrator implicitfast"),
    to_mjcf=to_mjcf,
    example=(0.005,),
    timestep="timestep",
    identifiable_from_decay=False,
)
