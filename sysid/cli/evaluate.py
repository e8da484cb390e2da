"""`husky-sysid evaluate`: success, velocity, heading, smoothness, contacts."""

import math
import os
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter

from sysid.cli.console import BoardName, Common, Output, Printer
from sysid.errors import SysidError

if TYPE_CHECKING:
    from policy_runtime.evaluation.plain import Protocol
    from policy_runtime.evaluation.result import Evaluation

CONDITION = Group("Condition", sort_key=0)


@Parameter(name="*", group=CONDITION)
@dataclass(frozen=True, kw_only=True)
class Condition:
    """Conditions of a ride; the easy ones by default."""

    duration: float = 20.0
    """Length of an episode [s]."""
    pushes: float = 0.0
    """Largest change of velocity by shoves, one every 5 to 10 s [m/s]."""
    delay: float = 0.0
    """Delay from the policy's answer to the servos [s]."""
    noise: float = 0.0
    """Noise of the sensors, over that of the training."""
    mass: float = 1.0
    """Factor of the robot's masses and inertias."""
    friction: float | None = None
    """Sliding friction of the soles on ground and deck; the scene's 1.0 if not given."""
    rolling: float = 1.0
    """Factor of the wheels' rolling friction."""
    slope: float = 0.0
    """Gradient of the ground along the start's direction [degrees], uphill positive."""
    push: float = 0.0
    """Force on the pelvis for 0.1 s, in a drawn direction, every 5 to 10 s [N]."""
    terrain: Literal["flat", "slopes", "steps"] = "flat"
    """The ground: level, descents of 5 to 10 degrees, or ledges of 3 to 6 cm to roll down."""
    coupling: Literal["equality", "direct", "none"] = "equality"
    """Steering of the trucks by the deck's tilt: a constraint, set after every step, or none."""
    board_scale: str | None = None
    """Factors of the board's stiffness, damping, inertia and rake, e.g. k=4,rake=0.9."""
    turn_deg: float = 45.0
    """Largest commanded turn [degrees]; 0 for straight on."""
    jump: float = 0.0
    """Time after which speed and turn are drawn anew [s]; 0 for one speed an episode and one turn a cycle."""
    stop: bool = False
    """Command a stop of 9 s on the way."""
    hold_heading: bool = False
    """Correct the heading errors of earlier turns."""
    randomised: bool = False
    """Draw every world as in training: friction, centres of mass, boards (mjlab only)."""

    def protocol(self) -> "Protocol":
        """Return the conditions of the episodes.

        Raises:
            SysidError: A number is out of range.
        """
        from policy_runtime.evaluation.plain import Protocol
        from policy_runtime.evaluation.stress import Stress
        from sim.board.scaled import parse_factors

        if not self.duration > 0:
            raise SysidError(f"--duration {self.duration:g}: must be longer than 0 s.")
        if not self.pushes >= 0:
            raise SysidError(f"--pushes {self.pushes:g}: must not be negative.")
        if not self.jump >= 0:
            raise SysidError(f"--jump {self.jump:g}: must not be negative.")
        if not 0 <= self.turn_deg <= 45:
            raise SysidError(f"--turn-deg {self.turn_deg:g}: policies are trained for 0 to 45°.")
        harder: dict[str, Any] = {field.name: getattr(self, field.name) for field in fields(Stress)}
        stress = Stress(**(harder | {"slope": math.radians(self.slope)}))
        return Protocol(
            duration=self.duration,
            pushes=self.pushes,
            stress=stress,
            terrain=self.terrain,
            coupling=self.coupling,
            board_scale=parse_factors(self.board_scale or ""),
            turn=math.radians(self.turn_deg),
            jump=self.jump,
            stop=self.stop,
            hold_heading=self.hold_heading,
            randomised=self.randomised,
        )


def evaluate(
    policy: str,
    /,
    *others: str,
    board: BoardName,
    episodes: int = 100,
    seeds: int = 5,
    condition: Condition = Condition(),
    suite: Annotated[bool, Parameter(group=CONDITION)] = False,
    simulator: Literal["mujoco", "mjlab"] = "mujoco",
    workers: int | None = None,
    breakdown: bool = False,
    output: Output | None = None,
    force: bool = False,
    common: Common = Common(),
) -> int:
    """Measure a policy, or several, over many episodes.

    Args:
        policy: An ONNX file of our interface or the HUSKY release's, or a scripted policy: zero, stand or push.
        others: More policies, for one table of all.
        board: The board to ride.
        episodes: Episodes of each seed; the paper has 1000.
        seeds: Number of seeds: 0, 1, 2, …
        condition: Conditions of the ride.
        suite: Ride under a table of conditions, one after the other.
        simulator: Plain MuJoCo has the servos at 500 Hz, as on the robot. mjlab, the simulator of the training, runs all
            episodes of a seed in parallel.
        workers: Processes in plain MuJoCo; one a processor if not given.
        breakdown: Show the errors by stretch, command, time within a stretch, and foot. The JSON always has them.
        output: Folder for the picture; reports/BOARD of the workspace if not given.
        force: Run even if policy and board disagree, or the board has not passed `check`.
    """
    from policy_runtime.evaluation.parallel import evaluate_in_parallel
    from policy_runtime.evaluation.plain import Protocol, evaluate_policy, riders
    from policy_runtime.evaluation.suite import SUITE
    from sysid.cli.bars import bar

    if episodes < 1 or seeds < 1:
        raise SysidError(f"--episodes {episodes} --seeds {seeds}: both must be at least 1.")
    given = condition.protocol()
    if suite and given != Protocol():
        raise SysidError("--suite has conditions of its own; leave the options of one condition out.")
    printer = Printer(common)
    policies = (policy, *others)
    printer.keep([Path(name) for name in policies])
    record = common.space.load_board(board)
    processes = workers or len(os.sched_getaffinity(0))
    rides: list[tuple[str, Evaluation]] = []
    with bar(printer) as progress, riders(processes) as pool:
        plain = partial(evaluate_policy, workers=processes, pool=pool)
        measure = evaluate_in_parallel if simulator == "mjlab" else plain
        for name, protocol in SUITE if suite else (("as asked for", given),):
            for one in policies:
                task = progress.add_task(f"{Path(one).stem}, {name}", total=episodes * seeds)
                tell, every = partial(progress.advance, task), tuple(range(seeds))
                result = measure(
                    one, record, episodes=episodes, seeds=every, protocol=protocol, force=force, progress=tell
                )
                rides.append((name, result))
    folder = output or common.space.outputs(record.name)
    title = f"{record.name} in {simulator}: {episodes} episode{'s' * (episodes > 1)} × {seeds} seed{'s' * (seeds > 1)}"
    if len(rides) > 1:
        content = _report_table(rides, title, folder, printer)
    else:
        content = _report_one(rides[0][1], title, simulator, breakdown, folder, printer)
    printer.result(content | {"simulator": simulator, "randomised": condition.randomised})
    return 0


def _report_table(
    rides: "list[tuple[str, Evaluation]]", title: str, folder: Path, printer: Printer
) -> dict[str, Any]:
    """Print and draw one row for each condition and policy; return them for machines."""
    from policy_runtime.evaluation.metrics import METRICS
    from reports.figures.ride import suite_figure
    from sysid.text import in_brackets as text

    errors = (
        "E_vel_mean_speed",
        "E_yaw",
        "E_contact",
        "E_stop",
        "stride_period",
        "foot_travel",
        "slip",
        "style_distance",
    )
    policies = list(dict.fromkeys(one.policy for _, one in rides))
    rows = [
        {
            "condition": name,
            "policy": one.policy,
            "E_succ": text(one.success),
            "standing": text(one.standing),
            "median": f"{one.median_duration:.0f} s",
            **{f"{error} [{METRICS[error]}]": text(one.errors[error]) for error in errors},
        }
        for name, one in rides
    ]
    printer.records(rows, f"{', '.join(policies)} on {title}")
    picture = folder / f"suite-{'-'.join(policies)}.png"
    suite_figure([(name, one.policy, one.success) for name, one in rides], title, picture)
    printer.say(f"picture: {picture}")
    return {
        "policies": policies,
        "conditions": [{"name": name} | one.to_json() for name, one in rides],
        "picture": str(picture),
    }


def _report_one(
    result: "Evaluation", title: str, simulator: str, breakdown: bool, folder: Path, printer: Printer
) -> dict[str, Any]:
    """Print and draw everything of one evaluation; return it for machines."""
    from policy_runtime.evaluation.metrics import METRICS
    from policy_runtime.evaluation.strides import clip_ranges
    from reports.figures.ride import paths_figure
    from sysid.text import in_brackets as text

    rows = [("E_succ", result.success), ("standing", result.standing)]
    rows += [(name, result.errors[name]) for name in METRICS]
    rows.append(("episode length", result.duration))
    title = f"{result.policy} on {title}"
    clips = {name: f"{low:.3g} to {high:.3g}" for name, (low, high) in clip_ranges().items()}
    head = ("quantity", "value and 95 %", "reference clips", "unit", "how")
    body = [(name, text(v), clips.get(name, ""), v.printed_unit, v.method) for name, v in rows]
    printer.table(head, body, title)
    endings = ", ".join(f"{ending} {count}" for ending, count in result.endings.items())
    printer.say(f"endings: {endings}")
    if breakdown:
        for table in result.tables:
            head, *body = table.texts()
            if body:
                printer.table(head, body, table.title)
    picture = folder / f"evaluate-{result.policy}-{simulator}.png"
    paths_figure(result.paths, result.headings, title, picture)
    printer.say(f"picture: {picture}")
    return {**result.to_json(), "picture": str(picture)}
