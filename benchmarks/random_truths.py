"""Logs whose joint, hand, sensor and clock are drawn at random, with what is hidden in them.

Nothing here is shared with the fit or with `sysid.synth`: torques are written out below, the motion is integrated by
scipy's LSODA, dry friction turns over within 1e-5 rad/s instead of sticking, and the hand is a chain of polynomials.

A draw belongs to its seed: the same seed is the same log. Seeds go round all kinds, so any range of them is balanced:
of ten logs two hide nothing, seven a variant of the catalogue or two, and one something outside it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

import numpy as np
from hidden_truths import TRUTHS

Array = np.ndarray
Torque = Callable[[float, float, float, Array], float]
"""Torque [N*m] of (time [s], tilt [rad], rate [rad/s], own inner states)."""
Flow = Callable[[float, float, Array], Sequence[float]]
"""Rates of the inner states from (tilt [rad], rate [rad/s], inner states)."""

INERTIA, STIFFNESS = 8.70e-3, 14.684
"""Of the shipped board `pink` [kg*m^2], [N*m/rad]."""
GRAVITY = 9.81
CREEP = 1e-5
"""Rate at which dry friction reaches three quarters of its size [rad/s]: in 2 s it creeps by a thousandth of a degree."""

CORNER = 100
"""Sharpness of a slider's yielding: within a hundredth of its stretch."""
FORGOTTEN = 5.0
"""Time constants after which a filter holds nothing of what was before."""
MOST_STEPS = 200_000
"""Of an integration before it is given up."""


@dataclass(frozen=True)
class Part:
    """What acts on the joint beside spring and damper."""

    torque: Torque
    flow: Flow | None = None
    count: int = 0
    """Inner states."""


@dataclass
class Truth:
    """A joint, what is hidden in it, and how it is moved and recorded."""

    name: str
    families: tuple[str, ...]
    strength: float = 0.0
    """As drawn: the largest torque of what is hidden over the spring's, or the relative change of what is changed."""
    inertia: float = INERTIA
    stiffness: float = STIFFNESS
    damping: float = 0.0
    rest: float = 0.0
    amplitude: float = 0.17
    """Of the first release [rad]."""
    parts: list[Part] = field(default_factory=list)
    support: tuple[float, float, float] | None = None
    """Inertia, stiffness and damping of what the joint stands on."""
    drift: float = 0.0
    lag: float = 0.0
    clock: float = 1.0

    @property
    def frequency(self) -> float:
        """Of the joint as released [rad/s]."""
        return float(np.sqrt(self.stiffness / self.inertia))


def _friction(torque: float, static: float = 0.0, speed: float = 1.0) -> Part:
    def size(v: float) -> float:
        return torque + max(static - torque, 0.0) * np.exp(-((v / speed) ** 2))

    return Part(lambda t, x, v, z: -np.tanh(v / CREEP) * size(v))


def _coulomb(t: Truth, s: float, rng: np.random.Generator) -> None:
    t.parts.append(_friction(0.5 * s * t.stiffness * t.amplitude))


def _stribeck(t: Truth, s: float, rng: np.random.Generator) -> None:
    sliding = 0.4 * s * t.stiffness * t.amplitude
    t.parts.append(
        _friction(sliding, rng.uniform(1.5, 3) * sliding, rng.uniform(0.03, 0.3) * t.amplitude * t.frequency)
    )


def _dahl(t: Truth, s: float, rng: np.random.Generator) -> None:
    torque, reach = 0.5 * s * t.stiffness * t.amplitude, rng.uniform(0.005, 0.06) * t.amplitude
    t.parts.append(Part(lambda _, x, v, z: -torque * z[0], lambda x, v, z: [(v - abs(v) * z[0]) / reach], 1))


def _jenkins(t: Truth, s: float, rng: np.random.Generator) -> None:
    torque, reach = s * t.stiffness * t.amplitude, rng.uniform(0.05, 0.4) * t.amplitude

    def flow(x: float, v: float, z: Array) -> list[float]:
        yields = min(abs(z[0]) / reach, 1.0) ** CORNER if z[0] * v > 0 else 0.0
        return [v * (1 - yields)]

    t.parts.append(Part(lambda _, x, v, z: -torque * np.clip(z[0] / reach, -1, 1), flow, 1))


def _bouc_wen(t: Truth, s: float, rng: np.random.Generator) -> None:
    torque, reach, u = (
        s * t.stiffness * t.amplitude,
        rng.uniform(0.05, 0.4) * t.amplitude,
        rng.uniform(0.3, 0.9),
    )

    def flow(x: float, v: float, z: Array) -> list[float]:
        return [(v - u * abs(v) * z[0] - (1 - u) * v * abs(z[0])) / reach]

    t.parts.append(Part(lambda _, x, v, z: -torque * z[0], flow, 1))


def _power_of_rate(power: int) -> "Draw":
    def draw(t: Truth, s: float, rng: np.random.Generator) -> None:
        size = s * t.stiffness * t.amplitude / (t.amplitude * t.frequency) ** power
        t.parts.append(Part(lambda _, x, v, z: -size * v * abs(v) ** (power - 1)))

    return draw


def _cubic(sign: float) -> "Draw":
    def draw(t: Truth, s: float, rng: np.random.Generator) -> None:
        c = sign * min(s, 0.6 if sign < 0 else 2.0) * t.stiffness / t.amplitude**2
        t.parts.append(Part(lambda _, x, v, z: -c * x**3))

    return draw


def _sine(t: Truth, s: float, rng: np.random.Generator) -> None:
    """A pendulum: its weight in place of a spring, from wider angles."""
    moment, t.stiffness, t.amplitude = t.stiffness, 0.0, np.sqrt(6 * min(s, 0.17))
    t.parts.append(Part(lambda _, x, v, z: -moment * np.sin(x)))


def _asymmetric(t: Truth, s: float, rng: np.random.Generator) -> None:
    b = rng.choice((-1, 1)) * min(s, 0.5) * t.stiffness / t.amplitude
    t.parts.append(Part(lambda _, x, v, z: -b * x * x))


def _bilinear(t: Truth, s: float, rng: np.random.Generator) -> None:
    b = rng.choice((-1, 1)) * min(s, 0.6) * t.stiffness
    t.parts.append(Part(lambda _, x, v, z: -b * abs(x)))


def _stop(*, loss: bool, sides: tuple[int, ...] = (-1, 1)) -> "Draw":
    def draw(t: Truth, s: float, rng: np.random.Generator) -> None:
        angle = rng.uniform(0.4, 0.85) * t.amplitude
        k = s * t.stiffness * t.amplitude / (t.amplitude - angle) * 10 ** rng.uniform(0, 1.2)
        d = rng.uniform(0.1, 0.6) * np.sqrt(k * t.inertia) if loss else 0.0
        pushing = sides if len(sides) == 2 else (int(rng.choice((-1, 1))),)

        def torque(_: float, x: float, v: float, z: Array) -> float:
            side = 1 if x > 0 else -1
            return -k * (x - side * angle) - d * v if side in pushing and side * x > angle else 0.0

        t.parts.append(Part(torque))

    return draw


def _freeplay(t: Truth, s: float, rng: np.random.Generator) -> None:
    k, w = t.stiffness, min(s, 0.4) * t.amplitude
    t.parts.append(Part(lambda _, x, v, z: k * float(np.clip(x, -w, w))))


def _arms(count: int) -> "Draw":
    def draw(t: Truth, s: float, rng: np.random.Generator) -> None:
        slow = 10 ** rng.uniform(0, 1.2) / t.frequency
        for number in range(count):
            k, time = s * t.stiffness / count, slow * 10.0**-number
            t.parts.append(
                Part(lambda _, x, v, z, k=k: -k * z[0], lambda x, v, z, time=time: [v - z[0] / time], 1)
            )

    return draw


def _support(t: Truth, s: float, rng: np.random.Generator) -> None:
    k, j = t.stiffness / min(s, 0.7), t.inertia * 10 ** rng.uniform(-0.7, 0.5)
    t.support = (j, k, 2 * rng.uniform(0.03, 0.3) * np.sqrt(k * j))


def _carried(t: Truth, s: float, rng: np.random.Generator) -> None:
    j = min(s, 1.0) * t.inertia
    k = j * (t.frequency * rng.uniform(0.5, 2.5)) ** 2
    d = 2 * rng.uniform(0.02, 0.15) * np.sqrt(k * j)
    t.parts.append(
        Part(
            lambda _, x, v, z: -k * (x - z[0]) - d * (v - z[1]),
            lambda x, v, z: [z[1], (k * (x - z[0]) + d * (v - z[1])) / j],
            2,
        )
    )


def _offset(t: Truth, s: float, rng: np.random.Generator) -> None:
    t.rest = rng.choice((-1, 1)) * min(s, 0.3) * t.amplitude


def _drift(t: Truth, s: float, rng: np.random.Generator) -> None:
    t.drift = rng.choice((-1, 1)) * min(s, 0.2) * t.amplitude


def _lowpass(t: Truth, s: float, rng: np.random.Generator) -> None:
    t.lag = min(s, 0.6) / t.frequency


def _clock(t: Truth, s: float, rng: np.random.Generator) -> None:
    t.clock = 1 + rng.choice((-1, 1)) * float(np.clip(s, 0.03, 0.3))


def _inertia(t: Truth, s: float, rng: np.random.Generator) -> None:
    t.inertia *= 1 + rng.choice((-1, 1)) * float(np.clip(s, 0.05, 0.4))  # the record does not know


Draw = Callable[[Truth, float, np.random.Generator], None]
VARIANTS: dict[str, tuple[str, Draw]] = {
    "coulomb": ("friction", _coulomb),
    "stribeck": ("friction", _stribeck),
    "dahl": ("friction", _dahl),
    "hysteresis": ("hysteresis", _jenkins),
    "bouc-wen": ("hysteresis", _bouc_wen),
    "quadratic-damping": ("drag", _power_of_rate(2)),
    "cubic-damping": ("drag", _power_of_rate(3)),
    "hardening": ("hardening", _cubic(1.0)),
    "softening": ("hardening", _cubic(-1.0)),
    "pendulum": ("hardening", _sine),
    "asymmetric-stiffness": ("asymmetry", _asymmetric),
    "bilinear-stiffness": ("asymmetry", _bilinear),
    "elastic stop": ("stop", _stop(loss=False)),
    "stop with loss": ("stop", _stop(loss=True)),
    "one-sided stop": ("stop", _stop(loss=False, sides=(1,))),
    "one-sided stop with loss": ("stop", _stop(loss=True, sides=(1,))),
    "freeplay": ("freeplay", _freeplay),
    "maxwell arm": ("relaxation", _arms(1)),
    "two arms": ("relaxation", _arms(2)),
    "compliant support": ("relaxation", _support),
    "carried body": ("relaxation", _carried),
    "offset": ("rest", _offset),
    "sensor-drift": ("drift", _drift),
    "lowpass": ("lowpass", _lowpass),
    "clock": ("clock", _clock),
    "inertia": ("inertia", _inertia),
}
"""Variants of the catalogue: family, and how one is drawn."""
AGAINST_RECORD = {"offset", "clock", "inertia"}
"""What leaves a linear joint linear, and shows against the record only."""
PAIRS = (
    ("coulomb", "hardening"), ("quadratic-damping", "softening"), ("coulomb", "quadratic-damping"),
    ("asymmetric-stiffness", "coulomb"), ("freeplay", "coulomb"), ("stop with loss", "coulomb"),
    ("maxwell arm", "hardening"), ("bilinear-stiffness", "quadratic-damping"), ("offset", "coulomb"),
)  # fmt: skip
OUTSIDE = tuple(t for t in TRUTHS if t.outside is not None and not t.kin)
"""What no effect is."""


@dataclass(frozen=True)
class Recording:
    """How a draw was moved and recorded."""

    sensor: str
    noise_kind: str
    noise: float
    """Of a sample [rad, or rad/s where the sensor is a gyro]; of an IMU the gyro's."""
    step: float
    """Of a coarse sensor, same unit."""
    memory: float
    """Of coloured noise [s]."""
    rate: float
    jitter: float
    """Of the stamps, in samples."""
    drops: float
    angles: tuple[float, ...]
    caught: bool
    pushed: bool


@dataclass(frozen=True)
class Case:
    """One log and everything that is known of it."""

    seed: int
    kind: str
    """'clean', 'inside' or 'outside'."""
    truth: Truth
    recording: Recording
    record_known: bool
    """Whether the board's record has the joint's true stiffness and damping; else it is the shipped board."""


def draw(seed: int) -> Case:
    """Draw a case."""
    rng = np.random.default_rng((20261122, seed))
    turn, place = divmod(seed, 10)
    kind = "clean" if place < 2 else "outside" if place == 9 else "inside"
    zeta = float(np.exp(rng.uniform(np.log(0.01), np.log(0.12))))
    known = bool(rng.random() < 0.6)
    name, families, parts = "nothing", (), ()
    if kind == "inside":
        number = 7 * turn + place - 2
        parts = (list(VARIANTS)[number % len(VARIANTS)],)
        if rng.random() < 0.12:
            parts = PAIRS[rng.integers(len(PAIRS))]
        name, families = " + ".join(parts), tuple(sorted({VARIANTS[p][0] for p in parts}))
    known |= bool(set(parts) & AGAINST_RECORD)
    stiffness = STIFFNESS * (
        float(np.exp(rng.uniform(np.log(0.3), np.log(3)))) if known and kind != "outside" else 1.0
    )
    truth = Truth(name, families, stiffness=stiffness, damping=2 * zeta * np.sqrt(stiffness * INERTIA))
    truth.amplitude = rng.uniform(0.1, 0.19)
    for part in parts:
        strength = (
            float(np.exp(rng.uniform(np.log(0.006), np.log(0.6))))
            if len(parts) == 1
            else rng.uniform(0.08, 0.4)
        )
        truth.strength = strength if len(parts) == 1 else max(truth.strength, strength)
        VARIANTS[part][1](truth, strength, rng)
    if kind == "outside":
        chosen, truth.strength = (
            OUTSIDE[turn % len(OUTSIDE)],
            float(np.exp(rng.uniform(np.log(0.3), np.log(4)))),
        )
        truth.name, truth.families, truth.amplitude = chosen.name, ("outside",), rng.uniform(0.16, 0.21)
        truth.damping = 0.04
        torque, memory, size = chosen.outside, chosen.memory, truth.strength
        assert torque is not None
        if memory is None:
            truth.parts.append(Part(lambda t, x, v, z: size * torque(t, x, v, 0.0)))
        else:
            truth.parts.append(
                Part(lambda t, x, v, z: size * torque(t, x, v, z[0]), lambda x, v, z: [memory(v, z[0])], 1)
            )
    return Case(seed, kind, truth, _recording(truth, turn, parts, rng), known)


def _recording(truth: Truth, turn: int, parts: Sequence[str], rng: np.random.Generator) -> Recording:
    sensor = str(rng.choice(("angle", "gyro", "imu"), p=(0.6, 0.2, 0.2)))
    if set(parts) & {"offset", "sensor-drift"}:
        sensor = "angle"  # a rate has neither
    kind = str(rng.choice(("white", "coloured", "quantised"), p=(0.6, 0.2, 0.2)))
    noise = np.exp(rng.uniform(np.log(0.02), np.log(0.2))) * (np.radians(1) if sensor == "angle" else 0.1)
    many = int(rng.choice((1, 2, 3, 4), p=(0.15, 0.2, 0.45, 0.2)))
    shares = rng.uniform(0.85, 1.0, many) * np.array((1.0, 0.8, 0.55, 0.7))[:many]
    return Recording(
        sensor=sensor, noise_kind=kind, noise=float(0.3 * noise if kind == "quantised" else noise),
        step=float(noise) if kind == "quantised" else 0.0, memory=float(rng.uniform(0.002, 0.02)),
        rate=float(rng.choice((100.0, 200.0, 400.0, 500.0, 1000.0), p=(0.1, 0.25, 0.25, 0.2, 0.2))),
        jitter=float(rng.choice((0.0, rng.uniform(0.002, 0.05)))), drops=float(rng.choice((0.0, rng.uniform(0, 0.01)))),
        angles=tuple(float(a) for a in truth.amplitude * shares * rng.choice((-1, 1)) * (-1.0) ** np.arange(many)),
        caught=(turn + turn // len(OUTSIDE)) % 3 == 0, pushed=bool(rng.random() < 0.25),
    )  # fmt: skip


@dataclass(frozen=True)
class Motion:
    """What truly happened, sampled."""

    time: Array
    """[s], shape (n,)."""
    states: Array
    """Roll [rad], rate [rad/s] and inner states, shape (n, 2 + inner)."""
    free: tuple[tuple[float, float], ...]
    """From when until when nobody touched the deck after a release [s]."""


class _Joint:
    """Equations of motion."""

    def __init__(self, truth: Truth) -> None:
        self.truth = truth
        self.count = sum(p.count for p in truth.parts) + (2 if truth.support else 0)

    def rates(self, time: float, roll: float, rate: float, inner: Array) -> tuple[float, list[float]]:
        """Return the deck's acceleration if nobody holds it, and the rates of the inner states."""
        t = self.truth
        s, w = inner[-2:] if t.support else (0.0, 0.0)
        x, v = roll - t.rest - s, rate - w
        torque, flows, at = -t.stiffness * x - t.damping * v, [], 0
        for part in t.parts:
            z = inner[at : at + part.count]
            torque += part.torque(time, x, v, z)
            if part.flow is not None:
                flows += part.flow(x, v, z)
            at += part.count
        if t.support:
            inertia, stiffness, damping = t.support
            flows += [w, (-stiffness * s - damping * w - torque) / inertia]
        return torque / t.inertia, flows

    def go(
        self, begin: float, end: float, start: Array, times: Array, hand: "_Hand | None" = None
    ) -> tuple[Array, Array]:
        """Integrate; return states (roll, rate, inner...), shape (times, 2 + count), and the last."""
        from scipy.integrate import solve_ivp

        steps = count()

        def slope(time: float, y: Array) -> list[float]:
            if next(steps) > MOST_STEPS:
                raise ArithmeticError(f"the motion is too stiff at {time:.3g} s")
            roll, rate = (y[0], y[1]) if hand is None else hand.at(time)
            acceleration, flows = self.rates(time, roll, rate, y[2:])
            return [rate, acceleration if hand is None else 0.0, *flows]

        if hand is None or self.count:
            grid = np.append(times, end)
            path = solve_ivp(
                slope, (begin, end), start, t_eval=grid, method="LSODA", rtol=1e-7, atol=1e-9,
                max_step=0.03 * 2 * np.pi / self.frequency,
            )  # fmt: skip
            whole = path.y.shape[1] == len(grid) and bool(np.all(np.isfinite(path.y)))
            if not whole or np.abs(path.y[0]).max() > 2.5:
                raise ArithmeticError(f"the motion from {begin:.3g} s on cannot be followed")
            states = path.y.T
        else:
            states = np.zeros((len(times) + 1, 2))
        if hand is not None:
            states[:, :2] = [hand.at(t) for t in (*times, end)]
        return states[:-1], states[-1]

    @property
    def frequency(self) -> float:
        """A typical one, of a pendulum too [rad/s]."""
        return self.truth.frequency or float(np.sqrt(STIFFNESS / self.truth.inertia))


class _Hand:
    """A quintic from one (roll, rate) to another in a time, then a hold with a tremor."""

    def __init__(
        self,
        begin: float,
        start: Sequence[float],
        move: float,
        target: Sequence[float],
        rng: np.random.Generator,
    ) -> None:
        self.begin, self.move, self.target = begin, move, target
        powers = np.arange(6)
        rows = []
        for u in (0.0, 1.0):
            slopes = powers * u ** np.maximum(powers - 1, 0)
            rows += [u**powers, slopes, powers * (powers - 1) * u ** np.maximum(powers - 2, 0)]
        ends = (start[0], start[1] * move, 0.0, target[0], target[1] * move, 0.0)
        self.c = np.linalg.solve(np.array(rows, dtype=float), ends)[::-1]
        self.size = np.radians(rng.uniform(0.003, 0.02))
        self.f, self.phase = rng.uniform(7, 11, 3) * 2 * np.pi, rng.uniform(0, 2 * np.pi, 3)

    def at(self, time: float) -> tuple[float, float]:
        u = (time - self.begin) / self.move
        if u < 1:
            return float(np.polyval(self.c, u)), float(np.polyval(np.polyder(self.c), u)) / self.move
        after = time - self.begin - self.move
        window = 1 - np.exp(-after / 0.1)
        angle = self.f * after + self.phase
        roll = self.target[0] + self.target[1] * after + self.size * window * float(np.sin(angle).sum())
        rate = self.size * window * float((self.f * np.cos(angle)).sum())
        return roll, self.target[1] + rate + self.size * (1 - window) / 0.1 * float(np.sin(angle).sum())


def move(case: Case) -> Motion:
    """Move the deck: rest, then for each release push, hold, let go, and catch or wait.

    Raises:
        ArithmeticError: The motion cannot be followed.
    """
    rng = np.random.default_rng((1, case.seed))
    truth, r = case.truth, case.recording
    joint = _Joint(truth)
    period = 2 * np.pi / joint.frequency
    wait = float(np.clip(rng.uniform(8, 30) * period, 1.0, 3.5))
    now, state = 0.0, np.zeros(2 + joint.count)
    state[0] = truth.rest
    times: list[Array] = []
    states: list[Array] = []
    free: list[tuple[float, float]] = []

    def go(duration: float, hand: _Hand | None) -> None:
        nonlocal now, state
        grid = np.arange(np.ceil(now * r.rate), np.ceil((now + duration) * r.rate)) / r.rate
        path, state = joint.go(now, now + duration, state, grid, hand)
        times.append(grid)
        states.append(path)
        now += duration

    def to(roll: float, rate: float, duration: float) -> _Hand:
        return _Hand(now, state[:2], duration, (roll, rate), rng)

    go(rng.uniform(0.4, 1.0), to(truth.rest, 0.0, 100.0))  # nobody moves it
    for angle in r.angles:
        go(0.4 + rng.uniform(0.3, 1.2), to(truth.rest + angle, 0.0, 0.4))
        if r.pushed:
            rate = -np.sign(angle) * rng.uniform(0.05, 0.4) * abs(angle) * joint.frequency
            go(0.06, to(state[0] + 0.4 * 0.06 * rate, rate, 0.06))
        duration = float(rng.uniform(3, 8)) * period if r.caught else wait
        free.append((now, now + duration))
        go(duration, None)
        if r.caught:  # brought to a stop in an eighth of a second, held, and taken on from there
            go(rng.uniform(0.2, 0.5), to(state[0] + 0.05 * state[1], 0.0, 0.12))
    if r.caught:
        go(0.8, to(truth.rest, 0.0, 0.3))
    return Motion(np.concatenate(times), np.concatenate(states), tuple(free))


def read(case: Case, motion: Motion, *, quiet: bool = False) -> tuple[Array, Array, dict[str, Array]]:
    """Return stamps [s], shape (n,), which samples are kept, shape (n,), and columns by name, shape (n,) each."""
    from scipy.signal import lfilter

    rng = np.random.default_rng((2, case.seed))
    truth, r = case.truth, case.recording
    step, samples = 1 / r.rate, len(motion.time)
    roll, speed = motion.states[:, 0], motion.states[:, 1]
    acceleration = np.gradient(speed, motion.time)

    def lagged(signal: Array) -> Array:
        if not truth.lag:
            return signal
        # Exact for a signal that is linear between samples.
        keep = np.exp(-step / truth.lag)
        gain = (1 - keep) * truth.lag / step
        return np.asarray(lfilter([1 - gain, gain - keep], [1, -keep], signal - signal[0])) + signal[0]

    def noise(size: float) -> Array:
        white = rng.standard_normal(samples)
        if r.noise_kind == "coloured":
            a = np.exp(-step / r.memory)
            longer = lfilter([np.sqrt(1 - a * a)], [1, -a], rng.standard_normal(samples + 500))
            white = np.asarray(longer)[500:]
        return (0.0 if quiet else size) * white

    def coarse(signal: Array, step_size: float) -> Array:
        return step_size * np.round(signal / step_size) if step_size and not quiet else signal

    angle = lagged(roll) + truth.drift * motion.time
    rate = lagged(speed)
    if r.sensor == "angle":
        columns = {"roll_rad": coarse(angle + noise(r.noise), r.step)}
    elif r.sensor == "gyro":
        columns = {"gyro_x_rad_s": coarse(rate + rng.normal(0, 0.01) + noise(r.noise), r.step)}
    else:
        left, up, size = 0.03, 0.05, 3 * r.noise
        y = GRAVITY * np.sin(roll) - acceleration * up - speed**2 * left
        z = GRAVITY * np.cos(roll) + acceleration * left - speed**2 * up
        columns = {
            "acc_x_m_s2": noise(size), "acc_y_m_s2": lagged(y) + noise(size), "acc_z_m_s2": lagged(z) + noise(size),
            "gyro_x_rad_s": coarse(rate + rng.normal(0, 0.01) + noise(r.noise), r.step),
            "gyro_y_rad_s": noise(r.noise) - 0.004, "gyro_z_rad_s": noise(r.noise) + 0.007,
        }  # fmt: skip
    late = np.clip(rng.standard_normal(samples), -3, 3)
    stamps = truth.clock * motion.time + (0.0 if quiet else r.jitter) * step * late
    kept = (rng.random(samples) >= r.drops) | (np.arange(samples) == 0) | quiet
    return stamps, kept, columns


def write(case: Case, motion: Motion, path: Path) -> None:
    """Write the log as CSV."""
    stamps, kept, columns = read(case, motion)
    table = np.column_stack((stamps, *columns.values()))[kept]
    np.savetxt(path, table, fmt="%.8f", delimiter=",", header=",".join(("time_s", *columns)), comments="")


def sizes(case: Case, motion: Motion) -> dict[str, float]:
    """Return how much what is hidden matters: its shares of the peak torque and of the dissipated energy."""
    truth, joint = case.truth, _Joint(case.truth)
    peak = linear = lost = whole = widest = 0.0
    for begin, end in motion.free:
        inside = (motion.time >= begin) & (motion.time <= end)
        for time, row in zip(motion.time[inside], motion.states[inside], strict=True):
            acceleration, _ = joint.rates(time, row[0], row[1], row[2:])
            x, v = row[0] - truth.rest, row[1]
            widest = max(widest, abs(x))
            plain = truth.stiffness * x + truth.damping * v
            extra = -acceleration * truth.inertia - plain
            peak, linear = max(peak, abs(extra)), max(linear, abs(plain))
            lost, whole = lost + extra * v, whole + extra * v + truth.damping * v * v
    if truth.stiffness == 0:
        peak, linear = widest - np.sin(widest), widest  # a pendulum: what its sine is off a spring
    return {
        "torque_share": peak / linear,
        "energy_share": float(np.clip(lost / whole, 0, 1)) if whole > 0 and truth.stiffness else 0.0,
    }


def weight(recording: Recording) -> float:
    """Return by how much a squared deviation of one sample from the truth counts as χ² [1/rad² or s²/rad²]."""
    coloured = recording.noise_kind == "coloured"
    correlated = np.exp(-1 / (recording.rate * recording.memory)) if coloured else 0.0
    return (1 - correlated) / (1 + correlated) / (recording.noise**2 + recording.step**2 / 12)


def visible(case: Case, motion: Motion) -> dict[str, float]:
    """Return how far the best linear decays are from the log without noise: as χ², what there is to see it by, and over the motion.

    They have one frequency, one damping and one rest, and any start. What shows against the record only is visible by its strength.
    What a filter remembers of a hand that pushed is none of the decay.
    """
    from scipy.optimize import least_squares

    truth, r = case.truth, case.recording
    _, _, columns = read(case, motion, quiet=True)
    signal = columns["roll_rad" if r.sensor == "angle" else "gyro_x_rad_s"]
    if set(truth.families) <= {VARIANTS[name][0] for name in AGAINST_RECORD} and truth.families:
        seen = truth.rest**2 * weight(r) * len(signal) if truth.rest else (truth.strength / 0.003) ** 2
        return {"visible": seen, "signal_share": truth.strength}
    remembered = FORGOTTEN * truth.lag if r.pushed else 0.0
    spans = [(motion.time >= a + remembered) & (motion.time <= b) for a, b in motion.free]
    joint = _Joint(truth)

    def misfit(point: Array) -> Array:
        frequency, damping = point * joint.frequency
        rows = []
        for number, ((begin, _), inside) in enumerate(zip(motion.free, spans, strict=True)):
            t = motion.time[inside] - begin
            block = np.zeros((len(t), 1 + 2 * len(spans)))
            block[:, 0] = 1.0
            swing = np.exp(-damping * t)
            block[:, 1 + 2 * number] = swing * np.cos(frequency * t)
            block[:, 2 + 2 * number] = swing * np.sin(frequency * t)
            rows.append(block)
        design, target = np.vstack(rows), np.concatenate([signal[inside] for inside in spans])
        return target - design @ np.linalg.lstsq(design, target, rcond=None)[0]

    best = min(
        (float(np.sum(least_squares(misfit, (f, z), bounds=((0.2, 0.0), (4.0, 1.5))).fun ** 2))
         for f in (0.8, 1.0, 1.3) for z in (0.03, 0.15)),
    )  # fmt: skip
    moved = np.concatenate([signal[inside] - np.median(signal) for inside in spans])
    return {"visible": best * weight(r), "signal_share": float(np.sqrt(best / np.sum(moved**2)))}
