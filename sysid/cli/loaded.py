"""`husky-sysid loaded`: the spring under load, from decays with weights on the deck."""

from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from sysid.cli.console import BoardName, Common, Printer, Texts
from sysid.cli.parameter_options import parse_or_read
from sysid.errors import SysidError
from sysid.quantity import parse_quantity

if TYPE_CHECKING:
    from sysid.experiments.loaded_decays import LoadedDecay


def loaded(
    *,
    board: BoardName,
    reading: Texts = (),
    rider: Annotated[float, Parameter(validator=Number(gt=0))] = 33.3,
    common: Common = Common(),
) -> None:
    """Measure the tilt spring under load, from decays of the deck with known weights on it.

    Args:
        board: The board; its roll inertia is used.
        reading: MASS,HEIGHT,OMEGA[,OWN] of one decay; may be repeated. Mass of the weight [kg]. Height of its centre above
            the tilt axis [m]. ω_n [rad/s] or the JSON of `decay`. Its own roll inertia [kg*m^2], 0 if left out.
            Quantities as 2.5±0.01, or with a unit as 10cm; '0,0,bare.json' is the bare deck.
        rider: Mass of the rider for the resulting stiffness [kg].
    """
    from sysid.experiments.loaded_decays import GRAVITY, loaded_stiffness

    printer = Printer(common)
    record = common.space.load_board(board)
    readings = [_read(text) for text in reading]
    found = loaded_stiffness(readings, record.inertia)
    ridden = found.under(rider * GRAVITY.value)
    rows = [(f"k under {r.mass.value:g} kg", k) for r, k in zip(readings, found.stiffness, strict=True)]
    rows += [
        ("k of the bare deck, by the line", found.bare),
        ("k that a newton adds", found.per_newton),
        (f"k under {rider:g} kg", ridden),
    ]
    printer.quantities(rows, f"{record.name}: the spring under load")
    low, high = found.per_newton.ci95
    if low <= 0 <= high:
        printer.say("the load does not change the spring significantly")
    if rider > 1.5 * max(r.mass.value for r in readings):
        printer.warn(f"{rider:g} kg is far more than the weights tried; the line is extrapolated.")
    printer.result(
        {
            "stiffness": found.stiffness,
            "bare": found.bare,
            "per_newton": found.per_newton,
            "rider_kg": rider,
            "under_rider": ridden,
            "chi_square": found.chi_square,
            "degrees_of_freedom": found.degrees_of_freedom,
        }
    )


def _read(text: str) -> "LoadedDecay":
    """Return one decay of '--reading MASS,HEIGHT,OMEGA[,OWN]'."""
    from sysid.experiments.loaded_decays import LoadedDecay

    where, fields = f"--reading {text}", text.split(",")
    if len(fields) not in (3, 4):
        raise SysidError(f"{where}: expected MASS,HEIGHT,OMEGA[,OWN], with commas between.")
    omega = parse_or_read(fields.pop(2), "omega_n", "rad/s", where)
    mass, height, own = (
        parse_quantity(field, unit, where, positive=False)
        for field, unit in zip([*fields, "0"][:3], ("kg", "m", "kg*m^2"), strict=True)
    )
    if min(mass.value, height.value, own.value) < 0:
        raise SysidError(f"{where}: mass, height and inertia must not be negative.")
    return LoadedDecay(mass=mass, height=height, own=own, natural_frequency=omega)
