"""Dry friction that is larger at standstill than in motion."""

from sysid.effects import coulomb
from sysid.effects._algebra import Algebra, Numbers, Value, Values
from sysid.effects._base import MjsJoint, MjSpec, MujocoSupport, Parameter, TorqueEffect
from sysid.effects._mjcf import add_passive_motor

_PER_STEP = 0.4
_PER_STAGE = 0.03
"""Bristle stiffness over inertia / step² [1], for semi-implicit integrators and for the explicit RK4."""
_VANISHING = 0.02
"""Friction of the element at speed, as a share of its friction at standstill [1]; zero is not allowed."""


def friction(m: Algebra, tilt: Value, speed: Value, parameters: Values) -> Value:
    """Return Fc + (Fs - Fc) exp(-(v/vs)²) [N*m]; Fs below Fc counts as Fc."""
    extra = m.maximum(parameters["static_torque"] - parameters["torque"], 0.0)
    return parameters["torque"] + extra * m.exp(-((speed / parameters["velocity"]) ** 2))


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Write a LuGre element beside plain dry friction."""
    import mujoco

    sliding, static, velocity = (parameters[name] for name in ("torque", "static_torque", "velocity"))
    static = max(static, sliding)
    if static <= sliding:
        return coulomb.to_mjcf(spec, joint, {"torque": sliding})
    explicit = spec.option.integrator == mujoco.mjtIntegrator.mjINT_RK4
    if not explicit:
        # The constraint holds the sliding friction exactly; an explicit step allows only one of the two.
        coulomb.to_mjcf(spec, joint, {"torque": sliding})
        sliding, static = _VANISHING * (static - sliding), static - sliding
    bristles = [bristle_stiffness(spec, joint), 0.0, sliding, static, velocity]
    add_passive_motor(spec, joint, "stribeck", native=native, lugre=bristles)
    beside = "" if explicit else f" beside frictionloss {parameters['torque']:.6g} N*m"
    return (f"stribeck: LuGre element {sliding:.6g} / {static:.6g} N*m, {velocity:.6g} rad/s{beside}",)


def bristle_stiffness(spec: MjSpec, joint: MjsJoint) -> float:
    """Return the largest stiffness of bristles at this time step [N*m/rad]: those of the LuGre model that replaces hard sticking.

    Bristles are a spring on the joint's inertia: harder ones oscillate or diverge.
    """
    import mujoco

    step, inertia = float(spec.option.timestep), float(joint.parent.inertia[0])
    explicit = spec.option.integrator == mujoco.mjtIntegrator.mjINT_RK4
    return (_PER_STAGE if explicit else _PER_STEP) * inertia / step**2


_SHARES = (0.35, 0.65)
"""Sliding friction over the static one of the restarts."""
_LEAST = 0.1
"""Smallest sliding friction over the static one; below, it has vanished: a choice."""


def part_again(parameters: Numbers) -> list[dict[str, float]]:
    """Return starts with both frictions after a search made them equal, or lost the sliding one.

    A static friction below the sliding one has no gradient, so the search cannot leave it. Without sliding friction, the
    damper and a wide Stribeck speed imitate it: another minimum.
    """
    sliding, static = parameters["torque"], parameters["static_torque"]
    if _LEAST * static <= sliding < static:
        return []
    most = max(sliding, static)
    speeds = (*_VELOCITY.starts, *(share * parameters["velocity"] for share in _SHARES))
    return [
        {"torque": share * most, "static_torque": most, "velocity": speed}
        for share in _SHARES
        for speed in speeds
    ]


_VELOCITY = Parameter("velocity", "rad/s", low=0.003, high=2.0, starts=(0.1, 0.4), neutral=None)

EFFECT = TorqueEffect(
    name="stribeck",
    title="dry friction with stiction",
    family="friction",
    also_called=("friction", "stiction"),
    parameters=(
        Parameter("torque", "N*m", low=0.0, high=1.0, starts=(0.02,), rough=True, default=0.0),
        Parameter("static_torque", "N*m", low=0.0, high=1.0, starts=(0.06,), neutral=None),
        _VELOCITY,
    ),
    law="τ = -(Fc + (Fs - Fc) exp(-(v/vs)²)) sgn v; sticks while the other torques stay within ±Fs",
    formula="({torque} + ({static_torque} - {torque}) exp(-(φ̇/{velocity})²)) sgn φ̇",
    source="Stribeck 1902; Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30 (1994)",
    does="Slow swings lose more than dry friction alone would take, and the joint stops early and off rest.",
    look_alikes=("coulomb", "hysteresis"),
    experiment="Pull the joint slowly with a spring balance: stiction shows as a jerk when it lets go.",
    mujoco=MujocoSupport(means="dcmotor without power, with LuGre friction"),
    to_mjcf=to_mjcf,
    example=(0.08, 0.25, 0.5),
    friction=friction,
    excludes=("coulomb",),
    restarts=part_again,
)
