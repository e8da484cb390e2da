"""Driven logs fitted by mujoco.sysid and by this tool: error, coverage, seconds, lines.

    pip install 'mujoco[sysid]' && python benchmarks/driven_peers.py --draws 4

Draws are from `driven_coverage.py`. They have no delay, bias and zero. Even ones are nature, odd ones MuJoCo. Both tools fit
armature, damping and friction to the first 6 s. Their models then replay the whole log in plain MuJoCo; the last 4 s count. Lines of
mujoco.sysid are the body of `peer`.
"""

import contextlib
import inspect
import io
import tempfile
import time
from itertools import product
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from driven_coverage import CASES, NAMES, RATE, Draw, draw, fitted, moved
from pages import table, write_between
from suite import command_line, run_suite

from sim.model.driven import patch_driven
from sim.model.setup import Setup

TRAIN = 6 * RATE
"""Samples of the fit."""
BOUNDS = {"armature": (1e-4, 0.5), "damping": (1e-3, 10.0), "frictionloss": (1e-4, 5.0)}
"""Bounds that mujoco.sysid needs, wide about every draw [SI]."""
LINES = 1
"""Ours: `husky-sysid fit LOG --model MODEL --joint all --input u --input-is torque`."""


def peer(
    file: Path, time: np.ndarray, angles: np.ndarray, inputs: np.ndarray
) -> tuple[Any, Any, mujoco.MjSpec]:
    """Return mujoco.sysid's parameters and half-widths of their intervals, and the fitted model."""
    from mujoco import sysid

    spec = mujoco.MjSpec.from_file(str(file))
    model, parameters = spec.compile(), sysid.ParameterDict()
    for joint in spec.joints:
        for attribute, (low, high) in BOUNDS.items():

            def modifier(
                target: mujoco.MjSpec, parameter: Any, name: str = joint.name, attribute: str = attribute
            ) -> None:
                value = float(parameter.value[0])
                setattr(target.joint(name), attribute, [value, 0, 0] if attribute == "damping" else value)

            begin = np.sqrt(low * high)
            parameters.add(sysid.Parameter(f"{joint.name} {attribute}", begin, low, high, modifier=modifier))
    channels = [(f"{joint.name}_qpos", sysid.SignalType.MjStateQPos) for joint in spec.joints]
    every = round((time[1] - time[0]) / model.opt.timestep)
    steps = model.opt.timestep * np.arange(every * (len(time) - 1) + 1)
    held = np.repeat(inputs, every, axis=1)[:, : len(steps)].T
    sequences = sysid.ModelSequences(
        "arm", spec, "log", sysid.create_initial_state(model, angles[:, 0], np.zeros(model.nv)),
        sysid.TimeSeries(steps, held), sysid.TimeSeries.from_names(time, angles.T, model, names=channels),
        allow_missing_sensors=True,
    )  # fmt: skip
    residual = sysid.build_residual_fn(models_sequences=[sequences], enabled_observations=channels)
    found, result = sysid.optimize(parameters, residual, optimizer="mujoco", verbose=False)
    half = sysid.calculate_intervals(residual(result.x, found)[0], result.jac)[1]
    for parameter in found.parameters.values():
        parameter.modifier(spec, parameter)
    return found, half, spec


def ours(file: Path, one: Draw) -> tuple[dict[str, Any], mujoco.MjModel]:
    """Return the fits of the first samples, and the patched model."""
    setup = Setup(file=file, joint="j0")
    fits = fitted(setup, one, more=(NAMES["friction"],), rows=TRAIN)
    patch_driven(setup, fits).save(file.with_name("patched.xml"))
    return fits, mujoco.MjModel.from_xml_path(str(file.with_name("patched.xml")))


def run(case: str, seed: int) -> dict[str, Any]:
    """Return seconds, held-out errors, and how many intervals hold the truth."""
    one, row = draw(case, seed, late=False), {"case": case, "seed": seed}
    keys = ("armature", "damping", "friction")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "model.xml"
        file.write_text(one.model)
        begin = time.process_time()
        with contextlib.redirect_stdout(io.StringIO()):
            found, half, spec = peer(file, one.time[:TRAIN], one.seen[:, :TRAIN], one.inputs[:, :TRAIN])
        row["peer"] = _row(one, spec.compile(), begin)
        values = np.array([float(each.value[0]) for each in found.parameters.values()]).reshape(-1, 3)
        inside = np.abs(values - [[p[k] for k in keys] for p in one.truth]) <= np.reshape(half, (-1, 3))
        row["peer"] |= {"inside": int(inside.sum()), "of": inside.size}
        begin = time.process_time()
        fits, model = ours(file, one)
        row["ours"] = _row(one, model, begin)
        quantities = [fits[name].quantities[NAMES.get(k, k)] for name in fits for k in keys]
        planted = [p[k] for p in one.truth for k in keys]
        held = [q.ci95[0] <= x <= q.ci95[1] for q, x in zip(quantities, planted, strict=True)]
        row["ours"] |= {"inside": int(sum(held)), "of": len(held)}
    return row


def _row(one: Draw, model: mujoco.MjModel, begin: float) -> dict[str, Any]:
    """Return processor seconds since the begin, and the held-out error as a share of the motion."""
    spent, none = time.process_time() - begin, [0.0] * len(one.truth)
    error = (one.seen - moved(model, one.inputs, none, none, none))[:, TRAIN:]
    return {"seconds": spent, "error": float(np.sqrt(np.mean(error**2)) / np.std(one.seen[:, TRAIN:]))}


def main() -> None:
    """Run the draws, and write the table."""
    parser = command_line(__doc__)
    parser.add_argument("--draws", type=int, default=4)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--rows", type=Path, help="JSON lines of an earlier run to go on from")
    options = parser.parse_args()
    cases = [(case, seed) for seed in range(options.draws) for case in CASES]
    rows = run_suite(run, cases, ("case", "seed"), options.rows, workers=options.workers)
    written = len([line for line in inspect.getsource(peer).splitlines()[3:] if line.strip()])
    lines: list[tuple[str, ...]] = []
    for case, simulated in product(CASES, (0, 1)):
        for who, name, count in (("peer", "mujoco.sysid", written), ("ours", "husky-sysid", LINES)):
            own = [row[who] for row in rows if row["case"] == case and row["seed"] % 2 == simulated]
            error, seconds = (float(np.median([x[key] for x in own])) for key in ("error", "seconds"))
            inside = f"{sum(x['inside'] for x in own)} of {sum(x['of'] for x in own)}"
            law = "MuJoCo" if simulated else "nature"
            found = f"{100 * error:.2f} %", inside, f"{seconds:.1f}", str(count)
            lines.append((case, law, str(len(own)), name, *found))
    head = (
        "joints",
        "law of the logs",
        "logs",
        "fitted by",
        "held-out error",
        "inside 95 %",
        "processor s",
        "lines",
    )
    write_between(Path(__file__).parent / "public.md", "driven peers", table(head, lines))


if __name__ == "__main__":
    main()
