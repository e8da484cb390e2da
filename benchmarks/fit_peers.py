"""One fit of stiffness and damping, by turns with every method on the same data.

Run:  pip install "mujoco[sysid]" && python benchmarks/fit_peers.py [SEEDS]

Two boards as in the project's comparison of peers: stiff (11.1 Hz, ζ 0.54) and light (7.2 Hz, ζ 0.05), released
from 0.2 rad, 1000 Hz for 2 s, white noise of 0.2°. The truth is the closed-form decay, not a simulator. Every
method starts from 0.7 k and 1.5 d. The first seed warms caches and is dropped. Two methods with the same model and
the same unknowns must find the same numbers, or one of them has stopped short of the optimum: that is checked.
"""

import math
import platform
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as ca
import mujoco
import numpy as np
from mujoco import rollout
from mujoco_sysid import fit_hinge, hinge
from pages import table, write_result
from scipy.optimize import least_squares

from sysid.board import load_board
from sysid.fitting.joint import fit_joint
from sysid.joint.mujoco_step import step
from sysid.quantity import Quantity
from sysid.roll import Release
from sysid.workspace import shipped_data

INERTIA, ANGLE, RATE, DURATION, NOISE = 7.15e-3, 0.2, 1000.0, 2.0, math.radians(0.2)
BOARDS = {"stiff": (34.8, 0.54), "light": (14.7, 0.03)}
START = (0.7, 1.5)
TIME = np.arange(round(RATE * DURATION)) / RATE
LOW, HIGH = np.array([1.0, 1e-3]), np.array([200.0, 5.0])
NODES = 100
STEP = "CasADi, MuJoCo's own step: k, d, start"
ROLLOUT = "scipy + mujoco.rollout: k, d, start"
SYSID = "mujoco.sysid, default optimiser: k, d, start given"
SYSID_SCIPY = "mujoco.sysid, scipy optimiser: k, d, start given"
SAME_PROBLEM = ((STEP, ROLLOUT), (SYSID, SYSID_SCIPY))


@dataclass(frozen=True)
class Fitted:
    stiffness: float
    damping: float


def truth(stiffness: float, damping: float) -> np.ndarray:
    decay = damping / (2 * INERTIA)
    frequency = math.sqrt(stiffness / INERTIA - decay**2)
    return (
        ANGLE
        * np.exp(-decay * TIME)
        * (np.cos(frequency * TIME) + decay / frequency * np.sin(frequency * TIME))
    )


def ours(start: np.ndarray, roll: np.ndarray) -> Fitted:
    """`fit_joint`: continuous law, k, d, rest angle, start angle and rate, noise floor, intervals."""
    board = replace(load_board(shipped_data() / "boards" / "black.toml"), effects=())
    board = replace(board, inertia=replace(board.inertia, value=INERTIA))
    board = board.with_tilt(
        stiffness=Quantity(start[0], 0.0, "N*m/rad"), damping=Quantity(start[1], 0.0, "N*m*s/rad")
    )
    release = Release(
        log="made", number=1, time=TIME, roll=roll, std=np.full(len(TIME), NOISE), origin="angle",
        rest=0.0, hold=0.0, end="rest",
    )  # fmt: skip
    fit = fit_joint([release], board)
    return Fitted(fit.law.stiffness, fit.law.damping)


def make_mujoco_step() -> Callable[[np.ndarray, np.ndarray], Fitted]:
    """MuJoCo's own implicitfast step in CasADi: k, d, start angle and rate, exact sensitivities."""
    p, y = ca.SX.sym("p", 2), ca.SX.sym("y", 2)
    after = step(INERTIA, lambda q, v: -p[0] * q - p[1] * v, y[0], y[1], timestep=1 / RATE)
    states = ca.Function("step", [y, p], [ca.vertcat(*after)]).mapaccum("rollout", len(TIME) - 1)
    x, measured = ca.MX.sym("x", 4), ca.MX.sym("measured", len(TIME))
    rolls = ca.vertcat(x[2], states(x[2:], ca.repmat(x[:2], 1, len(TIME) - 1))[0, :].T)
    forward = ca.Function("r", [x, measured], [rolls - measured, ca.jacobian(rolls, x)])

    def fit(start: np.ndarray, roll: np.ndarray) -> Fitted:
        cache: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

        def both(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            key = point.tobytes()
            if key not in cache:
                residual, slope = forward(point, roll)
                cache[key] = np.asarray(residual).ravel(), np.asarray(slope)
            return cache[key]

        found = least_squares(
            lambda p: both(p)[0], [*start, roll[0], 0.0], jac=lambda p: both(p)[1], x_scale="jac", xtol=1e-10,
            bounds=([*LOW, -1, -20], [*HIGH, 1, 20]),
        )  # fmt: skip
        return Fitted(*found.x[:2])

    return fit


def make_scipy_rollout() -> Callable[[np.ndarray, np.ndarray], Fitted]:
    """scipy's least squares with finite differences over mujoco.rollout: k, d, start angle and rate."""

    def fit(start: np.ndarray, roll: np.ndarray) -> Fitted:
        model = hinge(INERTIA, *start, 1 / RATE).compile()
        data = mujoco.MjData(model)

        def residual(point: np.ndarray) -> np.ndarray:
            model.jnt_stiffness[0], model.dof_damping[0] = point[:2]
            states, _ = rollout.rollout(model, data, np.array([[0.0, *point[2:]]]), nstep=len(TIME) - 1)
            return np.append(point[2], states[0, :, 1]) - roll

        found = least_squares(
            residual, [*start, roll[0], 0.0], x_scale="jac", xtol=1e-10,
            bounds=([*LOW, -1, -20], [*HIGH, 1, 20]),
        )  # fmt: skip
        return Fitted(*found.x[:2])

    return fit


def make_mujoco_sysid(optimizer: str) -> Callable[[np.ndarray, np.ndarray], Fitted]:
    """mujoco.sysid on the qpos channel: k and d, given the exact start, which it cannot fit."""
    bounds = {"stiffness": (LOW[0], HIGH[0]), "damping": (LOW[1], HIGH[1])}

    def fit(start: np.ndarray, roll: np.ndarray) -> Fitted:
        found = fit_hinge(hinge(INERTIA, *start, 1 / RATE), bounds, [(TIME, roll, ANGLE)], optimizer)
        return Fitted(float(found["stiffness"].value[0]), float(found["damping"].value[0]))

    return fit


def make_multiple_shooting() -> Callable[[np.ndarray, np.ndarray], Fitted]:
    """Plain multiple shooting: RK4 at 1 ms, 100 nodes, ipopt with a Gauss–Newton Hessian."""
    state, unknown = ca.MX.sym("s", 2), ca.MX.sym("p", 2)
    scale = ca.DM([30.0, 0.3])

    def rate(s: ca.MX) -> ca.MX:
        k, d = unknown[0] * scale[0], unknown[1] * scale[1]
        return ca.vertcat(s[1], (-k * s[0] - d * s[1]) / INERTIA)

    h = 1 / RATE
    k1 = rate(state)
    k2 = rate(state + h / 2 * k1)
    k3 = rate(state + h / 2 * k2)
    k4 = rate(state + h * k3)
    one = ca.Function("one", [state, unknown], [state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])
    length = len(TIME) // NODES
    many = one.mapaccum(length)
    nodes, measured = ca.MX.sym("nodes", 2, NODES), ca.MX.sym("measured", len(TIME))
    parts = many.map(NODES, "serial")(nodes, ca.repmat(unknown, 1, NODES * length))
    rolls = [ca.horzcat(nodes[0, i], parts[0, i * length : (i + 1) * length - 1]) for i in range(NODES)]
    residual = ca.horzcat(*rolls).T - measured
    ends = [parts[:, (i + 1) * length - 1] - nodes[:, i + 1] for i in range(NODES - 1)]
    weights = ca.diag(ca.DM([1.0, 40.0]))
    x = ca.vertcat(unknown, ca.vec(nodes))
    slope = ca.jacobian(residual, x)
    sigma, multipliers = ca.MX.sym("sigma"), ca.MX.sym("multipliers", 2 * (NODES - 1))
    constraints = ca.vertcat(*[ca.mtimes(ca.inv(weights), end) for end in ends])
    hessian = ca.Function(
        "hessian", [x, measured, sigma, multipliers], [sigma * ca.triu(ca.mtimes(slope.T, slope))],
    )  # fmt: skip
    problem = {"x": x, "p": measured, "f": 0.5 * ca.sumsqr(residual), "g": constraints}
    quiet = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-8}
    solver = ca.nlpsol("solver", "ipopt", problem, {**quiet, "hess_lag": hessian})

    def fit(start: np.ndarray, roll: np.ndarray) -> Fitted:
        guess = np.stack([roll[::length], np.gradient(roll[::length], length * h)])
        low = np.r_[LOW / np.array(scale).ravel(), -np.inf * np.ones(2 * NODES)]
        high = np.r_[HIGH / np.array(scale).ravel(), np.inf * np.ones(2 * NODES)]
        x0 = np.r_[start / np.array(scale).ravel(), guess.T.ravel()]
        found = solver(x0=x0, p=roll, lbx=low, ubx=high, lbg=0, ubg=0)
        values = np.asarray(found["x"]).ravel()[:2] * np.array(scale).ravel()
        return Fitted(*values)

    return fit


def measure(
    methods: dict[str, Callable[[np.ndarray, np.ndarray], Fitted]], seeds: int
) -> tuple[list[tuple[str, ...]], list[str]]:
    rows: list[tuple[str, ...]] = []
    notes: list[str] = []
    for board, (stiffness, damping) in BOARDS.items():
        clean = truth(stiffness, damping)
        start = np.array([START[0] * stiffness, START[1] * damping])
        seconds: dict[str, list[float]] = {name: [] for name in methods}
        errors: dict[str, list[tuple[float, float]]] = {name: [] for name in methods}
        for seed in range(seeds + 1):
            roll = clean + NOISE * np.random.default_rng(seed).standard_normal(len(TIME))
            for name, fit in methods.items():  # by turns, so that a busy machine slows all
                begin = time.process_time()
                found = fit(start, roll)
                passed = time.process_time() - begin
                if seed:
                    seconds[name].append(passed)
                    errors[name].append((found.stiffness / stiffness - 1, found.damping / damping - 1))
        fastest = statistics.median(next(iter(seconds.values())))
        for name in methods:
            error = 100 * np.array(errors[name])
            bias, spread = error.mean(axis=0), error.std(axis=0, ddof=1)
            middle = statistics.median(seconds[name])
            off = (f"{b:+.2f} ({s:.2f})" for b, s in zip(bias, spread, strict=True))
            rows.append((board, name, f"{1e3 * middle:.1f}", f"{middle / fastest:.1f}", *off))
            print(*rows[-1], sep=" | ", flush=True)
        for pair in SAME_PROBLEM:
            apart = np.abs(np.array(errors[pair[0]]) - np.array(errors[pair[1]])).max()
            notes.append(f"- {board}: '{pair[0]}' and '{pair[1]}' differ by {100 * apart:.1e} % at most.")
    return rows, notes


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    methods = {
        "husky-sysid `fit_joint`: k, d, rest, start, intervals": ours,
        STEP: make_mujoco_step(),
        SYSID: make_mujoco_sysid("mujoco"),
        SYSID_SCIPY: make_mujoco_sysid("scipy"),
        ROLLOUT: make_scipy_rollout(),
        "CasADi multiple shooting, ipopt: k, d, start": make_multiple_shooting(),
    }
    rows, notes = measure(methods, seeds)
    text = (
        "# One fit of stiffness and damping, beside its peers",
        f"One release of 2 s at 1000 Hz, noise 0.2°; MuJoCo {mujoco.__version__}, Python {platform.python_version()}, "
        f"medians of {seeds} seeds of CPU time, by turns; made by `benchmarks/fit_peers.py`.\n"
        "Bias is the mean error against the truth, in brackets its spread over the seeds, in %.",
        table(("board", "method", "CPU ms", "ratio", "k bias (sd) %", "d bias (sd) %"), rows),
        "Same model, same unknowns, so the same optimum:",
        "\n".join(notes),
        "The implicit step at 1 ms biases k by h d / 2I where the start is fitted as well: rows with MuJoCo's own step "
        "show it, the continuous law does not have it. mujoco.sysid cannot fit the start; it is given the true one.",
    )
    write_result("fit_peers.md", "\n\n".join(text))


if __name__ == "__main__":
    main()
