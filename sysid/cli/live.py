"""`husky-sysid live`: numbers while the board still rocks."""

import time
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

from sysid.cli.console import Printer
from sysid.cli.log_options import LogArguments, recording_of
from sysid.cli.measurement import Measurement
from sysid.decay.report import verdict
from sysid.errors import SysidError
from sysid.live.phyphox import Phone
from sysid.live.rest import Rest
from sysid.live.session import Session
from sysid.logs import read_roll
from sysid.recording import Recording
from sysid.roll import Release
from sysid.text import display
from sysid.workspace import shipped_data

POLL_PERIOD = 0.2
"""Time between two requests to the phone [s]."""
LOSSES = 5
"""Missing answers of the phone in a row after which the command ends."""


def live(
    *,
    measurement: Measurement = Measurement(),
    phone: str,
    releases: Annotated[int | None, Parameter(validator=validators.Number(gte=1))] = None,
) -> None:
    """Read a phone while the board rocks, and show stiffness and damping after each release.

    Args:
        phone: Address in phyphox, such as 192.168.0.42:8080.
        releases: End after so many.
    """
    printer, space, reading = Printer(measurement.common), measurement.space, measurement.reading
    record = measurement.load(printer)
    log = space.root / "logs" / f"{record.name}-{datetime.now():%Y%m%d-%H%M%S}"
    session, client, rest, lost = Session(record), Phone(phone, log), Rest(), 0
    # Once on a shipped log, to load all code before the first release.
    Session(record).take([Recording.read(shipped_data() / "decays" / "pink_imu.csv")])
    client.connect()
    printer.say(session.next_step)
    try:
        while releases is None or len(session.releases) < releases:
            begin = time.monotonic()
            try:
                rows, lost = client.poll(), 0
            except SysidError as error:
                lost += 1
                if lost >= LOSSES:
                    raise SysidError(f"{error} The log until then is kept in {log}.") from error
                printer.warn("the phone did not answer; trying again")
            else:
                if rest.has_come(rows) and (new := session.take(_recordings(log, reading))):
                    _say(session, new, printer)
            time.sleep(max(0.0, POLL_PERIOD - (time.monotonic() - begin)))
    except KeyboardInterrupt:
        printer.note("ended")
    numbers = {} if session.decay is None else session.decay.to_json()
    first, then = (space.command(name, *record.options, logs=[log]) for name in ("fit", "diagnose"))
    printer.say(f"kept: {log}\nnext: {first}\nthen: {then}")
    printer.result(
        {**numbers, "log": str(log), "releases_found": len(session.releases), "next": session.next_step}
    )


def _say(session: Session, new: Mapping[int, Release], printer: Printer) -> None:
    """Print a line for each new release; the last one has the numbers of all so far."""
    show = display(is_rate=False, slides=session.board.slides)
    *others, where = (f"release {n}: {show(r.amplitude, 2)} from the {r.side}" for n, r in new.items())
    for line in others:
        printer.say(line)
    if session.trouble or session.decay is None:
        printer.warn(f"{where}: {session.trouble}")
    else:
        numbers = session.decay.numbers
        printer.say(f"{where}   k = {numbers.stiffness}   d = {numbers.damping}   {verdict(session.decay)}")
    printer.say(f"  {session.next_step}")


def _recordings(folder: Path, arguments: LogArguments) -> list[Recording]:
    """Return the log so far, if it has a release."""
    try:
        return [recording_of(read_roll(folder, arguments.options), arguments)]
    except SysidError:
        return []
