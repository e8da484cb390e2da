"""The command line: `husky-sysid COMMAND`.

Each command is one file beside this one and is imported only when it is called, so that
`husky-sysid --help` answers at once.
"""

import sys
from typing import TYPE_CHECKING

from sysid.errors import HuskyError

if TYPE_CHECKING:
    import cyclopts

EXIT_CODES = """Exit codes: 0 good; 1 input or computation failed; 2 usage; 3 the quality gate said no."""

COMMANDS = {
    "decay": "Roll log in; log decrement, damping ratio, natural frequency, k and d out.",
    "roll": "Extract the roll angle of any log or video into a CSV file.",
    "fit": "Fit the MuJoCo tilt joint to logs and save it in the board record.",
    "compare": "Compare the simulated with the measured decay: how far off, and where.",
    "diagnose": "Rank the physical effects that the model is missing.",
    "check": "The gate: does the training scene decay like the board? Exit 0 or 3.",
    "mjcf": "Write the board as MJCF.",
    "inertia": "Roll inertia from dimensions, parts, swings, weights or two decays.",
    "boards": "List boards, their parameters and whether they passed the check.",
    "synth": "Make a synthetic log with a known truth.",
    "report": "Write one self-contained HTML file with everything known of a board.",
    "marker": "Print a page with markers for films, and how to fix and film them.",
    "view": "Show logs and model of a board in Rerun.",
    "motions": "List, plot and play reference motions.",
    "train": "Train a policy for a board.",
    "evaluate": "Measure a policy: success, velocity, heading, smoothness, contacts.",
    "play": "Show a policy in Rerun or in the MuJoCo viewer.",
    "export": "Pack scene, policy and board record into one folder that runs by itself.",
    "run": "Run a policy in real time, in MuJoCo or on the robot.",
}
"""Every command and its one-line help."""


def build_app() -> "cyclopts.App":
    """Return the application; commands are named here and imported when called."""
    from importlib.metadata import version

    import cyclopts

    app = cyclopts.App(
        name="husky-sysid",
        help=f"Find out why a MuJoCo joint does not behave like the real one, and mend it.\n\n{EXIT_CODES}",
        version=lambda: version("husky-sysid"),
    )
    for name, help_text in COMMANDS.items():
        app.command(f"sysid.cli.{name}:{name}", name=name, help=help_text)
    return app


def main() -> None:
    """Run the command line and exit with its code."""
    try:
        build_app()()
    except HuskyError as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201  the one line a user sees
        raise SystemExit(error.exit_code) from None
    except BrokenPipeError:  # the reader (head, less) has gone
        raise SystemExit(0) from None
    except KeyboardInterrupt:
        print("error: interrupted; no file is left half-written", file=sys.stderr)  # noqa: T201
        raise SystemExit(130) from None
