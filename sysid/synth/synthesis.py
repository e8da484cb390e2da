"""Synthetic logs with a known truth, independent of the model that is fitted.

`synthesise` moves a board as in a recording: rest, push, hold, release, and again. Its true law may hold any effects of the
catalogue. A sensor then reads the motion.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np
import numpy.typing as npt

from sysid.board import Board
from sysid.errors import SysidError
from sysid.roll import Array
from sysid.synth.effects import SENSOR_FIELDS, complete_effects, steps, true_law
from sysid.synth.hand import HandMotion, hand_motion
from sysid.synth.law import Modes, TrueLaw
from sysid.synth.log import SyntheticLog, SynthOptions, TrueRelease
from sysid.synth.motion import Condition, simulate
from sysid.synth.sensors import ANGLES, measure

MOST_SAMPLES = 2e7
"""Largest log [samples]: five and a half hours at 1 kHz."""


def synthesise(
    board: Board, effects: Mapping[str, Sequence[float]] | None = None, options: SynthOptions | None = None
) -> SyntheticLog:
    """Make a log of a board with the effects of its record and further ones.

    Args:
        effects: Name and parameters, in the order of the catalogue; they replace the record's of the same name.

    Raises:
        SysidError: An effect or an option is out of range.
    """
    options = options or SynthOptions()
    recorded = {effect.name: [q.value for q in effect.parameters.values()] for effect in board.effects}
    chosen = complete_effects({**recorded, **(effects or {})})
    _check(board, options, chosen)
    law = true_law(board, chosen)
    given = {field: chosen[name][0] for name, field in SENSOR_FIELDS.items() if name in chosen}
    options = replace(options, sensor=replace(options.sensor, **given))
    physics, sensing = np.random.default_rng(options.seed).spawn(2)
    time, motion, releases = _move(law, options, chosen.get("discretisation", (0.0,))[0], physics)
    if not options.hand:
        first = releases[0].start
        kept = time >= first - 1e-9
        time, motion = np.maximum(time[kept] - first, 0.0), motion[kept]
        releases = [replace(releases[0], start=0.0, end=releases[0].end - first)]
    channels = measure(time, motion, options.sensor, options.dialect, sensing)
    kept = _kept(len(time), options.dropout, sensing)
    ratio = options.sensor.clock
    return SyntheticLog(
        board=board.name, law=law, effects=chosen, options=options,
        time=ratio * time[kept], channels=channels[kept], true_motion=motion[kept],
        releases=tuple(
            replace(r, start=round(ratio * r.start, 9), end=round(ratio * r.end, 9)) for r in releases
        ),
    )  # fmt: skip


def _check(board: Board, options: SynthOptions, effects: Mapping[str, object]) -> None:
    def refuse(what: str, value: object, expected: str) -> None:
        raise SysidError(f"{what} is {value}; expected {expected}.")

    slides, dialect = board.slides, f"'{options.dialect}'"
    if not options.angles:
        refuse("the number of releases", 0, "at least one")
    for angle in options.angles:
        if slides and (angle == 0 or not math.isfinite(angle)):
            refuse("a release position", f"{angle:g} m", "a position away from rest")
        if not slides and not (abs(angle) > 0 and abs(angle - board.rest_angle) < math.pi / 2):
            refuse("a release angle", f"{math.degrees(angle):g} degrees", "0 to 90 degrees to either side")
    values = {**asdict(options), **asdict(options.sensor)}
    noises = ("noise", "quantisation", "gyro_noise", "accelerometer_noise")
    for name in ("rate", "duration", "push", "hold", "lead", "tremor", "seed", *noises):
        positive = name in ("rate", "duration", "push")
        if not (math.ulp(0.0) if positive else 0.0) <= values[name] < math.inf:
            refuse(
                f"the {name.replace('_', ' ')}",
                values[name],
                "a positive number" if positive else "0 or more",
            )
    if not all(map(math.isfinite, (*options.sensor.lever_arm, options.sensor.gyro_bias))):
        refuse("lever arm or gyro bias", "not finite", "finite numbers")
    seconds = options.lead + len(options.angles) * (options.push + options.hold + options.duration)
    if not seconds * options.rate <= MOST_SAMPLES:
        refuse("the number of samples", f"{seconds * options.rate:.3g}", f"at most {MOST_SAMPLES:.0e}")
    if not 0 <= options.jitter <= 0.3:
        refuse("the jitter", options.jitter, "0 to 0.3 sampling periods, or samples would change places")
    if not 0 <= options.dropout <= 0.9:
        refuse("the dropout", options.dropout, "a share from 0 to 0.9")
    if not options.hand and len(options.angles) > 1:
        refuse("the number of releases without a hand", len(options.angles), "one")
    if slides and options.dialect != "position":
        refuse("the dialect", dialect, "'position' for a joint that slides")
    if not slides and options.dialect == "position":
        refuse("the dialect", dialect, "one of an angle or an IMU for a joint that turns")
    if board.model and options.dialect not in (*ANGLES, "gyro"):
        expected = "an angle or 'gyro': where an IMU sits on a model's joint is not known"
        refuse("the dialect", dialect, expected)
    if options.dialect == "gyro" and "sensor-bias" in effects:
        raise SysidError("effect 'sensor-bias' is an angle and a rate gyro has none; use sensor-drift.")
    if "discretisation" in effects:
        if others := [name for name in effects if not steps(name)]:
            raise SysidError(
                f"effect 'discretisation' cannot be made together with {', '.join(sorted(others))}: "
                "the plain step loop holds smooth laws only."
            )
        if options.jitter:
            raise SysidError("effect 'discretisation' cannot be made with jitter: it moves in steps.")


def _kept(count: int, share: float, rng: np.random.Generator) -> npt.NDArray[np.bool_]:
    kept = np.ones(count, dtype=np.bool_)
    if share > 0:
        # Runs of five on average; each run start is drawn so that the expected share comes out.
        starts = np.flatnonzero(rng.random(count) < -math.log1p(-share) / 5)
        for start, length in zip(starts, rng.geometric(0.2, len(starts)), strict=True):
            kept[start : start + length] = False
        kept[0] = True
    return kept


def _move(
    law: TrueLaw, options: SynthOptions, timestep: float, rng: np.random.Generator
) -> tuple[Array, Array, list[TrueRelease]]:
    """Return true times, shape (n,), motion, shape (n, 3), and releases on the true clock."""
    period = 1.0 / options.rate

    def whole(duration: float) -> float:  # releases fall on samples
        return math.ceil(duration / period - 1e-9) * period

    lead, push, hold = whole(options.lead), whole(options.push), whole(options.hold)
    turn = push + hold + whole(options.duration)
    count = round((lead + turn * len(options.angles)) / period)
    time = np.arange(count, dtype=np.float64) * period
    if options.jitter:
        time = time + options.jitter * period * np.clip(rng.standard_normal(count), -1.5, 1.5)
        time[0] = 0.0
    motion = np.zeros((count, 3))
    condition = Condition.at_rest(law)
    motion[time < lead, 0] = condition.state[0]
    full = options.dialect not in ANGLES
    releases: list[TrueRelease] = []
    for number, angle in enumerate(options.angles):
        begin = lead + number * turn
        let_go, end = begin + push + hold, begin + turn
        start = (float(condition.state[0]), float(condition.state[1]))
        hand = hand_motion(begin, start, angle, push=push, hold=hold, tremor=options.tremor, rng=rng)
        # Half a nanosecond of slack: the sample at the release belongs to the free decay.
        held = slice(*np.searchsorted(time, (begin - 5e-10, let_go - 5e-10)).tolist())
        free = slice(held.stop, int(np.searchsorted(time, end - 5e-10)))
        motion[held] = hand.sample(time[held])
        condition = _led(law, condition, hand)
        angle, rate = condition.state[:2].tolist()
        releases.append(TrueRelease(start=let_go, end=end, angle=angle, rate=rate))
        if timestep:
            motion[free], condition = _stepped(law, condition, let_go, end, time[free], timestep)
        else:
            times = np.maximum(time[free], let_go)
            motion[free], condition = simulate(law, condition, let_go, end, times, accelerations=full)
    return time, motion, releases


def _led(law: TrueLaw, condition: Condition, hand: HandMotion) -> Condition:
    """Return the condition at the release; effects with memory are integrated along the hand's way."""
    if law.has_memory:
        _, condition = simulate(law, condition, hand.begin, hand.end, np.empty(0), hand)
    roll, rate, _ = hand.sample(np.array([hand.end]))[0].tolist()
    state = condition.state.copy()
    state[:2] = roll, rate
    return Condition(state, condition.modes.regions(law, roll - float(state[2]) - law.rest))


def _stepped(
    law: TrueLaw, condition: Condition, begin: float, end: float, times: Array, timestep: float
) -> tuple[Array, Condition]:
    """Move in MuJoCo's implicitfast steps: rate first, implicit in the damping, then roll with that rate.

    Raises:
        SysidError: A sample falls between two steps.
    """
    steps = round((end - begin) / timestep)
    if steps > MOST_SAMPLES:
        raise SysidError(f"a step of {timestep:g} s makes {steps:.3g} steps a release; use a longer one.")
    wanted = (times - begin) / timestep
    index = np.round(wanted).astype(np.int64)
    if np.abs(wanted - index).max(initial=0.0) > 1e-6:
        raise SysidError(
            f"samples fall between the simulator's steps of {timestep:g} s; use a rate of {1 / timestep:g} Hz "
            "or a whole fraction of it."
        )
    roll, rate = condition.state[:2].tolist()
    path = np.empty((steps + 1, 3))
    modes = Modes()
    for step in range(steps + 1):
        x = roll - law.rest
        torque = law.smooth_torque(x, rate, modes) - law.gravity * math.sin(roll)
        path[step] = roll, rate, torque / law.inertia
        slope = law.damping + 2 * law.quadratic_damping * abs(rate) + 3 * law.cubic_damping * rate**2
        rate += timestep * torque / (law.inertia + timestep * slope)
        roll += timestep * rate
        if not abs(roll) < 2 * math.pi:
            raise SysidError(
                f"with steps of {timestep:g} s the motion grows without bound; use a shorter one."
            )
    last = np.array([path[-1, 0], path[-1, 1], 0.0, 0.0, 0.0])  # steps have no memory
    return path[index], Condition(last, modes)
