"""`husky-sysid decay`: a log of a rocking board in, its stiffness and damping out."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from sysid.cli.console import Common, Printer
from sysid.cli.log_options import LogArguments, keep_logs, load_roll
from sysid.files import atomic_path, write_json

if TYPE_CHECKING:
    from sysid.free_decay import FreeDecay
    from sysid.quantity import Quantity
    from sysid.roll import Roll

_NO_ARGUMENTS = LogArguments()
_NO_COMMON = Common()

LABELS = {
    "log_decrement": "log decrement δ",
    "damping_ratio": "damping ratio ζ",
    "period": "period T",
    "omega_d": "damped frequency ω_d",
    "omega_n": "natural frequency ω_n",
    "inertia": "roll inertia I",
    "stiffness": "stiffness k = I ω_n²",
    "damping": "damping d = 2 ζ ω_n I",
}


def decay(
    log: Path,
    /,
    *,
    board: Annotated[str, Parameter(name=("--board", "-b"))],
    picture: bool = True,
    rerun: Annotated[Path | None, Parameter(name="--rerun")] = None,
    arguments: LogArguments = _NO_ARGUMENTS,
    common: Common = _NO_COMMON,
) -> int:
    """Identify the board's tilt joint from its free decays.

    Finds the releases in the log, fits a linear decay to all of them together, and prints logarithmic
    decrement, damping ratio, frequencies, stiffness and damping with 95 % intervals. Writes decay.json
    and decay.png into reports/BOARD of the workspace.

    Args:
        log: CSV, Parquet, MCAP, phone export (zip or folder) or video.
        board: Board that was recorded; its record gives the roll inertia.
        picture: Draw decay.png.
        rerun: Write a Rerun recording (.rrd) here.
        arguments: How the log is read.
        common: Options of every command.
    """
    from sysid.decay.plausibility import amplitude_warnings, period_warnings, record_warnings
    from sysid.free_decay import free_decay
    from sysid.releases import find_releases

    printer = Printer(common)
    keep_logs([log], arguments, printer, {"--rerun": rerun})
    record = common.space.load_board(board)
    roll = load_roll(log, arguments, printer)
    releases = find_releases(roll, start=arguments.start, stop=arguments.stop, releases=arguments.release)
    result = free_decay(releases, record.inertia)
    result = replace(
        result,
        warnings=(
            *amplitude_warnings(releases, record),
            *result.warnings,
            *period_warnings(result.numbers.omega_n.value, record, log=roll.log),
            *record_warnings(result.numbers, record, log=roll.log, linear=result.linear),
        ),
    )
    for warning in result.warnings:
        printer.warn(warning)
    _print(printer, board, roll, result)
    content = decay_json(board, roll, result)
    folder = common.space.outputs(board)
    write_json(folder / "decay.json", content)
    written = [folder / "decay.json"]
    if picture:
        from reports.figures.decay import decay_figure

        with atomic_path(folder / "decay.png") as temporary:
            decay_figure(roll, result, f"{board}: free decay in {log.name}").savefig(temporary, dpi=140)
        written.append(folder / "decay.png")
    if rerun is not None:
        from reports.page.summary import decay_summary
        from reports.rerun.decay import decay_recording

        decay_recording(rerun, roll, result, decay_summary(board, result))
        written.append(rerun)
    printer.say("written: " + ", ".join(str(path) for path in written))
    printer.result(content)
    return 0


def decay_json(board: str, roll: "Roll", result: "FreeDecay") -> dict[str, Any]:
    """Return the result file: SI, radians, each quantity with its interval."""
    from sysid.releases import log_phases

    return {
        "board": board,
        "log": roll.log,
        "releases": [
            {
                "number": release.number,
                "t_start_s": release.start,
                "t_end_s": float(release.time[-1]),
                "side": release.side,
                "amplitude_rad": release.amplitude,
                "hold_s": release.hold,
                "end": release.end,
                "rest_angle": rest.to_json(),
                "peaks": [
                    {"t_s": p.time, "angle_rad": p.roll, "half_cycle": p.number, "std_rad": p.std}
                    for p in peaks
                ],
            }
            for release, peaks, rest in zip(result.releases, result.peaks, result.rest_angles, strict=True)
        ],
        "phases": [
            {"t_start_s": phase.start, "t_end_s": phase.end, "kind": phase.kind}
            for phase in log_phases(roll, result.releases)
        ],
        **result.numbers.to_json(),
        "methods": {
            "whole_trace": {**result.numbers.to_json(), "signal": result.trace.signal},
            "peaks": None if result.from_line is None else result.from_line.to_json(),
            "two_peaks": None if result.two_peaks is None else {"log_decrement": result.two_peaks.to_json()},
        },
        "residual": {
            "rms": result.trace.noise,
            "noise_floor": result.floor.std,
            "correlation": result.trace.correlation,
            "intervals_widened": result.wider,
            "unit": "rad" if result.trace.signal == "roll" else "rad/s",
            "linear": result.linear,
        },
        "patterns": [{"effects": list(p.effects), "text": p.text} for p in result.nonlinearities],
        "notes": list(roll.notes),
        "warnings": [*roll.warnings, *result.warnings],
    }


def _print(printer: Printer, board: str, roll: "Roll", result: "FreeDecay") -> None:
    printer.say(
        f"{roll.log} · {len(roll.time)} samples · {roll.sampling_rate:.4g} Hz · {roll.time[-1] - roll.time[0]:.3g} s · {board}"
    )
    printer.table(
        ("release", "t [s]", "side", "first amplitude", "held before", "until", "end", "peaks"),
        [
            (
                str(release.number),
                f"{release.start:.3f}",
                release.side,
                f"{release.amplitude:.4f} rad ({_degrees(release.amplitude):.2f}°)",
                f"{release.hold:.2f} s" if release.hold else "moving",
                f"{release.time[-1]:.3f}",
                {"rest": "at rest", "caught": "caught", "log": "log ends"}[release.end],
                str(len(peaks)),
            )
            for release, peaks in zip(result.releases, result.peaks, strict=True)
        ],
    )
    value = "value ± 95 %" if result.linear else "value ± 95 % of a linear decay, which this is not"
    printer.table(("quantity", value, "unit", "how"), _rows(result))
    printer.say(equation(result))
    printer.say(_verdict(result))


def _rows(result: "FreeDecay") -> list[tuple[str, str, str, str]]:
    rows = [_row(LABELS[name], quantity) for name, quantity in result.numbers.items()]
    others = [] if result.line is None else [_row(LABELS["log_decrement"], result.line.log_decrement)]
    others += [] if result.two_peaks is None else [_row(LABELS["log_decrement"], result.two_peaks)]
    if result.line is None:
        others = [(LABELS["log_decrement"], "-", "1", "peaks: noise leaves no second one")]
    return [rows[0], *others, *rows[1:]]


def _row(name: str, quantity: "Quantity") -> tuple[str, str, str, str]:
    return name, quantity.number, quantity.printed_unit, quantity.method


def equation(result: "FreeDecay") -> str:
    """Return the identified law, as it would be written on a board."""
    numbers = result.numbers
    rest = sum(angle.value for angle in result.rest_angles) / len(result.rest_angles)
    roll = (
        "φ"
        if abs(rest) < 5e-4 or result.trace.signal == "rate"
        else f"(φ {'-' if rest > 0 else '+'} {abs(rest):.4f})"
    )
    terms = f"{_plain(numbers.inertia.value)}·φ̈ + {_plain(numbers.damping.value)}·φ̇"
    return f"{terms} + {numbers.stiffness.value:.4g}·{roll} = 0   (SI, rad)"


def _plain(value: float) -> str:
    """Print three digits, below a hundredth as 8.70e-3."""
    if abs(value) >= 0.01:
        return f"{value:.3g}"
    digits, _, power = f"{value:.2e}".partition("e")
    return f"{digits}e{int(power)}"


def _verdict(result: "FreeDecay") -> str:
    ratio = result.trace.noise / result.floor.std if result.floor.std > 0 else float("inf")
    if any(found.hidden_by_linear_fit for found in result.nonlinearities):
        levels = ", ".join(f"{_degrees(rest.value):+.2f}°" for rest in result.rest_angles[:6])
        return (
            f"✗ not a linear decay: it rests at {levels}, where a spring and a damper come back to one angle; k and d "
            "do not hold, run `husky-sysid diagnose`"
        )
    if not result.linear:
        return (
            f"✗ not a linear decay: the residual is {ratio:.3g} × the sensor noise; see the warnings, and run "
            "`husky-sysid diagnose`"
        )
    share = _inertia_share(result)
    closing = f"; {100 * share:.0f} % of k's variance comes from I" if share > 0.5 else ""
    wider = (
        f"; the intervals are {result.wider:.2g} × wider for it, as what follows the motion does not average out"
        if result.wider > 1.05
        else ""
    )
    if ratio > 1.15:
        size = max(float(abs(fitted.modelled - fitted.level).max()) for fitted in result.trace.releases)
        left = 100 * result.trace.noise / size
        return f"✓ linear decay but for {left:.2g} % of the amplitude ({ratio:.3g} × the sensor noise){wider}{closing}"
    return f"✓ linear decay: the residual is {ratio:.2f} × the sensor noise{closing}"


def _inertia_share(result: "FreeDecay") -> float:
    """Return which share of the variance of k the roll inertia brings in."""
    inertia, stiffness = result.numbers.inertia, result.numbers.stiffness
    if not (inertia.std > 0 and stiffness.std > 0):
        return 0.0
    return (inertia.std / inertia.value * stiffness.value / stiffness.std) ** 2


def _degrees(angle: float) -> float:
    return angle * 57.29577951308232
