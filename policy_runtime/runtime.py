"""The loop that runs a policy: 50 decisions a second over servos that step 500 times a second.

Every tick reads the robot, checks it, asks the policy, checks the answer and sends it. A failed check ends the
run in a damped stop: the servos only brake, until the robot has come down.
"""

import gc
import time
from array import array
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from policy_runtime.loop.commands import Command, CommandSource
from policy_runtime.loop.course import Course
from policy_runtime.loop.policy import Policy
from policy_runtime.loop.preparation import Delay, Preparation, StoppedError, prepare
from policy_runtime.loop.safety import Guard, Limits, finite
from policy_runtime.robots import BEGIN, PD_PERIOD, SERVO_STEPS, STAND, JointCommand, Robot, RobotState
from sim.skate.cycle.clock import CONTROL_PERIOD, STILL_SPEED, Clock
from sysid.roll import Array

STOP_TIME = 1.5
"""How long the servos brake after a stop [s]."""
INTERRUPTED = "interrupted"
"""Why a run stopped that was interrupted from the keyboard or by a signal."""


class Tick(NamedTuple):
    """One policy step, for recorders."""

    time: float
    """Since the start of the run [s]."""
    step: int
    """Policy steps since the cycle began."""
    state: RobotState
    command: Command
    target: Array
    """Joint targets [rad], shape (23,)."""
    action: Array
    """The policy's answer in its own units, shape (23,)."""
    course: float
    """Sum of the commanded turns since the start [rad]; `command` has the policy's turn."""


class Event(NamedTuple):
    """One line of the run's log."""

    time: float
    """Since the start of the run [s]."""
    kind: str
    """'wait', 'ramp', 'delay' and 'ready' while the robot is prepared; 'start' or, with the policy held back, 'dry';
    'stop' or 'end'."""
    text: str


TIMES = ("decide", "tick", "late", "age")
"""Of a tick [s]: its decision from reading to sending; all of it without sleep and recording; how late it began in real time.
The last is the age of the state that it decided on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """How a run went."""

    ticks: int
    stopped: str | None
    """Why it was stopped; None if it ended as planned."""
    events: tuple[Event, ...]
    times: Array
    """Columns of `TIMES` [s], shape (ticks, 4)."""
    delay: Delay | None = None
    """From command to measured torque; None where the robot was not prepared."""

    @property
    def duration(self) -> float:
        """Time during which the policy was in charge [s]."""
        return self.ticks * CONTROL_PERIOD

    def timing(self) -> dict[str, dict[str, float]]:
        """Return median, 99th percentile and maximum of each column of `times` [ms]; nothing without a tick."""
        if not len(self.times):
            return {}
        rows = np.percentile(self.times, (50, 99, 100), axis=0).T * 1e3
        names = ("p50_ms", "p99_ms", "max_ms")
        return {
            name: dict(zip(names, row.tolist(), strict=True)) for name, row in zip(TIMES, rows, strict=True)
        }

    def to_json(self) -> dict[str, Any]:
        """Return the result for machines."""
        return {
            "ticks": self.ticks,
            "duration_s": self.duration,
            "stopped": self.stopped,
            "events": [{"t_s": event.time, "kind": event.kind, "text": event.text} for event in self.events],
            "timing": self.timing(),
            "delay": None if self.delay is None else self.delay.to_json(),
        }


@dataclass(kw_only=True)
class Runtime:
    """One policy on one robot."""

    robot: Robot
    policy: Policy
    commands: CommandSource
    limits: Limits
    real_time: bool = False
    """Wait for the wall clock; a simulated robot runs as fast as it can without."""
    on_tick: Callable[[Tick], None] | None = None
    """Called once a tick, after the decision."""
    on_event: Callable[[Event], None] | None = None
    """Called for every line of the log as it is written."""
    stop_time: float = STOP_TIME
    """How long the servos brake after a stop [s]."""
    hold_heading: bool = False
    """Correct the heading errors of earlier turns in each commanded turn."""
    preparation: Preparation | None = None
    """Way of the robot to the start pose; None if it is there already."""

    def run(self, duration: float = float("inf")) -> RunResult:
        """Run until the longest time [s] is over, the commands end, or a check stops the robot."""
        return _Run(self).go(duration)


class _Run:
    """The state of one run."""

    def __init__(self, runtime: Runtime) -> None:
        self._runtime = runtime
        self.robot = runtime.robot
        self._guard = Guard(runtime.limits, CONTROL_PERIOD)
        self._events: list[Event] = []
        self._times = array("d")
        self._ticks = self._step = 0
        self._course = Course(hold=runtime.hold_heading)
        self._turn, self._stands = 0.0, False
        self._slept = 0.0
        self._delay: Delay | None = None
        preparation = runtime.preparation
        self._dry = preparation.pose if preparation is not None and preparation.dry else None

    def go(self, duration: float) -> RunResult:
        try:
            if self._runtime.preparation is not None:
                self._due = time.perf_counter()
                self._delay = prepare(self._runtime.preparation, self, self._log)
            state = self._read()
            self._runtime.policy.reset(state)
            self._log("start" if self._dry is None else "dry", f"policy '{self._runtime.policy.name}'")
            self._loop(duration)
            stopped = None
        except StoppedError as stop:
            stopped = str(stop)
        except KeyboardInterrupt:
            stopped = INTERRUPTED
        except BaseException as error:
            self._finish(f"failed: {error!r}")  # whatever went wrong, the robot must not go on by itself
            raise
        finally:
            gc.unfreeze()
        self._finish(stopped)
        return RunResult(
            ticks=self._ticks,
            stopped=stopped,
            events=tuple(self._events),
            times=np.asarray(self._times).reshape(-1, len(TIMES)),
            delay=self._delay,
        )

    def tick(self, command: JointCommand) -> RobotState:
        """See `preparation.Ticks`."""
        state = self._read()
        self.robot.send(command)
        for _ in range(SERVO_STEPS):
            self.servo_step()
        return state

    def servo_step(self) -> None:
        """See `preparation.Ticks`."""
        self.robot.step()
        if self._runtime.real_time:
            self._due += PD_PERIOD
            self._wait(self._due)

    def _read(self) -> RobotState:
        """Return the robot's state if it is well, else raise `StoppedError`."""
        state = self.robot.read()
        stopped = self._guard.check(state)
        if stopped is not None:
            raise StoppedError(stopped)
        return state

    def _loop(self, duration: float) -> None:
        """Decide and step until the end."""
        runtime = self._runtime
        gc.freeze()  # objects of the start stay: the collector need not scan them during a tick
        start = self._due = time.perf_counter()
        while self._ticks * CONTROL_PERIOD < duration - 1e-9:
            begin = time.perf_counter()
            tick = self._decide()
            decided = time.perf_counter()
            if tick is None:
                return
            if runtime.on_tick is not None:
                runtime.on_tick(tick)
            recorded = time.perf_counter()
            due = start + self._ticks * CONTROL_PERIOD
            for _ in range(SERVO_STEPS):
                self.servo_step()
            late = max(0.0, begin - due) if runtime.real_time else 0.0
            spent = time.perf_counter() - recorded + decided - begin - self._slept
            self._times.extend((decided - begin, spent, late, tick.state.age))
            self._ticks += 1

    def _decide(self) -> Tick | None:
        """Read, check, ask, send; return the tick, or None after the last command."""
        self._slept = 0.0
        runtime, now = self._runtime, self._ticks * CONTROL_PERIOD
        state = self._read()
        wanted = runtime.commands.at(now)
        if wanted is None:
            return None
        if {STAND, BEGIN} & state.buttons:
            self._stands = STAND in state.buttons
        command = self._latch(state, wanted._replace(speed=0.0) if self._stands else wanted)
        target = runtime.policy.act(state, command, self._step)
        if not finite(target):
            raise StoppedError("not finite: the policy's answer holds NaN or infinity")
        self.robot.send(JointCommand.hold(target if self._dry is None else self._dry))
        tick = Tick(now, self._step, state, command, target, runtime.policy.action, self._course.asked)
        self._step = int(Clock().after(self._step, command.speed < STILL_SPEED))
        return tick

    def _latch(self, state: RobotState, wanted: Command) -> Command:
        """Take speed at once, but a turn only when steering begins: it counts from the heading then; till the first, straight on."""
        turn = self._course.follow(state, self._step, wanted.turn)
        if turn is not None:
            self._turn = turn
        return Command(wanted.speed, self._turn)

    def _finish(self, stopped: str | None) -> None:
        if stopped is not None:
            self._log("stop", stopped)
        else:
            self._log("end", f"after {self._ticks * CONTROL_PERIOD:.1f} s")
        self.robot.send(JointCommand.brake())
        self._due = time.perf_counter()
        for _ in range(round(self._runtime.stop_time / PD_PERIOD)):
            self.servo_step()

    def _wait(self, until: float) -> None:
        now = time.perf_counter()
        if until > now:
            time.sleep(until - now)
            self._slept += time.perf_counter() - now

    def _log(self, kind: str, text: str) -> None:
        event = Event(self._ticks * CONTROL_PERIOD, kind, text)
        self._events.append(event)
        if self._runtime.on_event is not None:
            self._runtime.on_event(event)
