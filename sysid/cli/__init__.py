"""The command line: `husky-sysid COMMAND`.

Each command is one file beside this one and is imported only when it is called, so that
`husky-sysid --help` answers at once.
"""

import sys
from typing import TYPE_CHECKING, NamedTuple

from sysid.errors import SysidError

if TYPE_CHECKING:
    import cyclopts

EXIT_CODES = """Exit codes: 0 good; 1 input or computation failed; 2 usage; 3 the quality gate said no."""


class Command(NamedTuple):
    """What `--help` says of a command before it is imported."""

    help: str
    examples: tuple[str, ...]
    """Command lines, without the program's name."""
    page: str
    """Where to read on, in docs/."""
    has_parts: bool = False
    """Whether it is an application of its own, with commands in it."""


COMMANDS = {
    "decay": Command(
        "Roll log in; log decrement, damping ratio, natural frequency, k and d out.",
        ("decay tip.csv --board pink", "decay tip.csv", "decay film.mp4 --board pink --method edge"),
        "tutorial.md",
    ),
    "roll": Command(
        "Extract the roll angle of any log or video into a CSV file.",
        ("roll film.mp4 -o roll.csv --overlay seen.mp4", "roll film.mp4 -o roll.csv --align imu.csv"),
        "video.md",
    ),
    "fit": Command(
        "Fit the MuJoCo tilt joint to logs and save it in the board record.",
        ("fit tip.csv --board pink", "fit monday.csv tuesday.csv --board pink --effect coulomb --profile"),
        "intervals.md",
    ),
    "compare": Command(
        "Compare the simulated with the measured decay: how far off, and where.",
        ("compare tip.csv --board pink", "compare tip.csv --board pink --rerun tip.rrd"),
        "tutorial.md",
    ),
    "diagnose": Command(
        "Rank the physical effects that the model is missing.",
        ("diagnose tip.csv --board pink", "diagnose monday.csv tuesday.csv --board pink --json found.json"),
        "diagnosis.md",
    ),
    "check": Command(
        "Check that the MuJoCo scene reproduces the measured decay; exit 0 or 3.",
        ("check tip.csv --board pink", "check tip.csv --board pink --scene-file my_scene.xml --joint tilt"),
        "lying_scene.md",
    ),
    "mjcf": Command(
        "Write the board as MJCF.",
        ("mjcf --board pink -o board.xml", "mjcf --board pink --bench --timestep 0.002 -o rig.xml"),
        "boards.md",
    ),
    "inertia": Command(
        "Roll inertia from dimensions, parts, swings, weights or two decays.",
        (
            "inertia cuboid --mass 2.58±0.05 --width 20cm --height 2cm",
            "inertia bifilar --mass 2.58 --separation 150mm --length 1.2 --period 1.692±0.005 --save pink",
        ),
        "inertia.md",
        has_parts=True,
    ),
    "boards": Command(
        "List boards, their parameters and whether they passed the check.",
        ("boards", "boards pink"),
        "boards.md",
    ),
    "history": Command("Show how a board's record came about.", ("history --board pink",), "boards.md"),
    "undo": Command(
        "Put a board's record back to what it was before the last change.",
        ("undo --board pink",),
        "boards.md",
    ),
    "synth": Command(
        "Make a synthetic log with a known truth.",
        (
            "synth --board pink --releases 3 -o log.csv",
            "synth --board pink --effect coulomb=0.15 --dialect phyphox -o log.zip",
        ),
        "synthetic-logs.md",
    ),
    "report": Command(
        "Write one self-contained HTML file with everything known of a board.",
        ("report --board pink", "report tip.csv --board pink -o pink.html"),
        "tutorial.md",
    ),
    "view": Command(
        "Show logs and model of a board in Rerun.",
        ("view --board pink", "view film.mp4 --board pink -o film.rrd"),
        "tutorial.md",
    ),
    "marker": Command(
        "Print a page with markers for films, and how to fix and film them.",
        ("marker", "marker --number 4 -o marker.png"),
        "video.md",
    ),
    "motions": Command(
        "List, plot and play reference motions.", ("motions", "motions --plot motions.png"), "training.md"
    ),
    "train": Command(
        "Train a policy for a board.",
        ("train --board pink", "train --board pink --minutes 30"),
        "training.md",
    ),
    "evaluate": Command(
        "Measure a policy: success, velocity, heading, smoothness, contacts.",
        ("evaluate data/policies/pink.onnx --board pink",),
        "training.md",
    ),
    "paper": Command(
        "Make the HUSKY paper's tables and figures from trained policies.",
        ("paper", "paper main curves --episodes 20 --seeds 3"),
        "training.md",
    ),
    "play": Command(
        "Show a policy in Rerun or in the MuJoCo viewer.",
        ("play data/policies/pink.onnx --board pink", "play data/policies/pink.onnx --board pink --viewer"),
        "runtime.md",
    ),
    "export": Command(
        "Pack scene, policy and board record into one folder that runs by itself.",
        ("export --board pink --policy data/policies/pink.onnx -o pink_on_g1",),
        "runtime.md",
    ),
    "run": Command(
        "Run a policy in real time, in MuJoCo or on the robot.",
        ("run data/policies/pink.onnx --board pink", "run pink_on_g1 --robot unitree --interface eth0"),
        "runtime.md",
    ),
}
"""Every command, in the order of the help."""


def epilogue(name: str) -> str:
    """Return what stands below the options in a command's help: examples, and where to read on."""
    command = COMMANDS[name]
    lines = "\n".join(f"husky-sysid {example}" for example in command.examples)
    return f"Examples:\n\n```\n{lines}\n```\n\nRead on: docs/{command.page}"


def build_app() -> "cyclopts.App":
    """Return the application; commands are named here and imported when called."""
    from importlib.metadata import version

    import cyclopts

    app = cyclopts.App(
        name="husky-sysid",
        help=f"Find out why a MuJoCo joint does not behave like the real one, and mend it.\n\n{EXIT_CODES}",
        version=lambda: version("husky-sysid"),
    )
    for name, command in COMMANDS.items():
        more = {} if command.has_parts else {"help_epilogue": epilogue(name)}
        app.command(f"sysid.cli.{name}:{name}", name=name, help=command.help, **more)
    return app


def main() -> None:
    """Run the command line and exit with its code."""
    try:
        build_app()()
    except SysidError as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201  the one line a user sees
        raise SystemExit(error.exit_code) from None
    except BrokenPipeError:  # the reader (head, less) has gone
        raise SystemExit(0) from None
    except KeyboardInterrupt:
        print("error: interrupted; no file is left half-written", file=sys.stderr)  # noqa: T201
        raise SystemExit(130) from None
