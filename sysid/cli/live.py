"""`husky-sysid live`: numbers while the board still rocks."""

import time
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

from sysid.cli.console import Printer
from sysid.cli.log_options import LogArguments, recording_of
from sysid.cli.measurement import Measurement
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
"""Time between two requests to the phone, or two scans of the folder [s]."""
LOSSES = 5
"""Missing answers of the phone in a row after which the command ends."""


def live(
    *,
    measurement: Measurement = Measurement(),
    phone: str | None = None,
    watch: Path | None = None,
    releases: Annotated[int | None, Parameter(validator=validators.Number(gte=1))] = None,
) -> None:
    """Read a phone while the board rocks, and show stiffness and damping after each release.

    Args:
        phone: Address in phyphox, such as 192.168.0.42:8080.
        watch: Instead of a phone: a folder in which logs appear.
        releases: End after so many.
    """
    printer, space, reading = Printer(measurement.common), measurement.space, measurement.reading
    record = measurement.load(printer)
    if (phone is None) == (watch is None):
        raise SysidError(
            "live reads a phone or a folder: give --phone ADDRESS or --watch FOLDER, one of them."
        )
    stamp = f"{datetime.now():%Y%m%d-%H%M%S}"
    log = watch if watch is not None else space.root / "logs" / f"{record.name}-{stamp}"
    session = Session(record, grows=phone is not None)
    # Once on a shipped log, to load all code before the first release.
    Session(record).take([Recording.read(shipped_data() / "decays" / "pink_imu.csv")])
    look = (
        _watching(watch, reading, printer)
        if watch is not None
        else _phoning(str(phone), log, reading, printer)
    )
    printer.say(session.next_step)
    try:
        while releases is None or len(session.releases) < releases:
            begin = time.monotonic()
            found = look()
            if found is not None and (new := session.take(found)):
                _say(session, new, printer)
            time.sleep(max(0.0, POLL_PERIOD - (time.monotonic() - begin)))
    except KeyboardInterrupt:
        printer.note("ended")
    numbers = {} if session.decay is None else session.decay.to_json()
    logs = [log] if phone is not None else dict.fromkeys(release.log for release in session.releases)
    first, then = (space.command(name, *record.options, logs=logs) for name in ("fit", "diagnose"))
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
    if session.trouble or not session.history:
        printer.warn(f"{where}: {session.trouble}")
    else:
        numbers = session.history[-1]
        printer.say(f"{where}   k = {numbers.stiffness}   d = {numbers.damping}   {numbers.verdict}")
    printer.say(f"  {session.next_step}")


def _phoning(
    address: str, folder: Path, arguments: LogArguments, printer: Printer
) -> Callable[[], list[Recording] | None]:
    """Return a function that polls a phone, and reads its log when the deck has come to rest."""
    phone = Phone(address, folder)
    phone.connect()
    rest = Rest()
    owed = 0

    def look() -> list[Recording] | None:
        nonlocal owed
        try:
            rows = phone.poll()
        except SysidError as error:
            owed += 1
            if owed >= LOSSES:
                raise SysidError(f"{error} The log until then is kept in {folder}.") from error
            printer.warn("the phone did not answer; trying again")
            return None
        owed = 0
        if not rest.has_come(rows):
            return None
        try:
            return [recording_of(read_roll(folder, arguments.options), arguments)]
        except SysidError:  # no release yet
            return None

    return look


def _watching(
    folder: Path, arguments: LogArguments, printer: Printer
) -> Callable[[], list[Recording] | None]:
    """Return a function that reads new files of a folder when they have stopped growing, and reports bad ones."""
    if not folder.is_dir():
        raise SysidError(f"--watch {folder}: there is no such folder.")
    sizes: dict[Path, int] = {}
    read: dict[Path, Recording | None] = {}

    def look() -> list[Recording] | None:
        new = False
        for path in sorted(folder.iterdir()):
            if path.name.startswith(".") or not path.is_file() or path in read:
                continue
            size = path.stat().st_size
            if size and sizes.get(path) == size:
                try:
                    read[path] = recording_of(read_roll(path, arguments.options), arguments)
                    new = True
                except SysidError as error:  # no log, or none with a release in it
                    read[path] = None
                    printer.warn(f"left out: {error}")
            sizes[path] = size
        return [recording for recording in read.values() if recording is not None] if new else None

    return look
