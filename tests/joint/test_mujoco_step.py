"""The CasADi step against MuJoCo itself, over random joints, every integrator and step."""

from types import SimpleNamespace

import casadi as ca
import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mujoco_rollout import rollout_function
from stepped_joint import hinge_from_model, simulate_steps

from sysid.joint.mujoco_step import Hinge

pytestmark = pytest.mark.train

STEPS = (0.001, 0.005)
INTEGRATORS = [
    name
    for name in ("Euler", "implicit", "implicitfast", "RK4", "discrete")
    if f"mjINT_{name.upper()}" in mujoco.mjtIntegrator.__members__
]
DURATION = 0.5
"""Of a rollout [s]: one to six periods."""


SIZES = {
    "frequency": (10, 80), "damping_ratio": (0.005, 0.9), "inertia": (0.003, 0.1), "armature": (0, 0.3), "even": (-1, 1),
    "cubic": (-1, 30), "quadratic": (0, 0.3), "cubic_damping": (0, 0.05), "rest": (-0.05, 0.05), "friction": (0.001, 0.05),
    "limit": (0.05, 0.15), "start": (-0.2, 0.2), "rate": (-2, 2),
}  # fmt: skip
CASES = st.fixed_dictionaries(
    {name: st.floats(*ends) for name, ends in SIZES.items()}
    | {"friction_solver": st.integers(0, 2), "limit_solver": st.integers(0, 3)}
)
PLAIN = dict.fromkeys(SIZES, 0.0) | {
    "frequency": 30.0,
    "inertia": 0.01,
    "friction_solver": 0,
    "limit_solver": 0,
    "limit": 0.1,
}


def spec_of(
    case: dict[str, float], integrator: str, timestep: float, *, friction: bool, limit: bool
) -> mujoco.MjSpec:
    """Return a joint made of sizes that real joints have, so that no step is unstable."""
    part = SimpleNamespace(**case)
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep = timestep
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.option.integrator = mujoco.mjtIntegrator.__members__[f"mjINT_{integrator.upper()}"]
    body = spec.worldbody.add_body(name="deck", mass=1.0, ipos=[0.0, 0.0, 0.0])
    body.inertia, body.explicitinertial = [part.inertia] * 3, True
    joint = body.add_joint(name="tilt", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[1.0, 0.0, 0.0])
    stiffness = part.frequency**2 * part.inertia
    joint.armature = part.armature * part.inertia
    joint.stiffness[0] = stiffness
    joint.stiffness[1] = part.even * stiffness
    joint.stiffness[2] = part.cubic * stiffness
    joint.damping[0] = 2 * part.damping_ratio * part.frequency * part.inertia
    joint.damping[1] = part.quadratic * part.inertia
    joint.damping[2] = part.cubic_damping * part.inertia
    joint.springref = part.rest
    if friction:
        joint.frictionloss = part.friction * stiffness
        joint.solref_friction, joint.solimp_friction = (
            ([0.02, 1.0], [0.9, 0.95, 0.001, 0.5, 2.0]),
            ([0.002, 1.0], [0.9999, 0.9999, 0.001, 0.5, 2.0]),
            ([-100.0, -50.0], [0.95, 0.99, 0.001, 0.5, 2.0]),
        )[part.friction_solver]
    if limit:
        joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        joint.range = [-part.limit, 1.1 * part.limit]
        joint.solref_limit, joint.solimp_limit = (
            ([0.02, 1.0], [0.9, 0.95, 0.001, 0.5, 2.0]),
            ([-3000.0, -20.0], [0.9, 0.95, 0.001, 0.5, 2.0]),
            ([0.01, 0.5], [0.5, 0.99, 0.02, 0.3, 3.0]),
            ([0.02, 1.0], [0.0, 0.95, 0.01, 0.5, 1.0]),
        )[part.limit_solver]
    return spec


def largest_difference(spec: mujoco.MjSpec, start: tuple[float, float], integrator: str) -> float:
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = start
    steps = int(DURATION / model.opt.timestep)
    expected = np.empty(steps + 1)
    expected[0] = start[0]
    for i in range(steps):
        mujoco.mj_step(model, data)
        expected[i + 1] = data.qpos[0]
    ours = simulate_steps(
        hinge_from_model(model, "tilt"), start, steps, timestep=model.opt.timestep, integrator=integrator
    )
    return float(np.abs(ours[:, 0] - expected).max())


EXACT = settings(
    max_examples=4, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
"""The same cases each time, however long a busy machine takes to draw them; Hypothesis also draws constants of
the modules loaded so far, so that a case may come up only after other tests."""


@pytest.mark.parametrize("timestep", STEPS)
@pytest.mark.parametrize("integrator", INTEGRATORS)
@given(case=CASES)
@EXACT
def test_smooth_joints_equal_mujoco_to_rounding(integrator: str, timestep: float, case: dict[str, float]):
    spec = spec_of(case, integrator, timestep, friction=False, limit=False)
    assert largest_difference(spec, (case["start"], case["rate"]), integrator) < 1e-9


@pytest.mark.parametrize("timestep", STEPS)
@pytest.mark.parametrize("integrator", INTEGRATORS)
@given(case=CASES, friction=st.booleans())
@EXACT
def test_friction_and_limits_equal_mujoco(
    integrator: str, timestep: float, case: dict[str, float], friction: bool
):
    """Through sticking, slipping and hits, for all forms of solref and solimp."""
    spec = spec_of(case, integrator, timestep, friction=friction, limit=True)
    assert largest_difference(spec, (case["start"], case["rate"]), integrator) < 1e-7
    spec = spec_of(case, integrator, timestep, friction=True, limit=not friction)
    assert largest_difference(spec, (case["start"], case["rate"]), integrator) < 1e-7


@pytest.mark.parametrize("integrator", [name for name in INTEGRATORS if name in ("implicitfast", "discrete")])
@pytest.mark.parametrize(("solref", "solimp"), [
    ((0.001, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)), ((0.002, 0.3), (0.9, 0.9999, 0.01, 0.5, 2.0)),
    ((-2e4, -50.0), (0.9, 0.95, 0.001, 0.5, 2.0)), ((0.001, 1.0), (0.9, 0.99, 0.01, 0.5, 2.0)), ((0.05, 2.0), (0.5, 0.5, 0.001, 0.5, 2.0)),
    ((0.01, 0.5), (0.5, 0.99, 0.1, 0.3, 3.0)), ((0.0045, 1.0), (0.5, 0.9999, 0.05, 0.3, 3.0)),  # an impedance on its way up
])  # fmt: skip
def test_rows_stiffer_than_the_step_allows_equal_mujoco(
    integrator: str, solref: tuple[float, float], solimp: tuple[float, ...]
):
    case = PLAIN | {"damping_ratio": 0.1, "armature": 0.1, "even": 0.2, "cubic": 1.0, "quadratic": 0.05}
    case |= {"cubic_damping": 0.01, "rest": 0.01, "friction": 0.02, "start": 0.18, "rate": 0.5}
    spec = spec_of(case, integrator, 0.005, friction=True, limit=True)
    joint = spec.joint("tilt")
    joint.solref_limit = joint.solref_friction = solref
    joint.solimp_limit = joint.solimp_friction = solimp
    assert largest_difference(spec, (case["start"], case["rate"]), integrator) < 1e-7


@pytest.mark.parametrize("eulerdamp", [True, False])
@pytest.mark.parametrize("damping", [0.2, -0.01])
def test_euler_knows_the_flag_eulerdamp_and_negative_damping(eulerdamp: bool, damping: float):
    spec = spec_of(PLAIN, "Euler", 0.005, friction=False, limit=False)
    spec.joint("tilt").damping[0] = damping
    if not eulerdamp:
        spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    assert largest_difference(spec, (0.1, 0.0), "Euler") < 1e-9


def test_sensitivities_are_exact():
    """CasADi's derivative of a 2 s rollout against central differences, through friction."""
    symbols = ca.SX.sym("p", 3)
    hinge = Hinge(
        inertia=0.00715,
        stiffness=(symbols[0], 0.0, 0.0),
        damping=(symbols[1], 0.0, 0.0),
        frictionloss=symbols[2],
        limits=(-0.15, 0.15),
    )
    rollout = rollout_function(hinge, symbols, 400, timestep=0.005)
    start, values = ca.MX.sym("start", 2), ca.MX.sym("values", 3)
    last = rollout(start, values)[0, 60]
    slope = ca.Function("slope", [start, values], [ca.jacobian(last, ca.vertcat(start, values))])
    at = np.array([0.14, 0.5, 34.0, 0.3, 0.02])
    value = ca.Function("value", [start, values], [last])
    for i, exact in enumerate(np.array(slope(at[:2], at[2:])).ravel()):
        delta = 1e-6 * np.eye(5)[i]
        high, low = (float(value((at + d)[:2], (at + d)[2:])) for d in (delta, -delta))
        assert exact == pytest.approx((high - low) / 2e-6, rel=1e-5, abs=1e-9)
