# ruff: noqa: B023
"""Random logs with hands, motors and sensors of known truth, and what `decay` says of them.

    python benchmarks/decay_suite.py --seed 0 --count 3000 --jobs 8

Each kind of log is moved by code of this file alone. Printed for each kind: how many got a ✓ or a ✗, how many of those with a ✓ are
wrong, how many valid linear logs were called non-linear, and how many 95 % intervals of ω_n and ζ (of k/d for overdamped joints,
of d/I without a spring) hold the truth. Wrong with a ✓ means: a number off by more than 3 % and by more than two of its half-widths,
or any ✓ on a log without a linear joint in free motion.
"""

import argparse
import tempfile
import warnings
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

KINDS = (
    "plain", "one release", "kick", "driven then free", "caught", "touched", "wander", "jitter and loss", "coarse", "gyro", "imu",
    "geared", "critical", "pendulum", "coast-down", "friction", "drag", "hardening", "shaken", "driven", "growing", "frozen clock",
)  # fmt: skip
NO_LINEAR = ("friction", "drag", "hardening", "shaken", "driven", "growing")


@dataclass
class Made:
    kind: str
    seed: int
    time: np.ndarray
    angle: np.ndarray
    rate: np.ndarray
    truth: dict = field(default_factory=dict)
    noise: float = 0.0
    sensor: str = "angle"
    text: str = ""


def free(time, omega, zeta, x, v, torque=None):
    """Angle and rate of ẍ + 2ζω ẋ + ω² x = -torque(x, ẋ): closed form, or RK4 at a fifth of a milliradian of phase."""
    if torque is None:
        root = np.sqrt(complex(zeta**2 - 1)) or 1e-7
        one, two = -omega * (zeta + root), -omega * (zeta - root)
        b = (v - one * x) / (two - one)
        a = x - b
        first, second = a * np.exp(one * time), b * np.exp(two * time)
        return (first + second).real, (one * first + two * second).real
    fine = max(1, int(np.ceil((time[1] - time[0]) * omega / 0.03)))
    h = (time[1] - time[0]) / fine
    out = np.empty((len(time), 2))
    pull = lambda x, v: -2 * zeta * omega * v - omega**2 * x - torque(x, v)  # noqa: E731
    for i in range(len(time)):
        out[i] = x, v
        for _ in range(fine):
            a1 = pull(x, v)
            a2 = pull(x + h / 2 * v, v + h / 2 * a1)
            a3 = pull(x + h / 2 * (v + h / 2 * a1), v + h / 2 * a2)
            a4 = pull(x + h * (v + h / 2 * a2), v + h * a3)
            x, v = x + h * v + h * h / 6 * (a1 + a2 + a3), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return out.T


def lifted(time, begin, end, way):
    s = np.clip((time - begin) / (end - begin), 0, 1)
    return way * s**3 * (10 - 15 * s + 6 * s**2)


def make(kind: str, seed: int) -> Made:
    rng = np.random.default_rng([KINDS.index(kind), seed])
    omega = float(np.exp(rng.uniform(np.log(2), np.log(60))))
    zeta = float(np.exp(rng.uniform(np.log(0.005), np.log(0.6))))
    amplitude = float(rng.uniform(0.05, 0.25))
    if kind == "geared":
        zeta = float(rng.uniform(1.3, 4.0))
    elif kind == "critical":
        zeta = float(rng.uniform(0.7, 1.2))
    elif kind in ("friction", "drag", "hardening", "pendulum", "driven", "driven then free", "growing"):
        zeta = float(np.exp(rng.uniform(np.log(0.005), np.log(0.1))))
    period = 2 * np.pi / omega
    sampling = float(np.exp(rng.uniform(np.log(25), np.log(300)))) / period
    span = min(4.5 / min(zeta, 1 / (4 * zeta)) / omega, 60 * period) + period
    if kind == "caught":
        span = float(rng.uniform(3, 8)) * period
    count = (
        1
        if kind
        in ("one release", "kick", "driven then free", "geared", "pendulum", "coast-down", "frozen clock")
        else int(rng.integers(2, 5))
    )
    truth = {"omega": omega, "zeta": zeta}
    torque = None
    if kind == "friction":
        level = float(rng.uniform(0.03, 0.15)) * amplitude * omega**2
        torque = lambda x, v: level * np.tanh(v / (0.002 * amplitude * omega))  # noqa: E731
    elif kind == "drag":
        level = float(rng.uniform(0.1, 0.4)) / amplitude
        torque = lambda x, v: level * v * abs(v)  # noqa: E731
    elif kind == "hardening":
        level = float(rng.choice([-1, 1]) * rng.uniform(0.1, 0.4)) * omega**2 / amplitude**2
        torque = lambda x, v: level * x**3  # noqa: E731
    elif kind == "pendulum":
        amplitude = float(rng.uniform(0.5, 2.2))
        torque = lambda x, v: omega**2 * (np.sin(x) - x)  # noqa: E731
    pieces, now, step = [], 0.0, 1 / sampling

    def add(duration, move):
        nonlocal now
        t = np.arange(now, now + duration, step)
        x, v = move(t - now) if len(t) else (t, t)
        pieces.append((t, x, v))
        now = t[-1] + step if len(t) else now
        return x[-1], v[-1]

    still = lambda level: lambda t: (np.full_like(t, level), np.zeros_like(t))  # noqa: E731

    def hand(start, way, duration):
        def move(t):
            x = start + lifted(t, 0, duration, way)
            return x, np.gradient(x, t) if len(t) > 1 else np.zeros_like(x)

        return move

    at = 0.0
    if kind == "coast-down":
        beta, friction, speed = (
            float(rng.uniform(*low_high)) for low_high in ((0.1, 1.5), (0.0, 2.0), (8, 40))
        )
        truth = {"beta": beta, "friction": friction}
        step = float(rng.uniform(0.005, 0.02))
        stop = np.log1p(beta * speed / max(friction, 1e-9)) / beta

        def spin(t):
            t = np.minimum(t, stop)
            x = (speed + friction / beta) * (1 - np.exp(-beta * t)) / beta - friction / beta * t
            return x, (speed + friction / beta) * np.exp(-beta * t) - friction / beta

        add(min(stop * 1.2, 6 / beta), spin)
    elif kind == "shaken":
        total = float(rng.uniform(20, 60)) * period
        t = np.arange(0, total, step)
        x = sum(
            amplitude
            * rng.normal()
            * np.sin(omega * rng.uniform(0.3, 2) * t + rng.uniform(0, 6))
            * (1 + 0.7 * np.sin(rng.uniform(0.05, 0.3) * omega * t))
            for _ in range(4)
        )
        pieces.append((t, x, np.gradient(x, t)))
    elif kind in ("driven", "growing", "driven then free"):
        growth = float(rng.uniform(0.01, 0.06)) if kind == "growing" else 0.0
        pace = omega * float(rng.uniform(0.75, 0.98)) if kind != "growing" else omega
        add(
            float(rng.uniform(8, 20)) * period,
            lambda t: (
                amplitude * np.exp(growth * pace * t) * np.cos(pace * t) / (20 if growth else 1),
                -amplitude * pace * np.sin(pace * t),
            ),
        )
        if kind == "driven then free":
            x, v = pieces[-1][1][-1], pieces[-1][2][-1]
            add(span, lambda t: free(t, omega, zeta, x, v))
    else:
        add(float(rng.uniform(0.3, 1.0)) + period, still(0.0))
        for _ in range(count):
            size = amplitude * float(rng.uniform(0.6, 1.0)) * float(rng.choice([-1, 1]))
            if kind == "kick":
                push = float(rng.uniform(0.02, 0.2)) * period
                x, v = 0.5 * size * omega * push, size * omega
                add(push, lambda t: (x * (t / push) ** 2, v * t / push))
            else:
                lift = max(float(rng.uniform(0.5, 1.5)), 1.5 * period)
                add(lift, hand(at, size - at, lift))
                add(float(rng.uniform(0.3, 1.0)) + 0.5 * period, still(size))
                x, v = size, 0.0
            x, v = add(span, lambda t: free(t, omega, zeta, x, v, torque))
            if kind == "touched":
                add(2 * period, lambda t: free(t, omega, min(3 * zeta + 0.3, 0.9), x, v))
                x = pieces[-1][1][-1]
            if kind in ("caught", "touched"):
                stop = float(rng.uniform(0.05, 0.3)) * period
                add(stop, lambda t: (x + v * stop / 3 * (1 - (1 - t / stop) ** 3), v * (1 - t / stop) ** 2))
                x = pieces[-1][1][-1]
                add(float(rng.uniform(0.3, 1.0)), still(x))
                lift = max(0.5, period)
                add(lift, hand(x, -x, lift))
                x = 0.0
                add(0.3 + period, still(0.0))
            at = float(x)
    time, angle, rate = (np.concatenate([piece[i] for piece in pieces]) for i in range(3))
    made = Made(kind, seed, time, angle, rate, truth)
    made.noise = amplitude * float(np.exp(rng.uniform(np.log(0.0005), np.log(0.02))))
    made.sensor = {"gyro": "gyro", "imu": "imu", "coast-down": "gyro"}.get(kind, "angle")
    if kind in ("plain", "caught", "critical") and seed % 4 == 0:
        made.sensor = "gyro"
    return made


def measured(made: Made):
    """Return the recording of a log as its sensor saw it."""
    from sysid.recording import Recording
    from sysid.roll import Roll

    rng = np.random.default_rng([99, made.seed])
    time, n = made.time.copy(), len(made.time)
    if made.sensor == "angle":
        angle = made.angle + 0.02 * rng.normal() + rng.normal(0, made.noise, n)
        if made.kind == "wander":
            angle += np.cumsum(rng.normal(0, 0.02 * made.noise, n))
        if made.kind == "jitter and loss":
            kept = rng.random(n) > 0.03
            true = time + rng.uniform(-0.3, 0.3, n) * (time[1] - time[0])
            # A cubic: a straight line between samples would cut off the turning points.
            angle = CubicSpline(made.time, made.angle)(true) + angle - made.angle
            angle, time = angle[kept], true[kept]
        if made.kind == "coarse":
            step = float(np.ptp(made.angle)) / rng.uniform(15, 100)
            angle = np.round((made.angle + rng.normal(0, 0.1 * step, n)) / step) * step
        if made.kind == "frozen clock":
            at = int(0.5 * n)
            time = np.where(np.arange(n) > at, time[at], time)
        if made.kind != "frozen clock":
            roll = Roll(
                log=f"{made.kind} {made.seed}",
                time=time,
                roll=angle,
                std=np.full(n if made.kind != "jitter and loss" else len(time), made.noise),
                origin="angle",
            )
            return Recording.of(roll)
        names, table = "time_s,angle_rad", np.column_stack([time, angle])
    else:
        noise = 0.3 * made.noise / np.ptp(made.angle) * np.ptp(made.rate)
        gyro = (
            made.rate + rng.normal(0, noise, n) + (0.01 * rng.normal() if made.kind != "coast-down" else 0.0)
        )
        names, table = "time_s,gyro_rad_s", np.column_stack([time, gyro])
        if made.sensor == "imu":
            arm = rng.uniform(-0.05, 0.05, 2)
            spin = np.gradient(made.rate, time)
            g, x = 9.81, made.angle
            ay = g * np.sin(x) - spin * arm[1] - made.rate**2 * arm[0]
            az = g * np.cos(x) + spin * arm[0] - made.rate**2 * arm[1]
            other = rng.normal(0, noise, (n, 2))
            accel = np.column_stack([np.zeros(n), ay, az]) + rng.normal(0, 0.03, (n, 3))
            names = "time_s,gx_rad_s,gy_rad_s,gz_rad_s,ax_m_s2,ay_m_s2,az_m_s2"
            table = np.column_stack([time, gyro, other, accel])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        np.savetxt(path, table, "%.9g", ",", header=names, comments="")
        return Recording.read(path)


def judged(job: tuple[str, int]) -> dict:
    """Return the outcome of one log."""
    from sysid.errors import SysidError
    from sysid.free_decay import fit_decay

    kind, seed = job
    made = make(kind, seed)
    row = {"kind": kind, "seed": seed, "status": "refused", "wrong": False, "held": [], "text": ""}
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            decay = fit_decay(measured(made))
    except SysidError as error:
        return {**row, "text": str(error)[:150]}
    except Exception as error:  # noqa: BLE001  a bug is a row, not the end
        return {**row, "status": "bug", "wrong": True, "text": f"{type(error).__name__}: {error}"[:150]}
    found = dict(decay.numbers.items()) | dict(decay.others)
    omega, zeta = made.truth.get("omega"), made.truth.get("zeta")
    wanted = (
        {"damping_over_inertia": made.truth["beta"]}
        if "beta" in made.truth
        else {"omega_n": omega, "damping_ratio": zeta}
    )
    if zeta is not None and zeta > 1:
        wanted["stiffness_over_damping"] = omega / (2 * zeta)
    row["status"] = decay.status
    row["text"] = f"{len(decay.releases)} releases {decay.judgement.reason}"[:150]
    for name, truth in wanted.items():
        quantity = found.get(name)
        if quantity is None or not np.isfinite(quantity.value):
            continue
        low, high = quantity.ci95
        off = abs(quantity.value - truth)
        row["held"].append(bool(low <= truth <= high))
        row.setdefault("std", []).append(float(quantity.std / abs(truth)))
        if decay.linear and off > 0.03 * truth and off > (high - low):
            row["wrong"] = True
            row["text"] = f"{name} {quantity} for {truth:.4g}; {row['text']}"
    if decay.linear and kind in NO_LINEAR and kind not in ("friction", "drag", "hardening"):
        row["wrong"] = True
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=220)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--kind", action="append", choices=KINDS)
    parser.add_argument("--verbose", action="store_true", help="name each log that is not as it should be")
    given = parser.parse_args()
    kinds = given.kind or KINDS
    jobs = [(kinds[i % len(kinds)], given.seed * 100_000 + i // len(kinds)) for i in range(given.count)]
    if given.jobs > 1:
        with ProcessPoolExecutor(given.jobs) as pool:
            rows = list(pool.map(judged, jobs, chunksize=4))
    else:
        rows = [judged(job) for job in jobs]
    groups = defaultdict(list)
    for row in rows:
        groups[row["kind"]].append(row)
    print(f"{'kind':18}{'logs':>6}{'✓':>6}{'✗':>6}{'?':>6}{'refused':>9}{'wrong ✓':>9}{'coverage':>10}")
    for kind in kinds:
        group = groups[kind]
        held = [held for row in group if row["status"] == "linear" for held in row["held"]]
        say = [
            sum(row["status"] == status for row in group)
            for status in ("linear", "not linear", "cannot tell", "refused")
        ]
        wrong = sum(row["wrong"] for row in group)
        covered = (
            f"{100 * np.mean(held):.1f} %" if held and kind not in ("friction", "drag", "hardening") else "-"
        )
        print(f"{kind:18}{len(group):>6}{say[0]:>6}{say[1]:>6}{say[2]:>6}{say[3]:>9}{wrong:>9}{covered:>10}")
    valid = [row for row in rows if row["kind"] not in NO_LINEAR]
    called = sum(row["status"] == "not linear" for row in valid)
    print(
        f"wrong with a ✓: {sum(row['wrong'] for row in rows)} of {len(rows)}; valid logs called non-linear: {called} of {len(valid)}"
    )
    if given.verbose:
        for row in rows:
            good = (
                row["status"] == "linear" and all(row["held"])
                if row["kind"] not in NO_LINEAR
                else row["status"] != "linear"
            )
            if row["wrong"] or not good:
                print(
                    f"{row['kind']:16} {row['seed']:>8} {row['status']:12} {'WRONG ' if row['wrong'] else ''}{row['held']} {row['text']}"
                )


if __name__ == "__main__":
    main()
