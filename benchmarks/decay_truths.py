"""Random free decays with a known truth, by a generator that shares no code with the package's laws, fits or synthetic logs.

Any joint: natural frequency 0.4 to 60 rad/s, damping ratio 0.004 to 2, laws as written or bent by a tenth, hands that hold, open
slowly, push or touch, sensors that are coarse, drift, filter, clip, or measure the rate only.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from sysid.recording import Recording
from sysid.roll import Roll

Law = Callable[[float, float, list[float], float], tuple[float, list[float]]]
"""`law(x, v, states, t)` in units of the widest swing and of 1/ω₀: opposing torque over I ω₀² A, and the rates of its states."""


@dataclass(kw_only=True)
class Truth:
    kind: str
    """clean, known or outside."""
    families: tuple[str, ...]
    omega: float
    zeta: float
    amplitude: float
    bent: bool
    hand: str
    sensor: str
    laws: list[tuple[str, Law, int]] = field(default_factory=list)
    """Name, law, number of states."""


def _unit(v: float) -> float:
    return float(np.tanh(v / 2e-3))


def known(rng: np.random.Generator, name: str) -> tuple[str, Law, int]:
    """Return a law of the catalogue's families, of a size that matters."""
    u = rng.uniform
    if name == "friction":
        f = u(0.02, 0.09)
        if rng.random() < 0.3:
            extra, width = f * u(0.5, 1.0), u(0.05, 0.15)
            return (
                "stribeck",
                lambda x, v, z, t: ((f + extra * np.exp(-((v / width) ** 2))) * _unit(v), []),
                0,
            )
        return "coulomb", lambda x, v, z, t: (f * _unit(v), []), 0
    if name == "drag":
        c, cubic = u(0.08, 0.4), rng.random() < 0.3
        return "drag", lambda x, v, z, t: (c * (v**3 if cubic else v * abs(v)), []), 0
    if name == "hardening":
        c = float(rng.choice([u(0.08, 0.5), u(-0.35, -0.08)]))
        return "cubic", lambda x, v, z, t: (c * x**3, []), 0
    if name == "asymmetry":
        b = float(rng.choice([-1, 1])) * u(0.08, 0.35)
        square = rng.random() < 0.5
        return "asymmetry", lambda x, v, z, t: (b * (x * x if square else abs(x)), []), 0
    if name == "stop":
        a, k, d = u(0.5, 0.85), 10 ** u(0.5, 1.5), u(0.0, 0.4)
        side = rng.random() < 0.4

        def stop(x: float, v: float, z: list[float], t: float) -> tuple[float, list[float]]:
            beyond = max(x - a, 0.0) if side else max(abs(x) - a, 0.0) * np.sign(x)
            return k * beyond + (d * v if beyond else 0.0), []

        return "stop", stop, 0
    if name == "freeplay":
        w = u(0.05, 0.15)
        return "freeplay", lambda x, v, z, t: (-float(np.clip(x, -w, w)), []), 0
    if name == "hysteresis":
        c, a = u(0.08, 0.3), u(0.08, 0.3)

        def hysteresis(x: float, v: float, z: list[float], t: float) -> tuple[float, list[float]]:
            s = z[0]
            return c * s, [(v - 0.5 * abs(v) * s - 0.5 * v * abs(s)) / a]

        return "bouc-wen", hysteresis, 1
    if name == "relaxation":
        if rng.random() < 0.6:
            c, tau = u(0.1, 0.5), 10 ** u(-0.1, 0.9)
            return "maxwell", lambda x, v, z, t: (c * z[0], [v - z[0] / tau]), 1
        share, w, damp = u(0.05, 0.2), u(1.4, 3.5), u(0.02, 0.1)

        def support(x: float, v: float, z: list[float], t: float) -> tuple[float, list[float]]:
            s, r = z
            pull = w * w * (x - s) + 2 * damp * w * (v - r)
            return share / w * pull, [r, pull]

        return "second", support, 2
    raise KeyError(name)


def outside(rng: np.random.Generator) -> tuple[str, Law, int]:
    """Return a law that no effect of the catalogue is."""
    u, pick = rng.uniform, rng.integers(6)
    c = u(0.1, 0.3)
    if pick == 0:
        n, p = u(4, 9), u(0, 6)
        return "detent", lambda x, v, z, t: (c * 0.5 * np.sin(n * x + p), []), 0
    if pick == 1:
        slow = c / 25
        return "spring that fades", lambda x, v, z, t: (-min(slow * t, 0.5) * x, []), 0
    if pick == 2:
        return "damper of the angle", lambda x, v, z, t: (2.0 * c * x * x * v, []), 0
    if pick == 3:
        a, w = u(-0.4, 0.4), u(0.1, 0.2)
        return "patch of friction", lambda x, v, z, t: (c * np.exp(-(((x - a) / w) ** 2)) * _unit(v), []), 0
    if pick == 4:
        return "one way damper", lambda x, v, z, t: (c * max(v, 0.0) * (1.0 if x > 0 else 0.2), []), 0
    w = u(0.2, 0.5)
    return "pump", lambda x, v, z, t: (0.5 * c * np.sin(w * t) * x, []), 0


FAMILIES = ("friction", "drag", "hardening", "asymmetry", "stop", "freeplay", "hysteresis", "relaxation")


MATTERS = 0.01
"""Least RMS torque of a law beside a spring and a damper over the free motion, over the spring's: a stop that is never met is no truth."""


def draw(seed: int) -> tuple[Truth, Recording]:
    """Return one random truth, whose laws all matter in the free motion, and its recording."""
    for attempt in itertools.count():
        truth, recording, shares = _draw(seed, attempt)
        if not len(shares) or shares.min() > MATTERS:
            return truth, recording
    raise AssertionError


def _draw(seed: int, attempt: int) -> tuple[Truth, Recording, np.ndarray]:
    """Return a truth, its recording, and the share of the spring's torque that each law has, shape (laws,)."""
    rng = np.random.default_rng((20261130, seed, attempt))
    u = rng.uniform
    omega, amplitude = 10 ** u(-0.4, 1.78), u(0.08, 0.7)
    zeta = 10 ** u(-2.4, -0.3) if rng.random() < 0.9 else 10 ** u(-0.3, 0.3)
    kind = str(rng.choice(["known", "known", "known", "clean", "outside"]))
    bent = bool(kind == "known" and rng.random() < 0.4)
    names = (
        tuple(sorted(rng.choice(FAMILIES, 2 if rng.random() < 0.25 else 1, replace=False)))
        if kind == "known"
        else ()
    )
    laws = (
        [known(rng, str(n)) for n in names]
        if kind == "known"
        else [outside(rng)]
        if kind == "outside"
        else []
    )
    if bent:
        laws = [(n, _bend(law, rng), s) for n, law, s in laws]
    hand = str(rng.choice(["clean", "clean", "slow", "push", "caught", "touch"]))
    sensor = str(
        rng.choice(["plain", "plain", "plain", "coarse", "drift", "filter", "clip", "gyro", "fused"])
    )
    truth = Truth(
        kind=kind, families=tuple(map(str, names)), omega=omega, zeta=zeta, amplitude=amplitude, bent=bent, hand=hand, sensor=sensor, laws=laws
    )  # fmt: skip
    return truth, *_record(truth, rng, seed)


def _bend(law: Law, rng: np.random.Generator) -> Law:
    a, b, c = rng.normal(size=3) * 0.06

    def bent(x: float, v: float, z: list[float], t: float) -> tuple[float, list[float]]:
        torque, rates = law(x, v, z, t)
        return torque * (1 + a * np.sin(2 * x) + b * np.cos(3 * x) + c * np.sin(2 * v)), rates

    return bent


class _Hand(NamedTuple):
    """Torques of the hand in one release, in units of the largest swing and of the natural frequency."""

    swing: float
    opening: float
    pulse: tuple[float, float]
    touch: tuple[float, float]
    catch: float


def _slope(truth: Truth, hand: _Hand, y: np.ndarray, t: float) -> np.ndarray:
    x, v = float(y[0]), float(y[1])
    force, rates, at = -x - 2 * truth.zeta * v, [], 2
    for _, law, count in truth.laws:
        torque, moved = law(x, v, [float(s) for s in y[at : at + count]], t)
        force -= torque
        rates += moved
        at += count
    if t < hand.opening:  # a hand that lets go gradually
        force += (1 - t / hand.opening) * (8.0 * (hand.swing - x) - 3.0 * v)
    if t < hand.pulse[0]:
        force += hand.pulse[1] * np.pi / 2 / hand.pulse[0] * np.sin(np.pi * t / hand.pulse[0])
    if hand.touch[0] < t < hand.touch[0] + 1.0:
        force -= hand.touch[1] * 2 * v
    if t > hand.catch:
        force -= 6.0 * v + 4.0 * x
    return np.array([v, force, *rates])


def _record(truth: Truth, rng: np.random.Generator, seed: int) -> tuple[Recording, np.ndarray]:
    u = rng.uniform
    per_period = 10 ** u(1.4, 2.5)
    count = int(rng.integers(1, 5))
    swings = [1.0, -u(0.7, 0.95), u(0.4, 0.6), -u(0.25, 0.9)][:count]
    step = 2 * np.pi / per_period
    fine = max(int(np.ceil(per_period and 400 / per_period)), 1)
    longest = 2 * np.pi * min(40.0, max(3.0, 3.9 / (2 * np.pi * max(truth.zeta, 0.015))))
    angle: list[float] = []
    rate: list[float] = []
    free: list[np.ndarray] = []
    y = np.zeros(2 + sum(count for _, _, count in truth.laws))
    for number, swing in enumerate(swings):
        held = int(u(1.0, 3.0) * per_period)
        x, v = swing, 0.0
        back = 1.5 * 2 * np.pi
        if truth.hand == "push":
            x = 0.0
        states = _led(truth, y, x, back, held * step)
        angle += [x] * held
        rate += [v] * held
        hand = _Hand(
            swing,
            opening=u(0.05, 0.25) * 2 * np.pi if truth.hand == "slow" else 0.0,
            pulse=(u(0.3, 1.2), swing * u(0.8, 1.2)) if truth.hand == "push" else (0.0, 0.0),
            touch=(u(0.55, 0.8) * longest, u(0.1, 0.4)) if truth.hand == "touch" else (np.inf, 0.0),
            catch=u(0.4, 0.7) * longest if truth.hand == "caught" else np.inf,
        )
        h = step / fine
        y = np.array([x, v, *states])

        t = 0.0
        for _ in range(int(longest / step)):
            for _ in range(fine):
                a = _slope(truth, hand, y, t)
                b = _slope(truth, hand, y + h / 2 * a, t + h / 2)
                c = _slope(truth, hand, y + h / 2 * b, t + h / 2)
                d = _slope(truth, hand, y + h * c, t + h)
                y = y + h / 6 * (a + 2 * b + 2 * c + d)
                t += h
            angle.append(float(y[0]))
            rate.append(float(y[1]))
            if max(hand.opening, hand.pulse[0]) < t < min(hand.touch[0], hand.catch):
                free.append(np.array([*y[:2], 1.0, *_torques(truth, y, t)]))
        # A hand brings it to where it is released next.
        count = int(1.5 * per_period)
        to = 0.0 if truth.hand == "push" or number + 1 == len(swings) else swings[number + 1]
        way = np.linspace(0, np.pi, count)
        angle += list(float(y[0]) + (to - float(y[0])) * (1 - np.cos(way)) / 2)
        rate += list((to - float(y[0])) * np.sin(way) / 2 / (1.5 * 2))
    x, v = np.array(angle) * truth.amplitude, np.array(rate) * truth.amplitude * truth.omega
    time = np.arange(len(x)) * step / truth.omega
    noise = truth.amplitude / 10 ** u(2.2, 3.4)
    if truth.sensor == "filter":
        share = 1 - np.exp(-step / (2 * np.pi * u(0.01, 0.05)))
        for i in range(1, len(x)):
            x[i] = x[i - 1] + share * (x[i] - x[i - 1])
    if truth.sensor == "drift":
        x = x + np.cumsum(rng.normal(size=len(x))) * truth.amplitude * u(0.001, 0.005) / np.sqrt(per_period)
    x = x + noise * rng.normal(size=len(x))
    if truth.sensor == "coarse":
        q = noise * u(2.0, 5.0)
        x = np.round(x / q) * q
        noise = float(np.hypot(noise, q / np.sqrt(12)))
    if truth.sensor == "clip":
        limit = truth.amplitude * u(0.85, 0.97)
        x = np.clip(x, -limit, limit)
    keep = rng.random(len(x)) > 0.003
    stamps = time + rng.normal(size=len(x)) * 0.01 * step / truth.omega
    keep &= np.concatenate([[True], np.diff(stamps) > 0])
    rated = v + noise * truth.omega * rng.normal(size=len(v))
    std = np.full(len(x), noise)
    shared = {"log": f"random-{seed}", "time": stamps[keep]}
    if truth.sensor == "gyro":
        offset = truth.amplitude * truth.omega * 0.002 * rng.normal()
        rated = rated + offset
        total = np.cumsum(rated) * np.median(np.diff(time))
        roll = Roll(
            **shared,
            roll=total[keep],
            std=std[keep] * 3,
            rate=rated[keep],
            rate_std=std[keep] * truth.omega,
            origin="gyro",
            zero="drifting",
            measured="rate",
        )
    elif truth.sensor == "fused":
        roll = Roll(
            **shared,
            roll=x[keep],
            std=std[keep],
            rate=rated[keep],
            rate_std=std[keep] * truth.omega,
            origin="fused",
            zero="known",
            measured="roll",
        )
    else:
        roll = Roll(**shared, roll=x[keep], std=std[keep], origin="angle")
    return Recording.of(roll, keep_zero=True), _shares(np.array(free))


def _torques(truth: Truth, y: np.ndarray, t: float) -> list[float]:
    """Return the torque of each law in a state of the joint."""
    torques, at = list[float](), 2
    for _, law, count in truth.laws:
        torques.append(law(float(y[0]), float(y[1]), [float(s) for s in y[at : at + count]], t)[0])
        at += count
    return torques


def _shares(free: np.ndarray) -> np.ndarray:
    """Return the RMS torque of each law beside a spring, a damper and a constant, over the spring's.

    Args:
        free: Angle, rate, 1 and the torques of the laws over the free motion, shape (n, 3 + laws).
    """
    linear, torques = free[:, :3], free[:, 3:]
    beside = torques - linear @ np.linalg.lstsq(linear, torques, rcond=None)[0]
    return np.sqrt(np.mean(beside**2, axis=0) / np.mean(free[:, 0] ** 2))


def _led(truth: Truth, y: np.ndarray, to: float, back: float, held: float) -> list[float]:
    """Return the states of the laws after a hand has led the joint from a state to a place and held it there.

    Args:
        truth: The joint.
        y: Angle, rate and states before.
        to: The place.
        back: For how long the hand leads it.
        held: For how long it holds it.
    """
    x0, states, h = float(y[0]), np.array(y[2:]), 2 * np.pi / 400

    def rates(t: float, states: np.ndarray) -> np.ndarray:
        moved, at = list[float](), 0
        x = x0 + (to - x0) * (1 - np.cos(np.pi * min(t / back, 1.0))) / 2
        v = (to - x0) * np.pi / (2 * back) * np.sin(np.pi * t / back) if t < back else 0.0
        for _, law, count in truth.laws:
            moved += law(x, v, [float(s) for s in states[at : at + count]], t)[1]
            at += count
        return np.array(moved)

    for step in range(round((back + held) / h) if len(states) else 0):
        t = step * h
        a = rates(t, states)
        b = rates(t + h / 2, states + h / 2 * a)
        c = rates(t + h / 2, states + h / 2 * b)
        d = rates(t + h, states + h * c)
        states = states + h / 6 * (a + 2 * b + 2 * c + d)
    return [float(s) for s in states]
