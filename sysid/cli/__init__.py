"""The command line: `husky-sysid COMMAND`.

Each command is one file beside this one and is imported only when it is called, so that
`husky-sysid --help` answers at once.
"""

import contextlib
import os
import sys
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

from sysid.cli.streams import drop_output, listen, one_line, open_streams, stop_listening
from sysid.errors import SysidError

if TYPE_CHECKING:
    import cyclopts

EXIT_CODES = """Exit codes: 0 good; 1 input or computation failed; 2 usage; 3 the quality gate said no."""


class Command(NamedTuple):
    """Help of a command, known before its module is imported."""

    help: str
    examples: tuple[str, ...]
    """Command lines, without the program's name."""
    page: str
    """Its page in docs/."""
    first: str = ""
    """Options of its help's first screen; all of them if left out. `--help-all` shows the others too."""
    has_parts: bool = False
    """Whether it is an application of its own, with commands in it."""


JOINT, COLUMNS, OUTPUT = "--board --model --joint --pose", "--column --unit --axis", "--json --workspace"
LOG = f"{COLUMNS} --from --to"
RIDE = "--board --duration --speed --turn-deg --commands --viewer --force --output"
COMMANDS = {
    "decay": Command(
        "Measure stiffness, damping and frequency from a log.",
        ("decay tip.csv --board pink", "decay tip.csv", "decay film.mp4 --board pink --method edge"),
        "tutorial.md",
        f"{JOINT} {LOG} --picture {OUTPUT}",
    ),
    "roll": Command(
        "Extract the angle of any log or film into a CSV file.",
        ("roll film.mp4 -o roll.csv --overlay seen.mp4", "roll film.mp4 -o roll.csv --align imu.csv"),
        "video.md",
        f"--output {LOG} --rate --method --align --overlay {OUTPUT}",
    ),
    "fit": Command(
        "Fit the joint to logs and save it in its record.",
        (
            "fit monday.csv tuesday.csv --board pink --effect coulomb --profile",
            "fit swing.csv --model robot.xml --joint knee --effect coulomb",
        ),
        "any_joint.md",
        f"{JOINT} {COLUMNS} --effect --fix --profile --output {OUTPUT}",
    ),
    "compare": Command(
        "Compare simulated with measured: how far off, and where.",
        ("compare tip.csv --board pink", "compare tip.csv --board pink --rerun tip.rrd"),
        "tutorial.md",
        f"{JOINT} {LOG} --tolerance --rerun {OUTPUT}",
    ),
    "diagnose": Command(
        "Name the physical effect that the model is missing.",
        ("diagnose tip.csv --board pink", "diagnose monday.csv tuesday.csv --board pink --json found.json"),
        "diagnosis.md",
        f"{JOINT} {LOG} --fix {OUTPUT}",
    ),
    "check": Command(
        "Check that the MuJoCo scene moves as measured; exit 0 or 3.",
        ("check tip.csv --board pink", "check tip.csv --board pink --scene-file my_scene.xml --joint tilt"),
        "lying_scene.md",
        f"{JOINT} {COLUMNS} --tolerance --scene-file --timestep --export {OUTPUT}",
    ),
    "mjcf": Command(
        "Write the board as MJCF.",
        ("mjcf --board pink -o board.xml", "mjcf --board pink --bench --timestep 0.002 -o rig.xml"),
        "boards.md",
    ),
    "inertia": Command(
        "Find the inertia from dimensions, parts, swings, weights or two decays.",
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
    "coast-down": Command(
        "Measure rake and rolling resistance from a board that rolls by itself.",
        ("coast-down film.csv --board pink", "coast-down imu.csv --board pink --slope-deg -2 --save"),
        "boards.md",
        f"--board --slope-deg --rest --free --save {LOG} {OUTPUT}",
    ),
    "effects": Command(
        "List the effects, show one, or write a file for one of your own.",
        ("effects", "effects coulomb", "effects new my_effect"),
        "effects.md",
    ),
    "boards": Command(
        "List records, their numbers, and whether they passed the check.",
        ("boards", "boards pink"),
        "boards.md",
    ),
    "new": Command(
        "Write the smallest record of a joint.",
        (
            "new arm --kind pendulum --mass 0.49±0.002 --arm 0.1±0.001",
            "new knee --model robot.xml --joint knee",
        ),
        "boards.md",
    ),
    "history": Command(
        "Show how a board's record came about.",
        ("history --board pink",),
        "boards.md",
    ),
    "undo": Command(
        "Undo the last change of a record.",
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
        f"--board --model --joint --effect --releases --release-angle --rate --noise --dialect --seed --output {OUTPUT}",
    ),
    "report": Command(
        "Write one HTML file with everything known of a joint.",
        ("report --board pink", "report tip.csv --board pink -o pink.html"),
        "tutorial.md",
        f"{JOINT} {COLUMNS} --tolerance --output {OUTPUT}",
    ),
    "batch": Command(
        "Run many logs in parallel, into one table and one page.",
        ("batch week.toml", "batch week.csv --workers 8", "batch week.toml --cluster tcp://head:8786"),
        "batch.md",
    ),
    "view": Command(
        "Show logs and model in Rerun.",
        ("view --board pink", "view film.mp4 --board pink -o film.rrd"),
        "tutorial.md",
        f"{JOINT} {LOG} --output {OUTPUT}",
    ),
    "live": Command(
        "Read a phone while the board rocks; k and d after each release.",
        ("live --board pink --phone 192.168.0.42:8080",),
        "tutorial.md",
        f"--phone --releases {JOINT} {COLUMNS} {OUTPUT}",
    ),
    "marker": Command(
        "Print a page with markers for films, and how to fix and film them.",
        ("marker", "marker --number 4 -o marker.png"),
        "video.md",
    ),
    "motions": Command(
        "List, plot and play reference motions.",
        ("motions", "motions --plot motions.png"),
        "runtime.md",
    ),
    "train": Command(
        "Train a policy for a board.",
        ("train --board pink", "train --board pink --minutes 30"),
        "training.md",
        f"--board --minutes --resume --gpus --environments --iterations --seed --force --output {OUTPUT}",
    ),
    "evaluate": Command(
        "Measure a policy: success, velocity, heading, smoothness, contacts.",
        ("evaluate pink-strides --board pink",),
        "runtime.md",
        f"--board --episodes --seeds --simulator --workers --suite --duration --force --output {OUTPUT}",
    ),
    "play": Command(
        "Show a policy in Rerun or in the MuJoCo viewer.",
        ("play pink-strides --board pink", "play pink-strides --board pink --viewer"),
        "runtime.md",
        f"{RIDE} --terrain {OUTPUT}",
    ),
    "export": Command(
        "Pack scene, policy and board record into one folder that runs by itself.",
        ("export --board pink --policy data/policies/pink-strides.onnx -o pink_on_g1",),
        "runtime.md",
    ),
    "run": Command(
        "Run a policy in real time, in MuJoCo or on the robot.",
        ("run pink-strides --board pink", "run pink_on_g1 --robot unitree --interface eth0"),
        "runtime.md",
        f"{RIDE} --robot --interface --dry-run {OUTPUT}",
    ),
}
"""Every command."""
GROUPS = {
    "The loop": ("decay", "compare", "diagnose", "fit", "check", "mjcf", "report"),
    "Logs": ("live", "view", "synth", "batch"),
    "Joints": ("new", "boards", "inertia", "effects"),
    "Policies": ("train", "evaluate", "play", "run", "export"),
}
"""Commands of the first screen, in the order in which they are used; `--help-all` lists the others too."""
ALIASES = {"rollout": "coast-down"}
"""Names of version 0.1, which still work, and the commands that they mean."""
PURPOSE = "Find out why a MuJoCo joint does not behave like the real one, and correct it."
HELP, HELP_ALL = ("--help", "-h"), "--help-all"


def overview(*, everything: bool) -> str:
    """Return the help of the program: its commands in the order of the loop.

    It is plain text, because the package that formats the help of a command takes longer to import than all this.
    """
    shown = {name for names in GROUPS.values() for name in names}
    rest = tuple(name for name in COMMANDS if name not in shown)
    width = max(map(len, COMMANDS)) + 2
    lines = [PURPOSE, "", "Usage: husky-sysid COMMAND [OPTIONS]"]
    for title, names in (GROUPS | ({"More": rest} if everything else {})).items():
        lines += ["", title, *(f"  {name:{width}}{COMMANDS[name].help}" for name in names)]
    lines.append("")
    if not everything:
        lines.append(f"More commands and options: husky-sysid {HELP_ALL}, husky-sysid COMMAND {HELP_ALL}")
    lines.append("Help of one: husky-sysid COMMAND --help. Also: --version, --install-completion.")
    return "\n".join([*lines, EXIT_CODES])


def epilogue(name: str) -> str:
    """Return the end of a command's help: examples, and where to read on."""
    command = COMMANDS[name]
    lines = "\n".join(f"husky-sysid {example}" for example in command.examples)
    more = f"All options: husky-sysid {name} {HELP_ALL}\n\n" if command.first else ""
    return f"Examples:\n\n```\n{lines}\n```\n\n{more}Read on: docs/{command.page}"


def build_app(*, everything: bool = False) -> "cyclopts.App":
    """Return the application; commands are named here and imported when called.

    Args:
        everything: Whether a command's help shows its rare options too.
    """
    from importlib.metadata import version

    import cyclopts
    from rich.console import Console

    from sysid.cli.first_screen import FirstScreen

    app = cyclopts.App(
        name="husky-sysid",
        help=f"{PURPOSE}\n\n{EXIT_CODES}",
        version=lambda: version("husky-sysid"),
        config=_require_finite,
        default_parameter=cyclopts.Parameter(negative=()),
        error_console=Console(stderr=True, soft_wrap=True, highlight=False),  # one line, as all errors
        error_formatter=lambda error: f"error: {one_line(str(error))}",
        suppress_keyboard_interrupt=False,
    )
    app.register_install_completion_command(
        help="Let the shell complete commands and options (bash, zsh, fish)."
    )
    for name in (*COMMANDS, *ALIASES):
        meant = ALIASES.get(name, name)
        command = COMMANDS[meant]
        more: dict[str, Any] = {} if command.has_parts else {"help_epilogue": epilogue(meant)}
        if command.first and not everything:
            more["help_formatter"] = FirstScreen(shown=command.first.split())
        home = meant.replace("-", "_")
        more |= {"help": command.help, "show": name not in ALIASES}
        app.command(f"sysid.cli.{home}:{home}", name=name, **more)
    return app


def _require_finite(_app: object, _commands: object, arguments: "cyclopts.ArgumentCollection") -> None:
    """Accept finite numbers only."""
    from cyclopts import ValidationError

    for argument in arguments:
        if "float" not in str(argument.hint):  # alone, in a tuple, or where it may be left out
            continue
        for token in argument.tokens:
            with contextlib.suppress(ValueError):  # other values are refused later
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
        words = sys.argv[1:]
        try:
            if not words or (len(words) == 1 and words[0] in (*HELP, HELP_ALL)):
                sys.stdout.write(overview(everything=words == [HELP_ALL]) + "\n")
            elif HELP_ALL in words:
                build_app(everything=True)([HELP[0] if word == HELP_ALL else word for word in words])
            else:
                build_app()(words)
        finally:
            sys.stdout.flush()
    except BaseException as error:
        _end(error)
        raise


def require_own_packages() -> None:
    """Check that the packages `sysid` and `reports` are those of this tool: other projects use these names too."""
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
    """Print in one line why a command ended, and exit; return after an unexpected error."""
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
    """Print one line for the user, and exit."""
    with contextlib.suppress(OSError):
        print(f"error: {one_line(message)}", file=sys.stderr, flush=True)  # noqa: T201
    raise SystemExit(code) from None
