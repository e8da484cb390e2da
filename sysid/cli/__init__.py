"""The command line: `husky-sysid COMMAND`.

Each command is one file beside this one and is imported only when it is called, so that
`husky-sysid --help` answers at once.
"""

import contextlib
import os
import sys
from math import isfinite
from typing import TYPE_CHECKING, NamedTuple, NoReturn

from sysid.cli.streams import drop_output, listen, one_line, open_streams, stop_listening
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
        (
            "fit monday.csv tuesday.csv --board pink --effect coulomb --profile",
            "fit swing.csv --model robot.xml --joint knee --effect coulomb",
        ),
        "any_joint.md",
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
    "loaded": Command(
        "Measure the tilt spring under load, from decays with weights on the deck.",
        ("loaded --board pink --reading 0,0,bare.json --reading 5,10cm,w5.json --reading 10,10cm,w10.json",),
        "boards.md",
    ),
    "rollout": Command(
        "Measure rake and rolling resistance from a board that rolls by itself.",
        ("rollout film.csv --board pink", "rollout imu.csv --board pink --slope-deg -2 --save"),
        "boards.md",
    ),
    "effects": Command(
        "List the effects with their laws, show one, or write a file for one of your own.",
        ("effects", "effects coulomb", "effects new my_effect"),
        "effects.md",
    ),
    "boards": Command(
        "List boards, their parameters and whether they passed the check.",
        ("boards", "boards pink"),
        "boards.md",
    ),
    "new": Command(
        "Write the smallest record: a board, a pendulum, a torsion rig, a joint of a model.",
        (
            "new arm --kind pendulum --mass 0.49±0.002 --arm 0.1±0.001",
            "new knee --model robot.xml --joint knee",
        ),
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
    "batch": Command(
        "Run many logs of many boards in parallel, into one table and one page.",
        ("batch week.toml", "batch week.csv --workers 8", "batch week.toml --cluster tcp://head:8786"),
        "batch.md",
    ),
    "view": Command(
        "Show logs and model of a board in Rerun.",
        ("view --board pink", "view film.mp4 --board pink -o film.rrd"),
        "tutorial.md",
    ),
    "live": Command(
        "Read a phone while the board rocks: k, d and what to do next after each release.",
        ("live --board pink --phone 192.168.0.42:8080", "live --board pink --watch logs"),
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
        help=f"Find out why a MuJoCo joint does not behave like the real one, and correct it.\n\n{EXIT_CODES}",
        version=lambda: version("husky-sysid"),
        config=_require_finite,
        suppress_keyboard_interrupt=False,
    )
    app.register_install_completion_command(
        help="Let the shell complete commands and options (bash, zsh, fish)."
    )
    for name, command in COMMANDS.items():
        more = {} if command.has_parts else {"help_epilogue": epilogue(name)}
        app.command(f"sysid.cli.{name}:{name}", name=name, help=command.help, **more)
    return app


def _require_finite(_app: object, _commands: object, arguments: "cyclopts.ArgumentCollection") -> None:
    """Accept the numbers of a command line: none of them is nan or infinite.

    Raises:
        cyclopts.ValidationError: One is; it names the option.
    """
    from cyclopts import ValidationError

    for argument in arguments:
        if "float" not in str(argument.hint):  # alone, in a tuple, or where it may be left out
            continue
        for token in argument.tokens:
            with contextlib.suppress(ValueError):  # what is no number is told later, as of any kind
                if not isfinite(float(token.value)):
                    raise ValidationError(
                        exception_message="Must be a finite number.", argument=argument, value=token.value
                    )


def main() -> None:
    """Run the command line and exit with its code."""
    try:
        listen()
        open_streams()
        require_own_packages()
        try:
            build_app()()
        finally:
            sys.stdout.flush()
    except BaseException as error:
        _end(error)
        raise


def require_own_packages() -> None:
    """Make sure that `sysid` and `reports` are this tool's: other projects have packages of these names.

    Raises:
        SysidError: One of them is another's.
    """
    from importlib.util import find_spec

    root = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))  # noqa: PTH100, PTH120  starts sooner
    for name in ("sysid", "reports"):
        found = find_spec(name)
        where = None if found is None else found.origin
        own = os.path.join(root, name, "__init__.py")  # noqa: PTH118
        lost = name == "sysid" and "Recording" not in getattr(sys.modules[name], "__all__", ())
        if where != own or lost:
            raise SysidError(
                f"the package '{name}' that Python finds is another project's ({where}), and husky-sysid has one of that "
                "name. Install husky-sysid into an environment of its own, and run it where no such folder lies."
            )


def _end(error: BaseException) -> None:
    """Say in one line why a command ended, and exit; come back where it was nothing that was expected."""
    number = stop_listening()
    if isinstance(error, BrokenPipeError):  # the reader (head, less) has gone
        drop_output()
        raise SystemExit(0) from None
    if number is not None and not isinstance(error, SystemExit):
        _fail("interrupted; no file is left half-written", 128 + number)
    if isinstance(error, SysidError):
        _fail(str(error), error.exit_code)
    if isinstance(error, MemoryError):
        _fail("out of memory. Give a shorter log, or fewer at once.", 1)
    if isinstance(error, OSError):
        drop_output()
        _fail(f"{error.filename or 'standard output'}: {error.strerror or error}.", 1)


def _fail(message: str, code: int) -> NoReturn:
    """Say the one line that a user sees, and exit."""
    with contextlib.suppress(OSError):
        print(f"error: {one_line(message)}", file=sys.stderr, flush=True)  # noqa: T201
    raise SystemExit(code) from None
