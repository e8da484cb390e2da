"""`husky-sysid roll`: the roll angle of any log or film, as a plain table."""

import shlex
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from sysid.cli.console import Common, Output, Printer
from sysid.cli.log_options import LogArguments, load_roll, refuse_overwriting_logs
from sysid.errors import SysidError
from sysid.files import atomic_path
from sysid.quantity import Quantity
from sysid.roll import Roll
from sysid.text import display
from sysid.video.options import is_film


def roll(
    log: Path,
    /,
    *,
    output: Output,
    align: Path | None = None,
    preview: bool = False,
    arguments: LogArguments = LogArguments(),
    common: Common = Common(),
) -> None:
    """Extract the roll angle of any log or video into a CSV file.

    Args:
        log: CSV, Parquet, MCAP, phone export (zip or folder) or video.
        output: CSV file to write: time_s, roll_rad, roll_std_rad.
        align: Another record of the same motion (film or log): times become those of its clock.
        preview: Only show the tracked target of a film, and let the user draw the region of the board.
    """
    printer = Printer(common)
    overlay = arguments.video.overlay
    if overlay is not None and overlay.resolve() == output.resolve():
        raise SysidError(f"--overlay {overlay}: --output is the same file. Give each its own name.")
    refuse_overwriting_logs(
        [log, *([] if align is None else [align])], arguments, printer, {"--output": output}
    )
    if preview:
        _preview(log, output, arguments, printer)
        return
    signal = load_roll(log, arguments, printer)
    offset = None if align is None else _offset(log, signal, align, printer)
    if offset is not None:
        signal = replace(signal, time=signal.time + offset.value)
    part = arguments.part(signal)
    _write(part, output)
    show = display(is_rate=False, slides=part.slides)
    low, high, noise = part.roll.min(), part.roll.max(), float(np.median(part.std))
    printer.say(
        f"{output}: {len(part.time)} rows, {signal.sampling_rate:.4g} Hz, roll {show(low)} to {show(high)}, "
        f"noise {show(noise, 2)}"
    )
    if part.errors_last:
        printer.note(
            "errors of a film are correlated from frame to frame, which a table cannot store: give `decay` and `fit` the film itself"
        )
    printer.result(
        {
            "log": log,
            "output": output,
            "rows": len(part.time),
            "clock_offset": offset,
            "rate_hz": signal.sampling_rate,
            "origin": part.origin,
            "notes": part.notes,
            "warnings": part.warnings,
        }
    )


def _offset(log: Path, signal: Roll, other: Path, printer: Printer) -> Quantity:
    """Return the time that is added to those of a log, to have the clock of another of the same motion."""
    from sysid.logs.clock_offset import clock_offset

    offset = clock_offset(load_roll(other, LogArguments(), printer), signal)
    printer.note(f"{log}: {offset} added to its times, which then are those of {other}")
    half = (offset.ci95[1] - offset.ci95[0]) / 2
    if half > 1 / signal.sampling_rate:
        printer.warn(
            f"the offset is known to ± {1e3 * half:.2g} ms, more than a sample: do both records show the same release?"
        )
    return offset


def _write(roll: Roll, output: Path) -> None:
    import pandas as pd

    table = pd.DataFrame({"time_s": roll.time, "roll_rad": roll.roll, "roll_std_rad": roll.std})
    with atomic_path(output) as temporary:
        table.to_csv(temporary, index=False, float_format="%.9g")


def _preview(log: Path, output: Path, arguments: LogArguments, printer: Printer) -> None:
    """Write the page beside the output, and open it if there is a display."""
    if not is_film(log):
        raise SysidError(f"--preview: {log} is no film. Leave it out.")
    import webbrowser
    from contextlib import closing

    from sysid.video.film.camera import lens_of
    from sysid.video.film.frames import open_clip
    from sysid.video.film.reel import Reel
    from sysid.video.preview import write_preview

    options = replace(arguments.video.options, rate=arguments.rate)
    clip, page = open_clip(log), output.with_suffix(".html")
    typed = [word for word in sys.argv[1:] if word != "--preview"]
    if "--roi" in typed:  # with its four numbers: the page draws another one
        place = typed.index("--roi")
        del typed[place : place + 5]
    command = shlex.join(["husky-sysid", *typed])
    with closing(Reel(clip, lens_of(clip, options.calibration), options)) as reel:
        what = write_preview(reel, command, page)
    shown = printer.common.json is None and webbrowser.open(page.absolute().as_uri())
    printer.say(f"{page if shown else page.with_suffix('.png')}: {what}")
    printer.result({"log": log, "page": page, "picture": page.with_suffix(".png"), "what": what})
