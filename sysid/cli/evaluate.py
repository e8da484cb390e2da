"""`husky-sysid evaluate`: success, velocity, heading, smoothness, contacts."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter
from cyclopts.validators import Number

from policy_runtime.evaluation.protocol import Protocol
from sysid.cli.console import BoardName, Common, Output, Printer
from sysid.cli.parameter_options import parse_fixed
from sysid.errors import SysidError, UsageError
from sysid.text import count

if TYPE_CHECKING:
    from policy_runtime.evaluation.result import Evaluation

CONDITION = Group("Condition", sort_key=0)


def _radians(_: object, tokens: Sequence[Any]) -> float:
    """Read an option in degrees."""
    return math.radians(float(tokens[0].value))


def _factors(_: object, tokens: Sequence[Any]) -> dict[str, float]:
    """Read 'k=4,rake=0.9'."""
    return parse_fixed(tokens[0].value.split(","), "--board-scale")


@Parameter(name="*", group=CONDITION)
@dataclass(frozen=True, kw_only=True)
class Condition(Protocol):
    """Conditions of a ride."""

    slope: Annotated[float, Parameter(converter=_radians, allow_leading_hyphen=True)] = 0.0
    """Gradient of the ground along the start's direction [degrees], uphill positive."""
    board_scale: Annotated[
        Mapping[str, float], Parameter(converter=_factors, n_tokens=1, accepts_keys=False, show_default=False)
    ] = field(default_factory=dict[str, float])
    """Factors of the board's stiffness, damping, inertia and rake, e.g. k=4,rake=0.9."""
    speed: Annotated[tuple[float, float], Parameter(parse=False)] = Protocol.speed
    turn: Annotated[
        float,
        Parameter(name="--turn-deg", converter=_radians, show_default=lambda turn: f"{math.degrees(turn):g}"),
    ] = Protocol.turn
    """Largest commanded turn [degrees]; 0 for straight on."""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Effort:
    """Number of rides, and where they run."""

    episodes: Annotated[int, Parameter(validator=Number(gte=1))] = 100
    """Episodes of each seed; the paper has 1000."""
    seeds: Annotated[int, Parameter(validator=Number(gte=1))] = 5
    """Number of seeds: 0, 1, 2, …"""
    simulator: Literal["mujoco", "mjlab"] = "mujoco"
    """Plain MuJoCo has the servos at 500 Hz, as on the robot. mjlab, the simulator of the training, runs all episodes of a
    seed in parallel."""
    workers: int | None = None
    """Processes in plain MuJoCo; one a processor if not given."""


def evaluate(
    policy: str,
    /,
    *others: str,
    board: BoardName,
    effort: Effort = Effort(),
    condition: Condition = Condition(),
    suite: Annotated[bool, Parameter(group=CONDITION)] = False,
    output: Output | None = None,
    force: bool = False,
    common: Common = Common(),
) -> None:
    """Measure a policy, or several, over many episodes.

    Args:
        policy: An ONNX file of our interface or the HUSKY release's, or a scripted policy: zero, stand or push.
        others: More policies, for one table of all.
        board: The board to ride.
        condition: Conditions of the ride.
        suite: Ride under a table of conditions, one after the other.
        output: Folder for the picture; reports/BOARD of the workspace if not given.
        force: Run even if policy and board disagree, or the board has not passed `check`.
    """
    from policy_runtime.evaluation.parallel import evaluate_in_parallel
    from policy_runtime.evaluation.plain import evaluate_policy, riders
    from policy_runtime.evaluation.suite import SUITE
    from sysid.cli.bars import bar

    if not 0 <= condition.turn <= math.radians(45):
        raise SysidError(f"--turn-deg {math.degrees(condition.turn):g}: policies are trained for 0 to 45°.")
    if suite and condition != Condition():
        raise UsageError("--suite has conditions of its own; leave the options of one condition out.")
    printer = Printer(common)
    policies = (policy, *others)
    printer.keep([Path(name) for name in policies])
    record = common.space.load_board(board)
    processes = effort.workers or len(os.sched_getaffinity(0))
    rides: list[tuple[str, Evaluation]] = []
    size: Any = {"episodes": effort.episodes, "seeds": tuple(range(effort.seeds))}
    with bar(printer) as progress, riders(processes) as pool:
        plain = partial(evaluate_policy, pool=pool)
        measure = evaluate_in_parallel if effort.simulator == "mjlab" else plain
        for name, protocol in SUITE if suite else (("as asked for", condition),):
            for one in policies:
                task = progress.add_task(f"{Path(one).stem}, {name}", total=effort.episodes * effort.seeds)
                told = partial(progress.advance, task)
                result = measure(one, record, **size, protocol=protocol, force=force, progress=told)
                rides.append((name, result))
    folder = output or common.space.outputs(record.name)
    named = "-".join(dict.fromkeys(one.policy for _, one in rides))
    report, kind = (_report_table, "suite") if len(rides) > 1 else (_report_one, "evaluate")
    picture = folder / f"{kind}-{named}-{effort.simulator}.png"
    rode = f"{count(effort.episodes, 'episode')} × {count(effort.seeds, 'seed')}"
    content = report(rides, f"{record.name} in {effort.simulator}: {rode}", picture, printer)
    content |= {"simulator": effort.simulator, "randomised": condition.randomised, "picture": str(picture)}
    printer.result(content, picture)


def _report_table(
    rides: "list[tuple[str, Evaluation]]", title: str, picture: Path, printer: Printer
) -> dict[str, Any]:
    """Print and draw one row for each condition and policy; return them for machines."""
    from policy_runtime.evaluation.metrics import METRICS
    from reports.figures.ride import suite_figure
    from sysid.text import in_brackets as text

    errors = ["E_vel_mean_speed", "E_yaw", "E_contact", "E_stop"]
    errors += ["stride_period", "foot_travel", "slip", "style_distance"]
    policies = list(dict.fromkeys(one.policy for _, one in rides))
    head = ["condition", "policy", "E_succ", "standing", "median [s]"]
    rows = [
        [name, one.policy, text(one.success), text(one.standing), f"{one.median_duration:.0f}"]
        + [text(one.errors[error]) for error in errors]
        for name, one in rides
    ]
    head += [f"{error} [{METRICS[error]}]" for error in errors]
    printer.table(head, rows, f"{', '.join(policies)} on {title}")
    suite_figure([(name, one.policy, one.success) for name, one in rides], title, picture)
    return {"policies": policies, "conditions": [{"name": name} | one.to_json() for name, one in rides]}


def _report_one(
    rides: "list[tuple[str, Evaluation]]", title: str, picture: Path, printer: Printer
) -> dict[str, Any]:
    """Print and draw everything of one evaluation; return it for machines."""
    from policy_runtime.evaluation.metrics import METRICS, clip_ranges
    from reports.figures.ride import paths_figure
    from sysid.text import in_brackets as text

    ((_, result),) = rides
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
    paths_figure(result.paths, result.headings, title, picture)
    return result.to_json()
