"""`husky-sysid mjcf`: a board as an MJCF or USD file."""

from typing import TYPE_CHECKING, Literal

from sysid.cli.console import BoardName, Common, Flag, Output, Printer
from sysid.errors import SysidError
from sysid.files import refuse_other_kind, write_atomically

if TYPE_CHECKING:
    from sim.mjcf import Mjcf

WARNING_NRMSE, MAX_NRMSE = 0.02, 0.1
"""Largest NRMSE of the unloaded decay without a warning, as in `check`, and largest one that is written [1]."""


def mjcf(
    *,
    board: BoardName,
    output: Output,
    bench: Flag = False,
    scene: Flag = False,
    timestep: float = 0.005,
    integrator: str = "implicitfast",
    export: Literal["physical", "step-compensated", "in-scene"] | None = None,
    coupling: Literal["equality", "direct"] = "equality",
    usd: Flag = False,
    common: Common = Common(),
) -> int:
    """Write a board as MJCF.

    Args:
        board: Name of the board.
        output: File to write: .xml, or .usd, .usda or .usdc.
        bench: The clamped free-decay rig: the deck on its tilt joint.
        scene: The free board with trucks and wheels on the ground; this is the default.
        timestep: Step in s for the file.
        integrator: MuJoCo integrator for the file.
        export: 'physical' writes the record's numbers, 'step-compensated' those with the right decay at this step, 'in-scene'
            those with the right decay with wheels and coupling too. By default in-scene for a scene; for a bench physical
            up to 1 ms and step-compensated above.
        coupling: Steering of the trucks by tilt: a joint equality, or set from outside after each step.
        usd: Convert to OpenUSD (extra usd); refused if USD would drop an effect.
    """
    from sim.mjcf import board_mjcf
    from sysid.cli.bars import working
    from sysid.progress import stage

    if bench and scene:
        raise SysidError("--bench and --scene exclude each other.")
    if not 0 < timestep <= 0.05:
        raise SysidError(f"--timestep {timestep:g}: expected seconds between 0 and 0.05, such as 0.005.")
    if usd:
        from sim.usd import SUFFIXES

        refuse_other_kind(output, *SUFFIXES)
    else:
        refuse_other_kind(output, ".xml")
    printer = Printer(common)
    record = common.space.load_board(board)
    kind = "bench" if bench else "scene"
    if kind == "scene":
        record.need("the scene of the whole board (not --bench, the deck on its joint)")
    with working(printer), stage(0.0, 1.0, "compensating the step"):
        made = board_mjcf(
            record, kind, timestep=timestep, integrator=integrator, export=export, coupling=coupling
        )
    done = made.compensation
    error = f"the unloaded decay of this {kind} is {100 * done.decay_error:.1f} % off the board's"
    why = _why(made, kind, coupling)
    if done.decay_error > MAX_NRMSE and made.export != "physical":
        raise SysidError(f"{output}: not written: {error}. {why} --export physical writes it all the same.")
    if usd:
        from sim.usd import write_usd

        write_usd(made.xml, output)
    else:
        write_atomically(output, made.xml)
    printer.say(f"{output}: {kind} of board {board}, {made.export}")
    for line in done.lines():
        printer.say(f"  {line}")
    for line in made.substitutes:
        printer.warn(f"{line}. The unloaded decay of this file is off by {100 * done.decay_error:.1f} %.")
    if done.decay_error > WARNING_NRMSE and not made.substitutes:
        printer.warn(f"{error}. {why}")
    printer.result(
        {
            "board": board,
            "file": str(output),
            "kind": kind,
            "export": made.export,
            "substitutes": list(made.substitutes),
            "timestep_s": done.timestep,
            "integrator": done.integrator,
            "written": {
                "stiffness_nm_rad": done.board.stiffness,
                "damping_nms_rad": done.board.damping,
                "inertia_kgm2": done.board.inertia.value,
            },
            "decay_nrmse": done.decay_error,
            "decay_nrmse_uncompensated": done.decay_error_before,
            "static_stiffness_error": done.static_error,
        }
    )
    return 0


def _why(made: "Mjcf", kind: str, coupling: str) -> str:
    """Return the cause of a decay's error, and the remedy."""
    done = made.compensation
    said = [f"{line[0].upper()}{line[1:]}." for line in made.substitutes]
    # The error of a left-out part is separate from that of the step; the error of a substitute is not.
    if said and (len(said) > len(done.left_out) or done.step_error < WARNING_NRMSE):
        return " ".join(said)
    if made.export == "physical":
        other = "in-scene" if kind == "scene" else "step-compensated"
        said.append(f"It has the record's numbers unchanged; --export {other} compensates them.")
    elif kind == "scene" and coupling == "equality":
        said.append(
            "The joint equality drags the wheels over the ground, which damps more than this lightly damped joint. Choose --coupling "
            "direct, which sets the trucks after each step."
        )
    else:
        said.append(f"Choose a smaller --timestep{' for the rest' if said else ''}.")
    return " ".join(said)
