"""Many of MuJoCo's steps of one hinge as one CasADi function, with exact derivatives."""

import casadi as ca

from sysid.joint.mujoco_step import Hinge, Integrator, step


def rollout_function(
    hinge: Hinge, parameters: ca.SX, steps: int, *, timestep: float, integrator: Integrator = "implicitfast"
) -> ca.Function:
    """Return `f(start, parameters) -> states` over many steps.

    Args:
        hinge: The joint, in terms of `parameters`.
        parameters: Symbols, shape (n,).
        timestep: [s].

    Returns:
        A CasADi function of start (position and velocity, shape (2,)) and parameters, whose result has
        shape (2, steps): the states after each step.
    """
    state = ca.SX.sym("state", 2)
    after = ca.vertcat(*step(hinge, state[0], state[1], timestep=timestep, integrator=integrator))
    one = ca.Function("step", [state, parameters], [after])
    many = one.mapaccum("rollout", steps)
    start, values = ca.MX.sym("start", 2), ca.MX.sym("parameters", parameters.numel())
    return ca.Function(
        "rollout",
        [start, values],
        [many(start, ca.repmat(values, 1, steps))],
        ["start", "parameters"],
        ["states"],
    )
