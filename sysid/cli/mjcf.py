"""`husky-sysid mjcf`: a board as an MJCF or USD file."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

from sysid.cli.console import BoardName, Common, Coupling, Output, Printer, Step
from sysid.files import refuse_other_kind, write_atomically

if TYPE_CHECKING:
    from sim.mjcf import Mjcf


def mjcf(
    *,
    board: BoardName,
    output: Output,
    bench: bool = False,
    timestep: Step = 0.005,
    export: Literal["physical", "step-compensated", "in-scene"] | None = None,
    coupling: Coupling = "equality",
    usd: bool = False,
    common: Common = Common(),
) -> None:
    """Write a board as MJCF: the free board with trucks and wheels on the ground.

    Args:
        board: Name of the board.
        output: File to write: .xml, or .usd, .usda or .usdc.
        bench: Write the clamped free-decay rig instead: the deck on its tilt joint.
        timestep: Step in s for the file.
        export: 'physical' writes the record's numbers, 'step-compensated' those with the right decay at this step, 'in-scene'
            those with the right decay with wheels and coupling too. By default in-scene for a scene; for a bench physical
            up to 1 ms and step-compensated above.
        coupling: Steering of the trucks by tilt: a joint equality, or set from outside after each step.
        usd: Convert to OpenUSD (extra usd); refused if USD would drop an effect.
    """
    from sim.mjcf import board_mjcf
    from sysid.cli.bars import working

    suffixes, write = (".xml",), write_atomically
    if usd:
        from sim.usd import SUFFIXES as suffixes
        from sim.usd import write_usd as write
    refuse_other_kind(output, *suffixes)
    printer = Printer(common)
    record = common.space.load_board(board)
    kind = "bench" if bench else "scene"
    if not bench:
        record.need("the scene of the whole board (not --bench, the deck on its joint)")
    with working(printer, "compensating the step"):
        made = board_mjcf(record, kind, timestep=timestep, export=export, coupling=coupling)
    write(output, made.xml)
    printer.say(f"{output}: {kind} of board {board}, {made.export}")
    for line in made.compensation.lines():
        printer.say(f"  {line}")
    for line in _warnings(made, kind, coupling):
        printer.warn(line)
    printer.result({"board": board, "file": output, "kind": kind, **made.to_json()})


def _warnings(made: "Mjcf", kind: str, coupling: str) -> Iterator[str]:
    """Yield the causes of a decay's error, with the remedy."""
    from sysid.fitting.result import TOLERANCE

    error = f"{100 * made.compensation.decay_error:.1f} % off the board's"
    for line in made.substitutes:
        yield f"{line}. The unloaded decay of this file is {error}."
    if made.substitutes or made.compensation.decay_error <= TOLERANCE:
        return
    if made.export == "physical":
        other = "in-scene" if kind == "scene" else "step-compensated"
        why = f"It has the record's numbers unchanged; --export {other} compensates them."
    elif kind == "scene" and coupling == "equality":
        why = (
            "The joint equality drags the wheels over the ground, which damps more than this lightly damped joint. Choose --coupling "
            "direct, which sets the trucks after each step."
        )
    else:
        why = "Choose a smaller --timestep."
    yield f"the unloaded decay of this {kind} is {error}. {why}"
