"""Stiffness and damping of a hinge by mujoco.sysid (`pip install 'mujoco[sysid]' colorama`)."""

import contextlib
import io
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

Log = tuple[np.ndarray, np.ndarray, float]
"""Time [s] and roll [rad], shape (n,) each, and the roll at the start, which is let go at rest [rad]."""


def hinge(inertia: float, stiffness: float, damping: float, step: float) -> mujoco.MjSpec:
    """Return a body on a hinge 'roll', for implicitfast at a step [s]."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep = step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.gravity = [0.0, 0.0, 0.0]
    body = spec.worldbody.add_body(
        mass=1.0, ipos=[0.0, 0.0, 0.0], explicitinertial=True, inertia=[inertia] * 3
    )
    joint = body.add_joint(name="roll", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[1.0, 0.0, 0.0])
    joint.stiffness[0], joint.damping[0] = stiffness, damping
    return spec


def fit_hinge(
    spec: mujoco.MjSpec, bounds: dict[str, tuple[float, float]], logs: Sequence[Log], optimizer: str
) -> Any:
    """Return mujoco.sysid's stiffness and damping of a hinge, from where it is, on the qpos channel."""
    from mujoco import sysid

    model, parameters = spec.compile(), sysid.ParameterDict()
    for name, (low, high) in bounds.items():

        def modifier(target: mujoco.MjSpec, parameter: Any, name: str = name) -> None:
            getattr(target.joint("roll"), name)[0] = parameter.value[0]

        begin = float(getattr(spec.joint("roll"), name)[0])
        parameters.add(sysid.Parameter(name, begin, low, high, modifier=modifier))
    channel = ("roll_qpos", sysid.SignalType.MjStateQPos)
    sequences = [
        sysid.ModelSequences(
            "board", spec, f"release{number}", sysid.create_initial_state(model, np.array([start]), np.zeros(1)),
            sysid.TimeSeries(time, np.zeros((len(time), 0))),
            sysid.TimeSeries.from_names(time, roll[:, None], model, names=[channel]), allow_missing_sensors=True,
        )
        for number, (time, roll, start) in enumerate(logs, start=1)
    ]  # fmt: skip
    residual = sysid.build_residual_fn(models_sequences=sequences, enabled_observations=[channel])
    with contextlib.redirect_stdout(io.StringIO()):  # it prints each iteration
        return sysid.optimize(parameters, residual, optimizer=optimizer, verbose=False)[0]
